"""The findings on each segment of a route, segments standing for paths; where one starts or ends at a stop, too.

At a stop the velocity vanishes, and with it what most quantities divide by. A segment whose velocity vanishes at an end
to the order m is r' = u^m·q there, with u the time from that end, and q has the direction of r'. So the upright and the
natural frame turn as on a path with the velocity q; and across and along the path the acceleration is r'' against the
direction of q. Both are judged with q in the place of r', which does not vanish. The curvature has no such form: it
grows without bound at a stop, unless the path is straight there.
"""

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.algebra.cell_polynomial import CellPolynomial, cell_polynomial
from qtraj.design.proof.certificate import PROVED, UNDEFINED
from qtraj.design.proof.inequalities import PathDerivatives, Vectors, centred, path_derivatives
from qtraj.design.proof.judge import LIMIT_COUNT, LIMITS, Findings, Scale, indices, judge
from qtraj.foundation import cores
from qtraj.path.frenet import Invariants
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.quantity import QUANTITIES
from qtraj.path.stops import Segments
from qtraj.path.vehicle import RoadParameters

DIRECTIONS = ("slope", "angular_rate", "angular_acceleration", "yaw_rate", "yaw_acceleration")
"""What depends on the direction of the velocity alone."""

ACROSS = (
    "lateral_acceleration",
    "longitudinal_acceleration",
    *(name for name, entry in QUANTITIES.items() if entry.needs_vehicle),
)
"""What is the acceleration against that direction, and the speed."""

MAX_ORDER = 8
"""The highest order to which a velocity vanishes whose forces are known; it is never reached in practice."""

ROUNDED = 3
"""Roundings of each coefficient of Q, the integral of q."""

BLOCK_SIZE = 64
"""Segments that are judged at once, small enough for the processor's cache."""

VANISHES = 64 * float(np.finfo(float).eps)
"""A velocity or acceleration at an end below this part of the segment's size is zero to rounding."""


class Found(NamedTuple):
    """Codes, times since the segment's start [s] and values, a row for each segment, a column for each limit."""

    codes: Int[np.ndarray, "segments limits"]
    times: Float[np.ndarray, "segments limits"]
    values: Float[np.ndarray, "segments limits"]


def findings(segments: Segments, limits: dict[str, float], road: RoadParameters | None) -> Found:
    """The findings on every segment against `limits`, by name; `road` are the numbers of a vehicle if they need one."""
    names = tuple(limits)
    table = np.array([limits.get(entry.name, 1.0) for entry in LIMITS])
    given = [entry for entry in LIMITS if entry.name in names]
    order = [entry.name for entry in given]
    columns = np.array([k for k, entry in enumerate(LIMITS) if entry.name in names])
    c, h = segments.coefficients, segments.durations
    still: Any = ~c[:, 1:].any(axis=(1, 2))
    groups = _stopping(c, h, still)
    directions = c.copy()
    directions[still, 1] = 1.0 / h[still, None]  # any straight, whose proofs are short
    for _, stop, about in groups:
        directions[stop] = _integrals(about)
    moving = np.zeros(len(h), int)
    found = Found(
        *(np.array(x[:, columns]) for x in _judged(directions, directions, h, table, road, names, False, moving))
    )
    found.codes[still], found.times[still], found.values[still] = PROVED, 0.0, 0.0
    free = tuple(entry.name for entry in given if entry.divisor is None)
    somewhere = (*DIRECTIONS, *ACROSS)
    nowhere = _places(order, [entry.name for entry in given if entry.divisor and entry.name not in somewhere])
    for end, stop, about in groups:
        # About the end the time runs backwards: the direction of the velocity is the opposite one.
        own = -directions[stop] if end else directions[stop]
        for chosen, path, along, keeps in (
            (free, c[stop], c[stop], False),
            (tuple(name for name in order if name in ACROSS), about, own, True),
        ):
            if chosen:
                again = _judged(path, along, h[stop], table, road, chosen, keeps, _order(about))
                places = _places(order, chosen)
                rows, from_columns = np.ix_(stop, places), columns[places]
                found.codes[rows], found.values[rows] = again.codes[:, from_columns], again.values[:, from_columns]
                times = again.times[:, from_columns]
                found.times[rows] = h[stop, None] - times if end and keeps else times
        if end:
            turned = np.ix_(stop, _places(order, [name for name in order if name in DIRECTIONS]))
            found.times[turned] = h[stop, None] - found.times[turned]
        gone = np.ix_(stop, nowhere)
        found.codes[gone], found.values[gone] = UNDEFINED, np.nan
        found.times[gone] = h[stop, None] if end else 0.0
    return found


def _places(order: list[str], names: Sequence[str]) -> np.ndarray:
    """Where names stand in an order."""
    return np.array([order.index(name) for name in names], np.intp)


def _stopping(c: np.ndarray, h: np.ndarray, still: np.ndarray) -> list[tuple[bool, np.ndarray, np.ndarray]]:
    """Segments that stop at their start, and at their end: which, and their coefficients in the time from there."""
    groups = []
    at_start = _vanishing(c, h) & ~still
    candidates = np.flatnonzero(~still & (_end_speeds(c, h) <= _sizes(c, h) / h * 1e3 * VANISHES))
    turned = np.array([_exactly_reversed(c[i], h[i]) for i in candidates]).reshape(-1, *c.shape[1:])
    at_end = np.zeros(len(c), bool)
    ends = _vanishing(turned, h[candidates])
    at_end[candidates[ends]] = True
    one, other = np.flatnonzero(at_start & ~at_end), candidates[ends & ~at_start[candidates]]
    if one.size:
        groups.append((False, one, _without_rounding(c[one], h[one])))
    if other.size:
        groups.append((True, other, _without_rounding(turned[ends & ~at_start[candidates]], h[other])))
    return groups


def _sizes(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The sizes of segments [m] by their coefficients."""
    powers = h[:, None, None] ** np.arange(c.shape[1])[None, :, None]
    return np.sum(np.abs(c[:, 1:]) * powers[:, 1:], axis=(1, 2))


def _end_speeds(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    k = np.arange(1, c.shape[1])
    return np.linalg.norm(np.sum(c[:, 1:] * (k * h[:, None] ** (k - 1))[..., None], axis=1), axis=-1)


def _vanishing(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Whether the velocity at the start is zero to rounding."""
    return np.linalg.norm(c[:, 1], axis=-1) * h <= VANISHES * _sizes(c, h)


def _without_rounding(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The coefficients with those of the velocity, and of a vanishing acceleration after it, exactly zero."""
    c, sizes = c.copy(), _sizes(c, h)
    c[:, 1] = 0.0
    rest = np.linalg.norm(c[:, 2], axis=-1) * h**2 <= VANISHES * sizes
    c[rest, 2] = 0.0
    return c


def _integrals(c: np.ndarray) -> np.ndarray:
    """Coefficients of Q with Q' = q = r'/u^m, of segments whose first coefficients vanish."""
    found = np.zeros_like(c)
    for i, row in enumerate(c):
        powers = np.flatnonzero(row[1:].any(axis=-1)) + 1
        m = int(powers[0]) - 1 if powers.size else 0
        k = np.arange(m + 1, c.shape[1])
        found[i, 1 : c.shape[1] - m] = row[m + 1 :] * (k / (k - m))[:, None]
    return found


def _order(c: np.ndarray) -> np.ndarray:
    """The order to which the velocity vanishes at the start of each segment."""
    some = c[:, 1:].any(axis=-1)
    return np.minimum(np.argmax(some, axis=1), MAX_ORDER)


def _exactly_reversed(c: np.ndarray, h: float) -> np.ndarray:
    """The coefficients in the time from the end, each rounded once."""
    span, found = Fraction(float(h)), np.zeros_like(c)
    for axis in range(c.shape[1]):
        terms = [Fraction(float(x)) for x in c[:, axis]]
        for k in range(len(terms) - 1):
            for i in range(len(terms) - 2, k - 1, -1):
                terms[i] += span * terms[i + 1]
        found[:, axis] = [float(x) * (-1) ** k for k, x in enumerate(terms)]
    return found


def _judged(
    c: np.ndarray,
    directions: np.ndarray,
    h: np.ndarray,
    table: np.ndarray,
    road: RoadParameters | None,
    names: tuple[str, ...],
    keeps: bool,
    orders: np.ndarray,
) -> Findings:
    """Findings (rows, LIMIT_COUNT) on segments whose velocity has the direction of the derivative of `directions`.

    With `keeps` the acceleration is that of `c`, and not the second derivative of `directions`, and the velocity is
    u^order times that of `directions`.
    """
    index, count = indices(names)
    keep = np.full(len(h), keeps)
    rows = tuple(np.ascontiguousarray(x) for x in (c, directions, h, keep, orders * keeps))
    blocks = cores.split(np.arange(len(h)), BLOCK_SIZE)
    numbers = None if road is None else RoadParameters(*(np.asarray(x, float) for x in road))
    calls = [(cores.take(rows, block, BLOCK_SIZE), table, numbers, index, count) for block in blocks]
    found: Any = None
    for block, answers in zip(blocks, cores.map_blocks(_compiled, calls), strict=True):
        found = cores.allocate(len(h), answers) if found is None else found
        cores.put(found, block, answers)
    return found


@jax.jit
def _compiled(rows: Any, table: Array, road: RoadParameters | None, index: Array, count: Array) -> Findings:
    c, directions, h, keeps, orders = rows
    path, known = _parts(c, h), _parts(directions, h)
    later = zip(path.derivatives[1:], known.derivatives[1:], strict=True)
    kept = [jax.tree.map(lambda a, b: jnp.where(keeps, a, b), p, q) for p, q in later]
    length = jnp.where(keeps, path.length, known.length)
    pace = None if road is None else _pace(orders, known.unit, known.length / length)
    known = PathDerivatives([known.derivatives[0], *kept], length, known.unit, pace)

    def along(s: Array, order: int, upright: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in known.derivatives[:order])]
        return Invariants(derivatives, pace=1 if pace is None else pace.at(s)[0])

    limits = jnp.broadcast_to(table[:, None], (LIMIT_COUNT, h.shape[0]))
    upright = jnp.ones(h.shape, bool)
    vehicle = None if road is None else RoadParameters(*(jnp.broadcast_to(x, h.shape) for x in road))
    found = judge(along, Scale(known.length, known.unit), limits, upright, known, index, count, vehicle)
    return jax.tree.map(lambda x: x[:LIMIT_COUNT].T, found)


def _pace(orders: Int[Array, " rows"], unit: Array, ratio: Array) -> CellPolynomial:
    """u^order times the ratio of two lengths, with u = unit·(s + 1) the time from the stop [s]."""
    powers = jnp.arange(MAX_ORDER + 1, dtype=orders.dtype)[:, None]
    coefficients = jnp.where(powers == orders[None], ratio * unit ** orders.astype(unit.dtype), 0.0)
    c = centred(coefficients[:, None])[None]
    return cell_polynomial(c, 64 * float(jnp.finfo(c.dtype).eps) * jnp.sum(jnp.abs(c[0]), axis=0))


def _parts(c: Float[Array, "rows terms 3"], h: Float[Array, " rows"]) -> PathDerivatives:
    x, y, z = (c[:, :, k].T for k in range(3))
    # Where a segment begins does not count, and must not coarsen what does.
    x, y = x.at[0].set(0.0), y.at[0].set(0.0)
    return path_derivatives(MovingPolynomials(x, y, z, jnp.zeros_like(x[:1])), h, ROUNDED)


def worst(codes: Int[np.ndarray, "segments limits"]) -> Int[np.ndarray, " limits"]:
    """The code of the whole of each limit: the worst of its segments."""
    rank = np.array([0, 1, 4, 2, 3])  # proved, sampled, broken, undecided, undefined
    place = np.argmax(rank[codes], axis=0)
    return codes[place, np.arange(codes.shape[1])]
