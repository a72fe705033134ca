"""Plot paths in space, with equal axis scales: lines, recorded points, trihedra, boundary values."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D  # registers the projection
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from qtraj.design.limits import Limits
from qtraj.viz.drawable import path_samples
from qtraj.viz.extent import beside
from qtraj.viz.obstacles import draw_obstacles_in_space
from qtraj.viz.style import AXIS_COLOURS, RC, RECORD, body_axes, head, path_line, title

TRIHEDRA = 6
MIN_EXTENT = 0.3  # the smallest length of an axis, relative to the extent of the path
ARROW = 0.16  # relative to the extent of the path
BARB = np.sin(np.radians(16))  # sine of the angle between an arrow and the barbs of its head
SIZE = (7.6, 5.6)  # [inch]
WORLD_COLOUR, VELOCITY_COLOUR, RADIUS_COLOUR = "0.1", "#D55E00", "0.35"
VIEW = {"elev": 38, "azim": -60}


def path_figure(
    dataset: Any,
    trihedra: int = TRIHEDRA,
    velocities: bool = False,
    reference: bool = False,
    view: tuple[float | int, float | int] | None = None,
) -> Figure:
    """Plot paths in space with equal axis scales, and trihedra of the last path at equal time steps.

    `dataset` is the result of `qtraj.io.dataset.path_dataset`, or a path or a result that can be converted to it.
    `trihedra` is the number of trihedra. If `velocities` is true, the velocities V_A and V_B are drawn at the ends A
    and B. If `reference` is true, the world axes i, j, k at the origin and the radius vectors of the ends are drawn.
    `view` is (elevation, azimuth) [°].

    **Raises:** ValueError for a dataset without paths, or an object of any other type.
    """
    dataset = path_samples(dataset)
    with mpl.rc_context(RC):
        figure = Figure(figsize=SIZE)
        axes: Any = figure.add_axes((-0.05, 0.0, 1.08, 0.98), projection=Axes3D.name)
        draw_space(axes, dataset, trihedra, velocities, reference)
        if view is not None:
            axes.view_init(elev=view[0], azim=view[1])
        figure.legend(handles=axes.get_legend_handles_labels()[0], loc="upper left", fontsize=8)
        head(figure, title(dataset))
    return figure


def draw_space(
    axes: Any,
    dataset: xarray.Dataset,
    trihedra: int = TRIHEDRA,
    velocities: bool = False,
    reference: bool = False,
    limits: Limits | None = None,
) -> None:
    """Plot all paths relative to their common centre, or relative to the origin if `reference` is true.

    With positions relative to the centre, tick labels are short even if the world coordinates are large. The obstacles
    of `limits` are drawn, too.
    """
    positions = dataset["position"].values
    flat = positions.reshape(-1, 3)
    if reference:
        flat = np.concatenate([flat, np.zeros((1, 3))])
    centre = np.zeros(3) if reference else np.round((flat.min(axis=0) + flat.max(axis=0)) / 2)
    extent = np.ptp(flat, axis=0).max()
    if "recorded_position" in dataset:
        recorded = beside(dataset["recorded_position"].values, [flat]) - centre
        axes.plot(*recorded.T, ".", ms=4, color=RECORD, label="recorded", zorder=1)
    for k, name in enumerate(dataset["path"].values):
        axes.plot(*(positions[k] - centre).T, label=str(name), **path_line(str(name), k))
    last = dataset.isel(path=-1)
    if trihedra:
        _draw_trihedra(axes, last, centre, trihedra, length=ARROW * extent)
    if reference:
        _draw_reference(axes, positions[-1], extent)
    if velocities:
        _draw_velocities(axes, last, centre, extent)
    for end, letter in ((0, "A"), (-1, "B")):
        axes.text(*(positions[-1, end] - centre), f"  {letter}", fontweight="bold")
    _widen(axes, extent)
    if limits is not None:
        draw_obstacles_in_space(axes, limits, centre, extent)
        _widen(axes, extent)
    _frame(axes, centre)


def _widen(axes: Any, extent: float) -> None:
    """Give the axes of a flat or a narrow path enough length for ticks."""
    for letter in "xyz":
        low, high = getattr(axes, f"get_{letter}lim")()
        margin = max(MIN_EXTENT * extent - (high - low), 0.0)
        getattr(axes, f"set_{letter}lim")(low - margin / 2, high + margin / 2, auto=None)


def _frame(axes: Any, centre: np.ndarray) -> None:
    """Set equal axis scales and few ticks, and label the axes with the subtracted coordinates of the centre."""
    axes.set_aspect("equal", adjustable="box")
    for axis, ticks in ((axes.xaxis, 6), (axes.yaxis, 4), (axes.zaxis, 3)):
        axis.set_major_locator(MaxNLocator(ticks))
    axes.view_init(**VIEW)
    for letter, offset in zip("xyz", centre, strict=True):
        sign = "−" if offset >= 0 else "+"
        shift = f" {sign} {abs(offset):.0f}" if offset else ""
        getattr(axes, f"set_{letter}label")(f"{letter}{shift} [m]", labelpad=1 if letter == "z" else 6)


def _draw_trihedra(axes: Any, path: xarray.Dataset, centre: np.ndarray, count: int, length: float) -> None:
    chosen = np.linspace(0, path.sizes["sample"] - 1, count).round().astype(int)
    chosen = chosen[path["defined"].values[chosen].astype(bool)]
    if not chosen.size:
        return
    origin = path["position"].values[chosen] - centre
    for k, (label, colour) in enumerate(zip(body_axes(path).titles(), AXIS_COLOURS, strict=True)):
        arrow = length * path["dcm"].values[chosen, k]
        _arrows(axes, origin, arrow, 0.25, color=colour, lw=1.1, label=label)


def _arrows(axes: Any, origins: np.ndarray, arrows: np.ndarray, head: float, **style: Any) -> None:
    """Draw arrows (n, 3) with four barbs, which are visible from all sides.

    `head` is the length of the barbs divided by the length of the arrow. Matplotlib's arrows have two barbs, which are
    invisible if viewed edge-on.
    """
    length = np.linalg.norm(arrows, axis=1, keepdims=True)
    along = arrows / np.where(length > 0, length, 1.0)
    most_orthogonal = np.eye(3)[np.argmin(np.abs(along), axis=1)]
    side = np.cross(along, most_orthogonal)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    tips = origins + arrows
    ends = [origins] + [
        tips + head * length * (BARB * s - np.sqrt(1 - BARB**2) * along)
        for s in (side, -side, np.cross(along, side), -np.cross(along, side))
    ]
    lines = np.stack([np.stack([end, tips], axis=1) for end in ends], axis=1).reshape(-1, 2, 3)
    axes.add_collection3d(Line3DCollection(lines, **style), autolim=False)
    axes.auto_scale_xyz(*np.concatenate([origins, tips]).T, had_data=True)


def _draw_reference(axes: Any, positions: np.ndarray, extent: float) -> None:
    """Draw the world axes at the origin, and the radius vectors of both ends."""
    length = 1.6 * ARROW * extent
    for direction, letter in zip(np.eye(3), "ijk", strict=True):
        _arrows(axes, np.zeros((1, 3)), length * direction[None], 0.2, color=WORLD_COLOUR, lw=1.3)
        axes.text(*(1.12 * length * direction), letter, fontstyle="italic")
    for end, label in ((0, "radius vectors"), (-1, None)):
        axes.plot(*np.stack([np.zeros(3), positions[end]]).T, color=RADIUS_COLOUR, lw=0.9, ls=(0, (4, 3)), label=label)


def _draw_velocities(axes: Any, path: xarray.Dataset, centre: np.ndarray, extent: float) -> None:
    """Draw the velocities at both ends; the length of the longer arrow is a third of the path's extent."""
    velocities = path["velocity"].values[[0, -1]]
    scale = extent / 3 / max(np.linalg.norm(velocities, axis=1).max(), 1e-300)
    origin = path["position"].values[[0, -1]] - centre
    for point, velocity, letter, label in zip(origin, scale * velocities, "AB", ("velocity", None), strict=True):
        _arrows(axes, point[None], velocity[None], 0.15, color=VELOCITY_COLOUR, lw=1.6, label=label)
        axes.text(*(point + 1.08 * velocity), f"V$_{letter}$", color=VELOCITY_COLOUR)
