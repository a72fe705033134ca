"""Plot path quantities and their limits against time, with or without the paths in space."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D  # registers the projection

from qtraj.design.limits import Limits
from qtraj.foundation.units import symbol
from qtraj.io.dataset import (
    AT_SPEED,
    LIMIT_VARIABLES,
    bounded_values,
    limited_variables,
    limits_along,
    limits_of,
    own_variables,
)
from qtraj.viz.drawable import path_samples
from qtraj.viz.report.ranges import spike
from qtraj.viz.space import draw_space
from qtraj.viz.style import BAND, BOUND, LIMIT, RC, WIDTH, head, path_line, title

ALWAYS = ("curvature", "lateral_acceleration")
PANEL = 1.7  # height [inch]
# If all values are above this fraction of the largest value, the curves would look flat on an axis from zero.
FLAT = 0.85
LONG = 22  # names with more characters have the unit in a second line


def tuning_figure(dataset: Any, limits: Limits | None = None) -> Figure:
    """Plot paths in space, and curvature, lateral acceleration and all limited quantities over time.

    `dataset` is the result of `qtraj.io.dataset.path_dataset`, or a path or a result that can be converted to it. All
    paths and the recorded points are drawn, trihedra on the last path, and the obstacles of `limits`. Each quantity has
    its own panel.

    **Raises:** ValueError for a dataset without paths, or an object of any other type.
    """
    dataset = path_samples(dataset)
    panels, name = _panels(dataset), dataset.attrs.get("title", "")
    with mpl.rc_context(RC):
        band = BAND if name else 0.0
        height = max(4.65, PANEL * len(panels) + 0.45) + band
        figure = Figure(figsize=(WIDTH, height))
        # The 3-D axes have the same shape for any number of panels, and start below the title.
        space: Any = figure.add_axes((-0.045, 1 - (4.65 + band) / height, 0.575, 4.6 / height), projection=Axes3D.name)
        draw_space(space, dataset, limits=limits)
        margins = {"left": 0.63, "right": 0.985, "top": 1 - (0.15 + band) / height, "bottom": 0.55 / height}
        _draw_panels(figure, dataset, panels, margins)
        figure.legend(handles=space.get_legend_handles_labels()[0], loc="upper left", fontsize=8)
        head(figure, name, 1 - 0.08 / height)
    return figure


def limits_figure(dataset: Any, names: Sequence[str] | None = None) -> Figure:
    """Plot quantities of all paths against time, one panel for each quantity, with the limits of the dataset.

    `dataset` is the result of `qtraj.io.dataset.path_dataset`, or a path or a result that can be converted to it.
    `names` are names of `qtraj.Limits`; the default is curvature, lateral acceleration and all limited quantities.

    **Raises:** ValueError for an unknown name, a dataset without paths, or an object of any other type.
    """
    dataset = path_samples(dataset)
    unknown = set(names or ()) - set(LIMIT_VARIABLES)
    if unknown:
        raise ValueError(
            f"unknown path quantity {min(unknown)!r}; the known quantities are {', '.join(LIMIT_VARIABLES)}"
        )
    panels = _panels(dataset) if names is None else [LIMIT_VARIABLES[name] for name in names]
    if absent := [name for name in panels if name not in dataset]:
        raise ValueError(f"the dataset does not contain {absent[0]!r}: pass limits with a vehicle to path_dataset")
    with mpl.rc_context(RC):
        band = BAND if title(dataset) else 0.0
        height = PANEL * len(panels) + 0.65 + band
        figure = Figure(figsize=(0.75 * WIDTH, height))
        margins = {"left": 0.12, "right": 0.98, "top": 1 - (0.1 + band) / height, "bottom": 0.55 / height}
        _draw_panels(figure, dataset, panels, margins)
        head(figure, title(dataset))
    return figure


def _panels(dataset: xarray.Dataset) -> list[str]:
    """Return the variables to plot against time: all variables with a limit, and the variables in `ALWAYS`."""
    limited = {*ALWAYS, *limited_variables(dataset)}
    known = dict.fromkeys(name for name in LIMIT_VARIABLES.values() if name in dataset)  # forces need a vehicle
    known |= dict.fromkeys(own_variables(dataset))
    return [name for name in known if name in limited]


def _draw_panels(figure: Figure, dataset: xarray.Dataset, panels: list[str], margins: dict[str, float]) -> None:
    grid = figure.add_gridspec(len(panels), 1, hspace=0.12, **margins)
    drawn: list[Any] = []
    for row, name in enumerate(panels):
        drawn.append(figure.add_subplot(grid[row], sharex=drawn[0] if drawn else None))
        _draw_history(drawn[-1], dataset, name, last=row == len(panels) - 1)
    figure.align_ylabels(drawn)


def _draw_history(axes: Any, dataset: xarray.Dataset, name: str, last: bool) -> None:
    """Plot one quantity of every path against the time of the path, and the limit on the quantity."""
    variable = dataset[name]
    for k, path in enumerate(dataset["path"].values):
        values = variable.isel(path=k).values
        shown = bounded_values(name, values)
        axes.plot(dataset["time"].isel(path=k).values, shown, label=str(path), **path_line(str(path), k))
    limits = limits_of(variable)
    one = "lower limit" if "lower_limit" in variable.attrs else "limit"
    for limit, words in zip(limits, ("lower limit", "upper limit") if len(limits) > 1 else (one,), strict=False):
        axes.axhline(limit, label=f"{words} {limit:.4g}", **BOUND)
    for own in limits_along(dataset, name):
        for k in range(dataset.sizes["path"]):
            bound = dataset[own].isel(path=k).values
            axes.plot(dataset["time"].isel(path=k).values, bound, label="" if k else _changing(dataset[own]), **BOUND)
    # Where the road has no load, the friction demand is infinite.
    drawn = [y for line in axes.lines for y in line.get_ydata() if np.isfinite(y)]
    sampled = [y for line in axes.lines if len(line.get_ydata()) > 2 for y in line.get_ydata() if np.isfinite(y)]
    lowest = min(0.0, *drawn) if drawn else 0.0
    if (cut := spike([np.asarray(sampled)])) is not None:  # otherwise a single stop would determine the scale
        top = max([cut[0], *(1.08 * abs(limit) for limit in limits)])
        axes.set_ylim(max(1.08 * lowest, -top) - 0.03 * top, top)
        if max(sampled) > top:
            note = f"larger values, up to {max(sampled):.3g}, are not shown"
            axes.text(0.99, 0.97, note, transform=axes.transAxes, ha="right", va="top", fontsize="x-small")
    elif drawn and min(drawn) < FLAT * max(drawn):
        # leave margins, so that lines at both ends of the range are visible
        extent = max(drawn) - lowest
        axes.set_ylim(lowest - (0.08 if lowest < 0 else 0.03) * extent, max(drawn) + 0.08 * extent)
    _shade_beyond(axes, variable)
    axes.set_xlim(left=0)
    words, unit = name.removesuffix("_magnitude").replace("_", " "), symbol(variable.attrs["units"]) or "–"
    axes.set_ylabel(f"{words}{chr(10) if len(words) > LONG else ' '}[{unit}]")
    axes.grid(alpha=0.25, lw=0.5)
    axes.legend(loc="best", fontsize=8)
    if last:
        axes.set_xlabel("time from the start of the path [s]")
    else:
        axes.tick_params(labelbottom=False)


def _changing(limit: xarray.DataArray) -> str:
    """Return the words for a limit that changes."""
    return "limit at this speed" if limit.attrs["long_name"].endswith(AT_SPEED) else "limit along the way"


def _shade_beyond(axes: Any, variable: xarray.DataArray) -> None:
    """Shade the values that the limits exclude."""
    low, high = axes.get_ylim()
    for name, edge in (("limit", high), ("lower_limit", low)):
        if name in variable.attrs:
            axes.axhspan(float(variable.attrs[name]), edge, color=LIMIT, alpha=0.05, lw=0)
    axes.set_ylim(low, high)
