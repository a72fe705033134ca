"""Proof that a path stays within a corridor about a reference path.

The two paths are compared at equal fractions u of their durations. The squared distance, with the difference of the
azimuths measured along the arc, is a polynomial in u (see `CORRIDOR`). This polynomial is an upper bound on the true
squared distance if both radii have the same sign. This is proved, too.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.polynomial import horner
from qtraj.algebra.surd import Claim
from qtraj.design.on_host import host_callback
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, Certificate
from qtraj.design.proof.deciding import decided
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.sources import powers
from qtraj.foundation.arrays import concrete, constants, is_traced, require_positive
from qtraj.foundation.namespace import stop_gradient, xp
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import safe_root as root
from qtraj.path.placement import Placement
from qtraj.path.quantity import CORRIDOR, Offset
from qtraj.path.spiral_helix import SpiralHelix

GRID = np.linspace(0.0, 1.0, 193)
"""The instants at which the distance is sampled, as fractions of the durations."""


class Coefficients(NamedTuple):
    """The polynomials of one spiral-helix or a batch.

    The fields are the coefficients of the radius ρ, the azimuth φ and the height h for ascending powers of the time t
    [s], and the duration [s].
    """

    radius: Any
    angle: Any
    height: Any
    duration: Any


def coefficients(path: SpiralHelix, batch: tuple[int, ...]) -> Coefficients:
    """Return the coefficients of a batch of paths with one flat batch axis; a single path is repeated."""
    batch_ndim, np_ = len(path.duration.shape), jnp if is_traced(path) else np

    def flat(x: Any) -> Any:
        return np_.broadcast_to(np_.asarray(x), (*batch, *x.shape[batch_ndim:])).reshape(-1, *x.shape[batch_ndim:])

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

    ours, theirs, widths = coefficients(path, batch), coefficients(reference, batch), _broadcast(width, batch)
    codes, times, values = _findings(*constants((ours, theirs, widths)))
    if is_traced(path, reference, width):
        values = _distances(ours, theirs, times)
    columns = [x.reshape(*batch, 1) for x in (codes, times, values, widths)]
    pairs = zip((certificate.codes, certificate.times, certificate.values, certificate.limits), columns, strict=True)
    np_: Any = jnp if is_traced(certificate, columns) else np
    joined = (np_.concatenate([np_.asarray(old), np_.asarray(new, old.dtype)], axis=-1) for old, new in pairs)
    return Certificate((*certificate.names, CORRIDOR.name), *joined)


def _broadcast(width: Any, batch: tuple[int, ...]) -> Any:
    np_: Any = jnp if is_traced(width) else np
    return np_.broadcast_to(np_.asarray(width), batch).reshape(-1)


def _may_be_equal(one: Array, other: Array) -> bool:
    """Check whether two arrays are equal after broadcasting; true for traced arrays, whose values are unknown."""
    a, b = concrete(one), concrete(other)
    return a is None or b is None or bool(np.all(a == b))


def _findings(path: Coefficients, reference: Coefficients, widths: Any) -> Any:
    """Return status codes, times [s] and distances [m] of n paths, computed on the host."""
    if not is_traced(path, reference, widths):
        return judge_corridor(*jax.tree.map(np.asarray, (path, reference, widths)))
    dtype, shape = jnp.result_type(float), widths.shape
    result = tuple(jax.ShapeDtypeStruct(shape, x) for x in (np.int32, dtype, dtype))

    def on_host(*data: Any) -> Any:
        batch = np.shape(data[2])
        flat = jax.tree.map(lambda x: np.asarray(x).reshape(-1, *np.shape(x)[len(batch) :]), data)
        found = judge_corridor(*flat)
        return tuple(x.reshape(batch).astype(like.dtype) for x, like in zip(found, result, strict=True))

    return host_callback(on_host, result, path, reference, widths)


def judge_corridor(path: Coefficients, reference: Coefficients, widths: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return status codes, times [s] and distances [m] of the findings on n paths."""
    turns = _whole_turns(path, reference)

    def offset(polynomials: Any, turns: Any) -> Offset:
        ours, theirs = polynomials(path), polynomials(reference)
        radial, angle, up = (a - b for a, b in zip(ours, theirs, strict=True))
        return Offset(radial, angle - turns, up, theirs[0])

    def in_floats(p: Coefficients) -> list[BoundedPolynomial]:
        return [BoundedPolynomial(c.T * powers(p.duration, c.shape[1]), k=c.shape[1] + 1) for c in p[:3]]

    def in_integers(p: Coefficients, k: int) -> list[ExactPolynomial]:
        return [ExactPolynomial.from_floats(c[k]).substituted(float(p.duration[k])) for c in p[:3]]

    def within(width: Any, of: Offset) -> Claim:
        return Claim(width * width - CORRIDOR.numerator(of))

    def floats() -> Offset:
        return offset(in_floats, BoundedPolynomial.constant(turns))

    def integers(k: int) -> Offset:
        return offset(lambda p: in_integers(p, k), ExactPolynomial.of(turns[k]))

    every = np.isfinite(widths)
    inside = decided(
        every,
        lambda: within(BoundedPolynomial.constant(widths), floats()),
        lambda k: within(ExactPolynomial.of(widths[k]), integers(k)),
    )
    same_sign = decided(every, lambda: _radii(floats()), lambda k: _radii(integers(k)), strict=True).proved

    def squared_distance(u: np.ndarray) -> np.ndarray:
        def at(p: Coefficients) -> list[np.ndarray]:
            return [horner([*c.T], u * p.duration) for c in p[:3]]

        return CORRIDOR.numerator(offset(at, turns))

    grid = np.repeat(GRID[:, None], len(widths), axis=1)
    at, square = find_maxima(squared_distance, GRID, squared_distance(grid), inside.at[None])
    codes = np.where(inside.proved & same_sign, PROVED, np.where(inside.refuted, BROKEN, UNDECIDED))
    return codes.astype(np.int32), at * path.duration, np.sqrt(np.maximum(square, 0.0))


def _radii(of: Offset) -> Claim:
    """Return the product of both radii."""
    return Claim((of.outwards + of.radius) * of.radius)


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


def _whole_turns(path: Coefficients, reference: Coefficients) -> Any:
    """Return the multiple of 2π [rad] that is closest to the difference of the initial azimuths of two paths.

    Adding this angle to an azimuth does not change the positions.
    """
    turns = xp.round((path.angle[..., 0] - reference.angle[..., 0]) / (2 * np.pi))
    return 2 * np.pi * stop_gradient(turns)
