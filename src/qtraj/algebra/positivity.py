"""Is a function positive on [−1, 1]? Proved, refuted at a point, or left open."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.algebra.cells import Build, PerPath, judged, undivided

POSITIVE, OPEN, NEGATIVE = range(3)
"""Codes of an answer: proved positive everywhere; neither; proved negative somewhere."""


class Answer(eqx.Module):
    """What is known of the least value of a function on [−1, 1], for each path.

    `code` is POSITIVE, NEGATIVE or OPEN; the least value lies in [`low`, `high`], and `high` bounds the value at `at`.
    """

    code: Int[Array, " paths"]
    low: PerPath
    high: PerPath
    at: PerPath


def positive(build: Build, paths: int, dtype: np.dtype, pieces: Array | int = 1) -> Answer:
    """Whether the functions that `build` makes are positive on the whole of [−1, 1].

    So many `pieces` of [−1, 1] are judged one after the other. The question is left open where more than half of the
    cells of a round are undecided, too.
    """

    def judge(k: Array, before: Answer) -> Answer:
        front = jax.lax.while_loop(
            lambda front: jnp.any(front.undecided & (front.high >= 0)),
            lambda front: judged(build, front),
            undivided(paths, dtype, k, pieces),
        )
        left = front.open | jnp.any(front.active, axis=0)
        code = jnp.where(front.high < 0, NEGATIVE, jnp.where(left, OPEN, POSITIVE)).astype(jnp.int32)
        low = jnp.min(jnp.where(front.active, front.floor, jnp.inf), axis=0)
        low = jnp.minimum(jnp.minimum(front.low, low), before.low)
        lower = front.high < before.high
        high, at = jnp.where(lower, front.high, before.high), jnp.where(lower, front.at, before.at)
        return Answer(jnp.maximum(code, before.code), low, high, at)

    infinite = jnp.full((paths,), jnp.inf, dtype)
    start = Answer(jnp.full((paths,), POSITIVE, jnp.int32), infinite, infinite, jnp.zeros_like(infinite))
    return jax.lax.fori_loop(jnp.int32(0), jnp.asarray(pieces, jnp.int32), judge, start)
