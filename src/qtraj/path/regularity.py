"""How clearly a path moves, bends and keeps from the vertical: where its frames and rates exist.

Written over numbers and over triples of arrays, as `frenet` is.
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
"""In machine epsilons: a path that bends by less than this over its own length is straight, and a speed below this
part of its own changes is zero. At the tolerance itself the direction of n still has three good digits."""


class Regularity(eqx.Module):
    """Squares of relative sizes in [0, 1], without units, at one instant or at many.

    `speed` is S against the speeds that the path's own changes make over its duration, `cross_norm` is N against the
    largest N that these speeds and accelerations allow, and `level` is the horizontal part of S.
    """

    speed: Numbers
    cross_norm: Numbers
    level: Numbers


def regularity(i: Invariants, duration: Numbers) -> Regularity:
    """How clearly what rates and curvatures divide by differs from zero; the duration is in [s]."""
    speeds, cross_norms = largest(i, duration)
    return Regularity(_part(i.S, speeds), _part(i.N, cross_norms), _part(i.H, i.S))


def has_tangent(i: Invariants, duration: Numbers) -> Flags:
    """Whether there is a tangent, on a path of this duration [s]."""
    return is_significant(i.S, largest(i, duration)[0])


def has_natural_frame(i: Invariants, duration: Numbers) -> Flags:
    """Whether there is a natural trihedral."""
    return has_tangent(i, duration) & is_significant(i.N, largest(i, duration)[1])


def has_upright_frame(i: Invariants, duration: Numbers) -> Flags:
    """Whether there is an upright frame: the path moves, and not along the vertical."""
    return has_tangent(i, duration) & is_significant(i.H, i.S)


def largest(i: Invariants, duration: Array) -> tuple[Array, Array]:
    """What S and N are measured against."""
    square = i.A
    speeds = i.S + duration**2 * square + duration**4 * dot(i.r[3], i.r[3])
    return speeds, i.S * (square + i.S / duration**2)


def is_significant(square: Any, whole: Any) -> Flags:
    """Whether a square is more than zero to rounding, against what it is measured by; a normal number in any case."""
    limits = jnp.finfo(square.dtype)
    tolerance = (DEFINED_TOLERANCE * float(limits.eps)) ** 2
    return jnp.maximum(whole * tolerance, float(limits.tiny)) < square


def _part(part: Any, whole: Any) -> Any:
    positive = whole > 0
    return jnp.where(positive, part / jnp.where(positive, whole, 1.0), 0.0)
