"""Plot a slew: angle, rate and acceleration with their limits, phase plane and quaternion."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure

from qtraj.viz.style import (
    ACCELERATION_LABEL,
    ANGLE_LABEL,
    BAND,
    BOUND,
    RATE_LABEL,
    RC,
    SUBSCRIPTS,
    WIDTH,
    component,
    frame,
    head,
    title,
)

HEIGHT = 6.25  # [inch] without a title
ANGLE = "#0072B2"
HEADROOM = 1.12  # top of the axis, divided by the larger of limit and peak


def slew_figure(dataset: xarray.Dataset, limits: dict[str, float]) -> Figure:
    """Plot angle, rate and acceleration with their limits, rate against angle (all in degrees), and the quaternion.

    `dataset` contains angle [rad], angle_rate [rad/s], angle_acceleration [rad/s²] and quaternion over time. `limits`
    may contain max_rate [rad/s] and max_acceleration [rad/s²].
    """
    with mpl.rc_context(RC):
        band = BAND if title(dataset) else 0.0
        height = HEIGHT + band
        figure = Figure(figsize=(WIDTH, height))
        margins = {"top": 1 - (0.31 + band) / height, "bottom": 0.53 / height}
        left = figure.add_gridspec(3, 1, hspace=0.28, left=0.075, right=0.485, **margins)
        right = figure.add_gridspec(2, 1, hspace=0.42, left=0.57, right=0.98, **margins)
        angle = figure.add_subplot(left[0])
        rate, acceleration = (figure.add_subplot(left[row], sharex=angle) for row in (1, 2))
        phase, quaternion = (figure.add_subplot(right[row]) for row in (0, 1))
        _history(angle, dataset, "angle", ANGLE_LABEL, None)
        _history(rate, dataset, "angle_rate", RATE_LABEL, limits.get("max_rate"))
        _history(acceleration, dataset, "angle_acceleration", ACCELERATION_LABEL, limits.get("max_acceleration"))
        acceleration.set_xlabel("time [s]")
        for axes in (angle, rate):
            axes.tick_params(labelbottom=False)
        _phase_plane(phase, dataset, limits.get("max_rate"))
        _quaternion(quaternion, dataset)
        quaternion.set_xlabel("time [s]")
        figure.align_ylabels([angle, rate, acceleration])
        head(figure, title(dataset))
    return figure


def _quaternion(axes: Any, dataset: xarray.Dataset) -> None:
    """Plot the four components of the quaternion against time."""
    for label in dataset["component"].values:
        values = dataset["quaternion"].sel(component=label).values
        axes.plot(dataset["time"].values, values, label="λ" + SUBSCRIPTS[label], **component(label))
    axes.set_ylabel("quaternion [–]")
    frame(axes)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8, borderaxespad=0.1)


def _bound(axes: Any, limit: float, peak: float, text: str) -> None:
    """Draw a dotted line at `limit` [°/s or °/s²], and at −`limit` if a curve is negative."""
    low = min(float(np.nanmin(line.get_ydata())) for line in axes.lines)
    axes.axhline(limit, label=text, **BOUND)
    top = HEADROOM * max(limit, peak)
    if low < -1e-9 * limit:
        axes.axhline(-limit, **BOUND)
        axes.set_ylim(-top, top)
    else:
        axes.set_ylim(0, top)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize=8, borderaxespad=0.1)


def _history(axes: Any, dataset: xarray.Dataset, name: str, label: str, limit: float | None) -> None:
    values = np.degrees(dataset[name].values)
    axes.plot(dataset["time"].values, values, color=ANGLE, lw=1.8)
    axes.set_ylabel(label)
    frame(axes)
    if limit is not None:
        top = float(np.degrees(limit))
        _bound(axes, top, float(np.abs(values).max()), f"limit {top:.4g}")


def _phase_plane(axes: Any, dataset: xarray.Dataset, limit: float | None) -> None:
    angle, rate = np.degrees(dataset["angle"].values), np.degrees(dataset["angle_rate"].values)
    axes.plot(angle, rate, color=ANGLE, lw=1.8)
    axes.plot(angle[[0, -1]], rate[[0, -1]], "o", color=ANGLE, ms=4, clip_on=False)
    axes.set_xlabel(ANGLE_LABEL)
    axes.set_ylabel(RATE_LABEL)
    frame(axes)
    if limit is not None:
        top = float(np.degrees(limit))
        _bound(axes, top, float(np.abs(rate).max()), f"limit {top:.4g}")
