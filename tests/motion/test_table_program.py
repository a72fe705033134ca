"""The rotation spline: SciPy's RotationSpline, run to convergence, is the oracle."""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

from qtraj.algebra import quaternion
from qtraj.foundation.document import load
from qtraj.motion.table_program import TableProgram

SPLINE = 1e-11  # agreement of values, rates and accelerations of size 1 to 10 once both iterations have converged

# Compiled for one small run each: unoptimised code is there five times as fast.
jit = functools.partial(
    jax.jit, compiler_options={"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}
)


@pytest.fixture
def converged(monkeypatch):
    """SciPy stops at 1e-9 or after ten iterations: let it go on."""
    monkeypatch.setattr(RotationSpline, "TOL", 1e-15)
    monkeypatch.setattr(RotationSpline, "MAX_ITER", 300)


def table(count, step, seed=6):
    """Times from 0, attitudes about `step` rad apart, and the same as quaternions of any length and sign."""
    rng = np.random.default_rng(seed)
    rotations = [Rotation.random(random_state=5)]
    for vector in rng.normal(size=(count - 1, 3)):
        rotations.append(rotations[-1] * Rotation.from_rotvec(step * vector))
    rotations = Rotation.concatenate(rotations)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.4, 1.5, count - 1))])
    sizes = rng.uniform(0.3, 3, count) * rng.choice([-1, 1], count)
    return times, rotations, sizes[:, None] * rotations.as_quat(scalar_first=True)


@jit
def evaluated(program, times):
    """Attitudes, and how far 2λ̇ = λ∘ω and ω̇ = ε are from true."""

    def one(t):
        at, along = jax.jvp(program, (t,), (jnp.ones_like(t),))
        return at, along.quaternion - quaternion.derivative(at.quaternion, at.rate), along.rate - at.acceleration

    return jax.vmap(one)(times)


@pytest.mark.parametrize(("count", "step"), [(2, 1.0), (3, 0.5), (12, 0.2), (12, 0.9)])
def test_agrees_with_scipy(count, step, converged):
    times, rotations, quaternions = table(count, step)
    program = TableProgram(times + 7.5, quaternions)  # time is counted from the first
    np.testing.assert_allclose(program.duration, times[-1], rtol=1e-15)
    t = np.concatenate([times, np.linspace(0, times[-1], 301)])
    at, quaternion_gap, rate_gap = evaluated(program, t)
    expected = RotationSpline(times, rotations)
    gap = Rotation.from_quat(at.quaternion, scalar_first=True).inv() * expected(t)
    assert gap.magnitude().max() < SPLINE
    np.testing.assert_allclose(at.rate, expected(t, 1), atol=SPLINE)
    np.testing.assert_allclose(at.acceleration[:-1], expected(t, 2)[:-1], atol=10 * SPLINE)
    np.testing.assert_allclose(quaternion_gap, 0, atol=1e-14)
    np.testing.assert_allclose(rate_gap, 0, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(at.quaternion, axis=1), 1, atol=1e-14)
    assert np.sum(at.quaternion[count:-1] * at.quaternion[count + 1 :], axis=1).min() > 0.99
    first = quaternions[0] / np.linalg.norm(quaternions[0])
    np.testing.assert_allclose(at.quaternion[0], first, atol=1e-15)


def test_acceleration_is_continuous_far_beyond_small_steps():
    times, _, quaternions = table(40, 1.3, seed=2)
    program = TableProgram(times, quaternions)
    before, after = (evaluated(program, times[1:-1] + side)[0] for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(before.acceleration, after.acceleration, atol=1e-6)
    np.testing.assert_allclose(before.rate, after.rate, atol=1e-6)
    assert np.abs(after.acceleration).max() > 1


def test_a_steady_turn_is_reproduced():
    times = np.array([0.0, 0.3, 1.0, 1.1, 2.0])
    rate = np.array([0.3, -1.0, 0.4])
    program = TableProgram(times, Rotation.from_rotvec(times[:, None] * rate).as_quat(scalar_first=True))
    at, _, _ = evaluated(program, np.linspace(-1, 3, 41))  # the end pieces go on
    np.testing.assert_allclose(at.rate, np.tile(rate, (41, 1)), atol=1e-13)
    np.testing.assert_allclose(at.acceleration, 0, atol=1e-12)
    still = TableProgram([0, 1, 2], [[2, 0, 0, 0]] * 3)(0.4)
    assert still.quaternion.tolist() == [1, 0, 0, 0]
    assert still.rate.tolist() == [0, 0, 0]


def test_derivatives_with_respect_to_the_table():
    times, _, quaternions = table(5, 0.6)
    direction = np.random.default_rng(1).normal(size=5 + 20)

    def f(s):
        change = s * direction
        program = TableProgram(times + 0.1 * change[:5], quaternions + change[5:].reshape(5, 4))
        at = program(0.4 * times[-1])
        return jnp.concatenate([at.quaternion, at.rate, at.acceleration])

    def first(s):
        return jax.jvp(f, (s,), (1.0,))[1]

    h = 1e-5
    value, slopes, reverse, bend = jit(
        lambda s: (
            f(s),
            jax.vmap(first)(s + jnp.asarray([-h, 0.0, h])),
            jax.jacrev(f)(s),
            jax.jvp(first, (s,), (1.0,))[1],
        )
    )(0.0)
    near = jit(jax.vmap(f))(np.array([h, -h]))
    np.testing.assert_allclose(slopes[1], (near[0] - near[1]) / (2 * h), rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(reverse, slopes[1], atol=1e-12)
    np.testing.assert_allclose(bend, (slopes[2] - slopes[0]) / (2 * h), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        value, jnp.concatenate(jax.tree.leaves(TableProgram(times, quaternions)(0.4 * times[-1])))
    )


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_is_stored_exactly(suffix, tmp_path):
    times, _, quaternions = table(5, 0.6)
    program = TableProgram(times, quaternions)
    program.save(tmp_path / f"program{suffix}")
    assert jax.tree.all(jax.tree.map(np.array_equal, load(tmp_path / f"program{suffix}"), program))


def test_single_precision():
    times, _, quaternions = (np.asarray(x, np.float32) if isinstance(x, np.ndarray) else x for x in table(5, 0.6))
    program = TableProgram(times, quaternions)
    expected = TableProgram(times.astype(float), quaternions.astype(float))
    at, same = program(np.float32(1.7)), expected(float(np.float32(1.7)))
    assert at.acceleration.dtype == np.float32
    np.testing.assert_allclose(at.acceleration, same.acceleration, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize(
    ("times", "quaternions", "message"),
    [
        ([0.0], [[1.0, 0, 0, 0]], "at least two quaternions"),
        ([0.0, 1.0], [[1.0, 0, 0], [1.0, 0, 0]], "at least two quaternions"),
        ([0.0, 1.0, 2.0], [[1.0, 0, 0, 0]] * 2, "one time for each attitude"),
        ([0.0, 1.0, 1.0], [[1.0, 0, 0, 0]] * 3, "time 2 is 1 s after 1 s"),
        ([0.0, math.nan], [[1.0, 0, 0, 0]] * 2, "times of a table program must be finite"),
        ([0.0, 1.0], [[1.0, 0, 0, 0], [0.0, 0, 0, 0]], "quaternion 1 is zero"),
        ([0.0, 1.0], [[1.0, 0, 0, 0], [math.inf, 0, 0, 0]], "attitudes of a table program must be finite"),
    ],
)
def test_bad_input_is_refused(times, quaternions, message):
    with pytest.raises(ValueError, match=message):
        TableProgram(times, quaternions)


def test_given_rates_must_fit():
    with pytest.raises(ValueError, match="one row for each attitude"):
        TableProgram([0.0, 1.0], [[1.0, 0, 0, 0]] * 2, rates=[[0.0, 0, 0]])
