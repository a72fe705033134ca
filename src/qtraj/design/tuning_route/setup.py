"""Compute the arrays of `RouteProblem` from a route, its limits and the tube, in NumPy."""

from typing import NamedTuple

import numpy as np

from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.constraints import Names
from qtraj.design.tuning_route.problem import BLOCK, RouteProblem
from qtraj.foundation.arrays import as_float
from qtraj.path import pieces
from qtraj.path.quantity import quantity
from qtraj.path.route import Route

SLOW = 0.02
"""A segment touches a stop, and stays as it is, if the speed falls below this fraction of the largest speed."""

TIME_SCALE = 1.0
"""[s] The objective "nearest" multiplies changes of velocity by this time, changes of acceleration by its square."""

SHORTEST, LONGEST = 0.1, 10.0
"""Bounds on the ratio of a duration to the original one."""


class Parts(NamedTuple):
    """The segments of the original route: coefficients (n, terms, 3), durations (n,), and states (n + 1, 3, 3)."""

    c: np.ndarray
    h: np.ndarray
    states: np.ndarray


def parts(route: Route) -> Parts:
    """The segments of a route. Where it jumps, the state of a joint is the mean of both sides.

    Beside a segment that stays as it is, it is that segment's state, so that the tuned route does not jump there.
    """
    count = route.segments
    c, h = np.asarray(route.coefficients)[:count], np.diff(np.asarray(route.times))
    first = np.stack(pieces.values(c, np.zeros(count), 2), axis=1)
    last = np.stack(pieces.values(c, h, 2), axis=1)
    states = np.concatenate([first, last[-1:]])
    states[1:-1] = 0.5 * (first[1:] + last[:-1])
    given = Parts(c, h, states)
    still = standing(given)
    before, after = still[:-1] & ~still[1:], still[1:] & ~still[:-1]
    states[1:-1][before], states[1:-1][after] = last[:-1][before], first[1:][after]
    return given


def same_terms(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two arrays of coefficients (n, terms, 3), padded with zeros to the same number of terms."""
    terms = max(one.shape[1], other.shape[1])
    first, second = (np.concatenate([c, np.zeros((len(c), terms - c.shape[1], 3))], axis=1) for c in (one, other))
    return first, second


def size(count: int) -> int:
    """The padded number of segments, so that few sizes are compiled: about four in each doubling, at least 16."""
    step = max(4, 1 << max(0, (count - 1).bit_length() - 3))
    return max(16, -(-count // step) * step) if count <= 64 else -(-count // max(step, 32)) * max(step, 32)


def standing(given: Parts) -> np.ndarray:
    """Which segments touch a stop."""
    local = [np.linalg.norm(pieces.values(given.c, u * given.h, 1)[1], axis=-1) for u in np.linspace(0, 1, 17)]
    speeds = np.stack(local)
    return speeds.min(axis=0) <= SLOW * speeds.max()


def problem_of(
    given: Parts,
    names: Names,
    bounds: np.ndarray,
    tube: np.ndarray,
    fixed: np.ndarray,
    objective: str,
    timed: bool,
) -> RouteProblem:
    """The padded problem.

    `tube` (n + 1, 2) [m] and `fixed` (n + 1, 3) belong to the joints. With `timed`, the durations of the parts between
    segments that do not change stay fixed.
    """
    count = len(given.h)
    n = size(count)
    still = standing(given)
    moving = _filled(~still * 1.0, n, 0.0)
    h = np.where(moving > 0, _filled(given.h, n, 1.0), 1.0)
    ends, speed = _ends(given, n, moving, h)
    free = np.zeros((BLOCK, n + 1))
    held = np.ones((n + 1, 3), bool)
    held[: count + 1] = fixed
    held[:-1] |= (moving == 0)[:, None]
    held[1:] |= (moving == 0)[:, None]
    free[:9] = np.repeat(~held.T, 3, axis=0)
    free[0] = 0.0  # not along the path
    into, out = np.append(0.0, moving), np.append(moving, 0.0)
    free[9] = (into > 0) & ((out > 0) | (not timed))
    length, unit = float(np.sqrt(np.mean(tube**2))), 1.0
    own = h * moving
    weights = {"near": 0.0 * h, "pace": 0.0 * h, "jerk": 0.0 * h, "time": 0.0 * h}
    near = np.zeros((6, 6, n))
    if objective == "nearest":
        for k in range(3):
            near += TIME_SCALE ** (2 * k) * basis.gram(k)[:, :, None] * own * h ** (-2.0 * k) / length**2
        unit = length**2 / np.sum(given.h)
        weights["pace"] = own * TIME_SCALE**2 * np.maximum(speed, 1e-3 * np.max(speed)) ** 2 / length**2
    elif objective == "smoothest":
        jerks = np.sum(np.einsum("lm,mcn->lcn", basis.gram(3), ends) * ends, axis=(0, 1)) * h**-5 * moving
        unit = max(float(np.sum(jerks)), 1e-12) / max(np.sum(own), 1e-12)
        weights["jerk"] = moving / unit
    else:
        weights["time"] = moving
    used = np.broadcast_to(moving, (len(names) + 2, len(basis.NODES), n)).copy()
    smooth = [k for k in range(len(names) + 2) if k >= len(names) or quantity(names[k]).order <= 2]
    used[smooth, -1] = 0.0
    used[np.array(smooth)[:, None], 0, np.flatnonzero(np.all(held[:-1], axis=1))[None]] = 0.0
    scale = np.repeat([1.0, 1 / TIME_SCALE, 1 / TIME_SCALE**2], 3)
    pace = float(np.median(speed[moving > 0])) if moving.any() else 1.0
    fields = {
        "ends": ends,
        "durations": h,
        "moving": moving,
        "offset": _offsets(given, n, moving, basis.NODES),
        "fine_offset": _offsets(given, n, moving, basis.FINE_NODES),
        "squares": bounds**2,
        "tube": _tube(tube, n, basis.NODES),
        "fine_tube": _tube(tube, n, basis.FINE_NODES),
        "used": used,
        "shortest": SHORTEST * h,
        "longest": LONGEST * h,
        "near": near,
        "pace": weights["pace"],
        "jerk": weights["jerk"],
        "time": weights["time"],
        "unit": np.asarray(unit),
        "free": free,
        "scale": np.append(scale, 1 / max(pace, 1e-12)),
        "axes": _axes(given, n),
    }
    return RouteProblem(**{name: as_float(value) for name, value in fields.items()})


def _axes(given: Parts, n: int) -> np.ndarray:
    """Unit vectors along, to the left of and above the path at both ends of the segments (2, 3, 3, n)."""
    v = _filled(given.states[:, 1], n + 1, 0.0)
    size = np.linalg.norm(v, axis=1)
    v[size == 0] = (1.0, 0.0, 0.0)
    along = v / np.linalg.norm(v, axis=1)[:, None]
    steep = np.abs(along[:, 2]) > 0.9
    left = np.cross(np.where(steep[:, None], (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), along)
    left /= np.linalg.norm(left, axis=1)[:, None]
    rows = np.moveaxis(np.stack([along, left, np.cross(along, left)]), 1, 2)
    return np.stack([rows[:, :, :-1], rows[:, :, 1:]])


def _filled(x: np.ndarray, n: int, value: float) -> np.ndarray:
    return np.concatenate([x, np.full((n - len(x), *x.shape[1:]), value)])


def _ends(given: Parts, n: int, moving: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The end data (6, 3, n) and the RMS speeds (n,); segments that do not change become straight lines of length 1."""
    count = len(given.h)
    start, end = given.states[:-1].copy(), given.states[1:].copy()
    end[:, 0] -= start[:, 0]
    start[:, 0] = 0.0
    data = np.zeros((6, 3, n))
    data[[1, 3, 4], 0] = 1.0
    known = np.concatenate([start, end], axis=1).transpose(1, 2, 0)
    chosen = np.flatnonzero(moving[:count] > 0)
    data[:, :, chosen] = (known * given.h ** np.array(basis.POWERS)[:, None, None])[:, :, chosen]
    square = np.einsum("lm,lcn,mcn->n", basis.gram(1), data, data) / h**2
    return data, np.sqrt(square)


def _offsets(given: Parts, n: int, moving: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """The quintics through the states minus the original path (3, nodes, n); exactly zero if they agree to rounding."""
    found = np.zeros((3, len(nodes), n))
    own = pieces.hermite(given.h, given.states)
    own, c = same_terms(own, given.c)
    powers = (nodes[:, None] * given.h)[:, :, None] ** np.arange(own.shape[1])
    rows = np.einsum("fnk,nkc->cfn", powers, own - c)
    size = np.abs(given.states[:, 0]).max() + np.abs(given.states[:, 1]).max() * given.h.max()
    found[:, :, : len(given.h)] = np.where(np.abs(rows) > 1e-12 * size, rows, 0.0) * moving[: len(given.h)]
    return found


def _tube(tube: np.ndarray, n: int, nodes: np.ndarray) -> np.ndarray:
    """The squared half-widths (2, nodes, n), linear between the joints."""
    widths = _filled(tube, n + 1, 1.0)
    return np.moveaxis((widths[:-1, :, None] * (1 - nodes) + widths[1:, :, None] * nodes) ** 2, 0, -1)
