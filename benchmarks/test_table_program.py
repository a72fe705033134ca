"""Compare a spline through 60 attitudes with SciPy: attitude, rate and acceleration at 1e5 instants."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline

import qtraj as qt

from .race import race, report

INSTANTS, KNOTS, ROUNDS = 100_000, 60, 15
SAME = 1e-6
"""Tolerance for accelerations of size 10.

SciPy's iteration stops at 1e-9 of the rates, and the knots are at least 0.1 s apart.
"""
_RNG = np.random.default_rng(60)
TIMES = np.cumsum(_RNG.uniform(0.1, 0.3, KNOTS))
ROTATIONS = Rotation.from_rotvec(np.cumsum(0.2 * _RNG.normal(size=(KNOTS, 3)), axis=0))
WHEN = np.linspace(0.0, TIMES[-1] - TIMES[0], INSTANTS)
PROGRAM = qt.TableProgram(TIMES, ROTATIONS.as_quat(scalar_first=True))
SPLINE = RotationSpline(TIMES - TIMES[0], ROTATIONS)


ours = jax.jit(lambda program, times: jax.vmap(program)(times))


def with_scipy():
    return SPLINE(WHEN).as_quat(scalar_first=True), SPLINE(WHEN, 1), SPLINE(WHEN, 2)


def test_the_results_are_the_same():
    at, (quaternion, rate, acceleration) = ours(PROGRAM, WHEN), with_scipy()
    signs = np.sign(np.sum(quaternion * at.quaternion, axis=1, keepdims=True))
    np.testing.assert_allclose(at.quaternion, signs * quaternion, rtol=0, atol=1e-9)
    np.testing.assert_allclose(at.rate, rate, rtol=0, atol=1e-7)
    np.testing.assert_allclose(at.acceleration[:-1], acceleration[:-1], rtol=0, atol=SAME)


def test_ratios():
    runners = {"TableProgram": functools.partial(ours, PROGRAM, jnp.asarray(WHEN)), "RotationSpline": with_scipy}
    assert report("spline at 1e5 instants", race(runners, ROUNDS), dict.fromkeys(runners, ""))["RotationSpline"] > 1
