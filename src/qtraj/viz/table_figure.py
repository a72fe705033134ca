"""Plot the outputs of a table against time, one panel for each output."""

import textwrap
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure

from qtraj.foundation.units import symbol
from qtraj.path.quantity import TITLES
from qtraj.viz.style import AXIS_COLOURS, COMPONENTS, RC, SERIES, WIDTH, above, frame

PANEL, MARGINS = 1.55, 0.75  # heights [inch]: one panel, and both margins together
MAX_PATHS = 8
NOT_DRAWN = ("dcm", "defined")
"""Outputs that are plotted only if they are requested."""
PALE = 0.55
WRAP = 20  # characters of a line of a label


def table_figure(dataset: xarray.Dataset, names: Sequence[str] = ()) -> Figure:
    """Plot outputs of `qtraj.evaluate` against time, one panel for each output.

    `dataset` is the `to_xarray()` of a table. `names` are the outputs to plot, by default all except `dcm` and
    `defined`. Components have the labels of the table's frame. At most eight paths are drawn; the components of all
    paths except the first are pale. Outputs that depend on the frame are not drawn at instants at which the frame is
    not defined.

    **Raises:** ValueError for an output that the dataset does not contain, or if there are no outputs to plot.
    """
    if unknown := [name for name in names if name not in dataset.data_vars]:
        raise ValueError(
            f"the table does not contain {unknown[0]!r}; it contains {', '.join(map(str, dataset.data_vars))}"
        )
    drawn = list(names) or [str(name) for name in dataset.data_vars if name not in NOT_DRAWN]
    if not drawn:
        raise ValueError(f"the table has no outputs to plot: it contains only {', '.join(map(str, dataset.data_vars))}")
    with mpl.rc_context(RC):
        height = PANEL * len(drawn) + MARGINS
        figure = Figure(figsize=(0.75 * WIDTH, height))
        grid = figure.add_gridspec(
            len(drawn), 1, hspace=0.35, left=0.15, right=0.97, top=1 - 0.3 / height, bottom=0.45 / height
        )
        axes: list[Any] = []
        for row, name in enumerate(drawn):
            axes.append(figure.add_subplot(grid[row], sharex=axes[0] if axes else None))
            _panel(axes[-1], dataset, name)
            axes[-1].tick_params(labelbottom=row == len(drawn) - 1)
        axes[-1].set_xlabel("time from the start of the path [s]")
        figure.align_ylabels(axes)
    return figure


def _panel(axes: Any, dataset: xarray.Dataset, name: str) -> None:
    variable = dataset[name]
    along = dataset["time"].dims[-1]
    inner = [dim for dim in variable.dims if dim not in ("path", along)]
    labels = _labels(dataset, inner)
    paths = range(min(dataset.sizes.get("path", 1), MAX_PATHS))
    for k in paths:
        one, time = (x.isel(path=k) if "path" in x.dims else x for x in (variable, dataset["time"]))
        values = one.transpose(along, *inner).values.reshape(time.size, -1).astype(float)
        values = np.where(_exists(dataset, variable, k)[:, None], values, np.nan)
        for column, label in enumerate(labels):
            colour = _colour(label, column) if inner else SERIES[k % len(SERIES)]
            text = label if inner and k == 0 else f"path {k + 1}" if not inner and len(paths) > 1 else None
            axes.plot(
                time.values, values[:, column], color=colour, lw=1.5, alpha=PALE if inner and k else 1, label=text
            )
    heading = textwrap.fill(TITLES.get(name, name.replace("_", " ")), WRAP)
    axes.set_ylabel(f"{heading}\n[{symbol(variable.attrs.get('units', '1')) or '–'}]")
    frame(axes)
    if axes.get_legend_handles_labels()[1]:
        above(axes, 9)


def _labels(dataset: xarray.Dataset, inner: list[Any]) -> list[str]:
    labels = [""]
    for dim in inner:
        labels = [f"{head} {label}".strip() for head in labels for label in dataset[dim].values]
    return labels


def _colour(label: str, column: int) -> str:
    return COMPONENTS.get(label, (*AXIS_COLOURS, *SERIES)[column % (len(AXIS_COLOURS) + len(SERIES))])


def _exists(dataset: xarray.Dataset, variable: xarray.DataArray, k: int) -> np.ndarray:
    """Return whether the variable is defined at each instant; a variable without frame axes is always defined."""
    depends_on_frame = {"body", "quaternion_component"} & set(variable.dims)
    if "defined" not in dataset or not depends_on_frame:
        return np.ones(dataset["time"].shape[-1], bool)
    defined = dataset["defined"]
    return (defined.isel(path=k) if "path" in defined.dims else defined).values.astype(bool)
