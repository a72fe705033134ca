"""Evaluate one path at a million instants: position, velocity, acceleration, quaternion, curvature, torsion, rate.

qtraj, and NumPy with SciPy's Rotation, compute the same 18 numbers per instant. The time of qtraj is measured until the
result is ready. Compilation is timed separately, and the results are compared before timing.
"""

import time

import jax
import numpy as np
import pytest

import qtraj as qt
from benchmarks.evaluation import reference

INSTANTS = 1_000_000
PATH = qt.SpiralHelix(reference.RADIUS, reference.ANGLE, reference.HEIGHT, reference.DURATION)
TIMES = np.linspace(0.0, reference.DURATION, INSTANTS)


def ours(times):
    return jax.block_until_ready(qt.evaluate(PATH, times))


def numpy_and_scipy(times):
    """Return the reference, with the rate as a vector in trihedral axes."""
    *others, along, across = reference.numpy_and_scipy(times)
    return *others, np.stack([along, np.zeros_like(along), across], axis=-1)


@pytest.fixture(scope="module")
def compile_time():
    start = time.perf_counter()
    table = ours(TIMES)
    elapsed = time.perf_counter() - start
    reference = numpy_and_scipy(TIMES)
    names = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")
    for name, expected in zip(names, reference, strict=True):
        actual = np.asarray(getattr(table, name))
        if name == "quaternion":
            actual = actual * np.sign(np.sum(actual * expected, axis=-1, keepdims=True))
        np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-10)
    return elapsed


@pytest.mark.benchmark(group="evaluate 1e6 instants, float64")
def test_qtraj(benchmark, compile_time):
    benchmark.extra_info |= {"first_call_s": compile_time, "device": str(jax.devices()[0]), "jax": jax.__version__}
    benchmark.pedantic(ours, args=(TIMES,), rounds=7, warmup_rounds=2)


@pytest.mark.benchmark(group="evaluate 1e6 instants, float64")
def test_numpy_and_scipy(benchmark, compile_time):
    benchmark.pedantic(numpy_and_scipy, args=(TIMES,), rounds=7, warmup_rounds=2)
