"""Compute the findings on each segment of a route, including segments that start or end at a stop.

At a stop the speed is zero, and the denominators of most quantities contain the speed. If the velocity r' of a segment
has a zero of order m at an end, then r' = u^m·q, where u is the time from that end. The vector q is parallel to r' and
does not vanish. So the upright and the natural frame rotate as on a path with velocity q, and the lateral and
longitudinal acceleration are the components of r'' relative to the direction of q. These quantities are certified with
q instead of r'. This is impossible for the curvature, which is unbounded near a stop unless the path is straight there.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, UNDEFINED
from qtraj.design.proof.judge import LIMITS
from qtraj.design.proof.segment_judge import MAX_ORDER, Job, SegmentFindings, judged
from qtraj.design.proof.segment_parts import exactly_reversed, with_halves
from qtraj.path.moment_quantities import MOMENTS
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import QUANTITIES
from qtraj.path.standstill import ORDER, driven_invariants
from qtraj.path.stops import Segments
from qtraj.path.vehicle import RoadParameters

DIRECTIONS = ("slope", "angular_rate", "angular_acceleration", "yaw_rate", "yaw_acceleration", *MOMENTS)
"""Quantities that depend only on the direction of the velocity."""

COMPONENTS = (
    "lateral_acceleration",
    "longitudinal_acceleration",
    *(name for name, entry in QUANTITIES.items() if entry.on_road),
)
"""Components of the acceleration along and across the velocity, and the quantities that depend on the road."""

ZERO = 64 * float(np.finfo(float).eps)
"""The velocity at an end of a segment counts as zero if its product with the duration is at most this fraction of the
size of the segment; for the acceleration, the product with the squared duration is compared."""


RANK = np.array([0, 1, 4, 2, 3])
"""The rank of each code, from the best to the worst: proved, sampled, undecided, undefined, broken."""


def findings(segments: Segments, limits: dict[str, float], road: RoadParameters | None) -> SegmentFindings:
    """Compute the findings on every segment, in the order of the registry of quantities.

    `limits` contains the reduced limits by name. `road` contains the parameters of the vehicle, or is None.
    A moving segment that starts and ends at a stop is certified in two halves.
    """
    both = _stopping_twice(segments)
    if not both.size:
        return _findings(segments, limits, road)
    parts = _findings(with_halves(segments, both), limits, road)
    first, second = both, np.arange(both.size) + len(segments.durations)
    parts.times[second] += 0.5 * segments.durations[both, None]
    rank, values = RANK[parts.codes], np.where(np.isnan(parts.values), np.inf, parts.values)
    later = (rank[second] > rank[first]) | ((rank[second] == rank[first]) & (values[second] > values[first]))
    for array in parts:
        array[first] = np.where(later, array[second], array[first])
    return SegmentFindings(*(array[: len(segments.durations)] for array in parts))


def _stopping_twice(segments: Segments) -> np.ndarray:
    """Return the indices of the moving segments that stop at both ends."""
    c, h = segments.coefficients, segments.durations
    slow = _vanishing(c, h) & (_end_speeds(c, h) <= _sizes(c, h) / h * 1e3 * ZERO) & c[:, 1:].any(axis=(1, 2))
    found = np.flatnonzero(slow)
    reversed_c = np.array([exactly_reversed(c[i], h[i]) for i in found]).reshape(-1, *c.shape[1:])
    return found[_vanishing(reversed_c, h[found])]


def _findings(segments: Segments, limits: dict[str, float], road: RoadParameters | None) -> SegmentFindings:
    """Compute the findings on every segment; a segment that starts or ends at a stop has some undefined quantities."""
    entries = [entry for entry in LIMITS if entry.name in limits]
    bounds = np.array([limits[entry.name] for entry in entries])
    c, h = segments.coefficients, segments.durations
    parked: Any = ~c[:, 1:].any(axis=(1, 2))
    groups = _stopping(c, h, parked)
    # Next to a stop, a limit is judged with r', with q instead of r', or with q and the higher derivatives of the path.
    of_path, of_direction, of_components = (
        np.array([chosen(entry) for entry in entries], bool)
        for chosen in (_has_no_divisor, _is_direction, _is_component)
    )
    directions, needed = c.copy(), np.broadcast_to(~parked[:, None], (len(h), len(entries))).copy()
    directions[parked, 1] = 1.0 / h[parked, None]
    for group in groups:
        directions[group.rows] = _integrals(group.coefficients)
        needed[group.rows] = of_direction
    jobs = [Job(np.arange(len(h)), directions, directions, False, 0, needed)]
    for at_end, rows, coefficients in groups:
        # Time is measured backwards from the end, so the velocity is reversed.
        direction = -directions[rows] if at_end else directions[rows]
        jobs.append(Job(rows, c[rows], c[rows], False, 0, np.tile(of_path, (rows.size, 1))))
        orders = _order(coefficients)
        jobs.append(Job(rows, coefficients, direction, True, orders, np.tile(of_components, (rows.size, 1))))
    result = SegmentFindings(*(np.zeros(needed.shape, dtype) for dtype in (int, float, float)))
    for at_end, rows, _ in groups:
        undefined = ~(of_path | of_direction | of_components)
        result.codes[np.ix_(rows, undefined)], result.values[np.ix_(rows, undefined)] = UNDEFINED, np.nan
        result.times[rows] = h[rows, None] * at_end
    result.codes[parked], result.values[parked] = _at_rest(entries, bounds, road)
    found, ends = judged(jobs, h, entries, bounds, road), np.zeros(len(h), bool)
    for group in groups:
        ends[group.rows] = group.at_end
    for job, part in zip(jobs, found, strict=True):
        # Where a segment was reversed, its times were measured backwards from its end.
        reverse = ends[job.rows, None] & (of_components if job.keep_acceleration else of_direction) & job.needed
        times = np.where(reverse, h[job.rows, None] - part.times, part.times)
        for array, new in zip(result, (part.codes, times, part.values), strict=True):
            array[job.rows] = np.where(job.needed, new, array[job.rows])
    return result


def _has_no_divisor(entry: PathQuantity) -> bool:
    return entry.divisor is None


def _is_direction(entry: PathQuantity) -> bool:
    return entry.name in DIRECTIONS


def _is_component(entry: PathQuantity) -> bool:
    return entry.name in COMPONENTS


def _at_rest(
    entries: Sequence[PathQuantity], bounds: np.ndarray, road: RoadParameters | None
) -> tuple[np.ndarray, np.ndarray]:
    """Return the status codes and values of a segment without motion: only gravity acts, on a road without slope."""
    values = np.zeros(len(entries))
    if road is not None:
        zero, one = jnp.zeros(()), jnp.ones(())
        forces = driven_invariants([(zero, zero, zero)] * (ORDER + 1), None, road, zero, one)
        values = np.array([float(entry.value(forces)) if entry.on_road else 0.0 for entry in entries])
    proved, broken = values * (1 + ZERO) < bounds, values * (1 - ZERO) > bounds
    return np.where(proved, PROVED, np.where(broken, BROKEN, UNDECIDED)), values


class _Stopping(NamedTuple):
    """The segments `rows` with a stop at their start, or at their end if `at_end`.

    `coefficients` (rows, terms, 3) are the coefficients of powers of the time, measured from the stop.
    """

    at_end: bool
    rows: np.ndarray
    coefficients: np.ndarray


def _stopping(c: np.ndarray, h: np.ndarray, parked: np.ndarray) -> list[_Stopping]:
    """Return the segments with a stop at one end; `parked` marks the segments without motion."""
    groups = []
    at_start = _vanishing(c, h) & ~parked
    candidates = np.flatnonzero(~parked & (_end_speeds(c, h) <= _sizes(c, h) / h * 1e3 * ZERO))
    reversed_c = np.array([exactly_reversed(c[i], h[i]) for i in candidates]).reshape(-1, *c.shape[1:])
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
    """Return the sizes of segments [m]: the sums of the magnitudes of all terms of the displacement at the end."""
    powers = h[:, None, None] ** np.arange(c.shape[1])[None, :, None]
    return np.sum(np.abs(c[:, 1:]) * powers[:, 1:], axis=(1, 2))


def _end_speeds(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the speeds at the ends of segments [m/s]."""
    k = np.arange(1, c.shape[1])
    return np.linalg.norm(np.sum(c[:, 1:] * (k * h[:, None] ** (k - 1))[..., None], axis=1), axis=-1)


def _vanishing(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Check whether the velocity at the start of each segment is zero up to rounding."""
    return np.linalg.norm(c[:, 1], axis=-1) * h <= ZERO * _sizes(c, h)


def _without_rounding(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Set the velocity at the start to zero, and the acceleration, too, if the acceleration is zero up to rounding."""
    c, sizes = c.copy(), _sizes(c, h)
    c[:, 1] = 0.0
    unaccelerated = np.linalg.norm(c[:, 2], axis=-1) * h**2 <= ZERO * sizes
    c[unaccelerated, 2] = 0.0
    return c


def _integrals(c: np.ndarray) -> np.ndarray:
    """Return the coefficients of Q with Q' = q = r'/u^m, where u is the time from the stop.

    The power m is the number of leading coefficients of r' that are zero.
    """
    result = np.zeros_like(c)
    for i, row in enumerate(c):
        powers = np.flatnonzero(row[1:].any(axis=-1)) + 1
        m = int(powers[0]) - 1 if powers.size else 0
        k = np.arange(m + 1, c.shape[1])
        result[i, 1 : c.shape[1] - m] = row[m + 1 :] * (k / (k - m))[:, None]
    return result


def _order(c: np.ndarray) -> np.ndarray:
    """Return the order of the zero of the velocity at the start of each segment, at most `MAX_ORDER`."""
    some = c[:, 1:].any(axis=-1)
    return np.minimum(np.argmax(some, axis=1), MAX_ORDER)


def worst(codes: Int[np.ndarray, "segments limits"]) -> Int[np.ndarray, " limits"]:
    """Return the status code of each limit for the whole route, which is the worst code of all segments."""
    row = np.argmax(RANK[codes], axis=0)
    return codes[row, np.arange(codes.shape[1])]
