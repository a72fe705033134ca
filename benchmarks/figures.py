"""Draw the figures of docs/performance.md: throughput against size, and work against precision."""

import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullLocator

from qtraj.viz.figures import precision_figure, save
from qtraj.viz.style import MARKERS, RC, series

LARGEST = 3e-3
"""[rad] Solutions with larger errors are not drawn."""


def throughput(race):
    """Plot the throughput of `evaluate`, in instants per second, against the number of instants in one call."""
    with mpl.rc_context(RC):
        figure = Figure(figsize=(6.4, 4.0))
        axes = figure.add_axes((0.125, 0.13, 0.855, 0.84))
        for k, label in enumerate(("stored", 'reduce="max"')):
            rows = [row for row in race["rows"] if not isinstance(row[f"{label} [ns/instant]"], str)]
            sizes = [10.0 ** int(row["instants"].removeprefix("10^")) for row in rows]
            rates = [1e9 / row[f"{label} [ns/instant]"] for row in rows]
            axes.loglog(sizes, rates, marker=MARKERS[k], ms=5, label=label, **series(k))
        axes.set_xlabel("instants in one call")
        axes.set_ylabel("instants per second [1/s]")
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.yaxis.set_major_formatter(LogFormatterSciNotation(minor_thresholds=(9, 9)))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.grid(alpha=0.25, lw=0.5)
        axes.legend(fontsize=8, loc="lower right", title=_device(race["made"]), alignment="left", handlelength=3)
    return figure


def _device(made):
    machine = made["machine"]
    return f"{made['device']}: {machine['processor']}, {machine['cores']} cores"


def precision(race):
    """Plot the largest angle error of coning problems against the computing time of the propagation."""
    curves = {}
    for name, curve in race["settings"]["curves"].items():
        kept = [k for k, error in enumerate(curve["errors"]) if 0 < error < LARGEST]
        curves[name] = ([curve["ms"][k] for k in kept], [curve["errors"][k] for k in kept])
    return precision_figure(curves, work="time for all problems [ms]", error="largest angle error [rad]")


def draw(results, folder):
    """Write the figures of the benchmarks in these results."""
    for name, race, figure in (("throughput", "sizes", throughput), ("work_and_time", "propagation", precision)):
        if race in results["races"]:
            save(figure(results["races"][race]), folder / f"{name}.svg")
