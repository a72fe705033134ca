"""Evaluate the constraints on a = u̇² and its derivatives, with their derivatives (see `constraints`).

All functions accept NumPy and JAX arrays, except `second_derivatives`, which needs NumPy arrays.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.timing import road
from qtraj.design.timing.constraints import POWERS, UPPER, Constraints, Parts
from qtraj.design.timing.road import ROAD
from qtraj.foundation.namespace import namespace

Gradients = Float[Any, "count orders *nodes"]
"""For each constraint, the derivatives with respect to a = u̇², a' and, with a limit on the jerk, a''."""


def tightened(c: Constraints, factors: Float[Any, "count *nodes"]) -> Constraints:
    """Return the same constraints with their limits divided by `factors`."""
    own = None if c.road is None else road.tightened(c.road, factors[c.before_road :])
    forms = factors[1 : 1 + len(c.forms), None, None] ** 2
    own_sides = factors[1 + len(c.forms) : c.before_combined]
    sides, bends, combined = own_sides[:, None], c.bends, c.combined
    bends = None if bends is None else bends.scaled(own_sides)
    if combined is not None:
        combined = combined._replace(factor=combined.factor * factors[c.before_combined])
    jerk = None if c.jerk is None else c.jerk * factors[c.before_jerk : c.before_formulas, None, None] ** 2
    formulas = None if c.formulas is None else c.formulas.tightened(factors[c.before_formulas : c.before_road])
    return Constraints(c.upper * factors[0], c.forms * forms, c.sides * sides, jerk, own, bends, combined, formulas)


def squares(p: Parts) -> np.ndarray:
    """Return the power of a factor with which each constraint is multiplied if its limit is divided by the factor."""
    quadratic = (p.combined is not None) + (0 if p.jerk is None else len(p.jerk))
    formulas = [] if p.formulas is None else p.formulas.powers.tolist()
    road = [] if p.road is None else [1.0] * len(ROAD)
    return np.array([1.0] + [2.0] * len(p.forms) + [1.0] * len(p.sides) + [2.0] * quadratic + formulas + road)


def used(p: Parts, v: Float[Any, "orders *nodes"]) -> Float[Any, "limits *nodes"]:
    """Return each quantity divided by its limit in the order of `NAMES`, or a divided by its bound for `UPPER`.

    `v` contains a = u̇² and its derivatives with respect to the path parameter.
    """
    xp = namespace(v, p.upper)
    on_road = [] if p.road is None else road.used(p.road, v)
    upper = p.upper * xp.maximum(v[0], 0.0)[None]
    forms, *jerk = (xp.sqrt(xp.maximum(x, 0.0)) for x in _squares(p, v))
    combined = [] if p.combined is None else [p.combined.used(v)[None]]
    formulas = [] if p.formulas is None else [p.formulas.used(v)]
    return xp.concatenate([upper, forms, _of_sides(p, v), *combined, *jerk, *formulas, *(x[None] for x in on_road)])


def ratios(found: Float[Any, "limits *nodes"], rows: tuple[str, ...]) -> Float[Any, "limits *nodes"]:
    """Convert the result of `used` to ratios of quantities to their limits; `rows` are the names of its rows."""
    linear = [name in UPPER and POWERS[name] < 1 for name in rows]
    xp = namespace(found)
    return xp.stack([xp.sign(x) * xp.sqrt(abs(x)) if root else x for x, root in zip(found, linear, strict=True)])


class Products(NamedTuple):
    """The products of the matrices of the forms, and of those of the jerk, with v; both occur in several functions."""

    forms: Float[Any, "forms 2 *nodes"]
    jerk: Float[Any, "jerks 3 *nodes"] | None


def products(c: Constraints | Parts, v: Float[Any, "orders *nodes"]) -> Products:
    """Return the products of the matrices with v."""
    xp = namespace(v, c.upper)
    return Products(_products(xp, c.forms, v), None if c.jerk is None else _products(xp, c.jerk, v))


def values(c: Constraints, v: Float[Any, "orders *nodes"], p: Products | None = None) -> Float[Any, "count *nodes"]:
    """Return the constraint values, which must not be positive; `p` are the `products` if they are known."""
    on_road = [] if c.road is None else [x[None] for x in road.values(c.road, v)]
    upper, (forms, *jerk) = (c.upper * v[0])[None], _squares(c, v, p)
    sides = [_of_sides(c, v)] if len(c.sides) else []
    combined = [] if c.combined is None else [1 + c.combined.value(v)[None]]
    found = namespace(v, c.upper).concatenate([upper, forms, *sides, *combined, *jerk])
    found -= 1
    others = [*([] if c.formulas is None else [c.formulas.values(v)]), *on_road]
    return namespace(v, c.upper).concatenate([found, *others]) if others else found


def gradients(c: Constraints, v: Float[Any, "orders *nodes"], p: Products | None = None) -> Gradients:
    """Return the gradients of `values` with respect to the components of v = (a, a', a''), where a = u̇²."""
    xp = namespace(v, c.upper)
    forms, jerk = products(c, v) if p is None else p
    shape = np.broadcast_shapes(v.shape[1:], c.upper.shape)
    zero = xp.zeros((1, *shape), v.dtype)
    rows = [xp.broadcast_to(c.upper, shape)[None], *[zero] * (c.orders - 1)]
    rest = [zero] * (c.orders - 2)
    for x in forms:
        rows += [2 * x, *rest]
    bends = [0.0] * len(c.sides) if c.bends is None else c.bends.values(v[0])[1]
    for own, bend in zip(c.sides, bends, strict=True):
        slope = own[1] + bend
        rows += [xp.broadcast_to(xp.stack([slope, own[2]]), (2, *shape)), *rest]
    if c.combined is not None:
        rows += [xp.stack(c.combined.gradient(v)), *rest]
    for x in () if jerk is None else jerk:
        own = 2 * v[0][None] * x
        rows += [own[:1] + xp.einsum("i...,i...->...", x, v)[None], own[1:]]
    if c.formulas is not None:
        own = c.formulas.gradients(v)
        for x in own:
            rows += [x, *[zero] * (c.orders - own.shape[1])]
    if c.road is not None:
        for x in road.gradients(c.road, v):
            rows += [xp.stack(x), *rest]
    return xp.concatenate(rows).reshape(-1, c.orders, *shape)


def second_derivatives(
    c: Constraints,
    slope: Gradients,
    v: Float[Any, "orders *nodes"],
    multipliers: Float[Any, "count *nodes"],
    ratio: Float[Any, "count *nodes"],
    a: Float[Any, "*nodes"],
    p: Products | None = None,
) -> Float[Any, "entries *nodes"]:
    """Return Σ multiplier·(second derivatives) + ratio·gradient·gradientᵀ; `a` > 0, and `slope` are the gradients.

    The derivatives are with respect to v = (a, a', a''), where a = u̇²; the entries are those of the lower triangles of
    symmetric matrices, row by row. The jerk constraint is |y|² ≤ 1, y = √a·w, with w linear in v. Replacing 1/√a by its
    tangent leaves the second derivatives 2YᵀY, where Y is the Jacobian of y.
    """
    pairs, count = list(zip(*np.tril_indices(c.orders), strict=True)), len(c.forms)
    found: Any = np.empty((len(pairs), *v.shape[1:]))
    scaled = ratio[1:, None] * slope[1:]  # the first constraint depends on a only
    for own, (i, j) in zip(found, pairs, strict=True):
        np.einsum("c...,c...->...", scaled[:, i], slope[1:, j], out=own)
    found[0] += ratio[0] * slope[0, 0] ** 2
    if c.bends is not None:
        rows = multipliers[1 + count : c.before_combined]
        found[0] += np.sum(rows * np.maximum(c.bends.values(v[0])[2], 0.0), axis=0)
    if c.combined is not None:
        found[:3] += multipliers[c.before_combined] * np.stack(c.combined.second(v))
    for twice, form in zip(2 * multipliers[1 : 1 + count], c.forms, strict=True):
        for own, (i, j) in zip(found, pairs[:3], strict=False):
            own += twice * form[i, j]
    if c.jerk is not None:
        last = multipliers[c.before_jerk : c.before_formulas]
        known: Any = (products(c, v) if p is None else p).jerk
        slopes = np.einsum("k...,ki...->i...", last, known)
        for own, (i, j) in zip(found, pairs, strict=True):
            own += np.einsum("k...,k...->...", 2 * last * v[0][None], c.jerk[:, i, j])
            if j == 0:
                own += slopes[i] if i else 2 * slopes[0] + np.einsum("i...,i...->...", slopes, v) / (2 * a)
    if c.formulas is not None:
        more = c.formulas.second_derivatives(v, multipliers[c.before_formulas : c.before_road])
        for own, (i, j) in zip(found, pairs, strict=True):
            own += more[i, j] if i < len(more) else 0.0
    if c.road is not None:
        found[:3] += np.stack(road.second_derivatives(c.road, multipliers[c.before_road :]))
    return found


def changes(slope: Gradients, dv: Float[Any, "orders *nodes"]) -> Float[Any, "count *nodes"]:
    """Return the changes of the linearised constraint values for the changes `dv` of a and its derivatives."""
    return namespace(slope, dv).einsum("ci...,i...->c...", slope, dv)


def weighted(slope: Gradients, weights: Float[Any, "count *nodes"]) -> Float[Any, "orders *nodes"]:
    """Return the weighted sums of the gradients."""
    return namespace(slope, weights).einsum("ci...,c...->i...", slope, weights)


def _squares(
    c: Constraints | Parts, v: Float[Any, "orders *nodes"], p: Products | None = None
) -> list[Float[Any, "some *nodes"]]:
    """Return the squares of the quantities of the forms, divided by their limits, and that of the jerk."""
    xp = namespace(v, c.upper)
    of_forms, of_jerk = products(c, v) if p is None else p
    forms = xp.einsum("fi...,i...->f...", of_forms, v[:2])
    return [forms] if of_jerk is None else [forms, v[0][None] * xp.einsum("ki...,i...->k...", of_jerk, v)]


def _of_sides(c: Constraints | Parts, v: Float[Any, "orders *nodes"]) -> Float[Any, "sides *nodes"]:
    """Return the functions of the limits on one side."""
    affine = c.sides[:, 0] + c.sides[:, 1] * v[0][None] + c.sides[:, 2] * v[1][None]
    return affine if c.bends is None else affine + c.bends.values(v[0])[0]


def _products(xp: Any, forms: Float[Any, "forms n n *nodes"], v: Any) -> Float[Any, "forms n *nodes"]:
    return xp.einsum("fij...,j...->fi...", forms, v[: forms.shape[1]])
