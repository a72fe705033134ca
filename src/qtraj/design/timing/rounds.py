"""Repeat the search for a timing with tighter limits, until they are satisfied between the nodes, too."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from qtraj.design.solve.convex import STALLED, VIOLATED, State, begun, continued, solve
from qtraj.design.timing.boundedness import unbounded
from qtraj.design.timing.constraint_values import squares, tightened, used
from qtraj.design.timing.constraints import Parts
from qtraj.design.timing.initial import initial
from qtraj.design.timing.program import Program
from qtraj.design.timing.spline import ORDERS, Within
from qtraj.design.timing.tables import CHECKED, Tables
from qtraj.foundation.namespace import namespace

GAPS = (1e-5, 1e-8)
"""Relative optimality errors at the end of the first search and of all further searches."""

LEAST_ERROR = 0.1
"""With chosen cells, an optimality error of at most this fraction of the tolerance is small enough, also in a draft."""

FINEST = 128
"""With more cells than this, the allowed error of the last search grows with the square of the number of cells, because
rounding errors in the jerk prevent an optimality error of 1e-8."""

LARGEST_GAP = 1e-6
"""Largest allowed error of the last search without a limit on the jerk."""

ROUNDS, ALLOWED = 10, 8e-6
"""Maximum number of searches, and the relative violation between nodes up to which no further search is needed."""

FAILURES = 2
"""Number of searches without convergence, after which no further search is begun."""


class Rough(NamedTuple):
    """Relative errors at which searches end, where they are larger than the usual ones.

    `draft` and `gap` are the optimality errors of the first search and of all others; a search ends only if the limits
    are exceeded by no more at the nodes. `violation` is allowed between the nodes; the timing is slowed down by it.
    `slack` is the argument `least` of `continued`.
    """

    draft: float = 0.0
    gap: float = 0.0
    violation: float = 0.0
    slack: float = 1.0

    def times(self, tolerance: float) -> "Rough":
        """Return the same with the errors multiplied by a tolerance."""
        return Rough(tolerance * self.draft, tolerance * self.gap, tolerance * self.violation, self.slack)


NOT_ROUGH = Rough()

COLUMNS = 256
"""Number of cells whose limits are checked together: their data fit into the cache of the processor."""

OVER = 2.0
"""After a search, limits are tightened by `OVER` times the relative violation at `CHECKED` points of each cell. From
the fourth search on, this factor doubles after each search, because a peak far from the nodes decreases only if the
limits at the nodes become much tighter."""


def last_gap(cells: int, jerk: bool) -> float:
    """Return the relative optimality error at which the last search ends; `jerk` is whether the jerk is limited."""
    return min(GAPS[-1] * max(1.0, (cells / FINEST) ** 2), np.inf if jerk else LARGEST_GAP)


class Result(NamedTuple):
    """The result of all searches.

    The fields up to `error` are those of the last `State`. The last search divided the limits by the factors `used`.
    `usage` is the largest result of `constraints.used` in each cell.
    """

    coefficients: Float[Any, "*batch cells+3"]
    slacks: Float[Any, "*batch count 2 cells+1"]
    multipliers: Float[Any, "*batch count 2 cells+1"]
    steps: Int[Any, "*batch"]
    error: Float[Any, "*batch"]
    used: Float[Any, "*batch count cells"]
    usage: Float[Any, "*batch limits cells"]
    unbounded: Bool[Any, "*batch"]


def shapes(program: Program, places: Parts) -> Result:
    """Return the shapes and types of the result of a search for one problem."""
    (cells, count), dtype = (program.largest.shape[-1] - 1, program.constraints.per_node), program.weights.dtype
    nodes, limits = (count, 2, cells + 1), places.upper.shape[0] + count - 1
    of_type = [(cells + 3,), nodes, nodes, jnp.int32, (), (count, cells), (limits, cells), bool]
    return Result(
        *(jax.ShapeDtypeStruct(x, dtype) if isinstance(x, tuple) else jax.ShapeDtypeStruct((), x) for x in of_type)
    )


def searched(
    t: Tables,
    stops: Bool[Any, " 2"],
    start: Any,
    of_nodes: tuple[Any, ...],
    between: Parts,
    rounds: int = ROUNDS,
    held: tuple[float | None, float | None] = (None, None),
    rough: Rough = NOT_ROUGH,
) -> Result:
    """Repeat the search for a batch of problems until the limits are satisfied between the nodes, too.

    `start` are the first coefficients, or the result of the first search for one problem, or None. `of_nodes` contains
    the fields of `Program` after the nodes. The batch axis of the arguments is the first axis. `held` are the fixed
    values of u̇² at the ends.
    """
    of_nodes, between = jax.tree.map(lambda x: np.ascontiguousarray(np.moveaxis(x, 0, -3)), (of_nodes, between))
    program, within = Program(t.nodes, *of_nodes), t.within
    cells, count, jerk = within.cells, program.constraints.per_node, program.constraints.orders > 2
    with np.errstate(all="ignore"):  # a failed search ends with NaN
        state = _first_iterate(program, start, held)
        size, begins = len(state.steps), int(isinstance(start, Result))
        factors = np.ones((count, size, cells))
        used, usage = factors.copy(), np.zeros((between.upper.shape[0] + count - 1, size, cells))
        if begins:
            usage[:, 0] = start.usage
            factors *= _tighter(between, usage, state.error < max(GAPS[0], rough.draft), 0)
        which, own, places, failures = np.arange(size), program, between, np.zeros(size, int)
        for search in range(begins, rounds):
            imposed = own._replace(constraints=tightened(own.constraints, at_nodes(factors[:, which])))
            usual, larger = (GAPS[0], rough.draft) if search == 0 else (last_gap(cells, jerk), rough.gap)
            enough = np.full(which.size, max(usual, larger))
            first = continued(imposed, state.chosen(which), rough.slack)
            last = solve(imposed, first, enough, max(VIOLATED, larger))
            # A search that fails after a good one leaves the result of this one, which is slowed down.
            good = np.isfinite(last.z).all(axis=1) | (search == 0)
            state.store(which[good], last.chosen(good))
            found = between_nodes(places, within, state.z[which])
            used[:, which[good]], usage[:, which] = factors[:, which[good]], found
            factors[:, which] *= _tighter(places, found, last.error < np.maximum(enough, STALLED), search)
            failures[which] += ~(last.error < np.maximum(enough, STALLED))
            if search + 1 < len(GAPS):
                continue
            goes_on = (
                (found.max(axis=(0, 2)) > 1 + max(ALLOWED, rough.violation))
                & np.isfinite(last.error)
                & good
                & (failures[which] < FAILURES)
            )
            if not goes_on.all():
                which, own = which[goes_on], own.chosen(goes_on)
                places = jax.tree.map(lambda x, goes_on=goes_on: x[..., goes_on, :, :], places)
            if not which.size:
                break
        slow = stops | np.array([x is not None for x in held])
        free = unbounded(program, program.at_nodes(state.z)[0], slow)
    nodes = (np.moveaxis(x, 1, 0) for x in (*state[1:3], used, usage))
    slack, multiplier, used, usage = nodes
    return Result(state.z, slack, multiplier, *state[3:], used, usage, free)


def _first_iterate(program: Program, start: Any, held: tuple[float | None, float | None]) -> State:
    if not isinstance(start, Result):
        coefficients = initial(program) if start is None else start[None]
        for end, value in zip((0, -1), held, strict=True):
            coefficients[:, end] = coefficients[:, end] if value is None else value
        return begun(program, coefficients)
    slacks, multipliers = (np.array(x)[:, None] for x in (start.slacks, start.multipliers))
    own = (np.array(x)[None] for x in (start.coefficients, start.steps, start.error))
    coefficients, steps, error = own
    return State(coefficients, slacks, multipliers, steps, error)


def _tighter(
    between: Parts, found: Float[Any, "limits *batch cells"], converged: Bool[Any, "*batch"], search: int
) -> Float[Any, "count *batch cells"]:
    """Return the factors by which limits are tightened after a search; violations of other searches mean nothing."""
    excess = np.where(converged[:, None], grouped(between, found), 1.0)
    return np.where(excess > 1, 1 + OVER * 2.0 ** max(search - 2, 0) * (excess - 1), 1.0)


def lost(between: Parts, r: Result) -> Float[np.ndarray, " cells"]:
    """Return the times [s] that are lost in the cells of one problem, because its limits are tightened.

    The multipliers are the derivatives of the minimum duration with respect to the limits. Violations between the nodes
    count as if the limits were tightened already.
    """
    factors = r.used * _tighter(between, r.usage[:, None], np.ones(1, bool), 0)[:, 0]
    at, inside = np.moveaxis(r.multipliers * np.log(at_nodes(factors)), -2, 0)
    nodes = squares(between)[:, None] * np.stack([at, inside])
    each, cells = nodes.sum(axis=1), factors.shape[-1]
    return each[1, :cells] + 0.5 * (each[0, :-1] + each[0, 1:])


def between_nodes(between: Parts, within: Within, coefficients: Any) -> Float[Any, "limits *batch cells"]:
    """Return the maxima of `used` in each cell, from samples and parabolas through them."""
    third = between.jerk is not None or (between.formulas is not None and between.formulas.third)
    v = within.values(coefficients, CHECKED, ORDERS if third else 2)
    constant = all(x is None for x in (between.road, between.bends, between.combined, between.formulas))
    if namespace(coefficients, between.upper) is not np or not constant or within.cells <= COLUMNS:
        return _peaks(used(between, v))
    blocks = [slice(k, k + COLUMNS) for k in range(0, within.cells, COLUMNS)]
    found = [_peaks(used(jax.tree.map(lambda x, own=own: x[..., own], between), v[..., own])) for own in blocks]
    return np.concatenate(found, axis=-1)


def _peaks(rows: Float[Any, "limits *batch {CHECKED} cells"]) -> Float[Any, "limits *batch cells"]:
    """Return the maxima over the samples of each cell, and over the parabolas through three of them."""
    xp = namespace(rows)
    before, at, after = rows[..., :-2, :], rows[..., 1:-1, :], rows[..., 2:, :]
    bend, change = 2 * at - before - after, after - before
    peak = (bend > 0) & (xp.abs(change) <= 2 * bend)  # the vertex is between the three samples
    rise = xp.where(peak, change**2 / (8 * xp.where(peak, bend, 1.0)), 0.0)
    return xp.maximum(xp.max(rows, axis=-2), xp.max(at + rise, axis=-2))


def grouped(between: Parts, rows: Float[Any, "limits *batch cells"]) -> Float[Any, "count *batch cells"]:
    """Return the usage of each constraint; the upper bounds on a are one constraint."""
    xp, count = namespace(rows), between.upper.shape[0]
    return xp.concatenate([xp.max(rows[:count], axis=0, initial=0.0)[None], rows[count:]])


def at_nodes(factors: Float[Any, "count *batch cells"]) -> Float[Any, "count *batch 2 cells+1"]:
    """Return the factors at the nodes; a knot has the larger factor of its two cells."""
    xp = namespace(factors)
    one = xp.ones_like(factors[..., :1])
    before, after = xp.concatenate([one, factors], axis=-1), xp.concatenate([factors, one], axis=-1)
    return xp.stack([xp.maximum(before, after), after], axis=-2)
