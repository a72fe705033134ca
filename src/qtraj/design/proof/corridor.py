"""Proof that a path stays within a corridor about a reference path.

The two paths are compared at equal fractions of their durations, that is, at equal s = 2t/duration − 1. The squared
distance, with the difference of the azimuths measured along the arc, is a polynomial in s (see `CORRIDOR`). This
polynomial is an upper bound on the true squared distance if both radii have the same sign. This is proved, too.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.algebra.cells import Cells, PerPath
from qtraj.algebra.chebyshev_model import AXIS, TINY, ChebyshevModel, add_rounding, multiple
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, prove_positive
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, Certificate
from qtraj.design.proof.inequalities import centred, in_units, squared_bound
from qtraj.design.proof.search import find_maximum
from qtraj.foundation.arrays import concrete, is_traced, require_positive
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import safe_root as root
from qtraj.path.placement import Placement
from qtraj.path.quantity import CORRIDOR, Offset
from qtraj.path.spiral_helix import SpiralHelix

MAX_CELL_WIDTH = 2.0
CHUNKS = 8
"""Number of blocks of 30 intervals in the search for the maximum distance."""


class Coefficients(NamedTuple):
    """The polynomials of one spiral-helix or a batch.

    The fields are the coefficients of the radius ρ, the azimuth φ and the height h for ascending powers of the time t
    [s], and the duration [s].
    """

    radius: Array
    angle: Array
    height: Array
    duration: Array


def coefficients(path: SpiralHelix, batch: tuple[int, ...]) -> Coefficients:
    """Return the coefficients of a batch of paths with one flat batch axis; a single path is repeated."""
    batch_ndim = len(path.duration.shape)

    def flat(x: Array) -> Array:
        return jnp.broadcast_to(x, (*batch, *x.shape[batch_ndim:])).reshape(-1, *x.shape[batch_ndim:])

    return Coefficients(*map(flat, (path.radius, path.angle, path.height, path.duration)))


def add_corridor(certificate: Certificate, path: Any, reference: Any, width: Array) -> Certificate:
    """Return the certificate with an additional finding, on the distance from the reference.

    **Raises:** ValueError if one of the paths is not a spiral-helix, if their axes differ, if the corridor is not
    positive, or if the batch shapes differ.
    """
    if not (isinstance(path, SpiralHelix) and isinstance(reference, SpiralHelix)):
        raise ValueError(
            "a corridor needs a path and a reference that are both a SpiralHelix: pass reference= together with "
            "corridor="
        )
    require_positive(width, "the corridor", CORRIDOR.label)
    batch = path.duration.shape
    if width.shape not in ((), batch) or reference.duration.shape not in ((), batch):
        raise ValueError(
            f"the paths have the batch shape {batch}, but the corridor has the shape {width.shape} and the reference "
            f"has the batch shape {reference.duration.shape}: pass a corridor and a reference without a batch "
            "dimension, or with the batch shape of the paths"
        )
    axes = [p.placement or Placement() for p in (path, reference)]
    if not all(map(_may_be_equal, *map(jax.tree.leaves, axes))):
        raise ValueError("a corridor needs a path and a reference about the same axis, but their placements differ")

    ours, theirs = coefficients(path, batch), coefficients(reference, batch)
    widths = jnp.broadcast_to(width, batch).astype(path.duration.dtype)
    codes, times, values = judge_corridor(*jax.lax.stop_gradient((ours, theirs, widths.reshape(-1))))
    if is_traced(path, reference, width):
        values = _distances(ours, theirs, times)
    columns = [x.reshape(*batch, 1) for x in (codes, times, values)]
    pairs = (
        (certificate.codes, certificate.times, certificate.values, certificate.limits),
        (*columns, widths[..., None]),
    )
    return Certificate(
        (*certificate.names, CORRIDOR.name), *(jnp.concatenate(x, axis=-1) for x in zip(*pairs, strict=True))
    )


def _may_be_equal(one: Array, other: Array) -> bool:
    """Check whether two arrays are equal after broadcasting; true for traced arrays, whose values are unknown."""
    a, b = concrete(one), concrete(other)
    return a is None or b is None or bool(np.all(a == b))


@jax.jit
def judge_corridor(
    path: Coefficients, reference: Coefficients, width: Float[Array, " paths"]
) -> tuple[Int[Array, " paths"], PerPath, PerPath]:
    """Return status code, time [s] and distance [m] of the finding on each path of a batch."""
    offset, radii = _offsets(path, reference)
    bound = squared_bound(width, jnp.ones_like(width))

    def slack(centre: Cells, half: Cells) -> ChebyshevModel:
        p, radius = offset.on(centre, half), radii.on(centre, half)[1]
        return multiple(radius.one(), *bound) - CORRIDOR.numerator(Offset(p[0], p[1], p[2], radius))

    def radius_product(centre: Cells, half: Cells) -> ChebyshevModel:
        p = radii.on(centre, half)
        return p[0] * p[1]

    def squared_distance(s: Cells) -> Cells:
        radial, angle, up = offset.at(s)
        return CORRIDOR.numerator(Offset(radial, angle, up, radii.at(s)[1]))

    widest = jnp.full_like(width, MAX_CELL_WIDTH)
    proof, radii_positive = prove_positive(slack, widest), prove_positive(radius_product, widest)
    square, at = find_maximum(squared_distance, jnp.stack([proof.at] * 3), jnp.asarray(CHUNKS))
    proved = (proof.code == POSITIVE) & (radii_positive.code == POSITIVE)
    code = jnp.where(proved, PROVED, jnp.where(proof.code == NEGATIVE, BROKEN, UNDECIDED))
    return code.astype(jnp.int32), (at + 1) * 0.5 * path.duration, root(square)


def distance(path: Coefficients, reference: Coefficients, t: Scalar) -> Scalar:
    """Return the distance of a path from its reference at time t [s] by the formula of `judge_corridor`.

    The distance is differentiable.
    """
    u = t / jax.lax.stop_gradient(path.duration)
    ours, theirs = (
        [jnp.polyval(c[::-1], u * p.duration) for c in (p.radius, p.angle, p.height)] for p in (path, reference)
    )
    radial, angle, up = (a - b for a, b in zip(ours, theirs, strict=True))
    angle = angle - _whole_turns(path, reference)
    return root(CORRIDOR.numerator(Offset(radial, angle, up, theirs[0])))


_distances = jax.jit(jax.vmap(distance))


def _offsets(path: Coefficients, reference: Coefficients) -> tuple[CellPolynomial, CellPolynomial]:
    """Return the differences of ρ, φ and h, and both radii, as polynomials in s = 2t/duration − 1.

    The polynomials include bounds on the rounding errors.
    """
    # With half the duration as the unit of time, these are coefficients of powers of 1 + s = 2t/duration.
    ours = [in_units(c.T, 0.5 * path.duration) for c in (path.radius, path.angle, path.height)]
    theirs = [in_units(c.T, 0.5 * reference.duration) for c in (reference.radius, reference.angle, reference.height)]
    terms = max(c.shape[0] for c in (*ours, *theirs))
    ours, theirs = (jnp.stack([_pad(c, terms) for c in each]) for each in (ours, theirs))
    radii = jnp.stack([ours[0], theirs[0]])
    theirs = theirs.at[1, 0].add(_whole_turns(path, reference))
    return _polynomial(ours - theirs, jnp.abs(ours) + jnp.abs(theirs)), _polynomial(radii, jnp.abs(radii))


def _whole_turns(path: Coefficients, reference: Coefficients) -> Array:
    """Return the multiple of 2π [rad] that is closest to the difference of the initial azimuths of two paths.

    Adding this angle to an azimuth does not change the positions.
    """
    turns = jnp.round((path.angle[..., 0] - reference.angle[..., 0]) / (2 * jnp.pi))
    return 2 * jnp.pi * jax.lax.stop_gradient(turns)


def _polynomial(numbers: Float[Array, "axes k paths"], sizes: Float[Array, "axes k paths"]) -> CellPolynomial:
    """Return polynomials in s = 2t/duration − 1 from coefficients of powers of 1 + s, with a bound on rounding errors.

    Each element of `sizes` is the sum of the magnitudes of the numbers from which a coefficient was computed. The bound
    includes the rounding errors of the conversion to s.
    """
    centre_all = jax.vmap(lambda c: centred(c[:, None]))
    count = 3 * numbers.shape[1] + 6
    size = jnp.max(jnp.sum(centre_all(sizes), axis=AXIS), axis=0)
    return cell_polynomial(centre_all(numbers), add_rounding(jnp.full_like(size, TINY), count, size))


def _pad(c: Float[Array, "k paths"], terms: int) -> Any:
    return jnp.pad(c, ((0, terms - c.shape[0]), (0, 0)))
