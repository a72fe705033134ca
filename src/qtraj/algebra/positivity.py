"""Is a function positive on [−1, 1]? Proved, refuted at a point, or left open."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.cells import Build, PerPath, initial_front, refine

POSITIVE, UNDECIDED, NEGATIVE = range(3)
"""Codes of an answer: proved positive everywhere; neither; proved negative somewhere."""


NARROWER, NARROWEST = 4.0, 2.0**-9
"""By what a piece is made narrower; one of the second width or less is left open instead."""


class Answer(eqx.Module):
    """What is known of the least value of a function on [−1, 1], for each path.

    `code` is POSITIVE, NEGATIVE or UNDECIDED; the least value lies in [`low`, `high`], and `high` bounds the value at `at`.
    """

    code: Int[Array, " paths"]
    low: PerPath
    high: PerPath
    at: PerPath


def prove_positive(build: Build, widest: Float[Array, " paths"]) -> Answer:
    """Whether the functions that `build` makes, one for each path, are positive on the whole of [−1, 1].

    Piece after piece of [−1, 1] is judged, first of the `widest` width that is given for a path, a power of two. Where
    more cells of a piece are undecided than there is space for, a narrower one is taken.
    """

    def piece(s: _Sweep) -> _Sweep:
        front = jax.lax.while_loop(
            lambda front: jnp.any(front.undecided & (front.high >= 0)),
            lambda front: refine(build, front),
            initial_front(s.left, s.width, s.going),
        )
        narrower = front.overfull & (front.high >= 0) & (s.width > NARROWEST)
        left = front.overfull | jnp.any(front.active, axis=0)
        code = jnp.where(front.high < 0, NEGATIVE, jnp.where(left, UNDECIDED, POSITIVE)).astype(jnp.int32)
        done = s.going & ~narrower
        low = jnp.minimum(front.low, jnp.min(jnp.where(front.active, front.floor, jnp.inf), axis=0))
        lower = front.high < s.found.high
        found = Answer(
            jnp.where(done, code, s.found.code),
            jnp.where(done, jnp.minimum(low, s.found.low), s.found.low),
            jnp.where(lower, front.high, s.found.high),
            jnp.where(lower, front.at, s.found.at),
        )
        at = jnp.where(done, s.left + s.width, s.left)
        wider = (at / (2 * s.width) == jnp.round(at / (2 * s.width))) & (s.width < widest)
        width = jnp.where(narrower, s.width / NARROWER, jnp.where(wider, 2 * s.width, s.width))
        return _Sweep(at, width, (found.code == POSITIVE) & (at < 1), found)

    infinite = jnp.full_like(widest, jnp.inf)
    unknown = Answer(jnp.full(widest.shape, POSITIVE, jnp.int32), infinite, infinite, jnp.zeros_like(infinite))
    start = _Sweep(jnp.full_like(widest, -1.0), widest, jnp.ones(widest.shape, bool), unknown)
    return jax.lax.while_loop(lambda s: jnp.any(s.going), piece, start).found


class _Sweep(NamedTuple):
    """From where on [−1, 1] is not judged yet, and the width of the next piece."""

    left: Float[Array, " paths"]
    width: Float[Array, " paths"]
    going: Bool[Array, " paths"]
    found: Answer
