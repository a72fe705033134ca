"""λ(t) of coning problems: work against precision, and the least work that reaches a precision.

`propagate` with equal steps, diffrax with adaptive ones (both in a batch), and SciPy's DOP853 on one problem after the
other, with a right side in plain numbers, which is faster than one in NumPy arrays.
"""

import diffrax
import numpy as np

import qtraj as qt

from ..coning import Batch, with_diffrax, with_scipy, with_steps
from ..race import race
from . import Found

TARGET = 1e-9
"""[rad] The precision of the table."""
PROBLEMS, SPAN = 64, 10.0


def ladders(batch, quick):
    """Name → (call, settings from loose to tight)."""
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
    rows, curves = [], {}
    for name, (call, settings) in ladders(batch, quick).items():
        errors = [batch.error(call(setting)) for setting in settings]
        calls = {str(s): (lambda call=call, s=s: call(s)) for s in settings}
        spent = race(calls, 1 if "SciPy" in name else 7, warm="SciPy" not in name)
        curves[name] = {"errors": errors, "ms": [1e3 * float(np.median(t)) for t in spent.values()]}
        good = [k for k, error in enumerate(errors) if error <= TARGET]
        first = good[0] if good else len(errors) - 1
        rows.append({"method": name, "setting": f"{settings[first]:.3g}", "error [rad]": errors[first]})
        rows[-1]["time [ms]"] = curves[name]["ms"][first]
    for row in rows:
        row["over Gauss–Legendre 8"] = row["time [ms]"] / rows[0]["time [ms]"]
    title = f"{count} coning problems over {SPAN:g} s: the loosest setting that keeps {TARGET:g} rad"
    return Found(title, rows, {"problems": count, "curves": curves})
