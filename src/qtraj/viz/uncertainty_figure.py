"""Plot quantities with their standard deviations against time: a band of two standard deviations on both sides."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray
from jaxtyping import Float
from matplotlib.figure import Figure

from qtraj.viz.style import BOUND
from qtraj.viz.table_figure import table_figure

WIDE = 2.0
"""Half of the width of a band, in standard deviations; a normally distributed value is inside with 95 %."""

PALE = 0.22


def uncertainty_figure(dataset: xarray.Dataset, bands: Mapping[str, str], bound: float | None = None) -> Figure:
    """Plot variables with their bands, one panel each.

    `bands` are the variables to plot, and for each of them the variable with its standard deviation. A `bound` is drawn
    as a limit in every panel.

    **Raises:** ValueError for a variable that the dataset does not contain.
    """
    figure = table_figure(dataset, list(bands))
    for axes, (name, sigma) in zip(figure.axes, bands.items(), strict=True):
        values, widths = (np.asarray(dataset[x]).reshape(dataset.sizes["time"], -1) for x in (name, sigma))
        for line, value, width in zip(list(axes.lines), values.T, WIDE * widths.T, strict=True):
            style: Any = {"color": line.get_color(), "alpha": PALE, "lw": 0}
            axes.fill_between(dataset["time"].values, value - width, value + width, **style)
        if bound is not None:
            axes.axhline(bound, **BOUND)
    return figure


def without_turns(angles: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return angles [rad] without jumps by whole turns; NaN are left out."""
    result, known = angles.copy(), np.isfinite(angles)
    result[known] = np.unwrap(angles[known])
    return result
