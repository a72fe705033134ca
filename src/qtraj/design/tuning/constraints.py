"""The limits as constraints on a path: values at many places of many searches, with their derivatives.

A constraint is g(z, u) = ½((value/limit)² − 1) ≤ 0 at the fraction u of the duration. In unit time the duration T only
scales the limit: (value/limit)² = κ·G with κ = T^−2p/limit², p being the power of 1/s in the quantity's unit. G is a
function of a few invariants, and these are scalar products of r', r'', …, c = r'×r'' and c' = r'×r''', called blocks.

Which limit is meant is a number that all searches of a batch share, so that each limit's formula is compiled once, and
only the limits that are present are worked out.
"""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import monomials
from qtraj.design.tuning.curves import Changes, Curves, along_u, angle_at, unpacked
from qtraj.design.tuning.monomials import Table
from qtraj.foundation.types import Scalar
from qtraj.path.components import Triple, cross, times, total
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import QUANTITIES, PathQuantity

Places = Float[Array, " places"]


class Setting(NamedTuple):
    """A path in unit time, ln T, and the rotation from the axes of its placement to the world's."""

    curves: Curves
    log_duration: Scalar
    axes: Float[Array, "3 3"]


class Expansion(NamedTuple):
    """Of g at many places: value, derivatives in the variables, and in u."""

    value: Places
    slope: Float[Array, "n places"]
    curvature: Float[Array, "n n places"]
    mixed: Float[Array, "n places"]  # ∂²g/∂z∂u
    rate: Places  # ∂g/∂u
    bend: Places  # ∂²g/∂u²


class Group(NamedTuple):
    """Quantities that are formed from the same invariants.

    `products` gives each invariant as a scalar product of two blocks, by their names, or of one block and the vertical.
    """

    order: int
    members: tuple[Callable[[Any], Any], ...]
    products: dict[str, tuple[str, str]]
    table: Table
    upright: bool = False

    @property
    def crossed(self) -> dict[str, int]:
        """The blocks that are cross products of r' with another derivative, and the place of that one."""
        used = {name for pair in self.products.values() for name in pair}
        return {name: k for name, k in (("c", 1), ("c1", 2)) if name in used}


LEVEL = ("H", "G")
"""Invariants of the horizontal parts."""


def _slowness(i: Any) -> Any:
    return -1 * i.S


def _group(order: int, products: dict[str, tuple[str, str]], entries: Sequence[PathQuantity], *more: Any) -> Group:
    tables = [monomials.table(entry, tuple(products)) for entry in entries]
    slowest = Table(-np.ones(1), np.eye(len(products))[:1])
    table = monomials.stacked([*tables, *([slowest] if more else [])])
    members = (*(entry.squared for entry in entries), *more)
    return Group(order, members, products, table, any(entry.upright for entry in entries))


def _place(entry: PathQuantity) -> int:
    return int(entry.order > 2 or entry.upright)


_ENTRIES = [[entry for entry in QUANTITIES.values() if _place(entry) == k] for k in range(2)]
_BOTH = {"S": ("r1", "r1"), "B": ("r1", "r2"), "N": ("c", "c")}
_FURTHER = {
    "T": ("c", "r3"),
    "J": ("r3", "r3"),
    "E": ("c", "c1"),
    "D": ("c", "r4"),
    "V": ("r1", "up"),
    "H": ("r1", "r1"),
    "G": ("r1", "r2"),
    "P": ("c", "up"),
    "P1": ("c1", "up"),
}
GROUPS = (
    _group(2, {**_BOTH, "A": ("r2", "r2")}, _ENTRIES[0], _slowness),
    _group(4, {**_BOTH, **_FURTHER}, _ENTRIES[1]),
)
"""What most roads are limited by, and everything else."""

SLOWEST = len(QUANTITIES)
"""The place after the last limit: minus the square of the speed, whose peak is where a path is slowest."""

_PLACES = [_place(entry) for entry in QUANTITIES.values()]
GROUP = np.asarray([*_PLACES, 0], np.int32)
MEMBER = np.asarray([*(_PLACES[:k].count(g) for k, g in enumerate(_PLACES)), len(_ENTRIES[0])], np.int32)
PER_TIME = np.asarray([*(entry.per_time for entry in QUANTITIES.values()), 0], np.int32)


def values(setting: Setting, index: Int[Array, ""], limit: Scalar, u: Places) -> Places:
    """g at the places `u`."""
    curves = setting.curves
    scale, _ = _scale(setting, index, limit)

    def of(group: Group) -> Callable[[], Places]:
        def branch() -> Places:
            r = along_u(curves.up_to(group.order), u, 0)[0]
            r = _upright(setting, r, u) if group.upright else r
            found = Invariants([None, *((x[0], x[1], x[2]) for x in r)])
            known = SimpleNamespace(**{name: getattr(found, name) for name in group.products})
            squares = [lambda square=square: square(known) for square in group.members]
            return jax.lax.switch(jnp.asarray(MEMBER)[index], squares)

        return branch

    return 0.5 * (scale * _branch(index, of) - 1)


def slopes(
    setting: Setting, changes: Changes, index: Int[Array, ""], limit: Scalar, u: Places
) -> tuple[Places, Float[Array, "n places"]]:
    """g at the places `u`, and its derivatives in the variables."""
    curves = setting.curves
    scale, per_log = _scale(setting, index, limit)

    def of(group: Group) -> Callable[[], tuple[Places, Array]]:
        def branch() -> tuple[Places, Array]:
            r = along_u(curves.up_to(group.order), u, 0)[0]
            moved = along_u(changes.first.up_to(group.order), u, 0)[0]
            if group.upright:
                angle, first = (angle_at(x.angle, u, 0)[0] for x in (curves, changes.first))
                moved = _turned(setting.axes, angle, moved + first[:, None, None] * _spun(r)[None])
                r = _turned(setting.axes, angle, r)
            G, bar, _ = _gradient(group, _vectors(r), index)
            along = [_dot(_wide(b), v) for b, v in zip(bar, _vectors(moved), strict=True)]
            return G, total(along)

        return branch

    G, of_slopes = _branch(index, of)
    slope = changes.slopes.T @ of_slopes + (per_log * changes.log_duration)[:, None] * G[None]
    return 0.5 * (scale * G - 1), 0.5 * scale * slope


def expansions(setting: Setting, changes: Changes, index: Int[Array, ""], limit: Scalar, u: Places) -> Expansion:
    """g at the places `u`, with first and second derivatives in the variables and in u."""
    scale, per_log = _scale(setting, index, limit)
    G = Expansion(*_branch(index, lambda group: lambda: _expanded(group, setting, changes, index, u)))
    # The slopes are T times velocities: what is linear in the velocities is so in T, too.
    J, e = changes.slopes, changes.log_duration[:, None]
    slope, mixed = J.T @ G.slope, J.T @ G.mixed
    curved = jnp.einsum("in,ijp,jm->nmp", J, G.curvature, J)
    with_log = e[:, None] * slope[None]
    both = e[:, None] * e[None] * jnp.sum(e * slope, axis=0)[None, None]
    curved = curved + with_log + jnp.swapaxes(with_log, 0, 1) - both
    # κ = exp(−2p ln T)/limit².
    first = per_log * e
    cross = first[:, None] * slope[None]
    second = first[:, None] * first[None] * G.value[None, None]
    return Expansion(
        0.5 * (scale * G.value - 1),
        0.5 * scale * (slope + first * G.value[None]),
        0.5 * scale * (curved + second + cross + jnp.swapaxes(cross, 0, 1)),
        0.5 * scale * (mixed + first * G.rate[None]),
        0.5 * scale * G.rate,
        0.5 * scale * G.bend,
    )


def _scale(setting: Setting, index: Int[Array, ""], limit: Scalar) -> tuple[Array, Array]:
    """κ, and d ln κ / d ln T."""
    per_log = jnp.asarray(-2.0 * PER_TIME)[index].astype(limit.dtype)
    return jnp.exp(per_log * setting.log_duration) / limit**2, per_log


def _branch(index: Int[Array, ""], of: Callable[[Group], Callable[[], Any]]) -> Any:
    return jax.lax.switch(jnp.asarray(GROUP)[index], [of(group) for group in GROUPS])


def _expanded(group: Group, setting: Setting, changes: Changes, index: Int[Array, ""], u: Places) -> tuple[Array, ...]:
    """G, its derivatives in the slopes at the ends, those in slopes and u, and in u.

    In the directions w of the slopes and of u, with s for invariants and Y for blocks,
    G_ww = Σ G_ss s_w s_w + Σ W Y_w Y_w + Σ Ȳ·Y_ww, where W are the weights of the blocks' products and Ȳ = G_Y.
    """
    curves = setting.curves
    r, in_u, in_u_twice = along_u(curves.up_to(group.order), u, 2)
    moved, moved_in_u = along_u(changes.first.up_to(group.order), u, 1)
    w = jnp.concatenate([moved, in_u[None]])
    back: Any = lambda bar: (bar, 0.0)  # noqa: E731
    if group.upright:
        r, w, back = _in_world(setting, changes, r, w, u)
    directions = _vectors(w)
    vectors = _vectors(r)
    G, bar, (Y, bar_Y, of_s, hessian) = _gradient(group, vectors, index)
    in_w = {f"r{k + 1}": v for k, v in enumerate(directions)}
    for name, k in group.crossed.items():
        in_w[name] = _plus(cross(directions[0], _wide(vectors[k])), cross(_wide(vectors[0]), directions[k]))
    s_w, weighed = [], dict.fromkeys(in_w, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            s_w.append(in_w[a][2])
            continue
        axes = 2 if name in LEVEL else 3
        s_w.append(total([_dot(in_w[a][:axes], _wide(Y[b])[:axes]), _dot(in_w[b][:axes], _wide(Y[a])[:axes])]))
        weight = of_s[i][None]
        weighed[a] = _plus(weighed[a], _scaled(in_w[b], weight, axes))
        weighed[b] = _plus(weighed[b], _scaled(in_w[a], weight, axes))
    onto = jnp.einsum("ijp,jmp->imp", hessian, jnp.stack(s_w))
    curved = [_outer(onto[i], x) for i, x in enumerate(s_w)]
    curved += [_outer(x, y) for name in in_w for x, y in zip(in_w[name], weighed[name], strict=True)]
    for name, k in group.crossed.items():
        half = total(
            [_outer(x, y) for x, y in zip(cross(_wide(bar_Y[name]), directions[0]), directions[k], strict=True)]
        )
        curved += [half, jnp.swapaxes(half, 0, 1)]
    curved = total(curved)
    own, turned = back(jnp.stack([jnp.stack(b) for b in bar]))
    curved = curved + turned
    if changes.second is not None:
        second = changes.second.up_to(group.order)
        powers = [jnp.ones_like(u)]
        for _ in range(second.shape[-2] - 1):
            powers.append(powers[-1] * u)
        onto = own[:, None] * jnp.stack(powers)[None, :, None]
        added = unpacked(second.reshape(second.shape[0], -1) @ onto.reshape(-1, u.shape[0]))
        curved = curved + jnp.pad(added, ((0, 1), (0, 1), (0, 0)))
    n = moved.shape[0]
    flat = total([_dot(_wide(b), v) for b, v in zip(bar, directions, strict=True)])
    own = _vectors(own)
    mixed = total([_dot(_wide(b), v) for b, v in zip(own, _vectors(moved_in_u), strict=True)])
    bend = total([_dot(b, v) for b, v in zip(own, _vectors(in_u_twice), strict=True)])
    return G, flat[:n], curved[:n, :n], curved[:n, n] + mixed, flat[n], curved[n, n] + 2 * bend


def _gradient(group: Group, r: list[Triple], index: Int[Array, ""]) -> tuple[Places, list[Triple], tuple[Any, ...]]:
    """G and its derivatives in r', r'', …; then blocks, the derivatives in them and in the invariants, the Hessian."""
    Y = {f"r{k + 1}": v for k, v in enumerate(r)}
    Y |= {name: cross(r[0], r[k]) for name, k in group.crossed.items()}
    s = []
    for name, (a, b) in group.products.items():
        axes = 2 if name in LEVEL else 3
        s.append(Y[a][2] if b == "up" else _dot(Y[a][:axes], Y[b][:axes]))
    member = jnp.asarray(MEMBER)[index]
    coefficients, exponents = (jnp.asarray(x, s[0].dtype)[member] for x in group.table)
    G, of_s, hessian = monomials.expand(coefficients, exponents, jnp.stack(s))
    bar: dict[str, Any] = dict.fromkeys(Y, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            bar[a] = _plus(bar[a], (0, 0, of_s[i]))
            continue
        axes = 2 if name in LEVEL else 3
        bar[a] = _plus(bar[a], _scaled(Y[b], of_s[i], axes))
        bar[b] = _plus(bar[b], _scaled(Y[a], of_s[i], axes))
    bar = {name: tuple(_full(x, G) for x in v) for name, v in bar.items()}
    own = [bar[f"r{k + 1}"] for k in range(group.order)]
    for name, k in group.crossed.items():
        own[0], own[k] = _plus(own[0], cross(r[k], bar[name])), _plus(own[k], cross(bar[name], r[0]))
    return G, own, (Y, bar, of_s, hessian)


def _vectors(r: Array) -> list[Triple]:
    """Vectors (*rest, orders, 3, places) as triples of arrays (*rest, places), one for each order."""
    return [(r[..., k, 0, :], r[..., k, 1, :], r[..., k, 2, :]) for k in range(r.shape[-3])]


def _wide(v: Triple) -> Triple:
    """The vector for all directions, which stand on a first axis."""
    return (v[0][None], v[1][None], v[2][None])


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return total([times(x, y) for x, y in zip(a, b, strict=True)])


def _plus(a: Triple, b: Triple) -> Triple:
    return (total([a[0], b[0]]), total([a[1], b[1]]), total([a[2], b[2]]))


def _scaled(v: Triple, weight: Array, axes: int) -> Triple:
    """weight·v, without the vertical for two axes."""
    return (weight * v[0], weight * v[1], weight * v[2] if axes == 3 else 0)


def _outer(a: Any, b: Any) -> Any:
    """The products of all pairs of directions."""
    return 0 if isinstance(a, int) or isinstance(b, int) else a[:, None] * b[None]


def _full(x: Any, like: Array) -> Array:
    return jnp.zeros_like(like) if isinstance(x, int) else x


def _upright(setting: Setting, r: Array, u: Places) -> Array:
    """r', r'', … with the third axis vertical, where the axis of the path is not."""
    tilted = jnp.any(setting.axes[2, :2] != 0)
    angle = lambda: angle_at(setting.curves.angle, u, 0)[0]  # noqa: E731
    return jax.lax.cond(tilted, lambda: _turned(setting.axes, angle(), r), lambda: r)


def _turned(axes: Array, angle: Places, v: Array) -> Array:
    """Vectors (…, 3, places) from the moving basis to the world's."""
    x, y, z = v[..., 0, :], v[..., 1, :], v[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    local = jnp.stack([x * cos - y * sin, x * sin + y * cos, z], axis=-2)
    return jnp.einsum("ij,...jp->...ip", axes, local)


def _turned_back(axes: Array, angle: Places, v: Array) -> Array:
    """Vectors (…, 3, places) from the world's axes to the moving basis."""
    local = jnp.einsum("ji,...jp->...ip", axes, v)
    x, y, z = local[..., 0, :], local[..., 1, :], local[..., 2, :]
    cos, sin = _cos_sin(angle, x.ndim)
    return jnp.stack([x * cos + y * sin, y * cos - x * sin, z], axis=-2)


def _cos_sin(angle: Places, ndim: int) -> tuple[Array, Array]:
    wide = angle[(None,) * (ndim - 1)]
    return jnp.cos(wide), jnp.sin(wide)


def _spun(v: Array) -> Array:
    """k × v."""
    x, y = v[..., 0, :], v[..., 1, :]
    return jnp.stack([-y, x, jnp.zeros_like(x)], axis=-2)


def _in_world(setting: Setting, changes: Changes, r: Array, w: Array, u: Places) -> tuple[Array, Array, Any]:
    """r', r'', … and their derivatives in all directions in the world's axes; and what takes derivatives back.

    That gives derivatives in the moving basis, and what the turning of the basis adds to second ones.
    """
    axes = setting.axes
    angle, in_u, in_u_twice = angle_at(setting.curves.angle, u, 2)
    moved, moved_in_u = angle_at(changes.first.angle, u, 1)
    second = jnp.zeros((*moved.shape[:1] * 2, *moved.shape[1:]), u.dtype)  # φ is linear in the slopes
    first = jnp.concatenate([moved, in_u[None]])
    spun, again = _spun(r), _spun(_spun(r))
    twice = jnp.concatenate([second, moved_in_u[:, None]], axis=1)
    twice = jnp.concatenate([twice, jnp.concatenate([moved_in_u, 2 * in_u_twice[None]])[None]])

    def back(bar: Array) -> tuple[Array, Array]:
        own = _turned_back(axes, angle, bar)
        half = first[:, None] * jnp.einsum("okp,mokp->mp", own, _spun(w))[None]
        square = first[:, None] * first[None] * jnp.einsum("okp,okp->p", own, again)[None, None]
        added = twice * jnp.einsum("okp,okp->p", own, spun)[None, None]
        return own, half + jnp.swapaxes(half, 0, 1) + square + added

    return _turned(axes, angle, r), _turned(axes, angle, w + first[:, None, None] * spun[None]), back
