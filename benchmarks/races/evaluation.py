"""Compare `evaluate` for one path with a kernel in C, NumPy with SciPy, and plain writing of the same bytes.

The outputs are position, velocity, acceleration, quaternion, curvature, torsion and rate: 17 channels (18 for qtraj,
which also writes the zero component of the rate). The candidates alternate, and their results are compared before
timing.
"""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.batch.reduction import Reduced

from ..evaluation.reference import ANGLE, CHANNELS, DURATION, HEIGHT, RADIUS, Kernel, numpy_and_scipy
from ..race import race
from . import Measured

INSTANTS = 4_000_000
AGREE = {"float64": 1e-11, "float32": 1e-4}
NAMES = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")
SLOW = ("NumPy + SciPy", "NumPy + SciPy, assume_valid")


def helix(kind):
    return qt.SpiralHelix(*[jnp.asarray(c, kind) for c in (RADIUS, ANGLE, HEIGHT, DURATION)])


def runners(kind, instants):
    """Return the calls by name, for one dtype."""
    times, path = np.linspace(0.0, DURATION, instants).astype(kind), helix(kind)
    given, table, out = jnp.asarray(times), {}, np.zeros((CHANNELS, instants), kind)

    def again():
        table["old"] = qt.evaluate(path, given, reuse=table.get("old"))
        return table["old"]

    calls = {
        "qtraj": lambda: qt.evaluate(path, given),
        "qtraj, reuse": again,
        "qtraj, maxima": lambda: qt.evaluate(path, given, reduce="max"),
        "NumPy + SciPy": lambda: numpy_and_scipy(times),
    }
    if "assume_valid" in inspect.signature(Rotation.from_matrix).parameters:
        calls[SLOW[1]] = lambda: numpy_and_scipy(times, assume_valid=True)
    if Kernel.available():
        plain, vectorised = Kernel(kind, True), Kernel(kind, False)
        calls |= {
            "C": lambda: plain.evaluate(times, out),
            "C, fresh memory": lambda: plain.evaluate(times, np.empty_like(out)),
            "C, vectorised sincos": lambda: vectorised.evaluate(times, out),
            "C, maxima": lambda: plain.peaks(times),
            "C, maxima, vectorised sincos": lambda: vectorised.peaks(times),
            "writing alone": lambda: vectorised.fill(out),
            "writing alone, fresh memory": lambda: vectorised.fill(np.empty_like(out)),
        }
    return calls


def channels(found):
    """Return the 17 channels (17, n) of the result of any runner, or their maxima (17,)."""
    if isinstance(found, np.ndarray):
        return found
    if isinstance(found, tuple):
        return np.vstack([x.T for x in found])
    reduced = isinstance(found, Reduced)
    parts = [np.asarray(found[name] if reduced else getattr(found, name)).T for name in NAMES]
    return (np.hstack if reduced else np.vstack)([*parts[:-1], parts[-1][[0, 2]]])


def check(calls, kind):
    """Raise a ValueError if results disagree; a quaternion may have either sign."""
    ours = channels(calls["qtraj"]())
    scale = np.abs(ours).max(axis=1)
    for name, call in calls.items():
        if name == "qtraj" or "writing" in name:
            continue
        other = channels(call())
        expected = ours if other.ndim == 2 else ours.max(axis=1)
        if other.ndim == 2:
            expected = np.concatenate([ours[:9], ours[9:13] * np.sign(np.sum(ours[9:13] * other[9:13], 0)), ours[13:]])
        gaps = [np.max(np.abs(a - b)) / c for a, b, c in zip(other, expected, scale, strict=True)]
        if not max(gaps) < AGREE[kind]:
            raise ValueError(f"{name}: the results disagree by {max(gaps):.3g} in {kind}")


def measure(quick):
    instants, rounds = (400_000, 3) if quick else (INSTANTS, 7)
    found = {}
    for kind in ("float64", "float32"):
        calls = runners(kind, instants)
        check(calls, kind)
        found[kind] = race(calls, rounds, few=SLOW)
    rows = []
    for name in found["float32"]:
        base, row = ("qtraj, maxima" if "maxima" in name else "qtraj"), {"": name}
        for kind, spent in found.items():
            known = name in spent
            median = float(np.median(spent[name])) if known else None
            best = min(spent[name]) if known else None
            row[f"{kind} [ns]"] = 1e9 * median / instants if known else "—"
            row[f"best {kind} [ns]"] = 1e9 * best / instants if known else "—"
            row[f"qtraj time / this time, {kind}"] = float(np.median(spent[base])) / median if known else "—"
        rows.append(row)
    title = "Per instant: r, v, a, quaternion, curvature, torsion, rate of one path; medians and minima"
    return Measured(title, rows, {"instants": instants, "rounds": rounds, "device": str(jax.devices()[0])})
