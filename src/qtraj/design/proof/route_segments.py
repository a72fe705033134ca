"""The findings on each segment of a route, including segments that start or end at a stop.

At a stop the velocity vanishes, and most quantities divide by it. If the velocity of a segment has a zero of order m at
an end, then r' = u^m·q, where u is the time from that end, and q has the direction of r' and does not vanish. So the
upright and the natural frame rotate as on a path with velocity q, and the lateral and longitudinal acceleration are the
components of r'' relative to the direction of q. These quantities are certified with q in place of r'. This does not
apply to the curvature: at a stop it grows without bound, unless the path is straight there.
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
"""Quantities that depend only on the direction of the velocity."""

COMPONENTS = (
    "lateral_acceleration",
    "longitudinal_acceleration",
    *(name for name, entry in QUANTITIES.items() if entry.needs_vehicle),
)
"""Components of the acceleration relative to that direction, and forces, which depend on the speed as well."""

MAX_ORDER = 8
"""The highest order of a zero of the velocity for which forces are computed; lower ones occur in practice."""

N_ROUNDINGS = 3
"""Number of rounding operations in each coefficient of Q, the integral of q."""

BLOCK_SIZE = 64
"""Number of segments that are processed together, small enough for the processor's cache."""

ZERO = 64 * float(np.finfo(float).eps)
"""A velocity or acceleration at an end counts as zero below this fraction of the size of the segment."""


class SegmentFindings(NamedTuple):
    """Codes, times [s] since the start of the segment, and values; one row per segment, one column per limit."""

    codes: Int[np.ndarray, "segments limits"]
    times: Float[np.ndarray, "segments limits"]
    values: Float[np.ndarray, "segments limits"]


def findings(segments: Segments, limits: dict[str, float], road: RoadParameters | None) -> SegmentFindings:
    """The findings on every segment, in the order of the registry; `limits` are bounds by name.

    `road` are the numbers of the vehicle if a limit needs one.
    """
    entries = [entry for entry in LIMITS if entry.name in limits]
    names = [entry.name for entry in entries]
    bounds = np.array([limits.get(entry.name, 1.0) for entry in LIMITS])
    columns = np.array([k for k, entry in enumerate(LIMITS) if entry.name in limits])
    c, h = segments.coefficients, segments.durations
    parked: Any = ~c[:, 1:].any(axis=(1, 2))
    groups = _stopping(c, h, parked)
    directions = c.copy()
    directions[parked, 1] = 1.0 / h[parked, None]  # a straight line, which is cheap to certify
    for group in groups:
        directions[group.rows] = _integrals(group.coefficients)
    first = _judged(directions, directions, h, bounds, names, road)
    result = SegmentFindings(*(np.array(x[:, columns]) for x in first))
    result.codes[parked], result.times[parked], result.values[parked] = PROVED, 0.0, 0.0
    without_divisor = [entry.name for entry in entries if entry.divisor is None]
    components = [name for name in names if name in COMPONENTS]
    defined = (*without_divisor, *DIRECTIONS, *COMPONENTS)
    undefined = _places(names, [name for name in names if name not in defined])
    for at_end, rows, coefficients in groups:
        durations = h[rows, None]
        of_path = (without_divisor, c[rows], c[rows], False)
        # Time is counted back from the end, so the velocity has the opposite direction.
        direction = -directions[rows] if at_end else directions[rows]
        of_acceleration = (components, coefficients, direction, True)
        for chosen, path, direction, keep_acceleration in (of_path, of_acceleration):
            if chosen:
                orders = _order(coefficients)
                update = _judged(path, direction, h[rows], bounds, chosen, road, keep_acceleration, orders)
                places = _places(names, chosen)
                cells, source = np.ix_(rows, places), columns[places]
                result.codes[cells], result.values[cells] = update.codes[:, source], update.values[:, source]
                times = update.times[:, source]
                result.times[cells] = durations - times if at_end and keep_acceleration else times
        if at_end:  # these times were measured from the end
            cells = np.ix_(rows, _places(names, [name for name in names if name in DIRECTIONS]))
            result.times[cells] = durations - result.times[cells]
        cells = np.ix_(rows, undefined)
        result.codes[cells], result.values[cells] = UNDEFINED, np.nan
        result.times[cells] = durations if at_end else 0.0
    return result


def _places(order: list[str], names: Sequence[str]) -> np.ndarray:
    """The indices of `names` in `order`."""
    return np.array([order.index(name) for name in names], np.intp)


class _Stopping(NamedTuple):
    """The segments `rows` with a stop at their start, or at their end if `at_end`.

    `coefficients` are those of polynomials in the time from the stop.
    """

    at_end: bool
    rows: np.ndarray
    coefficients: np.ndarray


def _stopping(c: np.ndarray, h: np.ndarray, parked: np.ndarray) -> list[_Stopping]:
    """The moving segments that stop at one end."""
    groups = []
    at_start = _vanishing(c, h) & ~parked
    candidates = np.flatnonzero(~parked & (_end_speeds(c, h) <= _sizes(c, h) / h * 1e3 * ZERO))
    reversed_c = np.array([_exactly_reversed(c[i], h[i]) for i in candidates]).reshape(-1, *c.shape[1:])
    stops_at_end = _vanishing(reversed_c, h[candidates])
    at_end = np.zeros(len(c), bool)
    at_end[candidates[stops_at_end]] = True
    starting, only_end = np.flatnonzero(at_start & ~at_end), stops_at_end & ~at_start[candidates]
    ending = candidates[only_end]
    if starting.size:
        groups.append(_Stopping(False, starting, _without_rounding(c[starting], h[starting])))
    if ending.size:
        groups.append(_Stopping(True, ending, _without_rounding(reversed_c[only_end], h[ending])))
    return groups


def _sizes(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The sizes of segments [m]: sums of the magnitudes of their terms at the end."""
    powers = h[:, None, None] ** np.arange(c.shape[1])[None, :, None]
    return np.sum(np.abs(c[:, 1:]) * powers[:, 1:], axis=(1, 2))


def _end_speeds(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The speeds at the ends of segments [m/s]."""
    k = np.arange(1, c.shape[1])
    return np.linalg.norm(np.sum(c[:, 1:] * (k * h[:, None] ** (k - 1))[..., None], axis=1), axis=-1)


def _vanishing(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Whether the velocity at the start is zero up to rounding."""
    return np.linalg.norm(c[:, 1], axis=-1) * h <= ZERO * _sizes(c, h)


def _without_rounding(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The coefficients with exact zeros for the velocity, and for an acceleration that is zero up to rounding."""
    c, sizes = c.copy(), _sizes(c, h)
    c[:, 1] = 0.0
    unaccelerated = np.linalg.norm(c[:, 2], axis=-1) * h**2 <= ZERO * sizes
    c[unaccelerated, 2] = 0.0
    return c


def _integrals(c: np.ndarray) -> np.ndarray:
    """Coefficients of Q with Q' = q = r'/u^m, for segments whose first m coefficients of r' are zero."""
    result = np.zeros_like(c)
    for i, row in enumerate(c):
        powers = np.flatnonzero(row[1:].any(axis=-1)) + 1
        m = int(powers[0]) - 1 if powers.size else 0
        k = np.arange(m + 1, c.shape[1])
        result[i, 1 : c.shape[1] - m] = row[m + 1 :] * (k / (k - m))[:, None]
    return result


def _order(c: np.ndarray) -> np.ndarray:
    """The order to which the velocity vanishes at the start of each segment."""
    some = c[:, 1:].any(axis=-1)
    return np.minimum(np.argmax(some, axis=1), MAX_ORDER)


def _exactly_reversed(c: np.ndarray, h: float) -> np.ndarray:
    """The coefficients for the time before the end, each rounded once."""
    duration, result = Fraction(float(h)), np.zeros_like(c)
    for axis in range(c.shape[1]):
        terms = [Fraction(float(x)) for x in c[:, axis]]
        for k in range(len(terms) - 1):
            for i in range(len(terms) - 2, k - 1, -1):
                terms[i] += duration * terms[i + 1]
        result[:, axis] = [float(x) * (-1) ** k for k, x in enumerate(terms)]
    return result


def _judged(
    c: np.ndarray,
    directions: np.ndarray,
    h: np.ndarray,
    bounds: np.ndarray,
    names: Sequence[str],
    road: RoadParameters | None,
    keep_acceleration: bool = False,
    orders: int | np.ndarray = 0,
) -> Findings:
    """Findings (rows, LIMIT_COUNT) on segments `c`, with the derivative of `directions` in place of the velocity.

    The higher derivatives are also taken from `directions`, or with `keep_acceleration` from `c`. The velocity is then
    u^order times the derivative of `directions`, with u the time from the stop.
    """
    index, count = indices(tuple(names))
    keep = np.full(len(h), keep_acceleration)
    orders = np.broadcast_to(np.asarray(orders) * keep_acceleration, len(h))
    segments = tuple(np.ascontiguousarray(x) for x in (c, directions, h, keep, orders))
    numbers = None if road is None else RoadParameters(*(np.asarray(x, float) for x in road))
    blocks = cores.split(np.arange(len(h)), BLOCK_SIZE)
    calls = [(cores.take(segments, block, BLOCK_SIZE), bounds, numbers, index, count) for block in blocks]
    result: Any = None
    for block, block_result in zip(blocks, cores.map_blocks(_compiled, calls), strict=True):
        result = cores.allocate(len(h), block_result) if result is None else result
        cores.put(result, block, block_result)
    return result


@jax.jit
def _compiled(segments: Any, bounds: Array, road: RoadParameters | None, index: Array, count: Array) -> Findings:
    c, directions, h, keep, orders = segments
    path, direction = _derivatives(c, h), _derivatives(directions, h)
    pairs = zip(path.derivatives[1:], direction.derivatives[1:], strict=True)
    higher = [jax.tree.map(lambda a, b: jnp.where(keep, a, b), p, q) for p, q in pairs]
    length = jnp.where(keep, path.length, direction.length)
    pace = None if road is None else _pace(orders, direction.unit, direction.length / length)
    combined = PathDerivatives([direction.derivatives[0], *higher], length, direction.unit, pace)

    def evaluate(s: Array, order: int, upright: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in combined.derivatives[:order])]
        return Invariants(derivatives, pace=1 if pace is None else pace.at(s)[0])

    limits = jnp.broadcast_to(bounds[:, None], (LIMIT_COUNT, h.shape[0]))
    upright = jnp.ones(h.shape, bool)
    vehicle = None if road is None else RoadParameters(*(jnp.broadcast_to(x, h.shape) for x in road))
    result = judge(evaluate, Scale(combined.length, combined.unit), limits, upright, combined, index, count, vehicle)
    return jax.tree.map(lambda x: x[:LIMIT_COUNT].T, result)


def _pace(orders: Int[Array, " rows"], unit: Array, ratio: Array) -> CellPolynomial:
    """u^order times the ratio of two lengths, with u = unit·(s + 1) the time from the stop [s]."""
    powers = jnp.arange(MAX_ORDER + 1, dtype=orders.dtype)[:, None]
    coefficients = jnp.where(powers == orders[None], ratio * unit ** orders.astype(unit.dtype), 0.0)
    c = centred(coefficients[:, None])[None]
    return cell_polynomial(c, 64 * float(jnp.finfo(c.dtype).eps) * jnp.sum(jnp.abs(c[0]), axis=0))


def _derivatives(c: Float[Array, "rows terms 3"], h: Float[Array, " rows"]) -> PathDerivatives:
    x, y, z = (c[:, :, k].T for k in range(3))
    # No limit depends on the start position, and its size would only increase rounding errors.
    x, y = x.at[0].set(0.0), y.at[0].set(0.0)
    return path_derivatives(MovingPolynomials(x, y, z, jnp.zeros_like(x[:1])), h, N_ROUNDINGS)


def worst(codes: Int[np.ndarray, "segments limits"]) -> Int[np.ndarray, " limits"]:
    """The code of each limit for the whole route: the worst of all segments."""
    rank = np.array([0, 1, 4, 2, 3])  # proved, sampled, broken, undecided, undefined
    row = np.argmax(rank[codes], axis=0)
    return codes[row, np.arange(codes.shape[1])]
