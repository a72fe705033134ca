"""Define the optimisation problem of a route: variables at the joints, data of the segments, and objective.

The variables of a joint are the changes of its position, velocity, acceleration and time, scaled to lengths. Vectors
have components along and across the original path. The position changes only across the path. A shift of a joint along
the path would change only the subdivision into segments, and the objective would hardly determine this shift. A segment
depends only on the variables of its two joints, so the matrix of second derivatives is block tridiagonal. Segments
are the last axis of an array, joints the first. Segments that do not change have `moving` = 0 and no constraints.

The functions accept NumPy arrays and, for derivatives with respect to the data, JAX arrays.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.obstacles.clear import Clear
from qtraj.design.tuning_route import basis
from qtraj.foundation.namespace import matmul, xp

BLOCK = 10
"""Number of variables of a joint: position, velocity, acceleration (3 each) and time."""


JERK = basis.roots(3, 3)
"""The sum of the squares of `JERK` times the scaled end states is the integral of the squared third derivative."""


class RouteProblem(NamedTuple):
    """The data of n segments with n + 1 joints.

    `names` are the names of the limits. `ends` (6, 3, n) [m]: the scaled end states (see `basis`) of the original
    segments, with positions relative to the start of the segment. `durations` (n,) [s]: the original durations.
    `offset`, `fine_offset` (3, nodes, n) [m]: the quintic through the end states minus the original path. `squares`
    (limits,): the squares of the limits. `tube`, `fine_tube` (2, nodes, n) [m²]: the squares of the half-widths. `used`
    (limits + 2, nodes, n): whether a constraint is used. `shortest`, `longest` (n,) [s]: bounds on the durations.
    `clear` are the constraints of balls of the body and obstacles, to which the last `names` belong; `reached` (clear,
    n) marks the segments that may come near an obstacle, and their neighbours, whose values count at common joints;
    None without obstacles. `origins` (3, n) [m]: the positions of the starts of the original segments; None if no
    constraint contains the position. `shifts` (limits,): numbers that are added to signed values and their limits, or
    None; `squares` are then those of the sums.
    `local` (limits, fine, n): the squares of limits that change along the way, at the fine nodes; None if no limit
    changes. `road` (parameters, fine, n): the `RoadParameters` there; None if no limit depends on them.
    `by_speed`: how each limit depends on the speed (see `speed_ratio`), or None.
    `starts` (n,) [s]: the times at the starts of the original segments, or None if no obstacle moves.
    `target` (6, 3, n) [m]: the scaled end states of the path in the objective "nearest" minus `ends`; None without one.

    The objective is the sum over segments of δᵀ`near`δ + `pace`(h/h₀ − 1)² + `jerk`∫|r⃛|²dt + `time`·h, where δ is the
    change of the scaled end states, h the duration and h₀ the original duration. `unit` times this sum is the objective
    in the user's units. `free` (joints, 10): whether a variable may change; `scale` (10,) converts variables to SI.
    `axes` (joints, 3, 3): unit vectors along, to the left of and above the original path (joint, unit vector,
    component). `seam`: the index of the last joint of a closed route, which has the state of the first joint; otherwise
    None. `per_time` (n,): the change of a duration for a change of the time; 1, except that curves with a progress have
    a parameter of their own, and 0 for segments that do not change. `composed` (n,) marks these curves, and `rates`,
    `fine_rates` (3, nodes, n) are the derivatives of their progress (see `curves.rates`); None without such curves.
    `sense` (n,) is −1 for segments that are driven in reverse, and otherwise 1: the velocity at a joint is that of a
    vehicle which drives forwards, so it is continuous where the vehicle reverses. None if it never does.
    """

    names: tuple[str, ...]
    ends: Float[Any, "6 3 n"]
    durations: Float[Any, " n"]
    moving: Float[Any, " n"]
    offset: Float[Any, "3 nodes n"]
    fine_offset: Float[Any, "3 fine n"]
    squares: Float[Any, " limits"]
    tube: Float[Any, "2 nodes n"]
    fine_tube: Float[Any, "2 fine n"]
    used: Bool[Any, "constraints nodes n"]
    shortest: Float[Any, " n"]
    longest: Float[Any, " n"]
    near: Float[Any, "6 6 n"]
    pace: Float[Any, " n"]
    jerk: Float[Any, " n"]
    time: Float[Any, " n"]
    unit: Float[Any, ""]
    free: Bool[Any, "joints 10"]
    scale: Float[Any, " 10"]
    axes: Float[Any, "joints 3 3"]
    seam: int | None = None
    per_time: Any = None
    composed: Any = None
    rates: Any = None
    fine_rates: Any = None
    sense: Any = None
    local: Any = None
    road: Any = None
    target: Any = None
    clear: tuple[Clear, ...] = ()
    origins: Any = None
    reached: Any = None
    shifts: Any = None
    by_speed: Any = None
    starts: Any = None

    @property
    def on_duration(self) -> bool:
        """Whether a constraint is not proportional to a power of the duration."""
        return self.road is not None or self.by_speed is not None

    @property
    def first(self) -> int:
        """The lowest order of the derivatives in the constraints: 0 if one of them contains the position."""
        return 1 if self.origins is None else 0

    @property
    def dense(self) -> bool:
        """Whether all segments are curves with a progress, whose nodes are clustered; for parts of one group."""
        return self.composed is not None and bool(self.composed.all())

    def groups(self) -> list[Any]:
        """Return the indices of the segments whose nodes are not clustered, and of those whose nodes are."""
        if self.composed is None:
            return [slice(0, len(self.durations))]
        return [k for k in (np.flatnonzero(~self.composed), np.flatnonzero(self.composed)) if k.size]

    def part(self, k: Any) -> "RouteProblem":
        """Return the data of some segments, with the data of all joints."""
        return self._replace(
            **{name: getattr(self, name)[..., k] for name in OF_SEGMENTS if getattr(self, name) is not None}
        )


OF_SEGMENTS = (
    *("ends", "durations", "moving", "offset", "fine_offset", "tube", "fine_tube", "used"),
    *("shortest", "longest", "near", "pace", "jerk", "time", "per_time", "composed", "rates", "fine_rates", "local"),
    *("road", "target", "origins", "reached", "sense", "starts"),
)


class Segments(NamedTuple):
    """The segments for some variables.

    `h` are the durations, `ends` (6, 3, n) the scaled end states (see `basis`) [m], and `change` their changes [m].
    `start` (n,) [s] are the times at the starts, or None if no obstacle moves.
    """

    h: Float[Any, " n"]
    change: Float[Any, "6 3 n"]
    ends: Float[Any, "6 3 n"]
    start: Any = None

    def part(self, k: Any) -> "Segments":
        """Return some of the segments."""
        return Segments(*(None if x is None else x[..., k] for x in self))


def joined(problem: RouteProblem, parts: list[Any], groups: list[Any] | None = None) -> Any:
    """Join arrays, or tuples of arrays, that belong to groups of segments on their last axes, in the order of segments.

    `groups` contains the indices of the segments, by default those of `RouteProblem.groups`.
    """
    order = None
    if problem.composed is not None and len(parts) > 1:
        order = np.argsort(np.concatenate(problem.groups() if groups is None else groups))
    return _joined(parts, order)


def _joined(parts: Any, order: np.ndarray | None) -> Any:
    if parts[0] is None:
        return None
    if isinstance(parts[0], tuple):
        fields = [_joined(x, order) for x in zip(*parts, strict=True)]
        return type(parts[0])(*fields) if hasattr(parts[0], "_fields") else tuple(fields)
    found = parts[0] if len(parts) == 1 else xp.concatenate(parts, axis=-1)
    return found if order is None else found[..., order]


def factors(problem: RouteProblem, h: Float[Any, " n"]) -> Float[Any, "6 1 n"]:
    """Return the factors that convert the states of joints into scaled end states: 1, h with the `sense`, and h²."""
    first = h if problem.sense is None else h * problem.sense
    return xp.stack([xp.ones_like(h), first, h * h] * 2)[:, None]


def segments(problem: RouteProblem, z: Float[Any, "joints 10"]) -> Segments:
    """Return the segments for the variables `z`."""
    shifts, longer, later = moved(problem, z)
    h0 = problem.durations
    h = h0 + longer
    # h v − h₀v₀ = h δv + (h − h₀)v₀ avoids cancellation; the acceleration is treated in the same way.
    first = longer / h0
    growth = xp.stack([xp.zeros_like(h), first, first * (2 + first)] * 2)[:, None]
    change = factors(problem, h) * shifts + growth * problem.ends
    return Segments(h, change, problem.ends + change, None if later is None else problem.starts + later)


def moved(problem: RouteProblem, z: Float[Any, "joints 10"]) -> tuple[Float[Any, "6 3 n"], Float[Any, " n"], Any]:
    """Return the changes of the states at both ends of the segments [SI, world axes], and of the durations [s].

    The third result is the change of the times at the starts [s], or None if no obstacle moves.
    """
    move = z * problem.scale[None]
    world = matmul(move[:, :9].reshape(-1, 3, 3), problem.axes)
    both = xp.concatenate([world[:-1], world[1:]], axis=1)
    later = None if problem.starts is None else move[:-1, 9]
    return xp.moveaxis(both, 0, -1), problem.per_time * (move[1:, 9] - move[:-1, 9]), later


def objective(problem: RouteProblem, s: Segments) -> Float[Any, ""]:
    """Return the objective."""
    away = off_target(problem, s)
    near = xp.einsum("lmn,lcn,mcn->", problem.near, away, away)
    pace = problem.pace * (s.h / problem.durations - 1.0) ** 2
    return near + xp.sum(pace + problem.jerk * squared_jerk(s) * s.h**-5 + problem.time * s.h)


def off_target(problem: RouteProblem, s: Segments) -> Float[Any, "6 3 n"]:
    """Return the scaled end states minus those of the path to which the route should be near."""
    return s.change if problem.target is None else s.change - problem.target


def squared_jerk(s: Segments) -> Float[Any, " n"]:
    """Return the integral of the squared third derivative with respect to t/h over each segment [m²]."""
    return xp.sum(_jerk(s) ** 2, axis=0).reshape(3, -1).sum(axis=0)


def bent(s: Segments) -> Float[Any, "6 3 n"]:
    """Return half the derivatives of `squared_jerk` with respect to the scaled end states."""
    return matmul(JERK.T, _jerk(s)).reshape(s.ends.shape)


def _jerk(s: Segments) -> Float[Any, "3 columns"]:
    """Return the third derivatives with respect to t/h, weighted so that their squares sum to `squared_jerk`."""
    return matmul(JERK, s.ends.reshape(6, -1))
