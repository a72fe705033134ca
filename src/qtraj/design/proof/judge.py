"""Compute the findings on a batch of paths, with one executable for any set of limits.

The set of limits is an argument of the executable. A loop runs over the indices of the limits; in each iteration one
switch selects the inequality, and another switch selects the quantity. The index is never batched, so a switch compiles
to a branch, and limits that are not set cost no time.
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
from qtraj.algebra.positivity import NEGATIVE, POSITIVE, UNDECIDED as NOT_PROVED, Answer, prove_positive
from qtraj.design.proof import road
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.inequalities import ORDER, PathDerivatives, bounds, slack
from qtraj.design.proof.road import Bound
from qtraj.design.proof.search import find_maximum
from qtraj.foundation.indexing import element, with_element
from qtraj.path.frenet import Invariants, safe_root as root
from qtraj.path.path_quantity import LOAD, PathQuantity
from qtraj.path.quantity import QUANTITIES
from qtraj.path.regularity import Regularity, regularity
from qtraj.path.road_quantities import ROAD_QUANTITIES
from qtraj.path.vehicle import RoadParameters

MIN_RELATIVE_DIVISOR = 1e-9
"""A divisor that is not proved positive counts as zero if its relative size is below this value."""

CHUNKS = (8, 35)
"""Number of blocks of 30 intervals in the search for the maximum, with and without a proof."""

DIVISORS = ("S", "N", "H")
DIVISOR_SIZES = ("speed", "cross_norm", "level", LOAD)
"""The divisors of quantities: their names in `Invariants`, and the names of their relative sizes.

The load on the road has no name in `Invariants`.
"""

LIMITS = tuple(QUANTITIES.values())
LIMIT_COUNT = len(LIMITS)
ENTRY_COUNT = LIMIT_COUNT + len(DIVISOR_SIZES)
"""Number of entries; the entries are the limits in the order of the registry, followed by the divisors."""

UPRIGHT_DIVISOR = DIVISOR_SIZES.index("level")
"""The index of the first divisor that depends on the vertical."""

NO_DIVISOR = ENTRY_COUNT
"""The index of the divisor for quantities without a divisor."""

TIME_POWERS = 1 + max(entry.per_time for entry in LIMITS)
ROAD = ORDER + 1
"""The value in `ORDERS` for entries that depend on the road; they share the derivatives and the forces."""

ORDERS = [*(ROAD if entry.on_road else entry.order for entry in LIMITS), 1, 2, 1, ROAD]
PLACES = [ORDERS[:k].count(order) for k, order in enumerate(ORDERS)]
"""The index of each entry among the entries of the same order; entries of the same order share their derivatives."""

BRANCHES = [sum(order != ROAD for order in ORDERS[: k if ORDERS[k] != ROAD else None]) for k in range(ENTRY_COUNT)]
"""The index of each entry's branch in `_squares`; all entries that depend on the road share the last branch."""


class Entry(NamedTuple):
    """The integer constants of one entry.

    `unit` is the index of its unit in `_units`, `upright` indicates whether it depends on the vertical, `divisor` is
    the index of its divisor, and `pieces` is the minimum number of cells; `order`, `place` and `branch` are elements of
    `ORDERS`, `PLACES` and `BRANCHES`.
    """

    unit: Any
    upright: Any
    divisor: Any
    pieces: Any
    order: Any
    place: Any
    branch: Any


def _entries() -> np.ndarray:
    entries = []
    for k, x in enumerate(LIMITS):
        unit = (x.length + 1) * TIME_POWERS + x.per_time
        divisor = LIMIT_COUNT + DIVISOR_SIZES.index(x.divisor) if x.divisor else NO_DIVISOR
        entries.append(Entry(unit, x.upright, divisor, 1 + 3 * (x.order == 4), ORDERS[k], PLACES[k], BRANCHES[k]))
    entries += [
        Entry(TIME_POWERS, k >= LIMIT_COUNT + UPRIGHT_DIVISOR, NO_DIVISOR, 1, ORDERS[k], PLACES[k], BRANCHES[k])
        for k in range(LIMIT_COUNT, ENTRY_COUNT)
    ]
    return np.array(entries, np.int32)


ENTRIES = _entries()

Evaluate = Callable[[Float[Array, "instants paths"], int, bool], Invariants]
"""A function that returns invariants in units of `Scale`.

The arguments are instants in [−1, 1], the order of the derivatives, and whether the vertical is needed.
"""


class Scale(NamedTuple):
    """The units of length [m] and time [s] of each path; the unit of time is half the duration."""

    length: PerPath
    time: PerPath


class Findings(NamedTuple):
    """Status codes, times [s] and values of all entries: the limits, the divisors, and `NO_DIVISOR`."""

    codes: Int[Array, "entries paths"]
    times: Float[Array, "entries paths"]
    values: Float[Array, "entries paths"]


def indices(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the entries to judge (divisors first, padded with zeros), and their number."""
    limits = [k for k, entry in enumerate(LIMITS) if entry.name in names]
    divisors = sorted({int(Entry(*ENTRIES[k]).divisor) for k in limits} - {NO_DIVISOR})
    index = np.zeros(ENTRY_COUNT, np.int32)
    index[: len(divisors) + len(limits)] = divisors + limits
    return index, np.asarray(len(divisors) + len(limits), np.int32)


def judge(
    evaluate: Evaluate,
    scale: Scale,
    limits: Float[Array, "limits paths"],
    upright: Bool[Array, " paths"],
    derivatives: PathDerivatives | None,
    index: Int[Array, " entries"],
    count: Int[Array, ""],
    vehicle: RoadParameters | None,
) -> Findings:
    """Compute the findings on the first `count` entries of `index`, for the paths that `evaluate` evaluates.

    `upright` marks the paths with a vertical axis. Without polynomial `derivatives` no limit is proved. The parameters
    in `vehicle` have one value for each path, in SI units. If no limit depends on the road, `vehicle` is None, and the
    branches for limits on forces, friction and power are not compiled.
    """
    paths, dtype = scale.time.shape, scale.time.dtype
    shape = (ENTRY_COUNT + 1, *paths)
    start = Findings(jnp.full(shape, PROVED, jnp.int32), jnp.zeros(shape, dtype), jnp.zeros(shape, dtype))
    units = _units(scale)
    vehicle = None if vehicle is None else road.in_units(vehicle, scale.length, scale.time)

    def step(k: Array, findings: Findings) -> Findings:
        entry_index = element(index, k)
        entry = Entry(*element(ENTRIES, entry_index))
        divisor: Findings = element(findings, entry.divisor)
        bound, unit = element(limits, jnp.minimum(entry_index, LIMIT_COUNT - 1)), element(units, entry.unit)
        provable = (upright | (entry.upright == 0)) & (derivatives is not None)
        answer = _proof(derivatives, entry, bounds(bound, unit), vehicle, paths, dtype)
        chunks = jnp.where(jnp.all(provable), *CHUNKS)
        chunks = jnp.where((entry_index >= LIMIT_COUNT) & jnp.all(provable & (answer.code == POSITIVE)), 0, chunks)
        hints = jnp.stack([answer.at, jnp.clip(divisor.times / scale.time - 1, -1.0, 1.0), answer.at])
        square, at = find_maximum(lambda s: _squares(evaluate, vehicle, entry, s), hints, chunks)
        proved = answer.code == POSITIVE
        # The "square" of a signed quantity has the sign of the quantity.
        value = jnp.sign(square) * root(jnp.abs(square)) / unit
        sampled = jnp.where(value <= bound, SAMPLED, jnp.where(value > bound, BROKEN, UNDECIDED))
        proved_or_open = jnp.where(proved, PROVED, jnp.where(answer.code == NEGATIVE, BROKEN, UNDECIDED))
        code = jnp.where(provable, proved_or_open, sampled)
        code = jnp.where((divisor.codes == UNDECIDED) & (code != BROKEN), UNDECIDED, code)
        undefined = divisor.codes == UNDEFINED
        code = jnp.where(undefined, UNDEFINED, code)
        # The status of a divisor that is not proved positive depends on its smallest relative size at the samples.
        evidence = jnp.where(-square < MIN_RELATIVE_DIVISOR**2, UNDEFINED, jnp.where(provable, UNDECIDED, SAMPLED))
        code = jnp.where(entry_index < LIMIT_COUNT, code, jnp.where(provable & proved, PROVED, evidence))
        time = jnp.where(undefined, divisor.times, (at + 1) * scale.time)
        finding = Findings(code.astype(jnp.int32), time, jnp.where(undefined, jnp.nan, value))
        return with_element(findings, entry_index, finding)

    return jax.lax.fori_loop(0, count, step, start)


def _units(scale: Scale) -> Float[Array, "units paths"]:
    """Return the products of powers of both units: the powers −1 to 2 of 1/length times nonnegative powers of time."""
    inverse = 1 / scale.length
    lengths = jnp.stack([scale.length, jnp.ones_like(scale.length), inverse, inverse * inverse])
    times = [jnp.ones_like(scale.time)]
    for _ in range(TIME_POWERS - 1):
        times.append(times[-1] * scale.time)
    return (lengths[:, None] * jnp.stack(times)[None]).reshape(-1, *scale.time.shape)


def _proof(
    derivatives: PathDerivatives | None,
    entry: Entry,
    bound: Bound,
    vehicle: RoadParameters | None,
    paths: tuple[int, ...],
    dtype: Any,
) -> Answer:
    if derivatives is None:
        nothing = jnp.zeros(paths, dtype)
        return Answer(jnp.full(paths, NOT_PROVED, jnp.int32), nothing, nothing, nothing)
    slacks = [*(partial(slack, x) for x in LIMITS), *(partial(_divisor, name) for name in DIVISORS)]

    def of_order(order: int) -> Callable[[Array, Array], ChebyshevModel]:
        builds = [build for build, needed in zip(slacks, ORDERS, strict=False) if needed == order]

        def build(centre: Array, half: Array) -> ChebyshevModel:
            vectors = [r.on(centre, half) for r in derivatives.derivatives[:order]]
            chosen = [lambda r, build=build: build(Invariants([None, *r]), bound) for build in builds]
            return jax.lax.switch(entry.place, chosen, vectors)

        return build

    def on_road(centre: Array, half: Array) -> ChebyshevModel:
        vectors = [r.on(centre, half) for r in derivatives.derivatives[:2]]
        pace = 1 if derivatives.pace is None else derivatives.pace.on(centre, half)[0]
        return road.road_slack(entry.place, Invariants([None, *vectors], vehicle=vehicle, pace=pace), bound, half)

    branches = [*(of_order(order) for order in range(1, ORDER + 1)), *([] if vehicle is None else [on_road])]
    build = lambda centre, half: jax.lax.switch(entry.order - 1, branches, centre, half)  # noqa: E731
    max_width = jnp.full(paths, 2.0, dtype) / entry.pieces.astype(dtype)
    return prove_positive(build, max_width)


def _divisor(name: str, i: Invariants, bound: Bound) -> ChebyshevModel:
    return getattr(i, name)


def _squares(
    evaluate: Evaluate, vehicle: RoadParameters | None, entry: Entry, s: Float[Array, "instants paths"]
) -> Float[Array, "instants paths"]:
    """Return the square of a quantity (with its sign, if it is signed), or the negative relative size of a divisor."""

    @jax.jit
    def sizes(s: Array) -> Regularity:
        return regularity(evaluate(s, 3, True), jnp.asarray(2.0, s.dtype))

    def on_road(s: Array) -> Array:
        i = evaluate(s, 2, True)
        i.vehicle = jax.tree.map(lambda x: x[None], vehicle)
        i.contact.compute()
        return jax.lax.switch(entry.place, [partial(of, x, i) for x in ROAD_QUANTITIES] + [partial(_no_load, i)])

    def of(x: PathQuantity, i: Invariants) -> Array:
        if x.signed is None:
            return jnp.broadcast_to(x.squared(i), s.shape)
        value = x.value(i)
        return value * jnp.abs(value)

    limits = [lambda s, x=x: of(x, evaluate(s, x.order, x.upright)) for x in LIMITS if not x.on_road]
    divisors = [lambda s, name=name: -getattr(sizes(s), name) for name in DIVISOR_SIZES[:-1]]
    return jax.lax.switch(entry.branch, [*limits, *divisors, *([] if vehicle is None else [on_road])], s)


def _no_load(i: Invariants) -> Array:
    return -road.relative_load(i)
