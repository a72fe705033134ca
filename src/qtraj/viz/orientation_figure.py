"""Plot an orientation over time: quaternion, Gibbs vector, angle, and singular points."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from qtraj.algebra import rotation
from qtraj.foundation.arrays import as_float
from qtraj.viz.style import BAND, MARK, RC, SUBSCRIPTS, above, component, frame, head

SIZE = (7.6, 6.05)  # [inch] without a title
JUMP = np.cos(np.pi / 4)
"""Two consecutive attitudes differ by more than 90°, and count as a jump, if |p·q| is below this value.

p and q are the unit quaternions of the attitudes.
"""
HALF_TURN = 1e-9
"""Magnitude of the scalar part below which a unit quaternion counts as a rotation by 180° (infinite Gibbs vector)."""
MAX_GIBBS = 4.0  # axis limit, because the Gibbs vector is infinite at 180°
INFINITE = {"color": MARK, "lw": 1.0, "ls": (0, (4, 2)), "zorder": 1.2}
FLIP = {"color": "0.35", "lw": 1.0, "ls": (0, (1, 1)), "zorder": 1.2}


def orientation_figure(
    times: ArrayLike, quaternions: ArrayLike, defined: ArrayLike | None = None, title: str = ""
) -> Figure:
    """Plot quaternion, Gibbs vector and angle of the shorter rotation over `times` (n,) [s], and mark singular points.

    `quaternions` (n, 4), scalar first, may have any nonzero norm and either sign; the signs are made continuous. The
    figure marks instants at which the Gibbs vector is infinite (the angle is 180°) or the attitude jumps by more than
    90°. Samples at which `defined` (n,) is false are not drawn.
    """
    t, q = np.asarray(times, float), np.asarray(quaternions, float)
    q = np.asarray(rotation.continuous(as_float(q))) / np.linalg.norm(q, axis=1, keepdims=True)
    exists = np.ones(len(t), bool) if defined is None else np.asarray(defined, bool)
    flips = np.abs(np.sum(q[1:] * q[:-1], axis=1)) < JUMP
    crossings = (q[1:, 0] * q[:-1, 0] < 0) & ~flips & exists[1:] & exists[:-1]
    with mpl.rc_context(RC):
        band = BAND if title else 0.0
        height = SIZE[1] + band
        figure = Figure(figsize=(SIZE[0], height))
        margins = {"top": 1 - (0.29 + band) / height, "bottom": 0.48 / height}
        grid = figure.add_gridspec(3, 1, hspace=0.34, left=0.1, right=0.98, **margins)
        axes = [figure.add_subplot(grid[0])]
        axes += [figure.add_subplot(grid[row], sharex=axes[0]) for row in (1, 2)]
        q = np.where(exists[:, None], q, np.nan)
        _draw_components(axes[0], t, q, "wxyz", "λ", flips)
        _draw_gibbs(axes[1], t, q, flips | crossings)
        angle = np.degrees(2 * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), np.abs(q[:, 0])))
        axes[2].plot(*_interrupted(t, angle, flips), color="#0072B2", lw=1.6)
        axes[2].set_ylim(0, 190)
        axes[2].set_yticks([0, 45, 90, 135, 180])
        for panel, label in zip(axes, ("quaternion [–]", "Gibbs vector [–]", r"angle $\Phi$ [°]"), strict=True):
            panel.set_ylabel(label)
            frame(panel)
            panel.set_xlim(t[0], t[-1])
            panel.tick_params(labelbottom=panel is axes[2])
            _mark(panel, _crossing_times(t, q[:, 0], crossings), INFINITE, "Φ = 180°: G infinite")
            _shade(panel, t, np.abs(q[:, 0]) < HALF_TURN)
            _mark(panel, (t[:-1] + t[1:])[flips] / 2, FLIP, "attitude jumps")
        for panel in axes[:2]:
            above(panel)
        axes[2].set_xlabel("time [s]")
        figure.align_ylabels(axes)
        head(figure, title)
    return figure


def _draw_components(axes: Any, t: np.ndarray, values: np.ndarray, labels: str, symbol: str, breaks: Any) -> None:
    for label, column in zip(labels, values.T, strict=True):
        axes.plot(*_interrupted(t, column, breaks), label=symbol + SUBSCRIPTS[label], **component(label))


def _draw_gibbs(axes: Any, t: np.ndarray, q: np.ndarray, breaks: np.ndarray) -> None:
    scalar = np.where(np.abs(q[:, 0]) < HALF_TURN, np.nan, q[:, 0])
    gibbs = q[:, 1:] / scalar[:, None]
    _draw_components(axes, t, gibbs, "xyz", "G", breaks)
    size = np.nanmax(np.abs(gibbs), initial=0.0)
    if size > MAX_GIBBS:
        axes.set_ylim(-MAX_GIBBS, MAX_GIBBS)


def _interrupted(t: np.ndarray, values: np.ndarray, breaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a curve with a gap between samples k and k + 1 if element k of `breaks` (n−1,) is true."""
    places = np.flatnonzero(breaks) + 1
    return np.insert(t, places, t[places - 1]), np.insert(values, places, np.nan)


def _crossing_times(t: np.ndarray, scalar: np.ndarray, crossings: np.ndarray) -> np.ndarray:
    """Return the instants at which the scalar part of the quaternion is zero, by linear interpolation."""
    k = np.flatnonzero(crossings)
    return t[k] + (t[k + 1] - t[k]) * scalar[k] / (scalar[k] - scalar[k + 1])


def _mark(axes: Any, times: np.ndarray, line: dict[str, Any], label: str) -> None:
    for k, time in enumerate(times):
        axes.axvline(time, label=label if k == 0 else None, **line)


def _shade(axes: Any, t: np.ndarray, lasting: np.ndarray) -> None:
    """Shade the intervals of two or more consecutive samples at which `lasting` is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lasting, [False]]).astype(int)))
    for k, (first, last) in enumerate(zip(edges[::2], edges[1::2] - 1, strict=True)):
        if last > first:
            label = "Φ = 180° throughout" if k == 0 else None
            axes.axvspan(t[first], t[last], color=MARK, alpha=0.1, lw=0, label=label)
