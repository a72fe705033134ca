"""Is a polynomial positive on [0, 1]? Proved, refuted at a point, or left open below a stated gap."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from qtraj.algebra.cells import Build, judged, undivided
from qtraj.foundation.types import Scalar

POSITIVE, NEGATIVE, OPEN = 0, 1, 2
"""Codes of an answer: proved positive everywhere; proved negative somewhere; neither."""


class Answer(eqx.Module):
    """What is known of the least value of a polynomial on [0, 1].

    `code` is POSITIVE, NEGATIVE or OPEN; the least value lies in [`low`, `high`], and `high` bounds the value at `at`.
    """

    code: Int[Array, ""]
    low: Scalar
    high: Scalar
    at: Scalar


def positive(build: Build, parts: Any) -> Answer:
    """Whether the polynomial that `build` makes of `parts` is positive on the whole of [0, 1].

    The question is left open where more than half of the cells of a round are undecided, too.
    """
    front = jax.lax.while_loop(
        lambda front: front.undecided & (front.high >= 0),
        lambda front: judged(build, parts, front, jnp.zeros_like),
        undivided(build, parts),
    )
    left = front.open | jnp.any(front.active)
    code = jnp.where(front.high < 0, NEGATIVE, jnp.where(left, OPEN, POSITIVE))
    return Answer(code.astype(jnp.int32), front.floor_of_all, front.high, front.at)
