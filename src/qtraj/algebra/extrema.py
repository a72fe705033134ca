"""The least and the greatest value of a polynomial on [0, 1], between bounds that hold whatever rounding did."""

import jax
import jax.numpy as jnp

from qtraj.algebra.bernstein import Bernstein
from qtraj.algebra.cells import Enclosure, judged, undivided
from qtraj.foundation.types import Scalar

GAP = 64
"""In machine epsilons of the largest coefficient: enclosures narrower than this, and its error, are not divided."""


def least(p: Bernstein) -> Enclosure:
    """The least value of one polynomial: in [`low`, `high`], and taken to within that near `at` ∈ [0, 1].

    Cells whose values all lie above one that was seen are left, the others are halved until the gap closes to rounding.
    Where the least value is taken on more than four of eight cells at once the enclosure stays as wide as it was there.
    """
    gap = GAP * jnp.finfo(p.error.dtype).eps * p.size + 4 * p.error

    def above(high: Scalar) -> Scalar:
        return high - gap

    front = jax.lax.while_loop(
        lambda front: front.undecided,
        lambda front: judged(Bernstein.on, p, front, above),
        undivided(Bernstein.on, p),
    )
    return Enclosure(jnp.minimum(front.floor_of_all, front.high), front.high, front.at)


def greatest(p: Bernstein) -> Enclosure:
    """The greatest value of one polynomial: in [`low`, `high`], and taken to within that near `at` ∈ [0, 1]."""
    found = least(Bernstein(-p.coefficients, p.error))
    return Enclosure(-found.high, -found.low, found.at)
