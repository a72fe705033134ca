"""The distance of a path from another one, its reference, proved to stay within a corridor.

At equal parts of the two durations, s = 2t/duration − 1, the square of the distance, counted along the arc, is a
polynomial in s wherever both radii are positive (see `CORRIDOR`), and that they are is proved as well.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.cells import Cells, PerPath
from qtraj.algebra.chebyshev_model import AXIS, TINY, ChebyshevModel, add_rounding, multiple
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, prove_positive
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, Certificate
from qtraj.design.proof.inequalities import centred, squared_bound
from qtraj.design.proof.search import highest
from qtraj.foundation.arrays import concrete, require_positive
from qtraj.foundation.types import Scalar
from qtraj.path.placement import Placement
from qtraj.path.quantity import CORRIDOR, Offset
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.values import root

WIDEST = 2.0
CHUNKS = 8
"""Of 30 intervals in which the largest distance is sought."""


class Coefficients(NamedTuple):
    """Of ρ, φ and h in t, and the duration [s]: of one spiral-helix, or of many with a batch in front."""

    radius: Array
    angle: Array
    height: Array
    duration: Array


def coefficients(path: SpiralHelix, batch: tuple[int, ...]) -> Coefficients:
    """The coefficients of paths with this batch, in rows; one path stands for all."""
    own = len(path.duration.shape)

    def rows(x: Array) -> Array:
        return jnp.broadcast_to(x, (*batch, *x.shape[own:])).reshape(-1, *x.shape[own:])

    return Coefficients(*map(rows, (path.radius, path.angle, path.height, path.duration)))


def with_corridor(found: Certificate, path: Any, reference: Any, width: Array) -> Certificate:
    """Findings in float64 with one more, on the distance from a reference.

    **Raises:** ValueError for what is no spiral-helix, another axis, or a corridor that is not positive.
    """
    if not (isinstance(path, SpiralHelix) and isinstance(reference, SpiralHelix)):
        raise ValueError(
            "a corridor needs a spiral-helix and its reference, another one: pass reference= beside corridor="
        )
    require_positive(width, "the corridor", CORRIDOR.label)
    batch = path.duration.shape
    if width.shape not in ((), batch) or reference.duration.shape not in ((), batch):
        raise ValueError(
            f"the paths have the batch {batch}, but the corridor has the shape {width.shape} and the reference the "
            f"batch {reference.duration.shape}: give one for all, or one for each"
        )
    axes = [p.placement or Placement() for p in (path, reference)]
    if not all(map(_may_agree, *map(jax.tree.leaves, axes))):
        raise ValueError("a corridor needs a path and a reference about the same axis, but their placements differ")

    own, given = coefficients(path, batch), coefficients(reference, batch)
    wide = jnp.broadcast_to(width, batch).astype(path.duration.dtype)
    codes, times, values = within(*jax.lax.stop_gradient((own, given, wide.reshape(-1))))
    if any(isinstance(x, Tracer) for x in jax.tree.leaves((path, reference, width))):
        values = jax.vmap(distance)(own, given, times)
    columns = [x.reshape(*batch, 1) for x in (codes, times, values)]
    both = (found.codes, found.times, found.values, found.limits), (*columns, wide[..., None])
    return Certificate((*found.names, CORRIDOR.name), *(jnp.concatenate(x, axis=-1) for x in zip(*both, strict=True)))


def _may_agree(one: Array, other: Array) -> bool:
    """Whether arrays that are known are equal, one of them perhaps for all."""
    a, b = concrete(one), concrete(other)
    return a is None or b is None or bool(np.all(a == b))


@jax.jit
def within(
    path: Coefficients, reference: Coefficients, width: Float[Array, " paths"]
) -> tuple[Int[Array, " paths"], PerPath, PerPath]:
    """What is known of paths (a batch in front) about the axes of their references: code, time [s], distance [m]."""
    offset, radii = _offsets(path, reference)
    bound = squared_bound(width, jnp.ones_like(width))

    def slack(centre: Cells, half: Cells) -> ChebyshevModel:
        p, radius = offset.on(centre, half), radii.on(centre, half)[1]
        return multiple(radius.one(), *bound) - CORRIDOR.numerator(Offset(p[0], p[1], p[2], radius))

    def apart(centre: Cells, half: Cells) -> ChebyshevModel:
        p = radii.on(centre, half)
        return p[0] * p[1]

    def measured(s: Cells) -> Cells:
        outwards, angle, up = offset.at(s)
        return CORRIDOR.numerator(Offset(outwards, angle, up, radii.at(s)[1]))

    widest = jnp.full_like(width, WIDEST)
    answer, apart_from_axis = prove_positive(slack, widest), prove_positive(apart, widest)
    square, at = highest(measured, jnp.stack([answer.at] * 3), jnp.asarray(CHUNKS))
    proved = (answer.code == POSITIVE) & (apart_from_axis.code == POSITIVE)
    code = jnp.where(proved, PROVED, jnp.where(answer.code == NEGATIVE, BROKEN, UNDECIDED))
    return code.astype(jnp.int32), (at + 1) * 0.5 * path.duration, root(square)


def distance(path: Coefficients, reference: Coefficients, t: Scalar) -> Scalar:
    """The distance at time t [s] of a path, as `within` measures it; it can be differentiated."""
    u = t / jax.lax.stop_gradient(path.duration)
    own, given = (
        [jnp.polyval(c[::-1], u * p.duration) for c in (p.radius, p.angle, p.height)] for p in (path, reference)
    )
    outwards, angle, up = (a - b for a, b in zip(own, given, strict=True))
    angle = angle - _whole_turns(path, reference)
    return root(CORRIDOR.numerator(Offset(outwards, angle, up, given[0])))


def _offsets(path: Coefficients, reference: Coefficients) -> tuple[CellPolynomial, CellPolynomial]:
    """How far the paths are apart in ρ, φ and h, and both radii, as polynomials in s: small numbers beside large."""
    own = [_scaled(c, path.duration) for c in (path.radius, path.angle, path.height)]
    given = [_scaled(c, reference.duration) for c in (reference.radius, reference.angle, reference.height)]
    terms = max(c.shape[0] for c in (*own, *given))
    own, given = (jnp.stack([_filled(c, terms) for c in each]) for each in (own, given))
    radii = jnp.stack([own[0], given[0]])
    given = given.at[1, 0].add(_whole_turns(path, reference))
    return _polynomial(own - given, jnp.abs(own) + jnp.abs(given)), _polynomial(radii, jnp.abs(radii))


def _whole_turns(path: Coefficients, reference: Coefficients) -> Array:
    """By which whole turns [rad] the azimuths of two paths begin apart: they mean the same place."""
    turns = jnp.round((path.angle[..., 0] - reference.angle[..., 0]) / (2 * jnp.pi))
    return 2 * jnp.pi * jax.lax.stop_gradient(turns)


def _polynomial(numbers: Float[Array, "axes k paths"], sizes: Float[Array, "axes k paths"]) -> CellPolynomial:
    """Polynomials in s of coefficients in 1 + s, with the rounding of what was scaled, subtracted and centred."""
    whole = jax.vmap(lambda c: centred(c[:, None]))
    count = 3 * numbers.shape[1] + 6
    size = jnp.max(jnp.sum(whole(sizes), axis=AXIS), axis=0)
    return cell_polynomial(whole(numbers), add_rounding(jnp.full_like(size, TINY), count, size))


def _scaled(c: Float[Array, "paths k"], duration: PerPath) -> Float[Array, "k paths"]:
    """Coefficients in 1 + s = 2t/duration."""
    powers = [jnp.ones_like(duration)]
    for _ in range(c.shape[1] - 1):
        powers.append(powers[-1] * (0.5 * duration))
    return c.T * jnp.stack(powers)


def _filled(c: Float[Array, "k paths"], terms: int) -> Any:
    return jnp.pad(c, ((0, terms - c.shape[0]), (0, 0)))
