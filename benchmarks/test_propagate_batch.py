"""Solve 256 coning problems at once, each to 1e-10 rad: β from 10° to 50°, Ω from 0.74π to 2π rad/s, 10 s.

Methods are compared at equal accuracy. Each method has the loosest of many settings with which all 256 problems reach
the target; successive settings differ by a quarter of a decade, or by about 5 % in the number of steps. diffrax takes
adaptive and equal steps. SciPy solves one problem after the other, with the usual right-hand side in NumPy arrays, and
with a faster one in plain numbers. `pytest benchmarks/test_propagate_batch.py -n 0 -s -k ratios` prints the ratios.
"""

import functools

import diffrax
import jax
import numpy as np
import pytest

import qtraj as qt

from .coning import Batch, in_arrays, with_diffrax, with_equal_steps_of_diffrax, with_scipy, with_steps
from .race import decades, loosest, race, report, seconds

TARGET, ROUNDS = 1e-10, 21
_RNG = np.random.default_rng(256)
BATCH = Batch(np.radians(_RNG.uniform(10, 50, 256)), _RNG.uniform(0.74 * np.pi, 2 * np.pi, 256), 10.0)

PEERS = {
    "Gauss-Legendre 12": (with_steps(BATCH, qt.GaussLegendre(12)), range(7, 12)),
    "Gauss-Legendre 10": (with_steps(BATCH, qt.GaussLegendre(10)), range(12, 17)),
    "Gauss-Legendre 8": (with_steps(BATCH, qt.GaussLegendre(8)), range(20, 25)),
    "diffrax Dopri8": (with_diffrax(BATCH, diffrax.Dopri8()), decades(-11, -13)),
    "diffrax Tsit5": (with_diffrax(BATCH, diffrax.Tsit5()), decades(-10, -13)),
    "diffrax Dopri8, equal steps": (with_equal_steps_of_diffrax(BATCH, diffrax.Dopri8()), range(170, 260, 10)),
    "diffrax Tsit5, equal steps": (with_equal_steps_of_diffrax(BATCH, diffrax.Tsit5()), range(800, 1300, 50)),
    "SciPy DOP853, arrays": (with_scipy(BATCH, in_arrays), decades(-11, -13)),
    "SciPy DOP853, plain numbers": (with_scipy(BATCH), decades(-11, -13)),
}


@functools.cache
def tuned(name):
    """Return (call without arguments, setting, error, seconds of the first call) for one of the `PEERS`."""
    call, settings = PEERS[name]
    first = seconds(lambda: call(settings[0])) if "SciPy" not in name else 0.0
    setting, found = loosest(call, settings, BATCH.error, TARGET)
    return functools.partial(call, setting), setting, found, first


@pytest.mark.benchmark(group="256 coning problems to 1e-10 rad")
@pytest.mark.parametrize("name", PEERS)
def test_batch(benchmark, name):
    call, setting, found, first = tuned(name)
    benchmark.extra_info |= {"setting": setting, "error_rad": found, "first_call_s": first, "jax": jax.__version__}
    assert found <= TARGET
    benchmark.pedantic(lambda: jax.block_until_ready(call()), rounds=2 if "SciPy" in name else 7, warmup_rounds=1)


def test_ratios():
    runners = {name: tuned(name)[0] for name in PEERS}
    remarks = {
        name: f"{tuned(name)[1]:.4g}, error {tuned(name)[2]:.1e}, first {tuned(name)[3]:.1f} s" for name in PEERS
    }
    slow = {name: runners.pop(name) for name in PEERS if "SciPy" in name}
    spent = race(runners, ROUNDS) | race(slow, 1)
    ratios = report("256 coning problems to 1e-10 rad", spent, remarks)
    assert min(ratio for name, ratio in ratios.items() if "diffrax" in name) > 5
    assert min(ratio for name, ratio in ratios.items() if "SciPy" in name) > 300
