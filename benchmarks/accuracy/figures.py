"""Draw the figures of docs/accuracy.md."""

import time

import diffrax
import jax
import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

import qtraj as qt
from qtraj.viz.figures import precision_figure
from qtraj.viz.style import BOUND, RC, SERIES, above, frame, series

from ..coning import with_diffrax, with_steps
from ..test_propagate_batch import BATCH
from . import closed_loop, recorded_gyro


def recorded_gyro_figure():
    """Plot the rates of a recorded gyro, and the error of the attitude propagated from these rates."""
    with mpl.rc_context(RC):
        figure = Figure(figsize=(7, 4.6), layout="constrained")
        rate, error = figure.subplots(2, 1, sharex=True)
        times, rates, _, every, _ = recorded_gyro.recording()
        thin = 4 * every
        for values, label, colour in zip(np.degrees(rates[::thin]).T, "xyz", SERIES, strict=False):
            rate.plot(times[::thin], values, lw=0.7, label=label, color=colour)
        rate.set_ylabel("rate [°/s]")
        for start, label, colour in ((0, "sample", SERIES[0]), (4000, "movement", SERIES[1])):
            instants, gaps = recorded_gyro.deviations(start)
            error.plot(instants[::2], gaps[::2], lw=0.8, label=f"from the first {label}", color=colour)
        error.set(xlabel="time [s]", ylabel="error [°]", ylim=(0, None))
        for axes in (rate, error):
            frame(axes)
            above(axes)
        figure.align_ylabels()
        figure.get_layout_engine().set(h_pad=0.08)  # keeps the legend away from the edge
    return figure


def closed_loop_errors_figure():
    """Plot the deviation of simulated loops from the closed form, by kind of error (columns) and tolerance (rows)."""
    deviations = closed_loop.deviations()
    kinds = list(dict.fromkeys(kind for kind, _ in deviations))
    with mpl.rc_context(RC):
        figure = Figure(figsize=(8, 4.8), layout="constrained")
        grid = figure.subplots(2, len(kinds), sharex=True, sharey="row")
        for column, kind in zip(grid.T, kinds, strict=True):
            column[0].set_title(f"{kind} error")
            column[1].set_xlabel("time [s]")
            curves = {gains: pair for (of, gains), pair in deviations.items() if of == kind}
            for row, (axes, bound) in enumerate(zip(column, (1e-9, 1e-11), strict=True)):
                for k, (gains, pair) in enumerate(curves.items()):
                    axes.semilogy(closed_loop.TIMES[1:], pair[row][1:], label=f"{gains} gains", **series(k))
                axes.axhline(bound, label="the tests' bound", **BOUND)
                frame(axes)
                axes.set_xlim(left=0)
        for axes, how in zip(grid[:, 0], ("defaults, rtol 1e-10", "rtol 1e-13"), strict=True):
            axes.set_ylabel(f"{how}\ndeviation [–]")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4, handlelength=3)
    return figure


def work_precision_figure():
    """Plot work against precision of propagation, for a batch of 256 coning problems."""
    ladders = {
        "Gauss–Legendre 8": (with_steps(BATCH, qt.GaussLegendre(8)), (8, 11, 14, 18, 22, 26, 30)),
        "Gauss–Legendre 12": (with_steps(BATCH, qt.GaussLegendre(12)), (5, 6, 7, 8, 10, 12)),
        "Magnus 6": (with_steps(BATCH, qt.Magnus(6)), (60, 120, 240, 480, 960)),
        "diffrax Dopri8": (with_diffrax(BATCH, diffrax.Dopri8()), tuple(10.0**-k for k in range(3, 14))),
        "diffrax Tsit5": (with_diffrax(BATCH, diffrax.Tsit5()), tuple(10.0**-k for k in range(3, 14))),
    }
    curves = {}
    for name, (call, settings) in ladders.items():
        errors = [BATCH.error(call(setting)) for setting in settings]  # also compiles the call
        curves[name] = ([_median_ms(call, setting) for setting in settings], errors)
    return precision_figure(curves, work="time for all 256 problems [ms]", error="largest angle error [rad]")


def _median_ms(call, setting, rounds=7):
    spent = []
    for _ in range(rounds):
        start = time.perf_counter()
        jax.block_until_ready(call(setting))
        spent.append(time.perf_counter() - start)
    return 1e3 * np.median(spent)


FIGURES = {
    "recorded_gyro": recorded_gyro_figure,
    "closed_loop_errors": closed_loop_errors_figure,
    "work_precision": work_precision_figure,
}
