"""Fit a window of a recording together with the samples beyond its ends, and cut the route to the window.

At the ends of a recording, the derivatives of a fit are several times less accurate than inside. The ends of a window
are as accurate as its inside if there are samples beyond them.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from qtraj.design.fitting.route_covariance import STEP, blocks, from_blocks, smoothing_errors
from qtraj.design.fitting.units import units
from qtraj.path.track import Track, to_float64

MARGIN = 10.0
"""Duration beyond each end of a window whose samples are used, in units of time."""


class Widened(NamedTuple):
    """A window of a recording and the samples beyond it.

    `track` contains these samples, and `chosen` (n,) marks them in the recording. `inner` is the track of the window,
    and `inside` marks its samples in `track`. `start` and `end` [s] are measured from the first sample of `track`.
    """

    track: Track
    chosen: Bool[np.ndarray, " n"]
    inner: Track
    inside: Bool[np.ndarray, " k"]
    start: float
    end: float


def widened(track: Track, window: Any) -> Widened:
    """Return the window [t0, t1] [s] of a recording, on its clock, and the samples beyond it; None means all samples.

    **Raises:** ValueError for a window that is not within the recording, or has too few samples.
    """
    times = to_float64(track.times)
    if window is None:
        every = np.ones(len(times), bool)
        return Widened(track, every, track, every, 0.0, float(times[-1] - times[0]))
    t0, t1 = _pair(window)
    inner = track.window(t0, t1)
    own = to_float64(inner.times)
    margin = MARGIN * units(times - times[0], to_float64(track.positions)).time
    low, high = max(times[0], own[0] - margin), min(times[-1], own[-1] + margin)
    outer = track.window(low, high)
    seen = to_float64(outer.times)
    inside = (seen >= own[0]) & (seen <= own[-1])
    return Widened(
        outer,
        (times >= low) & (times <= high),
        inner,
        inside,
        float(own[0] - seen[0]),
        float(own[-1] - seen[0]),
    )


def _pair(window: Any) -> tuple[float, float]:
    values = np.asarray(window, float) if np.ndim(window) == 1 else np.zeros(0)
    if values.shape != (2,) or not np.isfinite(values).all():
        raise ValueError(
            f"the window must be two times (t0, t1) [s] on the clock of the recording, but {window!r} was given"
        )
    return float(values[0]), float(values[1])


class Cut(NamedTuple):
    """The part of a route within a window: knots (m,), which start at 0, states (m, 3, 3), normal matrix and penalty.

    `errors` are the expected errors of the states by the smoothing.
    """

    knots: Float[np.ndarray, " m"]
    states: Float[np.ndarray, "m 3 3"]
    matrix: Float[np.ndarray, "*axes 6 unknowns"]
    penalty: Float[np.ndarray, "*axes 6 unknowns"]
    errors: Float[np.ndarray, "m 3 3"]


def cut(
    knots: np.ndarray, states: np.ndarray, matrix: np.ndarray, penalty: np.ndarray, start: float, end: float
) -> Cut:
    """Return the part of a route between its knots at `start` and `end`.

    The unknowns at the knots beyond are eliminated from the normal matrix, so that the covariances remain the same.
    The penalty is the derivative of the result when the penalty is added to the matrix.
    """
    first, last = (int(np.abs(knots - t).argmin()) for t in (start, end))
    kept = slice(first, last + 1)
    changed = matrix + 1j * STEP * penalty
    reduced: Any = np.stack([_reduced(x, first, last) for x in changed.reshape(-1, *matrix.shape[-2:])])
    reduced = reduced.reshape(*matrix.shape[:-1], -1)
    # The reduced penalty is a derivative, so it does not give these errors.
    relative = np.array(states)
    relative[:, 0] -= states[:1, 0]
    errors = smoothing_errors(matrix, penalty, relative)[kept]
    return Cut(knots[kept] - knots[first], states[kept], reduced.real, reduced.imag / STEP, errors)


def _reduced(matrix: Complex[np.ndarray, "6 unknowns"], first: int, last: int) -> Complex[np.ndarray, "6 fewer"]:
    diagonal, upper = blocks(matrix)
    for i in range(first):
        diagonal[i + 1] -= upper[i].T @ np.linalg.solve(diagonal[i], upper[i])
    for i in range(len(diagonal) - 1, last, -1):
        diagonal[i - 1] -= upper[i - 1] @ np.linalg.solve(diagonal[i], upper[i - 1].T)
    return from_blocks(diagonal[first : last + 1], upper[first:last])


def clipped(intervals: Any, start: float, end: float) -> Float[np.ndarray, "k 2"]:
    """Return the parts of intervals (n, 2) within the window, measured from its start."""
    found = np.clip(np.reshape(intervals, (-1, 2)), start, end)
    return found[found[:, 1] > found[:, 0]] - start
