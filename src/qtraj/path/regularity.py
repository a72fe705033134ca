"""Where the frames and rates of a path exist: tests whether the speed, the curvature and the horizontal speed are zero.

The functions accept numbers or triples of arrays, as in `frenet`.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from qtraj.path.components import dot
from qtraj.path.frenet import Invariants

Numbers = Float[Array, "..."]
Flags = Bool[Array, "..."]

DEFINED_TOLERANCE = 4096
"""In machine epsilons: a path whose direction changes by less than this over its length counts as straight, and a speed
below this fraction of its own change counts as zero. At the tolerance, n is still accurate to three digits."""


class Regularity(eqx.Module):
    """Dimensionless squares in [0, 1] that are 0 where a frame does not exist, at one instant or many.

    `speed` is S relative to the speeds that the path's accelerations cause over its duration, `cross_norm` is N
    relative to its largest value for these speeds and accelerations, and `level` is the horizontal part of S.
    """

    speed: Numbers
    cross_norm: Numbers
    level: Numbers


def regularity(i: Invariants, duration: Numbers) -> Regularity:
    """The relative size of the divisors of rates and curvatures; the duration is in [s]."""
    speed_scale, cross_norm_scale = reference_squares(i, duration)
    return Regularity(_ratio(i.S, speed_scale), _ratio(i.N, cross_norm_scale), _ratio(i.H, i.S))


def has_tangent(i: Invariants, duration: Numbers) -> Flags:
    """Whether a path with this duration [s] has a tangent, i.e. its speed is not zero."""
    return is_significant(i.S, reference_squares(i, duration)[0])


def has_natural_frame(i: Invariants, duration: Numbers) -> Flags:
    """Whether the natural trihedral exists: the path moves and is not straight."""
    return has_tangent(i, duration) & is_significant(i.N, reference_squares(i, duration)[1])


def has_upright_frame(i: Invariants, duration: Numbers) -> Flags:
    """Whether the upright frame exists: the path moves, and not along the vertical."""
    return has_tangent(i, duration) & is_significant(i.H, i.S)


def reference_squares(i: Invariants, duration: Array) -> tuple[Array, Array]:
    """The reference values for deciding whether S and N are zero."""
    square = i.A
    speed_scale = i.S + duration**2 * square + duration**4 * dot(i.r[3], i.r[3])
    return speed_scale, i.S * (square + i.S / duration**2)


def is_significant(square: Any, reference: Any) -> Flags:
    """Whether a square is a normal number and, relative to `reference`, larger than rounding errors."""
    limits = jnp.finfo(square.dtype)
    tolerance = (DEFINED_TOLERANCE * float(limits.eps)) ** 2
    return jnp.maximum(reference * tolerance, float(limits.tiny)) < square


def _ratio(square: Any, reference: Any) -> Any:
    positive = reference > 0
    return jnp.where(positive, square / jnp.where(positive, reference, 1.0), 0.0)
