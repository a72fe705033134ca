"""Plot a work-precision diagram."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator, ScalarFormatter
from numpy.typing import ArrayLike

from qtraj.viz.style import BAND, MARKERS, RC, above, head, series

SIZE = (6.4, 4.6)  # [inch]
COLUMNS, ROW = 3, 0.17  # number of columns of the legend, and height of its rows [inch]
FEW = 8  # maximum number of different work values for which each value is a tick of the axis


def precision_figure(
    series_by_name: Mapping[str, tuple[ArrayLike, ArrayLike]],
    work: str = "evaluations [–]",
    error: str = "error [rad]",
    round_off: float | None = None,
    title: str = "",
) -> Figure:
    """Plot error against work on logarithmic axes, one line with markers for each method.

    `series_by_name` contains a pair (work, error) of arrays of positive values for each method. The line of a method of
    order p has slope −p. `work` and `error` are the axis labels, with units. Errors below `round_off` are drawn at
    `round_off`.

    **Raises:** ValueError if there is no method, or a value is not positive.
    """
    if not series_by_name:
        raise ValueError("a work-precision figure needs at least one method")
    entries = len(series_by_name) + (round_off is not None)
    with mpl.rc_context(RC):
        top = 1 - (0.1 + ROW * -(-entries // COLUMNS) + (BAND if title else 0.0)) / SIZE[1]
        figure = Figure(figsize=SIZE)
        axes = figure.add_axes((0.125, 0.115, 0.855, top - 0.115))
        works = set()
        for k, (name, (x, y)) in enumerate(series_by_name.items()):
            x, y = np.asarray(x, float), np.asarray(y, float)
            y = y if round_off is None else np.maximum(y, round_off)
            if not ((x > 0).all() and (y > 0).all()):
                raise ValueError(f"work and error values must be positive, but the values of {name!r} are {x}, {y}")
            works |= set(x.tolist())
            axes.plot(x, y, marker=MARKERS[k % len(MARKERS)], ms=5, label=name, **series(k))
        axes.set_xscale("log")
        axes.set_yscale("log")
        if len(works) <= FEW:
            axes.set_xticks(sorted(works))
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_locator(LogLocator(numticks=9))
        axes.yaxis.set_minor_formatter(NullFormatter())
        if round_off is not None:
            axes.axhline(round_off, color="0.6", lw=0.8, ls=(0, (4, 3)), label="round-off")
        axes.set_xlabel(work)
        axes.set_ylabel(error)
        axes.grid(alpha=0.25, lw=0.5)
        above(axes, COLUMNS, handle=3.0)
        head(figure, title)
    return figure
