"""The figures of docs/accuracy.md."""

import time

import diffrax
import jax
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import qtraj as qt

from ..coning import with_diffrax, with_steps
from ..test_propagate_batch import BATCH
from . import closed_loop, recorded_gyro

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "qtraj", "font.size": 9, "axes.grid": True, "grid.alpha": 0.3})
COLOURS = {"body": "#0072b2", "inertial": "#d55e00", "additive": "#009e73"}


def save(figure, file):
    figure.savefig(file, metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)


def recorded_gyro_figure():
    figure, (above, below) = plt.subplots(2, 1, figsize=(7, 4.6), sharex=True)
    times, rates, _, every, _ = recorded_gyro.recording()
    thin = 4 * every
    above.plot(times[::thin], np.degrees(rates[::thin]), lw=0.7, label=["x", "y", "z"])
    above.set_ylabel("rate [°/s]")
    above.legend(loc="upper left", ncols=3)
    for start, label in ((0, "from the first sample"), (4000, "from the first movement")):
        instants, gaps = recorded_gyro.deviations(start)
        below.plot(instants[::2], gaps[::2], lw=0.8, label=label)
    below.set(xlabel="time [s]", ylabel="angle to the optical attitude [°]", ylim=(0, None))
    below.legend(loc="upper left")
    return figure


def closed_loop_errors_figure():
    figure, axes = plt.subplots(1, 2, figsize=(8, 3.2), sharey=True)
    for (kind, gains), pair in closed_loop.deviations().items():
        style = {"scalar": "-", "diagonal": "--", "full": ":"}[gains]
        for axis, values in zip(axes, pair, strict=True):
            how = {"lw": 1.2, "color": COLOURS[kind], "label": f"{kind}, {gains}"}
            axis.semilogy(closed_loop.TIMES[1:], values[1:], style, **how)
    for axis, title, bound in zip(axes, ("defaults, rtol 1e-10", "rtol 1e-13"), (1e-9, 1e-11), strict=True):
        axis.axhline(bound, color="0.3", lw=0.8)
        axis.annotate("the tests' bound", (0.1, bound * 1.3), fontsize=8, color="0.3")
        axis.set(title=title, xlabel="time [s]", ylim=(1e-17, 1e-8))
    axes[0].set_ylabel("deviation from the closed form")
    axes[1].legend(fontsize=7, handlelength=3.5, loc="center left", bbox_to_anchor=(1, 0.5))
    return figure


def work_precision_figure():
    figure, axis = plt.subplots(figsize=(7, 4))
    ladders = {
        "Gauss–Legendre 8": (with_steps(BATCH, qt.GaussLegendre(8)), (8, 11, 14, 18, 22, 26, 30)),
        "Gauss–Legendre 12": (with_steps(BATCH, qt.GaussLegendre(12)), (5, 6, 7, 8, 10, 12)),
        "Magnus 6": (with_steps(BATCH, qt.Magnus(6)), (60, 120, 240, 480, 960)),
        "diffrax Tsit5": (with_diffrax(BATCH, diffrax.Tsit5()), tuple(10.0**-k for k in range(3, 14))),
        "diffrax Dopri8": (with_diffrax(BATCH, diffrax.Dopri8()), tuple(10.0**-k for k in range(3, 14))),
    }
    for marker, (name, (call, settings)) in zip("osv^D", ladders.items(), strict=True):
        errors = [BATCH.error(call(setting)) for setting in settings]
        axis.loglog(errors, [_median_ms(call, s) for s in settings], marker=marker, ms=4, lw=1, label=name)
    axis.invert_xaxis()
    axis.set(xlabel="largest angle error of 256 coning problems [rad]", ylabel="time for all 256 [ms]")
    axis.legend()
    return figure


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
