"""Plot a simulated closed loop: error, rate and command over time, with closed form and limit."""

from typing import Any

import matplotlib as mpl
import numpy as np
import xarray
from matplotlib.figure import Figure

from qtraj.viz.style import (
    BAND,
    BOUND,
    CLOSED,
    COMPONENTS,
    LIMIT,
    MIN_ANGLE,
    RC,
    SUBSCRIPTS,
    WIDTH,
    above,
    component,
    frame,
    head,
    title,
)

HEIGHT = 7.25  # [inch] of three rows without a title
FAR = 3
"""Limits beyond this multiple of the largest value are not drawn."""
PROGRAM = {"color": "0.55", "lw": 0.8, "ls": "solid", "zorder": 1.5}
NORM = {"color": "0.2", "lw": 1.2, "alpha": 0.8}


def simulation_figure(dataset: xarray.Dataset, settled: float, limit: float | list[float] | None) -> Figure:
    """Plot error, body rate, physical and virtual command, and the norm of the quaternion over time.

    The error is shown as an angle, on a logarithmic axis, and as a quaternion. `dataset` is the table written by `qtraj
    simulate`. The closed form of the error is drawn too, if it applies. Lines mark the angle `settled` [rad] and the
    `limit` of the command [rad/s or rad/s²], one number or one for each component. A rigid body has a fourth row with
    its torque and the momenta of its wheels; without wheels, with the acceleration minus the command.
    """
    with mpl.rc_context(RC):
        band = BAND if title(dataset) else 0.0
        rows = 4 if "torque" in dataset else 3
        height = HEIGHT * rows / 3 + band
        figure = Figure(figsize=(WIDTH, height))
        margins = {"top": 1 - (0.35 + band) / height, "bottom": 0.5 / height}
        grid = figure.add_gridspec(rows, 2, hspace=0.34, wspace=0.3, left=0.08, right=0.98, **margins)
        angle = figure.add_subplot(grid[0, 0])
        others = [figure.add_subplot(grid[k // 2, k % 2], sharex=angle) for k in range(1, 2 * rows)]
        error, command, virtual, rate, length, *body = others
        _draw_angle(angle, dataset, settled)
        _draw_error(error, dataset)
        _draw_command(command, dataset, limit)
        _draw_virtual(virtual, dataset)
        _draw_rate(rate, dataset)
        _draw_norm(length, dataset)
        if body:
            _draw_torque(body[0], dataset)
            _draw_wheels(body[1], dataset)
        every = [angle, *others]
        for axes in every:
            frame(axes)
            axes.tick_params(labelbottom=axes in every[-2:])
        for axes in every[-2:]:
            axes.set_xlabel("time [s]")
        figure.align_ylabels(every[::2])
        figure.align_ylabels(every[1::2])
        head(figure, title(dataset))
    return figure


def _applies(dataset: xarray.Dataset) -> bool:
    """Return whether the closed form applies to this motion; with a disturbance, for example, it does not apply."""
    return dataset.attrs.get("closed_form", "applies") == "applies"


def _draw_angle(axes: Any, dataset: xarray.Dataset, settled: float) -> None:
    time = dataset["time"].values
    for name, label, line in (
        ("angle", "simulated", {"color": "#0072B2", "lw": 1.8}),
        ("closed_form_angle", "closed form", CLOSED),
        ("open_loop_angle", "without feedback", {"color": "0.45", "lw": 1.4, "ls": (0, (1, 1))}),
    ):
        if name in dataset and (name != "closed_form_angle" or _applies(dataset)):
            values = np.degrees(dataset[name].values)
            axes.plot(time, np.where(values > MIN_ANGLE, values, np.nan), label=label, **line)
    axes.axhline(np.degrees(settled), color=LIMIT, lw=0.8, ls=(0, (4, 3)), label=f"{np.degrees(settled):.4g}°")
    axes.set_yscale("log")
    axes.set_ylabel("error angle [°]")
    above(axes)


def _draw_error(axes: Any, dataset: xarray.Dataset) -> None:
    symbol = {"inertial": "μ*", "additive": "Δ"}.get(dataset.attrs.get("law", ""), "μ")
    _draw_components(axes, dataset, "error", symbol, "wxyz")
    if "closed_form_error" in dataset and _applies(dataset):
        lines = axes.plot(dataset["time"].values, dataset["closed_form_error"].values, **CLOSED)
        lines[0].set_label("closed form")
    axes.set_ylabel("error quaternion [–]")
    above(axes)


def _draw_command(axes: Any, dataset: xarray.Dataset, limit: float | list[float] | None) -> None:
    unit = _unit(dataset)
    _draw_components(axes, dataset, "command", "ω" if unit == "°/s" else "ε", "xyz", degrees=True)
    values = np.degrees(dataset["command"].values)
    if dataset.attrs.get("saturation") != "axis":  # with "axis" the limits apply to components, not to the norm
        axes.plot(dataset["time"].values, np.linalg.norm(values, axis=1), label="norm", **NORM)
    bounds = np.unique(np.degrees([] if limit is None else limit))
    peak = np.nanmax(np.abs(values), initial=0.0)
    if bounds.size and bounds.max() <= FAR * max(peak, 1e-12):
        for k, value in enumerate(bounds):
            label = "limit " + ", ".join(f"{b:.4g}" for b in bounds) if k == 0 else None
            axes.axhline(value, label=label, **BOUND)
            axes.axhline(-value, **BOUND)
    axes.set_ylabel(f"command [{unit}]")
    above(axes)


def _draw_virtual(axes: Any, dataset: xarray.Dataset) -> None:
    unit = {"s-1": "1/s", "s-2": "1/s²"}[dataset["virtual_command"].attrs["units"]]
    axes.plot(dataset["time"].values, dataset["virtual_command"].values, color=COMPONENTS["w"], lw=1.5)
    axes.ticklabel_format(axis="y", scilimits=(-3, 4), useMathText=True)
    axes.set_ylabel(f"virtual command [{unit}]")


def _draw_rate(axes: Any, dataset: xarray.Dataset) -> None:
    _draw_components(axes, dataset, "rate", "ω", "xyz", degrees=True)
    lines = axes.plot(dataset["time"].values, np.degrees(dataset["program_rate"].values), **PROGRAM)
    lines[0].set_label("program")
    axes.set_ylabel("body rate [°/s]")
    above(axes)


def _draw_norm(axes: Any, dataset: xarray.Dataset) -> None:
    values = dataset["norm"].values
    axes.plot(dataset["time"].values, values, color=COMPONENTS["w"], lw=1.5)
    middle, spread = np.nanmean(values), np.nanmax(values) - np.nanmin(values)
    if spread < 1e-6 * middle:  # an automatic range would magnify round-off
        axes.set_ylim(0.9 * middle, 1.1 * middle)
    axes.set_ylabel("norm |λ| [–]")


def _draw_torque(axes: Any, dataset: xarray.Dataset) -> None:
    _draw_components(axes, dataset, "torque", "M", "xyz")
    _draw_bounds(axes, dataset["torque"])
    axes.set_ylabel("control torque [N m]")
    above(axes)


def _draw_wheels(axes: Any, dataset: xarray.Dataset) -> None:
    """Plot the momenta of the wheels; without wheels, the acceleration minus the command."""
    if "momentum" not in dataset:
        _draw_components(axes, dataset, "mismatch", "Δε", "xyz", degrees=True)
        axes.set_ylabel("mismatch [°/s²]")
    else:
        for k, momentum in enumerate(dataset["momentum"].values.T):
            axes.plot(dataset["time"].values, momentum, lw=1.5, label=f"wheel {k + 1}")
        _draw_bounds(axes, dataset["momentum"])
        axes.set_ylabel("wheel momenta [N m s]")
    above(axes)


def _draw_bounds(axes: Any, variable: xarray.DataArray) -> None:
    """Draw the limits of a variable on both sides, unless they are far from its values."""
    peak = np.nanmax(np.abs(variable.values), initial=0.0)
    for k, bound in enumerate(np.unique(np.ravel(variable.attrs.get("limit", [])))):
        if bound <= FAR * max(peak, 1e-12):
            axes.axhline(bound, label="limit" if k == 0 else None, **BOUND)
            axes.axhline(-bound, **BOUND)


def _draw_components(
    axes: Any, dataset: xarray.Dataset, name: str, symbol: str, labels: str, degrees: bool = False
) -> None:
    for label in labels:
        values = dataset[name].sel({str(dataset[name].dims[1]): label}).values
        axes.plot(
            dataset["time"].values,
            np.degrees(values) if degrees else values,
            label=symbol + SUBSCRIPTS[label],
            **component(label),
        )


def _unit(dataset: xarray.Dataset) -> str:
    return {"rad s-1": "°/s", "rad s-2": "°/s²"}[dataset["command"].attrs["units"]]
