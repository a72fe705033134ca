"""Figures for documents (matplotlib, without its global state)."""

import os
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # registers the projection

from qtraj.io.dataset import MAGNITUDES

# Okabe and Ito's colours, told apart with any colour vision; line styles tell them apart in grey.
COLOURS = {"before": "#D55E00", "after": "#0072B2"}
STYLES = {"before": (0, (5, 2)), "after": "solid"}
SPARE = ("#009E73", "#CC79A7", "#E69F00", "#56B4E9")
AXIS_COLOURS = {"tangent": "#009E73", "normal": "#CC79A7", "binormal": "#E69F00"}
RECORD, LIMIT = "0.45", "0.1"
COMPONENTS = {"w": "#000000", "x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
LINES = {"w": (0, (5, 2)), "x": "solid", "y": (0, (3, 1, 1, 1)), "z": (0, (1, 1))}
"""Of the components of quaternions and vectors."""
SUBSCRIPTS = {"w": "₀", "x": "₁", "y": "₂", "z": "₃"}

WIDTH = 10.0  # [inch]
ALWAYS = ("curvature", "lateral_acceleration")
TRIHEDRA = 6
LEAST_HEIGHT = 0.3  # of the extent of the path: a flat path leaves room for the ticks of z
SYMBOLS = {"tangent": "τ", "normal": "n", "binormal": "b"}
UNITS = {"m-1": "1/m", "m s-1": "m/s", "m s-2": "m/s²", "rad s-1": "rad/s", "rad s-2": "rad/s²", "1": "–"}

RC: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "qtraj",
}


def tuning_figure(dataset: xarray.Dataset) -> Figure:
    """Paths in space with trihedra and recorded points; curvature, lateral acceleration and limits against time.

    `dataset` is one of `qtraj.io.dataset.path_dataset`: every path in it is drawn, trihedra stand on the last, and
    each variable with a limit has its own panel.
    """
    panels = _panels(dataset)
    with mpl.rc_context(RC):
        height = max(5.0, 1.7 * len(panels) + 0.8)
        figure = Figure(figsize=(WIDTH, height))
        # The space keeps its own shape however many panels stand beside it, and hangs below the title.
        space: Any = figure.add_axes((-0.045, 0.92 - 4.6 / height, 0.575, 4.6 / height), projection=Axes3D.name)
        _draw_space(space, dataset)
        margins = {"left": 0.63, "right": 0.985, "top": 1 - 0.5 / height, "bottom": 0.55 / height}
        grid = figure.add_gridspec(len(panels), 1, hspace=0.12, **margins)
        shared = None
        for row, name in enumerate(panels):
            axes = figure.add_subplot(grid[row], sharex=shared)
            shared = shared or axes
            _draw_history(axes, dataset, name, last=row == len(panels) - 1)
        figure.align_ylabels(figure.axes[1:])
        figure.legend(handles=space.get_legend_handles_labels()[0], loc="upper left", fontsize=8)
        figure.suptitle(dataset.attrs.get("title", ""), y=1 - 0.08 / height, va="top", fontsize=11, fontweight="bold")
    return figure


def save(figure: Figure, file: str | os.PathLike[str]) -> None:
    """Write a figure in the format of the suffix (png, svg, pdf), the same bytes for the same figure."""
    suffix = os.fspath(file).rpartition(".")[2]
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(suffix)
    with mpl.rc_context(RC):
        figure.savefig(file, dpi=200, metadata=metadata)


def title(dataset: xarray.Dataset) -> str:
    """The name of the scenario, or of its file."""
    return dataset.attrs.get("title") or dataset.attrs.get("scenario_file", "")


def frame(axes: Any) -> None:
    """A light grid, and the horizontal axis no longer than what is drawn."""
    axes.grid(alpha=0.25, lw=0.5)
    axes.margins(x=0)


def _panels(dataset: xarray.Dataset) -> list[str]:
    """Variables to show against time: those with a limit, and two in any case."""
    return [name for name in MAGNITUDES.values() if name in ALWAYS or "limit" in dataset[name].attrs]


def _draw_space(axes: Any, dataset: xarray.Dataset) -> None:
    """All paths about their common centre, so that large world coordinates do not clutter the axes."""
    positions = dataset["position"].values
    flat = positions.reshape(-1, 3)
    centre = np.round((flat.min(axis=0) + flat.max(axis=0)) / 2)
    extent = np.ptp(flat, axis=0)
    if "recorded_position" in dataset:
        recorded = dataset["recorded_position"].values - centre
        axes.plot(*recorded.T, ".", ms=4, color=RECORD, label="recorded", zorder=1)
    for k, name in enumerate(dataset["path"].values):
        axes.plot(*(positions[k] - centre).T, label=str(name), **_line(str(name), k))
    _draw_trihedra(axes, dataset.isel(path=-1), centre, length=0.16 * extent.max())
    for end, letter in ((0, "A"), (-1, "B")):
        axes.text(*(positions[-1, end] - centre), f"  {letter}", fontweight="bold")
    low, high = axes.get_zlim()
    room = max(LEAST_HEIGHT * extent.max() - (high - low), 0.0)
    axes.set_zlim(low - room / 2, high + room / 2)
    axes.set_aspect("equal", adjustable="box")
    for axis, ticks in ((axes.xaxis, 6), (axes.yaxis, 6), (axes.zaxis, 3)):
        axis.set_major_locator(MaxNLocator(ticks))
    axes.view_init(elev=38, azim=-60)
    for letter, offset in zip("xyz", centre, strict=True):
        sign = "−" if offset >= 0 else "+"
        shift = f" {sign} {abs(offset):.0f}" if offset else ""
        getattr(axes, f"set_{letter}label")(f"{letter}{shift} [m]", labelpad=1 if letter == "z" else 6)


def _draw_trihedra(axes: Any, path: xarray.Dataset, centre: np.ndarray, length: float) -> None:
    chosen = np.linspace(0, path.sizes["sample"] - 1, TRIHEDRA).round().astype(int)
    chosen = chosen[path["defined"].values[chosen].astype(bool)]
    if not chosen.size:
        return
    origin = path["position"].values[chosen] - centre
    for k, (name, colour) in enumerate(AXIS_COLOURS.items()):
        arrow = path["dcm"].values[chosen, k]
        axes.quiver(
            *origin.T,
            *arrow.T,
            length=length,
            color=colour,
            lw=1.1,
            arrow_length_ratio=0.25,
            label=f"{SYMBOLS[name]} ({name})",
        )


def _draw_history(axes: Any, dataset: xarray.Dataset, name: str, last: bool) -> None:
    """One magnitude of every path against its own time, with its limit."""
    variable = dataset[name]
    for k, path in enumerate(dataset["path"].values):
        values = variable.isel(path=k).values
        axes.plot(dataset["time"].isel(path=k).values, np.abs(values), label=str(path), **_line(str(path), k))
    if (limit := variable.attrs.get("limit")) is not None:
        axes.axhline(limit, color=LIMIT, lw=1.0, ls=(0, (1, 1.5)), label=f"limit {limit:.4g}")
    drawn = [y for line in axes.lines for y in line.get_ydata()]
    if min(drawn) < 0.5 * max(drawn):  # else the zero would only squeeze what there is to see
        axes.set_ylim(bottom=0)
    axes.set_xlim(left=0)
    axes.set_ylabel(f"{name.removesuffix('_magnitude').replace('_', ' ')} [{UNITS[variable.attrs['units']]}]")
    axes.grid(alpha=0.25, lw=0.5)
    axes.legend(loc="best", fontsize=8)
    if last:
        axes.set_xlabel("time from the start of the path [s]")
    else:
        axes.tick_params(labelbottom=False)


def _line(name: str, k: int) -> dict[str, Any]:
    return {"color": COLOURS.get(name, SPARE[k % len(SPARE)]), "ls": STYLES.get(name, "solid"), "lw": 1.8}
