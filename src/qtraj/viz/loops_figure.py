"""Plot a comparison of closed loops: error angles, deviations from the closed form, and commands."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl
import numpy as np
from jaxtyping import Array, Float
from matplotlib.figure import Figure

from qtraj.motion.simulation.solution import Solution
from qtraj.viz.style import CLOSED, LIMIT, MIN_ANGLE, RC, WIDTH, above, frame, head, series

PANEL = 2.3  # height [inch]
# The axis of the deviations includes at least this range, so that round-off looks flat.
MIN_DEVIATION, MIN_TOP = 1e-17, 1e-13


def loops_figure(
    solutions: Mapping[str, Solution],
    closed_forms: Mapping[str, Float[Array, "n 4"] | np.ndarray] | None = None,
    settled: float | None = None,
    title: str = "",
) -> Figure:
    """Plot the error angle (on a logarithmic axis) and the norm of the physical command of several closed loops.

    `solutions` contains results of `qtraj.simulate` by name. `closed_forms` contains, for some of the names, the error
    quaternions (n, 4) that `qtraj.error_response` returns at the times of the solution, either for a body error or for
    an inertial error. The angle of the closed form is drawn over the simulated angle, and an additional panel shows the
    largest component of the deviation. A line is drawn at the angle `settled` [rad].

    **Raises:** ValueError if `solutions` is empty, a solution has no commands, or a name in `closed_forms` is not in
    `solutions`.
    """
    closed = dict(closed_forms or {})
    if not solutions or any(solution.command is None for solution in solutions.values()):
        without = [name for name, solution in solutions.items() if solution.command is None]
        missing = f"{without[0]!r} has no commands" if without else "there is no solution"
        raise ValueError(f"a figure of closed loops needs solutions with commands, but {missing}")
    if unknown := closed.keys() - solutions.keys():
        raise ValueError(f"closed_forms contains {min(unknown)!r}, but solutions does not contain this name")
    panels = 3 if closed else 2
    with mpl.rc_context(RC):
        height = PANEL * panels + 0.8
        figure = Figure(figsize=(0.8 * WIDTH, height))
        margins = {"top": 1 - 0.62 / height, "bottom": 0.5 / height, "left": 0.11, "right": 0.98}
        grid = figure.add_gridspec(panels, 1, hspace=0.16, **margins)
        angle = figure.add_subplot(grid[0])
        others = [figure.add_subplot(grid[row], sharex=angle) for row in range(1, panels)]
        for k, (name, solution) in enumerate(solutions.items()):
            times = np.asarray(solution.times)
            angle.plot(times, _visible(np.degrees(np.asarray(solution.angle))), label=name, **series(k))
            length = np.linalg.norm(np.degrees(np.asarray(solution.physical_command)), axis=1)
            others[-1].plot(times, length, **series(k))
            if name in closed:
                deviation = np.abs(np.asarray(solution.error) - np.asarray(closed[name])).max(axis=1)
                others[0].plot(times, np.maximum(deviation, MIN_DEVIATION), **series(k))
        _draw_closed(angle, solutions, closed)
        _draw_settled(angle, settled)
        if closed:
            others[0].set_yscale("log")
            others[0].set_ylim(MIN_DEVIATION, max(MIN_TOP, 2 * others[0].get_ylim()[1]))
            others[0].set_ylabel("simulated − closed form [–]")
        others[-1].set_ylabel("command [°/s²]")
        others[-1].set_xlabel("time [s]")
        for axes in (angle, *others):
            frame(axes)
            axes.tick_params(labelbottom=axes is others[-1])
        others[-1].set_ylim(bottom=0)
        above(angle)
        figure.align_ylabels([angle, *others])
        head(figure, title, y=1 - 0.08 / height)
    return figure


def _draw_closed(axes: Any, solutions: Mapping[str, Solution], closed: dict[str, Any]) -> None:
    for k, (name, error) in enumerate(closed.items()):
        mu = np.asarray(error)
        angle = np.degrees(2 * np.arctan2(np.linalg.norm(mu[:, 1:], axis=1), np.abs(mu[:, 0])))
        label = "closed form" if k == 0 else None
        axes.plot(np.asarray(solutions[name].times), _visible(angle), label=label, **CLOSED)


def _draw_settled(axes: Any, settled: float | None) -> None:
    axes.set_yscale("log")
    axes.set_ylabel("error angle [°]")
    if settled is not None:
        level = float(np.degrees(settled))
        axes.axhline(level, color=LIMIT, lw=0.8, ls=(0, (4, 3)), label=f"{level:.4g}°")


def _visible(degrees: np.ndarray) -> np.ndarray:
    return np.where(degrees > MIN_ANGLE, degrees, np.nan)
