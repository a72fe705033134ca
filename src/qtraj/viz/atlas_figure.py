"""Draw an atlas: the feasible region with a value as colour and contours, its border, and the limits outside."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from qtraj.foundation.suggestion import suggestion
from qtraj.foundation.units import symbol
from qtraj.sweeps.atlas.classified import CLASSES, INFEASIBLE, SAMPLED
from qtraj.sweeps.atlas.outcome import VALUE_UNITS, Atlas
from qtraj.viz.style import RC, SERIES, frame

SIZE = (7.6, 4.6)
"""Width and height [inch]."""
PIXELS = 400
"""Number of pixels along each axis; the border is drawn as a line, without pixels."""
PALE = 0.62
"""Share of white in the colours of the limits."""
OTHERS = {"sampled": "#E8F0C8", "infeasible": "0.86", "undecided": "0.6", "failed": "0.25"}
"""Colours of the classes without a value or a limit."""
PLAIN = "#B7DCC9"
"""Colour of the feasible region if no value is drawn."""
CONTOURS = 8
"""Largest number of contour lines."""
WIDE = 56
"""Labels of this length need a column of their own."""


def atlas_figure(
    atlas: Atlas,
    value: str | None = None,
    title: str = "",
    *,
    limits: Sequence[str] | None = None,
    bounds: tuple[float, float] | None = None,
) -> Figure:
    """Draw the classes of an atlas over its two parameters.

    Inside the feasible region, `value` is shown by colours and contour lines; by default it is "duration" if the atlas
    contains it. The infeasible region is coloured by the limits that are met first. The border of the feasible region
    is a black line. For figures that are compared, `limits` are the names of all limits that have a colour, and
    `bounds` the range of the colours of the value; by default, those of this atlas.

    **Raises:** ValueError for a value that the atlas does not contain.
    """
    if value is None and "duration" in atlas.values:
        value = "duration"
    if value is not None and value not in atlas.values:
        raise ValueError(f"the atlas has no value {value!r}: {suggestion(value, [*atlas.values], 'values')}")
    x, y = (np.linspace(axis.low, axis.high, PIXELS) for axis in (atlas.x_axis, atlas.y_axis))
    found = atlas.at(*np.meshgrid(x, y))
    with mpl.rc_context(RC):
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        handles = _draw_classes(axes, x, y, found, value is not None, limits_in(atlas) if limits is None else limits)
        if value is not None:
            _draw_value(figure, axes, (x, y), found, value, bounds)
        for line in atlas.border:
            axes.plot(*line.T, color="0.0", lw=1.4)
        frame(axes)
        axes.set(xlabel=atlas.x_axis.label, ylabel=atlas.y_axis.label, xlim=x[[0, -1]], ylim=y[[0, -1]])
        axes.set_axisbelow(False)
        if handles:
            columns = 2 if max(len(str(handle.get_label())) for handle in handles) < WIDE else 1
            figure.legend(handles=handles, loc="outside lower left", ncols=columns, fontsize=7.5, handlelength=1.4)
        if title:
            axes.set_title(title, fontsize=11, fontweight="bold")
    return figure


def limits_in(atlas: Atlas) -> list[str]:
    """Return the limits that are met first at infeasible points, or combinations of them, in alphabetical order."""
    return sorted({str(name) for name in atlas.first_limit[atlas.codes == INFEASIBLE]} - {""})


def _draw_classes(
    axes: Any, x: np.ndarray, y: np.ndarray, found: dict[str, np.ndarray], has_value: bool, limits: Sequence[str]
) -> list[Patch]:
    """Fill the plane with the colours of classes and limits; return the entries of the legend."""
    status, limit = found["status"], found["first_limit"]
    kinds = np.where(status == CLASSES[INFEASIBLE], limit, "")
    colours = {name: _pale(SERIES[k % len(SERIES)]) for k, name in enumerate(limits)}
    colours |= {name: to_rgb(colour) for name, colour in {CLASSES[0]: PLAIN, **OTHERS}.items()}
    names = np.where(kinds == "", status, kinds)
    shown = [name for name in colours if (names == name).any()]
    codes = np.select([names == name for name in shown], range(len(shown)), 0)
    palette = ListedColormap([colours[name] for name in shown])
    axes.pcolormesh(x, y, codes, cmap=palette, vmin=-0.5, vmax=len(shown) - 0.5, shading="nearest", rasterized=True)
    listed = [name for name in shown if not (has_value and name == CLASSES[0])]
    return [Patch(color=colours[name], label=_label(name, limits)) for name in listed]


def _draw_value(
    figure: Figure,
    axes: Any,
    places: tuple[Any, Any],
    found: dict[str, np.ndarray],
    value: str,
    bounds: tuple[float, float] | None,
) -> None:
    """Draw a value inside the feasible region."""
    inside = np.isin(found["status"], CLASSES[: SAMPLED + 1])
    values = np.ma.masked_where(~inside | ~np.isfinite(found[value]), found[value])
    if values.count() == 0:
        return
    low, high = (None, None) if bounds is None else bounds
    drawn = axes.pcolormesh(*places, values, cmap="viridis", vmin=low, vmax=high, shading="nearest", rasterized=True)
    unit = symbol(VALUE_UNITS.get(value, "1"))
    figure.colorbar(drawn, ax=axes, label=value.replace("_", " ") + (f" [{unit}]" if unit else ""), pad=0.02)
    if np.ptp(values.compressed()) > 0:
        lines = axes.contour(*places, values, levels=CONTOURS, colors="white", linewidths=0.7)
        axes.clabel(lines, fontsize=7, fmt="%.4g")


def _label(name: str, limits: Sequence[str]) -> str:
    words = name.replace("_", " ").replace("longitudinal", "long.")
    return f"infeasible: {words}" if name in limits else name


def _pale(colour: str) -> tuple[float, float, float]:
    red, green, blue = (PALE + (1 - PALE) * part for part in to_rgb(colour))
    return red, green, blue
