"""Compare a spline through 60 attitudes with SciPy's RotationSpline: attitude, rate and acceleration."""

import functools

import jax.numpy as jnp
import numpy as np

from ..race import race
from ..test_table_program import INSTANTS, KNOTS, PROGRAM, WHEN, ours, test_the_results_are_the_same, with_scipy
from . import Measured


def measure(quick):
    test_the_results_are_the_same()
    calls = {"TableProgram": functools.partial(ours, PROGRAM, jnp.asarray(WHEN)), "SciPy RotationSpline": with_scipy}
    spent = race(calls, 3 if quick else 15)
    ms = {name: 1e3 * float(np.median(times)) for name, times in spent.items()}
    rows = [{"": name, "time [ms]": x, "relative to TableProgram": x / ms["TableProgram"]} for name, x in ms.items()]
    return Measured(f"A spline through {KNOTS} attitudes at {INSTANTS} instants", rows, {"instants": INSTANTS})
