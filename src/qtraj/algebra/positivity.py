"""Prove that functions are positive on [−1, 1], or find a point where a function is negative."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.cells import Build, PerPath, initial_front, refine

POSITIVE, UNDECIDED, NEGATIVE = range(3)
"""Result codes: proved to be positive everywhere on [−1, 1], undecided, proved to be negative somewhere."""


SHRINK_FACTOR, MIN_WIDTH = 4.0, 2.0**-9
"""Factor by which a subinterval with too many undecided cells becomes narrower, if its width exceeds `MIN_WIDTH`."""


class Answer(eqx.Module):
    """Bounds on the minimum of a function on [−1, 1], for each path.

    `code` is POSITIVE, NEGATIVE or UNDECIDED. The value at `at`, and therefore the minimum, is at most `high`. If
    `code` is POSITIVE, `low` is a lower bound on the minimum. Otherwise `low` is a lower bound only in the subintervals
    that were searched.
    """

    code: Int[Array, " paths"]
    low: PerPath
    high: PerPath
    at: PerPath


def prove_positive(build: Build, widest: Float[Array, " paths"]) -> Answer:
    """Prove or disprove that functions, one for each path, are positive on [−1, 1]; `build` returns their models.

    The search processes subintervals of [−1, 1] from left to right, until a subinterval is undecided or contains a
    negative value. No subinterval is wider than `widest`, a power of two for each path. If a subinterval has too many
    undecided cells, the search tries a narrower one.
    """

    def piece(s: _Sweep) -> _Sweep:
        front = jax.lax.while_loop(
            lambda front: jnp.any(front.undecided & (front.high >= 0)),
            lambda front: refine(build, front),
            initial_front(s.left, s.width, s.active),
        )
        narrower = front.overfull & (front.high >= 0) & (s.width > MIN_WIDTH)
        undecided = front.overfull | jnp.any(front.active, axis=0)
        code = jnp.where(front.high < 0, NEGATIVE, jnp.where(undecided, UNDECIDED, POSITIVE)).astype(jnp.int32)
        done = s.active & ~narrower
        low = jnp.minimum(front.low, jnp.min(jnp.where(front.active, front.lower_bound, jnp.inf), axis=0))
        lower = front.high < s.answer.high
        answer = Answer(
            jnp.where(done, code, s.answer.code),
            jnp.where(done, jnp.minimum(low, s.answer.low), s.answer.low),
            jnp.where(lower, front.high, s.answer.high),
            jnp.where(lower, front.at, s.answer.at),
        )
        at = jnp.where(done, s.left + s.width, s.left)
        wider = (at / (2 * s.width) == jnp.round(at / (2 * s.width))) & (s.width < widest)
        width = jnp.where(narrower, s.width / SHRINK_FACTOR, jnp.where(wider, 2 * s.width, s.width))
        return _Sweep(at, width, (answer.code == POSITIVE) & (at < 1), answer)

    infinite = jnp.full_like(widest, jnp.inf)
    initial = Answer(jnp.full(widest.shape, POSITIVE, jnp.int32), infinite, infinite, jnp.zeros_like(infinite))
    start = _Sweep(jnp.full_like(widest, -1.0), widest, jnp.ones(widest.shape, bool), initial)
    return jax.lax.while_loop(lambda s: jnp.any(s.active), piece, start).answer


class _Sweep(NamedTuple):
    """State of the search: [−1, `left`] has been searched, and the next subinterval is [`left`, `left` + `width`]."""

    left: Float[Array, " paths"]
    width: Float[Array, " paths"]
    active: Bool[Array, " paths"]
    answer: Answer
