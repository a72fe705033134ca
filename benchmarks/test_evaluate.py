"""A million instants of one path: position, velocity, acceleration, quaternion, curvature, torsion, rate.

The same 18 numbers per instant from qtraj and from NumPy with SciPy's Rotation, warm, blocking on the result. The
compilation is timed apart, and the two results are compared before anything is timed.
"""

import time

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt

INSTANTS = 1_000_000
RADIUS, ANGLE, HEIGHT, DURATION = [20.0, 1.0, 0.3, -0.05], [0.2, 0.35], [1.0, 0.4, 0.05, -0.01], 4.5
PATH = qt.SpiralHelix(RADIUS, ANGLE, HEIGHT, DURATION)
TIMES = np.linspace(0.0, DURATION, INSTANTS)


def ours(times):
    return jax.block_until_ready(qt.evaluate(PATH, times))


def numpy_and_scipy(times):
    """The textbook evaluation with NumPy arrays, each product formed once."""
    rho, h = np.polynomial.Polynomial(RADIUS), np.polynomial.Polynomial(HEIGHT)
    w = ANGLE[1]
    p = [rho.deriv(k)(times) for k in range(4)]
    along = [p[0], p[1], p[2] - w**2 * p[0], p[3] - 3 * w**2 * p[1]]
    across = [0.0 * p[0], w * p[0], 2 * w * p[1], 3 * w * p[2] - w**3 * p[0]]
    phi = ANGLE[0] + w * times
    cos, sin = np.cos(phi), np.sin(phi)
    r = [
        np.stack([along[k] * cos - across[k] * sin, along[k] * sin + across[k] * cos, h.deriv(k)(times)], axis=-1)
        for k in range(4)
    ]
    c = np.cross(r[1], r[2])
    speed, area = np.linalg.norm(r[1], axis=-1), np.linalg.norm(c, axis=-1)
    tangent, binormal = r[1] / speed[:, None], c / area[:, None]
    axes = np.stack([tangent, np.cross(binormal, tangent), binormal], axis=-1)
    quaternion = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    curvature, torsion = area / speed**3, np.einsum("ij,ij->i", c, r[3]) / area**2
    rate = np.stack([speed * torsion, np.zeros_like(speed), speed * curvature], axis=-1)
    return r[0], r[1], r[2], quaternion, curvature, torsion, rate


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
