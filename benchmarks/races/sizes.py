"""Measure cost against size: `evaluate` for 10² to 10⁷ instants, and maxima without stored samples for 10² to 10⁸."""

import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import DURATION
from ..race import race
from . import Measured
from .evaluation import helix

STORED, REDUCED = 10**7, 10**8


def measure(quick):
    path, rows = helix("float64"), []
    sizes = [10**k for k in range(2, 7 if quick else 9)]
    for size in sizes:
        times = jnp.linspace(0.0, DURATION, size)
        calls = {"maxima": lambda times=times: qt.evaluate(path, times, reduce="max")}
        if size <= STORED:
            calls["stored"] = lambda times=times: qt.evaluate(path, times)
        spent = race(calls, int(np.clip(10**7 // size, 2, 30)))
        row = {"instants": f"10^{round(np.log10(size))}"}
        for name, label in (("stored", "stored"), ("maxima", 'reduce="max"')):
            median = float(np.median(spent[name])) if name in spent else None
            row[f"{label} [ms]"] = "—" if median is None else 1e3 * median
            row[f"{label} [ns/instant]"] = "—" if median is None else 1e9 * median / size
        rows.append(row)
    return Measured("Time of one warm call for different numbers of instants, float64", rows, {"outputs": "as above"})
