"""Divide a path into the parts that are timed separately: the whole path, or the drives of a route between stops."""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.design.timing.directions import STANDS
from qtraj.design.timing.regular import first_zero
from qtraj.foundation.arrays import concrete, constants, is_traced
from qtraj.path import pieces
from qtraj.path.driving import segments_of
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.stops import Segments, fastest, stops

CONTINUOUS = 1e-6
"""A relative jump of the velocity or the acceleration at a joint below this value counts as a rounding error."""

SAMPLES = 33

STOP_DISTANCE = 0.2
"""By default, slow motion within this distance [m] is treated as a stop, if `stop_speed` is given."""

SLOW = 0.02
"""A speed below this fraction of the highest speed counts as slow, in advice."""


class Part(NamedTuple):
    """A part of a path, from the parameter `start` to `end` [s]: the segments from `first` to before `last`.

    The vehicle is at rest on a part that does not move. `stops` indicates whether the velocity of the path is zero at
    the start and at the end. `smooth` (last − first − 1,) is the order of the derivatives of u̇² that are continuous at
    the joints between the segments, 0 to 2.
    """

    start: Any
    end: Any
    first: int
    last: int
    moves: bool = True
    stops: tuple[bool, bool] = (False, False)
    smooth: Int[np.ndarray, " joints"] = np.zeros(0, int)


def of_path(
    path: AbstractHodograph, names: tuple[str, ...], regular: bool = False
) -> tuple[list[Part], tuple[bool, bool]]:
    """Return the parts in order, and whether the velocity of a route is zero at its start and at its end.

    `names` are those of the limits, and `regular` indicates whether it is known that the velocity is never zero.

    **Raises:** ValueError for a route inside jit or vmap, a batch of routes, a route without motion, a route whose
    velocity is zero within a segment, or a route whose velocity jumps. With a limit on the jerk, also for a route whose
    acceleration jumps.
    """
    if not isinstance(path, Route):
        return [Part(np.zeros(()), path.duration, 0, 1)], (False, False)
    segments = known_segments(path)
    slow = standing_ends(segments)
    still = np.asarray(~segments.coefficients[:, 1:].any(axis=(1, 2)))
    if still.all():
        raise ValueError("the vehicle is at rest on the whole route, so there is nothing to retime")
    if not regular:
        _require_regular(segments, slow, still)
    starts = np.append(segments.starts, segments.starts[-1] + segments.durations[-1])
    cut = slow[1:, 0] | slow[:-1, 1]
    smooth = _smoothness(segments, cut, names)
    bounds = [0, *(np.flatnonzero(cut) + 1).tolist(), still.size]
    parts = []
    for first, last in pairwise(bounds):
        ends = bool(slow[first, 0]), bool(slow[last - 1, 1])
        own = smooth[first : last - 1]
        parts.append(Part(starts[first], starts[last], first, last, not still[first], ends, own))
    return parts, (bool(slow[0, 0]), bool(slow[-1, 1]))


def stops_of(parts: list[Part]) -> list[Any]:
    """Return the parameters at which the velocity is zero."""
    ends = ((x.start, x.stops[0] or not x.moves, x.end, x.stops[1] or not x.moves) for x in parts)
    return [u for start, first, end, last in ends for u, stands in ((start, first), (end, last)) if stands]


def known_segments(route: Route) -> Segments:
    """Return the segments of a route with known values, in NumPy arrays; the route may be differentiated.

    **Raises:** ValueError for a batch of routes, for a route inside jit or vmap, and for times of joints that are
    differentiated: the cells of the timing, whose ends are at the joints, are constants.
    """
    known = constants(route)
    if route.duration.ndim or is_traced(known):
        raise ValueError(
            "retime needs a route with known values: call it once for each route, outside jit and vmap. The limits may "
            "be traced, and grad and jvp may be with respect to the states of the route."
        )
    if is_traced(route.starts, route.duration):
        raise ValueError(
            "retime has no derivatives with respect to the times of the joints of a route: differentiate with respect "
            "to their positions, velocities and accelerations."
        )
    return segments_of(known)


def standing_ends(s: Segments) -> np.ndarray:
    """Return whether the velocity is zero at the start and at the end of each segment, (n, 2)."""
    with np.errstate(over="ignore"):  # too large numbers get an error of their own
        speeds = np.linalg.norm(_velocities(s), axis=-1)
    return speeds[:, [0, -1]] <= STANDS * speeds.max(axis=1, keepdims=True)


def _velocities(s: Segments) -> Float[Any, "n samples 3"]:
    local = s.durations[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    return s.values(np.arange(len(local))[:, None] + np.zeros(SAMPLES, int), local, 1)[1]


def _require_regular(s: Segments, slow: np.ndarray, still: np.ndarray) -> None:
    """Raise a ValueError if the velocity vanishes within a segment; decided in exact integers where floats do not."""
    if (bad := first_zero(s, slow, still)) is None:
        return
    at = float(s.starts[bad[0]] + bad[1] * s.durations[bad[0]])
    raise ValueError(
        f"the velocity of the route is zero at {at:.6g} s, within a segment, but retime divides a route only at joints "
        f"where the vehicle is at rest. {_advice(s, at)}"
    )


def _advice(s: Segments, at: float) -> str:
    """Return advice on a route that reverses at the time `at` [s], typically in slow motion next to a stop."""
    slow = next(
        ((a, b) for a, b in stops(s, SLOW * fastest(s)) if a <= at + s.durations.max() / SAMPLES and at <= b), None
    )
    parts = f"before {slow[0]:.6g} s and after {slow[1]:.6g} s" if slow else "before and after this instant"
    return (
        f"Either extract the parts {parts} with route.window(t0, t1) and retime each of them, with end_speed=0 or "
        "start_speed=0 at an end at rest, or use tune_route instead of retime: it does not change segments at a stop."
    )


def _smoothness(s: Segments, cut: np.ndarray, names: tuple[str, ...]) -> Int[np.ndarray, " joints"]:
    """Return the order of the derivatives of u̇² that are continuous at the joints, 0 to 2.

    Where the second derivative of the path jumps, the first derivative of u̇² may jump, otherwise the acceleration along
    the path would have to jump. Where the third derivative jumps, the same applies to the jerk and to the second one.
    These jumps are relative to the derivatives at the joint: where the parameter is slow, u̇ is large, and so are the
    effects of a small jump. An error is raised only for jumps that are large for the whole route.

    **Raises:** ValueError if the velocity jumps at a joint that is not a `cut`, or with a limit on the jerk, if the
    acceleration jumps there.
    """
    s, limited = s.in_time(), {quantity(name).base or name for name in names}
    ends = pieces.values(s.coefficients[:-1], s.durations[:-1], 3)
    after = pieces.values(s.coefficients[1:], np.zeros(s.durations.size - 1), 3)
    paces, spans = np.linalg.norm(s.coefficients[:, 1], axis=-1), s.durations
    pace, span = np.maximum(paces[1:], paces[:-1]), np.minimum(spans[1:], spans[:-1])
    smooth = np.full(s.durations.size - 1, 2)
    for order in (3, 2, 1):
        jump = np.linalg.norm(after[order] - ends[order], axis=-1)
        left, right = (np.linalg.norm(x[order], axis=-1) for x in (ends, after))
        size, own = right.max(initial=0.0) + left, right + left
        if order > 1:  # the added terms keep the scales positive where the derivatives are zero
            size = size + paces.max() / spans.max() ** (order - 1)
            own = own + pace / span ** (order - 1)
        jumps = (jump > CONTINUOUS * size) & ~cut
        if jumps.any() and (order == 1 or (order == 2 and "jerk" in names)):
            raise ValueError(
                f"the {('velocity', 'acceleration')[order - 1]} of the route jumps at "
                f"{s.starts[1 + int(np.argmax(jumps))]:.4g} s, while the vehicle is moving, so retime cannot satisfy a "
                f"limit on the {('acceleration', 'jerk')[order - 1]} there. Use a route with continuous acceleration, "
                "such as the result of fit_route."
            )
        if order == 3 or (order == 2 and "jerk" not in names):
            jumps |= (jump > CONTINUOUS * own) & ~cut
        smooth[jumps] = 0 if order < 3 else 1 if "jerk" in names else 0 if "yaw_acceleration" in limited else 2
    return smooth


def known_zero(v: Any) -> bool:
    """Return whether a speed is known to be zero."""
    return v is not None and concrete(v) is not None and float(v) == 0
