"""Propagate λ(t) of coning problems: work against precision, and the least work for one precision.

The methods are `propagate` with equal steps, diffrax with adaptive steps (both in a batch), and SciPy's DOP853, which
solves one problem after the other. Its right-hand side uses plain numbers, which are faster than NumPy arrays. All
settings of all methods alternate, but SciPy runs only in the first two rounds. Errors are deviations from the closed
form.
"""

import diffrax
import numpy as np

import qtraj as qt

from ..coning import Batch, with_diffrax, with_scipy, with_steps
from ..race import first_within, race
from . import Measured

TARGET = 1e-9
"""Precision [rad] of the table."""
PROBLEMS, SPAN = 64, 10.0


def ladders(batch, quick):
    """Return (call, settings from loose to tight) by the name of the method."""
    few = slice(None, None, 3) if quick else slice(None)
    tolerances = [10.0**-k for k in range(4, 14)]
    return {
        "Gauss–Legendre 8": (with_steps(batch, qt.GaussLegendre(8)), (6, 8, 11, 14, 17, 20, 23, 26)[few]),
        "Gauss–Legendre 12": (with_steps(batch, qt.GaussLegendre(12)), (4, 5, 6, 7, 8, 10)[few]),
        "Magnus 6": (with_steps(batch, qt.Magnus(6)), (60, 120, 240, 480, 960)[few]),
        "diffrax Dopri8": (with_diffrax(batch, diffrax.Dopri8()), tolerances[few]),
        "diffrax Tsit5": (with_diffrax(batch, diffrax.Tsit5()), tolerances[few]),
        "SciPy DOP853": (with_scipy(batch), tolerances[1::4] if quick else tolerances[1::2]),
    }


def measure(quick):
    rng, count = np.random.default_rng(256), 8 if quick else PROBLEMS
    batch = Batch(np.radians(rng.uniform(10, 50, count)), rng.uniform(0.74 * np.pi, 2 * np.pi, count), SPAN)
    ways = ladders(batch, quick)
    errors = {name: [batch.error(call(setting)) for setting in settings] for name, (call, settings) in ways.items()}
    calls = {
        (name, k): lambda call=call, setting=setting: call(setting)
        for name, (call, settings) in ways.items()
        for k, setting in enumerate(settings)
    }
    slow = [key for key in calls if "SciPy" in key[0]]
    spent = race(
        calls, 3 if quick else 7, few=slow, warm=False
    )  # everything was compiled when the errors were computed
    ms = {name: [1e3 * float(np.median(spent[name, k])) for k in range(len(errors[name]))] for name in ways}
    rows = [row(name, ways[name][1], errors[name], ms[name]) for name in ways]
    base = rows[0]["time [ms]"]
    for each in rows:
        known = "—" not in (base, each["time [ms]"])
        each[f"relative to {rows[0]['method']}"] = each["time [ms]"] / base if known else "—"
    curves = {name: {"errors": errors[name], "ms": ms[name]} for name in ways}
    title = (
        f"{count} coning problems over {SPAN:g} s: the loosest setting (number of steps, or tolerance) with an error "
        f"below {TARGET:g} rad (—: no setting tried reached it)"
    )
    return Measured(title, rows, {"problems": count, "curves": curves})


def row(name, settings, errors, ms):
    """Return the loosest setting that reaches the target, its error and its time; dashes if none reaches it."""
    found = first_within(errors, TARGET)
    if found is None:
        return {"method": name, "setting": "—", "error [rad]": "—", "time [ms]": "—"}
    k, error = found
    return {"method": name, "setting": f"{settings[k]:.3g}", "error [rad]": error, "time [ms]": ms[k]}
