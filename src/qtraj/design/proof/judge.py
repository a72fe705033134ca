"""Findings on many paths at once: one program, whatever limits there are and however many.

Which limits are present is data: a loop over their indices, in which one switch builds the inequality and another
evaluates the quantity. Neither index is ever batched, so that a switch is a branch and absent limits cost nothing.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.cells import PerPath
from qtraj.algebra.chebyshev_model import ChebyshevModel
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, UNDECIDED, Answer, prove_positive
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.inequalities import ORDER, Parts, slack, squared_bound
from qtraj.design.proof.search import highest
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import QUANTITIES
from qtraj.path.regularity import Regularity, regularity
from qtraj.path.values import root

GAP = 1e-9
"""A relative speed or bend that is not proved positive, and below this at its least, cannot be told from zero."""

CHUNKS = (8, 35)
"""Of 30 intervals in which the largest value is sought: beside a proof, and where it has to stand for one."""

DIVISORS = ("S", "N", "H")
SIZES = ("speed", "cross_norm", "level")
"""What quantities divide by, among the invariants and among the measures of regularity."""

LIMITS = tuple(QUANTITIES.values())
COUNT = len(LIMITS)
ROWS = COUNT + len(DIVISORS)
"""Rows of findings: the limits in the registry's order, and what they divide by."""

NONE = ROWS
"""The row of what does not exist: the divisor of a quantity that has none."""

TIMES = 1 + max(entry.per_time for entry in LIMITS)
ORDERS = [*(entry.order for entry in LIMITS), 1, 2, 1]
PLACES = [ORDERS[:k].count(order) for k, order in enumerate(ORDERS)]
"""Among those that need as many derivatives: these are worked out once for all of them."""


class Entry(NamedTuple):
    """What the loop knows of a row: all whole numbers, read from one table."""

    unit: Any
    upright: Any
    divisor: Any
    pieces: Any
    order: Any
    place: Any


def _entries() -> np.ndarray:
    rows = []
    for k, x in enumerate(LIMITS):
        unit = (x.length + 1) * TIMES + x.per_time
        below = COUNT + SIZES.index(x.divisor) if x.divisor else NONE
        rows.append(Entry(unit, x.upright, below, 1 + 3 * (x.order == 4), ORDERS[k], PLACES[k]))
    rows += [Entry(TIMES, k == ROWS - 1, NONE, 1, ORDERS[k], PLACES[k]) for k in range(COUNT, ROWS)]
    return np.array(rows, np.int32)


ENTRIES = _entries()

Along = Callable[[Float[Array, "instants paths"], int, bool], Invariants]
"""(instants in [−1, 1], order, whether they refer to the vertical) → the invariants there, in units of `Scale`."""


class Scale(NamedTuple):
    """Units of length [m] and of time [s]: half the duration."""

    length: PerPath
    time: PerPath


class Findings(NamedTuple):
    """Codes, times [s] and values, a row each for the limits, the divisors and none."""

    codes: Int[Array, "rows paths"]
    times: Float[Array, "rows paths"]
    values: Float[Array, "rows paths"]


def present(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The indices of what is judged, divisors first and filled up with zeros, and their number."""
    given = [k for k, entry in enumerate(LIMITS) if entry.name in names]
    needed = sorted({int(Entry(*ENTRIES[k]).divisor) for k in given} - {NONE})
    index = np.zeros(ROWS, np.int32)
    index[: len(needed) + len(given)] = needed + given
    return index, np.asarray(len(needed) + len(given), np.int32)


def judge(
    along: Along,
    scale: Scale,
    limits: Float[Array, "limits paths"],
    upright: Bool[Array, " paths"],
    parts: Parts | None,
    index: Int[Array, " rows"],
    count: Int[Array, ""],
) -> Findings:
    """The findings on what `index` names, of paths whose derivatives are `along`; without `parts` nothing is proved."""
    paths, dtype = scale.time.shape, scale.time.dtype
    rows = (ROWS + 1, *paths)
    start = Findings(jnp.full(rows, PROVED, jnp.int32), jnp.zeros(rows, dtype), jnp.zeros(rows, dtype))
    units = _units(scale)

    def step(k: Array, found: Findings) -> Findings:
        which = _row(index, k)
        entry = Entry(*_row(jnp.asarray(ENTRIES), which))
        below: Findings = jax.tree.map(lambda x: _row(x, entry.divisor), found)
        bound, unit = _row(limits, jnp.minimum(which, COUNT - 1)), _row(units, entry.unit)
        provable = (upright | (entry.upright == 0)) & (parts is not None)
        answer = _proof(parts, entry, squared_bound(bound, unit), paths, dtype)
        chunks = jnp.where(jnp.all(provable), *CHUNKS)
        chunks = jnp.where((which >= COUNT) & jnp.all(provable & (answer.code == POSITIVE)), 0, chunks)
        hints = jnp.stack([answer.at, jnp.clip(below.times / scale.time - 1, -1.0, 1.0), answer.at])
        square, at = highest(lambda s: _squares(along, which, s), hints, chunks)
        proved = answer.code == POSITIVE
        value = root(square) / unit
        sampled = jnp.where(value <= bound, SAMPLED, jnp.where(value > bound, BROKEN, UNDECIDED))
        known = jnp.where(proved, PROVED, jnp.where(answer.code == NEGATIVE, BROKEN, UNDECIDED))
        code = jnp.where(provable, known, sampled)
        code = jnp.where((below.codes == UNDECIDED) & (code != BROKEN), UNDECIDED, code)
        undefined = below.codes == UNDEFINED
        code = jnp.where(undefined, UNDEFINED, code)
        # A divisor is proved positive, or cannot be told from zero, or is seen to be positive.
        seen = jnp.where(-square < GAP**2, UNDEFINED, jnp.where(provable, UNDECIDED, SAMPLED))
        code = jnp.where(which < COUNT, code, jnp.where(provable & proved, PROVED, seen))
        time = jnp.where(undefined, below.times, (at + 1) * scale.time)
        row = Findings(code.astype(jnp.int32), time, jnp.where(undefined, jnp.nan, value))
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_index_in_dim(x, y, which, 0), found, row)

    return jax.lax.fori_loop(0, count, step, start)


def _units(scale: Scale) -> Float[Array, "units paths"]:
    """What turns limits into numbers: every power of the units that a quantity has, lengths from −1, times from 0."""
    lengths = (scale.length, jnp.ones_like(scale.length), 1 / scale.length)
    times = [jnp.ones_like(scale.time)]
    for _ in range(TIMES - 1):
        times.append(times[-1] * scale.time)
    return jnp.stack([a * b for a in lengths for b in times])


def _row(x: Array, k: Array) -> Array:
    return jax.lax.dynamic_index_in_dim(x, k, keepdims=False)


def _proof(parts: Parts | None, entry: Entry, bound: tuple[Array, Array], paths: tuple[int, ...], dtype: Any) -> Answer:
    if parts is None:
        nothing = jnp.zeros(paths, dtype)
        return Answer(jnp.full(paths, UNDECIDED, jnp.int32), nothing, nothing, nothing)
    slacks = [*(partial(slack, x) for x in LIMITS), *(partial(_divisor, name) for name in DIVISORS)]

    def of_order(order: int) -> Callable[[Array, Array], ChebyshevModel]:
        builds = [build for build, needed in zip(slacks, ORDERS, strict=True) if needed == order]

        def build(centre: Array, half: Array) -> ChebyshevModel:
            derivatives = [r.on(centre, half) for r in parts.derivatives[:order]]
            chosen = [lambda r, build=build: build(Invariants([None, *r]), bound) for build in builds]
            return jax.lax.switch(entry.place, chosen, derivatives)

        return build

    branches = [of_order(order) for order in range(1, ORDER + 1)]
    build = lambda centre, half: jax.lax.switch(entry.order - 1, branches, centre, half)  # noqa: E731
    widest = jnp.full(paths, 2.0, dtype) / entry.pieces.astype(dtype)
    return prove_positive(build, widest)


def _divisor(name: str, i: Invariants, bound: tuple[Array, Array]) -> ChebyshevModel:
    return getattr(i, name)


def _squares(along: Along, which: Array, s: Float[Array, "instants paths"]) -> Float[Array, "instants paths"]:
    """The square of a quantity; of a divisor its relative size, negative."""

    @jax.jit
    def sizes(s: Array) -> Regularity:
        return regularity(along(s, 3, True), jnp.asarray(2.0, s.dtype))

    limits = [lambda s, x=x: jnp.broadcast_to(x.squared(along(s, x.order, x.upright)), s.shape) for x in LIMITS]
    divisors = [lambda s, name=name: -getattr(sizes(s), name) for name in SIZES]
    return jax.lax.switch(which, limits + divisors, s)
