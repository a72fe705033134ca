"""How clearly a path moves, bends and keeps from the vertical: where its frames and rates exist."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.path.components import dot
from qtraj.path.frenet import Invariants

Numbers = Float[Array, "..."]


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


def largest(i: Invariants, duration: Array) -> tuple[Array, Array]:
    """What S and N are measured against."""
    square = i.A
    speeds = i.S + duration**2 * square + duration**4 * dot(i.r[3], i.r[3])
    return speeds, i.S * (square + i.S / duration**2)


def _part(part: Any, whole: Any) -> Any:
    positive = whole > 0
    return jnp.where(positive, part / jnp.where(positive, whole, 1.0), 0.0)
