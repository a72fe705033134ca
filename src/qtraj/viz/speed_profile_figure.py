"""Draw the figure of a speed profile: speed against distance, the limits that are reached, accelerations and jerk."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from qtraj.foundation.units import symbol
from qtraj.path.quantity import COMBINED, QUANTITIES, SIDES, quantity
from qtraj.viz.road_panels import draw_road, road_panels
from qtraj.viz.style import BAND, BOUND, RC, WIDTH, head, title

COLOURS = {
    "speed": "#0072B2",
    "lateral_acceleration": "#D55E00",
    "longitudinal_acceleration": "#009E73",
    "acceleration": "#E69F00",
    "jerk": "#CC79A7",
    "yaw_rate": "#56B4E9",
    "yaw_acceleration": "#7A5C00",
    "angular_rate": "#000000",
}
"""One colour for each limit, the same in all figures."""
KNOWN = {*QUANTITIES, *SIDES, COMBINED}
"""The limits of the registry; a dataset has only the names of quantities of the user."""
OTHER, CURVE, ABOVE = "#8A2BE2", "0.45", "0.91"
"""Colours of other limits, of curves where no limit is reached, and of excluded speeds."""
PANELS = ("longitudinal_acceleration", "lateral_acceleration", "acceleration", "yaw_acceleration", "jerk")
"""Limits with their own panel; other limits, such as limits on rotation rates, contribute to the bound on the speed."""
SPEED, ROW, PANEL, GAP = 3.1, 0.2, 1.15, 0.16  # heights [inch]
TOP, BOTTOM = 0.3, 0.5
LEFT, RIGHT = 0.185, 0.985
HEADROOM = 1.12
NEAR = 1.3
"""If a limit on the speed is below this multiple of the top of the panel, the panel is extended to show the limit."""
WAIT, APART = 0.5, 0.07
"""Stops of at least `WAIT` [s] are labelled with their duration.

A label is omitted if it would be nearer to the label of a longer stop than `APART` times the width."""
MANY_LABELS = 7
"""Number of labels from which on the legend is smaller, so that it fits into one line."""
LARGEST = 1e100
"""Larger speeds [m/s] and limits are not drawn, because the axes would overflow."""
MANY = 1500
"""Maximum number of cells that are drawn with lines of full width; with more cells, lines are thinner."""


def speed_profile_figure(dataset: xarray.Dataset) -> Figure:
    """Draw the speed, coloured by the active limit, and each limited acceleration or jerk, against the distance.

    `dataset` is the result of `qtraj.SpeedProfile.to_xarray`. The grey area contains the speeds that the limits exclude
    even at constant speed. Bars show where each limit is reached, with the percentage of the distance. The last panels
    show the bank and the friction of a road that changes along the way.
    """
    names = [str(name) for name in dataset["limit"].values]
    panels = [panel for panel in PANELS if panel in map(_panel_of, names)]
    bars, road = ROW * len(names) + 0.12, road_panels(dataset)
    with mpl.rc_context(RC):
        heights = [SPEED, bars, *[PANEL] * (len(panels) + len(road))]
        band = BAND if title(dataset) else 0.0
        height = sum(heights) + GAP * (len(heights) - 1) + TOP + BOTTOM + band
        figure = Figure(figsize=(WIDTH, height))
        top, drawn = height - TOP - band, []
        for each in heights:
            box = (LEFT, (top - each) / height, RIGHT - LEFT, each / height)
            drawn.append(figure.add_axes(box, sharex=drawn[0] if drawn else None))
            top -= each + GAP
        scale, unit = (1000.0, "km") if float(dataset["distance"][-1]) > 2000 else (1.0, "m")
        way = dataset["distance"].values / scale
        _draw_speed(drawn[0], dataset, names, way)
        _draw_bars(drawn[1], dataset, names, scale)
        for axes, name in zip(drawn[2:], [*panels, *road], strict=True):
            if name in road:
                draw_road(axes, dataset, dataset["distance"].values, way, name)
                axes.set_ylabel(road[name], fontsize=7.5)
            else:
                _draw_panel(axes, dataset, names, name, way)
        for axes in drawn:
            axes.grid(alpha=0.25, lw=0.5)
            axes.set_xlim(0, way[-1])
            axes.tick_params(labelbottom=axes is drawn[-1])
            for at in dataset["stop_distance"].values[1:-1] / scale:
                axes.axvline(at, color="0.75", lw=0.8, zorder=0)
        drawn[1].grid(False, axis="y")
        drawn[-1].set_xlabel(f"distance travelled [{unit}]")
        figure.align_ylabels([drawn[0], *drawn[2:]])
        head(figure, title(dataset), 1 - 0.08 / height)
    return figure


def _draw_speed(axes: Any, dataset: xarray.Dataset, names: list[str], way: np.ndarray) -> None:
    """Draw the speed, its bound, and the stops."""
    speed, bound = dataset["speed"].values, dataset["speed_bound"].values
    top = HEADROOM * float(np.max(speed[np.isfinite(speed)], initial=0.0))
    top = top if 0 < top < LARGEST else 1.0  # a failed search has no finite speeds
    if "speed" in names:
        limits = _limits(dataset, names.index("speed"))
        top = max([top, *(1.06 * limits[limits < NEAR * top])])
    shown = np.minimum(np.nan_to_num(bound, posinf=2 * top), 2 * top)
    axes.fill_between(way, shown, 2 * top, color=ABOVE, lw=0, zorder=0, label="excluded at constant speed")
    axes.plot(way, np.where(shown < 2 * top, shown, np.nan), color="0.7", lw=0.8, zorder=1)
    active = dataset["active_limit"].values
    thin = 0.5 if active.size > MANY else 1.0
    axes.plot(way, speed, color=CURVE, lw=1.8 * thin, zorder=2, label="no limit reached")
    for k, name in enumerate(names):
        if np.any(active == k):
            axes.plot(way, _only(speed, active == k), color=_colour(name), lw=2.8 * thin, label=_words(name), zorder=3)
    _mark_stops(axes, dataset, way)
    if "speed_min" in names:
        axes.plot(way, _limits(dataset, names.index("speed_min")), **BOUND)
    axes.set_ylim(0, top)
    axes.set_ylabel("speed [m/s]")
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda k: (labels[k].startswith(("excluded", "no limit", "at rest")), k))
    axes.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=8,
        fontsize=7.5 if len(labels) < MANY_LABELS else 7.0,
        borderaxespad=0.1,
        handlelength=1.2,
        columnspacing=0.8 if len(labels) < MANY_LABELS else 0.5,
        handletextpad=0.5,
    )


def _mark_stops(axes: Any, dataset: xarray.Dataset, way: np.ndarray) -> None:
    """Mark the positions of the stops, and label long stops with their duration (see `WAIT`)."""
    at = dataset["stop_distance"].values * (way[-1] / float(dataset["distance"][-1]))
    axes.plot(
        at, 0 * at, "s", color="0.1", ms=5, clip_on=False, zorder=5, ls="none", label="at rest" if at.size else None
    )
    waits = dataset["stop_time"].values[:, 1] - dataset["stop_time"].values[:, 0]
    written: list[float] = []
    for k in np.argsort(-waits):  # the longest stop first
        place = float(at[k])
        if waits[k] < WAIT or any(abs(place - other) < APART * way[-1] for other in written):
            continue
        written.append(place)
        last = place > (1 - APART) * way[-1]
        axes.annotate(
            f"{waits[k]:.3g} s",
            (place, 0),
            xytext=(-8 if last else 8, 4),
            textcoords="offset points",
            ha="right" if last else "left",
            fontsize=7.5,
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
            zorder=4,
        )


def _draw_bars(axes: Any, dataset: xarray.Dataset, names: list[str], scale: float) -> None:
    """Draw bars where each limit is reached; the label of a limit contains the percentage of the distance."""
    ends = dataset["cell_distance"].values / scale
    reached = dataset["usage"].values >= dataset.attrs.get("reached", 0.99)
    for k, name in enumerate(names):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], reached[k], [False]]))).reshape(-1, 2)
        spans = [(ends[a], ends[b] - ends[a]) for a, b in edges]
        axes.broken_barh(spans, (k - 0.36, 0.72), facecolors=_colour(name), lw=0)
    shares = 100 * dataset["share"].values
    labels = [f"{_words(name)}  {share:.0f} %" for name, share in zip(names, shares, strict=True)]
    axes.set_yticks(range(len(names)), labels, fontsize=7.5)
    for label, name in zip(axes.get_yticklabels(), names, strict=True):
        label.set_color(_colour(name))
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(names) - 0.4, -0.6)


def _draw_panel(axes: Any, dataset: xarray.Dataset, names: list[str], panel: str, way: np.ndarray) -> None:
    """Draw one limited quantity with its limits; the acceleration along the path is signed."""
    along = panel == "longitudinal_acceleration"
    own = [k for k, name in enumerate(names) if _panel_of(name) == panel]
    sided = any(quantity(names[k]).base for k in own)
    thin = 0.5 if dataset.sizes["cell"] > MANY else 1.0
    values = dataset["tangential_acceleration" if along else quantity(names[own[0]]).variable].values
    limits = [_limits(dataset, k) for k in own]
    axes.plot(way, values, color=CURVE, lw=thin)
    for k in own:
        reached = dataset["usage"].values[k] >= 0.99
        axes.plot(way, _only(values, reached), color=_colour(names[k]), lw=1.8 * thin)
    lines = [sign * limit for limit in limits for sign in ((1, -1) if along and not sided else (1,))]
    for limit in lines:
        axes.plot(way, limit, **BOUND)
    shown = [float(x) for limit in lines for x in (np.min(limit), np.max(limit)) if abs(x) < LARGEST]
    top = 1.2 * max(shown, default=1.0)
    low = 1.2 * min(shown, default=-1.0) if along or sided else 0.0
    if sided:  # without a limit on one side, the values determine the extent
        known = values[np.isfinite(values)]
        low, top = min(low, 1.2 * known.min(initial=0.0)), max(top, 1.2 * known.max(initial=0.0))
    axes.set_ylim(low, top)
    axes.yaxis.set_major_locator(MaxNLocator(4, steps=(1, 2, 2.5, 5, 10)))
    axes.set_ylabel(f"{_words(panel).replace(' ', chr(10))}\n[{symbol(quantity(panel).unit)}]", fontsize=7.5)


def _limits(dataset: xarray.Dataset, k: int) -> np.ndarray:
    """Return the limit with the index k at all samples."""
    if "bound_along" in dataset:
        return dataset["bound_along"].values[k]
    return np.full(dataset["distance"].size, float(dataset["bound"][k]))  # a file of an older version


def _panel_of(name: str) -> str:
    return (quantity(name).base if name in KNOWN else "") or name


def _only(values: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Return `values` with NaN at all samples outside the selected `cells`."""
    within = np.repeat(cells, (values.size - 1) // cells.size)
    return np.where(np.append(within, False) | np.append(False, within), values, np.nan)


def _words(name: str) -> str:
    words = name.replace("_", " ")
    return words.replace("longitudinal", "long.") if name in KNOWN and quantity(name).base else words


def _colour(name: str) -> str:
    """Return the colour of a limit; a lower side has another one than the upper side."""
    if name not in KNOWN:
        return OTHER
    entry = quantity(name)
    return OTHER if entry.lower else COLOURS.get(entry.base or name, OTHER)
