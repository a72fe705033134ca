"""Define the style of all figures (colours, line styles, labels), and write figures to files with `save`."""

import os
from typing import Any

import matplotlib as mpl
import xarray
from matplotlib.figure import Figure

from qtraj.foundation.printable import printable
from qtraj.path.frame_axes import NATURAL, FrameAxes, axes_of

# The colours of Okabe and Ito can be distinguished with all common forms of colour blindness. The line styles can be
# distinguished even in greyscale.
COLOURS = {"before": "#D55E00", "after": "#0072B2"}
STYLES = {"before": (0, (5, 2)), "after": "solid"}
SPARE = ("#0072B2", "#D55E00", "#56B4E9", "#000000")  # for paths with other names; distinct from AXIS_COLOURS
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
DASHES = ("solid", (0, (5, 2)), (0, (3, 1, 1, 1)), (0, (7, 1.5, 1.5, 1.5)), (0, (2, 1)), (0, (5, 1, 1, 1, 1, 1)))
MARKERS = "os^Dvx+"
AXIS_COLOURS = ("#009E73", "#CC79A7", "#E69F00")
"""Colours of the body axes x, y, z."""
RECORD, LIMIT, MARK = "0.45", "0.1", "#B00020"
COMPONENTS = {"w": "#000000", "x": "#D55E00", "y": "#009E73", "z": "#0072B2"}
LINES = {"w": (0, (5, 2)), "x": "solid", "y": (0, (3, 1, 1, 1)), "z": (0, (1, 1))}
"""Line styles of the components of quaternions and vectors."""
SUBSCRIPTS = {"w": "₀", "x": "₁", "y": "₂", "z": "₃"}
CLOSED = {"color": "0.0", "lw": 1.1, "ls": (0, (1, 1.6)), "zorder": 3}
"""Style of a closed form, which is drawn over a simulation."""
BOUND = {"color": LIMIT, "lw": 1.0, "ls": (0, (1, 1.5))}
"""Style of a limit."""

WIDTH = 10.0  # [inch]
BAND = 0.35  # height of a title [inch]
MIN_ANGLE = 1e-7  # [°]; smaller angles are round-off
ANGLE_LABEL, RATE_LABEL = r"angle $\Phi$ [°]", r"rate $\dot\Phi$ [°/s]"
ACCELERATION_LABEL = r"acceleration $\ddot\Phi$ [°/s²]"

RC: Any = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "qtraj",
}


def save(figure: Figure, file: str | os.PathLike[str]) -> None:
    """Write a figure in the format of the suffix (png, svg, pdf); equal figures produce identical files."""
    suffix = os.fspath(file).rpartition(".")[2]
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(suffix)
    with mpl.rc_context(RC):
        figure.savefig(file, dpi=200, metadata=metadata)


def title(dataset: xarray.Dataset) -> str:
    """Return the name of the scenario, or the name of its file if the scenario has no name."""
    return printable(dataset.attrs.get("title") or dataset.attrs.get("scenario_file", ""))


def body_axes(dataset: xarray.Dataset) -> FrameAxes:
    """Return the axes of a dataset's frame, or the axes of the natural trihedral if no frame is stored."""
    return axes_of(str(dataset.attrs.get("frame", NATURAL)))


def frame(axes: Any) -> None:
    """Add a light grid, and fit the horizontal axis to the data."""
    axes.grid(alpha=0.25, lw=0.5)
    axes.margins(x=0)


def head(figure: Figure, text: str, y: float = 0.985) -> None:
    """Add the title of a figure, unless it is empty."""
    if text:
        figure.suptitle(text, y=y, va="top", fontsize=11, fontweight="bold")


def above(axes: Any, columns: int = 6, handle: float = 1.7) -> None:
    """Add a legend above the panel, where it hides no curves."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        fontsize=7.5,
        borderaxespad=0.1,
        handlelength=handle,
        columnspacing=1.0,
        handletextpad=0.5,
    )


def path_line(name: str, k: int) -> dict[str, Any]:
    """Return colour and line style of the k-th path; "before" and "after" look the same in all figures."""
    return {
        "color": COLOURS.get(name, SPARE[k % len(SPARE)]),
        "ls": STYLES.get(name, DASHES[k % len(DASHES)]),
        "lw": 1.8,
    }


def series(k: int) -> dict[str, Any]:
    """Return colour and line style of the k-th curve of a comparison."""
    return {"color": SERIES[k % len(SERIES)], "ls": DASHES[k % len(DASHES)], "lw": 1.6}


def component(label: str) -> dict[str, Any]:
    """Return colour and line style of a component, "w", "x", "y" or "z"."""
    return {"color": COMPONENTS[label], "ls": LINES[label], "lw": 1.5}
