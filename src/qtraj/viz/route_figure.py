"""Plot a route as a map coloured by curvature, and its height, speed and limited quantities against the distance.

After a tuning, the route before is drawn too, and a panel shows the lateral distance between both. Bands are two
standard deviations of the fitted route on both sides. A road that changes along the way has panels for its bank and its
coefficients of friction.
"""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D  # registers the projection

from qtraj.design.limits import Limits
from qtraj.foundation.units import symbol
from qtraj.io.dataset import bounded_values, limited_variables, limits_along, limits_of
from qtraj.viz.drawable import path_samples
from qtraj.viz.extent import beside
from qtraj.viz.map_colours import map_colours
from qtraj.viz.obstacles import draw_obstacles
from qtraj.viz.report.along import match
from qtraj.viz.report.ranges import spike
from qtraj.viz.road_panels import draw_road, road_panels
from qtraj.viz.space import draw_space
from qtraj.viz.style import BAND, BOUND, COLOURS, MARK, RC, RECORD, STYLES, WIDTH, above, head, title
from qtraj.viz.uncertainty_figure import PALE, WIDE

PANEL, MAP, SCENE = 1.05, 4.6, 4.4  # heights [inch]
LEFT = 0.105
HEIGHT = "height"
"""The first panel, also without a limit on the height."""

LATERAL = "to the left\nof before"
"""Label of the lateral distance of the path after a tuning from the path before."""


def route_figure(dataset: Any, limits: Limits | None = None) -> Figure:
    """Plot the last path of a dataset as a map, and its height, speed and limited quantities against the distance.

    If the last two paths are "before" and "after", both are drawn, with the lateral distance of "after" from "before".
    `dataset` is the result of `qtraj.io.dataset.path_dataset`, or a path that can be converted to it. Recorded
    positions are drawn as points behind the line of the path, and so are the obstacles of `limits`, which are also
    drawn in space, below the map. Where a quantity violates its limit, the curve is red.

    **Raises:** ValueError for a dataset without paths, or an object of any other type.
    """
    dataset = path_samples(dataset)
    if HEIGHT not in dataset:  # a stored dataset may be older than this output
        dataset = dataset.assign({HEIGHT: dataset["position"].isel(world=2, drop=True)})
    path = dataset.isel(path=-1)
    limited = limited_variables(path)
    before = _before(dataset)
    road = road_panels(dataset)
    panels = [*dict.fromkeys([HEIGHT, "speed", *limited]), *road, *([] if before is None else [LATERAL])]
    with mpl.rc_context(RC):
        band = BAND if title(dataset) else 0.0
        scene = SCENE if limits is not None and limits.keep_out else 0.0
        height = MAP + scene + PANEL * len(panels) + 0.5 + band
        figure = Figure(figsize=(WIDTH, height))
        top = 1 - (band + 0.15) / height
        plan: Any = figure.add_axes((LEFT, top - (MAP - 0.5) / height, 0.94 - LEFT, (MAP - 0.5) / height))
        _draw_map(figure, plan, dataset, path, before)
        if limits is not None:
            draw_obstacles(plan, limits, np.round(path["position"].values[:, :2].mean(axis=0)))
        if scene:
            corner = (0.0, top - (MAP + scene - 0.3) / height, 1.0, (scene - 0.3) / height)
            space: Any = figure.add_axes(corner, projection=Axes3D.name)
            draw_space(space, dataset.isel(path=[-1]), trihedra=0, limits=limits)
        grid = figure.add_gridspec(
            len(panels), 1, hspace=0.22, left=LEFT, right=0.985, top=top - (MAP + scene) / height, bottom=0.5 / height
        )
        way = distance(path)
        label, scale = ("distance travelled [km]", 1000.0) if way[-1] > 1000 else ("distance travelled [m]", 1.0)
        drawn: list[Any] = []
        for row, name in enumerate(panels):
            drawn.append(figure.add_subplot(grid[row], sharex=drawn[0] if drawn else None))
            if name == LATERAL and before is not None:
                _draw_lateral(drawn[-1], path, before, way / scale)
            elif name in road:
                draw_road(drawn[-1], dataset, way, way / scale, name)
                _finish(drawn[-1], road[name])
            else:
                _draw_panel(drawn[-1], path, way / scale, name, None if before is None else (before, scale))
            drawn[-1].tick_params(labelbottom=row == len(panels) - 1)
        drawn[-1].set_xlabel(label)
        if before is not None:
            above(drawn[1])
        figure.align_ylabels(drawn)
        head(figure, title(dataset), 1 - 0.08 / height)
    return figure


def distance(path: xarray.Dataset) -> np.ndarray:
    """Return the distance travelled [m] at each sample, by the trapezoidal rule."""
    speed, time = path["speed"].values, path["time"].values
    return np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(time))])


def _before(dataset: xarray.Dataset) -> xarray.Dataset | None:
    """Return the path "before" if the last path is "after", otherwise None."""
    names = [str(name) for name in np.atleast_1d(dataset["path"].values)]
    return dataset.isel(path=names.index("before")) if names[-1] == "after" and "before" in names else None


def _draw_map(
    figure: Figure, axes: Any, dataset: xarray.Dataset, path: xarray.Dataset, before: xarray.Dataset | None
) -> None:
    """Draw the horizontal positions relative to their centre (rounded to metres), coloured by curvature."""
    position = path["position"].values[:, :2]
    centre = np.round(position.mean(axis=0))
    points = position - centre
    if "recorded_position" in dataset:
        recorded = beside(dataset["recorded_position"].values[:, :2], [position]) - centre
        axes.plot(*recorded.T, ".", ms=1.5, color=RECORD, label="recorded", zorder=1, rasterized=True)
    colours = map_colours(path)
    own, values = colours.lines(points)
    lines = LineCollection(own, cmap="viridis", linewidths=2.2, zorder=2, capstyle="round")
    lines.set_array(values)
    lines.set_clim(0.0, colours.top)
    axes.add_collection(lines)
    if before is not None:
        line = {"color": COLOURS["before"], "ls": STYLES["before"], "lw": 0.6, "zorder": 3}
        axes.plot(*(before["position"].values[:, :2] - centre).T, label="before", **line)
        axes.plot([], [], color=lines.get_cmap()(0.3), lw=2.2, label="after, coloured by curvature")
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="upper left", fontsize=8, markerscale=4)
    for letter, at, across in (("A", points[0], "right"), ("B", points[-1], "left")):
        shift = (4 if across == "left" else -4, 4)
        axes.annotate(letter, at, xytext=shift, textcoords="offset points", ha=across, fontweight="bold")
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.04)
    axes.autoscale_view()
    axes.grid(alpha=0.25, lw=0.5)
    axes.set_xlabel(_offset("x", centre[0]))
    axes.set_ylabel(_offset("y", centre[1]))
    figure.colorbar(lines, ax=axes, fraction=0.025, pad=0.01, extend="max", label="curvature [1/m]")


def _offset(letter: str, centre: float) -> str:
    return f"{letter} [m]" if centre == 0 else f"{letter} {'−' if centre > 0 else '+'} {abs(centre):.0f} [m]"


def _draw_panel(
    axes: Any, path: xarray.Dataset, way: np.ndarray, name: str, before: tuple[xarray.Dataset, float] | None
) -> None:
    """Plot one quantity against the distance, with its limit; values that violate the limit are red.

    `before` is the path before a tuning, and the length of the unit of the distance [m].
    """
    values = _values(path, name)
    if before is not None:
        earlier, scale = before
        style = {"color": COLOURS["before"], "ls": STYLES["before"], "lw": 0.9}
        axes.plot(distance(earlier) / scale, _values(earlier, name), label="before", **style)
        _draw_band(axes, earlier, distance(earlier) / scale, name, COLOURS["before"])
    axes.plot(way, values, color=COLOURS["after"], lw=1.0, label="after")
    _draw_band(axes, path, way, name, COLOURS["after"])
    limits = limits_of(path[name])
    for limit in limits:
        axes.axhline(limit, **BOUND, label=f"limit {limit:.4g}")
    lower, upper = (_bound(path, name, x, absent) for x, absent in (("lower_limit", -np.inf), ("limit", np.inf)))
    for bound in (path[own].values for own in limits_along(path, name)):
        axes.plot(way, bound, **BOUND, label="limit along the way")
    if np.isfinite(lower).any() or np.isfinite(upper).any():
        broken = (values > upper) | (values < lower)
        axes.plot(way, np.where(broken, values, np.nan), color=MARK, lw=1.4)
    cut = None if name == HEIGHT else spike([values])
    if cut is not None:
        top = max([cut[0], *(1.3 * abs(limit) for limit in limits)])
        axes.set_ylim(max(-top, min(0.0, float(np.min(values)))), top)
    unit = symbol(path[name].attrs["units"])
    _finish(axes, f"{name.replace('_magnitude', '').replace('_', ' ')}\n[{unit or '-'}]")


def _draw_band(axes: Any, path: xarray.Dataset, way: np.ndarray, name: str, colour: str) -> None:
    """Draw two standard deviations on both sides of a quantity, where they are known."""
    own = f"{'position' if name == HEIGHT else name}_sigma"
    if own not in path or not np.isfinite(path[own].values).any():
        return
    width = WIDE * (path[own].values[:, 2] if name == HEIGHT else path[own].values)
    values = _values(path, name)
    axes.fill_between(way, values - width, values + width, color=colour, alpha=PALE, lw=0)


def _draw_lateral(axes: Any, path: xarray.Dataset, before: xarray.Dataset, way: np.ndarray) -> None:
    """Plot the lateral distance of the path after a tuning from the path before, positive to the left."""
    axes.plot(way, match(path["position"].values, before["position"].values).lateral, color=COLOURS["after"], lw=1.0)
    _finish(axes, f"{LATERAL}\n[m]")


def _bound(path: xarray.Dataset, name: str, attribute: str, absent: float) -> Any:
    """Return the limit on a variable, also at each sample; `absent` without a limit."""
    own = f"{name}_{attribute}"
    return path[own].values if own in path else float(path[name].attrs.get(attribute, absent))


def _values(path: xarray.Dataset, name: str) -> np.ndarray:
    return bounded_values(name, path[name].values)


def _finish(axes: Any, label: str) -> None:
    axes.set_ylabel(label, fontsize=8)
    axes.grid(alpha=0.25, lw=0.5)
    axes.margins(x=0)
