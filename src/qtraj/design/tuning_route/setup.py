"""Compute the arrays of `RouteProblem` from a route, its limits and the tube, in NumPy."""

from typing import Any, NamedTuple

import numpy as np

from qtraj.design.tuning_route import basis, circuit
from qtraj.design.tuning_route.constraints import contain_position
from qtraj.design.tuning_route.curves import Curves, chain, curves_of, rates, rebuilt, stretch
from qtraj.design.tuning_route.geometry import (
    joint_states,
    nearest,
    offsets,
    smooth_fields,
    speeds,
    time_scale,
    tube_squares,
)
from qtraj.design.tuning_route.problem import BLOCK, RouteProblem
from qtraj.design.tuning_route.scales import scales, sizes_of
from qtraj.path import pieces
from qtraj.path.driving import segments_of
from qtraj.path.quantity import quantity
from qtraj.path.route import Route, from_segments
from qtraj.path.stops import Segments as RouteSegments

SLOW = 0.02
"""A segment with a speed below this fraction of the highest speed counts as touching a stop and is not changed."""

SHORTEST, LONGEST = 0.1, 10.0
"""Bounds on the ratio of a duration to the original one."""


TIME = 0.25
"""Unit of time of the search, in mean durations of a segment; small, because in the objective "fastest" the barrier is
a fraction of it."""

LEAST_JERK = 1e-3
"""Lower bound on the integral of the squared jerk, in units of the tube and of a segment. A straight route has no jerk,
but needs some around obstacles, and the search could not start from an objective that is large in its unit."""


class Parts(NamedTuple):
    """The curves of the original route: coefficients `c` (n, terms, 3), durations `h` (n,), and states of the joints.

    The axes of `states` (n + 1, 3, 3) are the joint, the order of the derivative and the component. `curves` relates
    them to the `segments` of the route. In this package, the curves are called segments (see `curves`).
    """

    c: np.ndarray
    h: np.ndarray
    states: np.ndarray
    curves: Curves
    segments: RouteSegments

    @property
    def stretch(self) -> np.ndarray:
        """The durations in seconds, relative to `h`."""
        return stretch(self.curves, self.segments, self.h)

    def rebuilt(self, c: np.ndarray, h: np.ndarray, origin: np.ndarray) -> Route:
        """Return the route with these coefficients and durations of the curves."""
        s = self.segments
        durations, rows, own = rebuilt(self.curves, s.durations, s.progress, self.h, c, h)
        times = np.append(0.0, np.cumsum(durations))
        return from_segments(times[:-1], rows, np.asarray(times[-1]), origin, own)


def parts(route: Route, closed: bool = False) -> Parts:
    """Return the segments of a route; the first and the last joint of a `closed` route have the same state."""
    s = segments_of(route)
    curves = curves_of(s)
    c, h = chain(curves, s.coefficients, s.durations, s.progress)
    if closed and curves.reversing is not None:
        circuit.require_same_heading(c, h, curves.reversing)
    return Parts(c, h, joint_states(c, h, standing(c, h), closed, curves.reversing), curves, s)


def standing(c: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return whether each segment touches a stop."""
    local = [np.linalg.norm(pieces.values(c, u * h, 1)[1], axis=-1) for u in np.linspace(0, 1, 17)]
    speeds = np.stack(local)
    return speeds.min(axis=0) <= SLOW * speeds.max()


def problem_of(
    given: Parts,
    names: tuple[str, ...],
    bounds: np.ndarray,
    tube: np.ndarray,
    fixed: np.ndarray,
    objective: str,
    timed: bool,
    closed: bool = False,
    road: np.ndarray | None = None,
    origin: np.ndarray | None = None,
) -> RouteProblem:
    """Return the problem.

    `tube` (n + 1, 2) [m] and `fixed` (n + 1, 3) have one row for each joint. With `timed`, the total duration of each
    part between segments that do not change is fixed. The last joint of a `closed` route has the state of the first
    one. Constraints that contain the position need the `origin` (3,) of the route.
    """
    moving = ~standing(given.c, given.h) * 1.0
    stretched = given.stretch
    held = _held(fixed, moving, closed)
    composed = given.curves.composed if given.curves.composed.any() else None
    sense = given.curves.reversing
    smooth = smooth_fields(given.c, given.h, given.states, tube, moving, composed, sense)
    smooth |= scales(names, bounds, sizes_of(names, bounds, float(np.sqrt(np.mean(tube[:, 1] ** 2)))))
    if origin is not None and contain_position(names):
        smooth |= {"origins": given.states[:-1, 0].T + origin[:, None]}
    fine = basis.places(composed, len(given.h), fine=True)
    ends, h = smooth["ends"], smooth["durations"]
    size = np.abs(given.states[:, :2]).max(axis=(0, 2)) @ (1.0, given.h.max())
    fields = smooth | _objective(objective, ends, h, moving, stretched, tube, float(np.sum(given.h)))
    fine_offset = offsets(given.c, given.h, given.states, moving, fine, sense)
    return RouteProblem(**fields | {
        "names": names,
        "moving": moving,
        "offset": _exact(smooth["offset"], size),
        "fine_offset": _exact(fine_offset, size),
        "fine_tube": tube_squares(tube, fine),
        "used": _used(names, held, given.curves.at_rest(), moving, closed, sense),
        "shortest": SHORTEST * h,
        "longest": LONGEST * h,
        "free": _free(held, given.curves.at_rest(), moving, timed, closed),
        "scale": _scale(speeds(ends, h), h, moving, tube),
        "seam": len(h) if closed else None,
        "per_time": moving / stretched,
        "road": road,
        "sense": sense,
        **_rates(given),
    })  # fmt: skip


def _rates(given: Parts) -> dict[str, np.ndarray]:
    """Return the rates of the progress at the nodes and at the fine nodes."""
    curves = given.curves
    if not curves.composed.any():
        return {}
    fields, count = {"composed": curves.composed}, len(given.h)
    for name, nodes in (("rates", basis.NODES), ("fine_rates", basis.FINE_NODES)):
        found = np.zeros((3, len(nodes), count))
        found[0] = 1.0
        found[..., curves.composed] = rates(curves, given.segments, given.h, basis.clustered(nodes))
        fields[name] = found
    return fields


def _held(fixed: np.ndarray, moving: np.ndarray, closed: bool) -> np.ndarray:
    """Return whether position, velocity and acceleration of the joints, (n + 1, 3), are fixed.

    They are fixed by the user, or because an adjacent segment does not change.
    """
    held, still = fixed.copy(), (moving == 0)[:, None]
    held[:-1] |= still
    held[1:] |= still
    if closed:
        held[[0, -1]] = held[0] | held[-1]
    return held


def _free(held: np.ndarray, at_rest: np.ndarray, moving: np.ndarray, timed: bool, closed: bool) -> np.ndarray:
    """Return whether each variable (n + 1, 10) may change.

    At a joint `at_rest` (n + 1,), the speed along the curve is not that of the vehicle, so it may change there.
    The last joint of a closed route repeats the state of the first one, which has the variables.
    """
    free = np.zeros((len(held), BLOCK), bool)
    free[:, :9] = np.repeat(~held, 3, axis=1)
    free[at_rest, 3] = free[at_rest, 6] = True
    free[:, 0] = False  # not along the path
    into, out = np.append(0.0, moving), np.append(moving, 0.0)
    free[:, 9] = (into > 0) & ((out > 0) | (not timed))
    if closed:
        free[-1, :9] = False
    return free


def _used(
    names: tuple[str, ...],
    held: np.ndarray,
    at_rest: np.ndarray,
    moving: np.ndarray,
    closed: bool,
    sense: np.ndarray | None,
) -> np.ndarray:
    """Return whether each constraint (limits + 2, nodes, n) is used.

    A quantity that is continuous at a joint is constrained on one side only. Where the vehicle reverses, signed
    quantities, such as the horizontal curvature, change their signs. No limit is imposed at a joint whose state is
    fixed, except `at_rest`: there the curvature may change (see `_free`).
    """
    settled = np.all(held, axis=1) & ~at_rest
    used = np.broadcast_to(moving > 0, (len(names) + 2, len(basis.NODES), len(moving))).copy()
    smooth = [k for k in range(len(names) + 2) if k >= len(names) or quantity(names[k]).order <= 2]
    used[smooth, -1] = False
    if sense is not None:
        signed = np.array([k for k in smooth if k < len(names) and quantity(names[k]).signed is not None], int)
        used[signed[:, None], -1, np.flatnonzero(np.diff(sense))[None]] = True
    heights = np.array([k for k in range(len(names)) if quantity(names[k]).of_position], int)
    used[heights[:, None], 0, np.flatnonzero(held[:-1, 0])[None]] = False
    used[np.array(smooth)[:, None], 0, np.flatnonzero(settled[:-1])[None]] = False
    if not closed and not settled[-1]:
        used[smooth, -1, -1] = moving[-1] > 0
    if held[-1, 0]:
        used[heights, -1, -1] = False
    return used


def _scale(speed: np.ndarray, h: np.ndarray, moving: np.ndarray, tube: np.ndarray) -> np.ndarray:
    """Return the factors (10,) that convert variables to SI: changes as large as the tube have variables near 1."""
    length, time = _length(tube), TIME * float(time_scale(h, moving))
    pace = float(np.median(speed[moving > 0])) if moving.any() else length / time
    return length * np.append(np.repeat([1.0, 1 / time, 1 / time**2], 3), 1 / pace)


def _length(tube: np.ndarray) -> float:
    """Return the RMS half-width of the tube [m], the unit of length of the search."""
    return float(np.sqrt(np.mean(tube**2)))


def _objective(
    objective: str,
    ends: np.ndarray,
    h: np.ndarray,
    moving: np.ndarray,
    stretched: np.ndarray,
    tube: np.ndarray,
    duration: float,
) -> dict[str, Any]:
    """Return the weights of the objective, without dimension, and its unit."""
    zero = 0.0 * h
    fields: dict[str, Any] = {"near": np.zeros((6, 6, len(h))), "pace": zero, "jerk": zero, "time": zero}
    length, segment = _length(tube), float(time_scale(h, moving))
    if objective == "nearest":
        near, pace = nearest(ends, h, moving, length)
        return fields | {"near": near, "pace": pace, "unit": np.asarray(length**2 * segment / duration)}
    if objective == "smoothest":
        jerks = np.sum(np.einsum("lm,mcn->lcn", basis.gram(3), ends) * ends, axis=(0, 1)) * h**-5 * moving
        unit = max(float(np.sum(jerks)), LEAST_JERK * length**2 / segment**5) / max(np.sum(moving), 1.0)
        return fields | {"jerk": moving / unit, "unit": np.asarray(unit)}
    return fields | {"time": moving * stretched / (TIME * segment), "unit": np.asarray(TIME * segment)}


def _exact(offset: np.ndarray, size: float) -> np.ndarray:
    """Return the offsets, with zeros in place of rounding errors of a route with the given `size` [m]."""
    return np.where(np.abs(offset) > 1e-12 * size, offset, 0.0)
