"""The rotation spline, compared with SciPy's RotationSpline run to convergence."""

import math

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation, RotationSpline

from qtraj.algebra import quaternion
from qtraj.foundation.document import load
from qtraj.motion.programs import rotation_spline
from qtraj.motion.programs.table_program import TableProgram

SPLINE = 1e-11  # agreement of values, rates and accelerations of size 1 to 10 once both iterations have converged


@pytest.fixture
def converged(monkeypatch):
    """SciPy stops at 1e-9 or after ten iterations: let it converge."""
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


def test_a_missing_sample_is_named_without_printing_the_table():
    times, _, quaternions = table(500, 0.1)
    quaternions[[17, 40], 2] = math.nan
    with pytest.raises(
        ValueError, match=r"sample 17 \(samples are numbered from 0 to 499\) is \[.*nan.*\]; it is the first of 2"
    ) as error:
        TableProgram(times, quaternions)
    assert len(str(error.value)) < 250
    with pytest.raises(ValueError, match=r"sample 3 \(samples are numbered from 0 to 499\) is inf$"):
        TableProgram(np.where(np.arange(500) == 3, math.inf, times), np.ones((500, 4)))


@jax.jit
def evaluated(program, times):
    """Attitudes, and the residuals of 2λ̇ = λ∘ω and ω̇ = ε."""

    def one(t):
        at, along = jax.jvp(program, (t,), (jnp.ones_like(t),))
        return at, along.quaternion - quaternion.derivative(at.quaternion, at.rate), along.rate - at.acceleration

    return jax.vmap(one)(times)


@pytest.mark.parametrize(("count", "step"), [(2, 1.0), (12, 0.2), (12, 0.9)])
def test_agrees_with_scipy(count, step, converged):
    times, rotations, quaternions = table(count, step)
    program = TableProgram(times + 7.5, quaternions)  # time is counted from the first
    np.testing.assert_allclose(program.duration, times[-1], rtol=1e-15)
    t = np.concatenate([times, np.linspace(0, times[-1], 313 - count)])
    at, quaternion_residual, rate_residual = evaluated(program, t)
    expected = RotationSpline(times, rotations)
    gap = Rotation.from_quat(at.quaternion, scalar_first=True).inv() * expected(t)
    assert gap.magnitude().max() < SPLINE
    np.testing.assert_allclose(at.rate, expected(t, 1), atol=SPLINE)
    np.testing.assert_allclose(at.acceleration[:-1], expected(t, 2)[:-1], atol=10 * SPLINE)
    np.testing.assert_allclose(quaternion_residual, 0, atol=1e-14)
    np.testing.assert_allclose(rate_residual, 0, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(at.quaternion, axis=1), 1, atol=1e-14)
    assert np.sum(at.quaternion[count:-1] * at.quaternion[count + 1 :], axis=1).min() > 0.99
    first = quaternions[0] / np.linalg.norm(quaternions[0])
    np.testing.assert_allclose(at.quaternion[0], first, atol=1e-15)


def test_the_acceleration_is_continuous_for_large_steps():
    times, _, quaternions = table(12, 1.3, seed=2)
    program = TableProgram(times, quaternions)
    before, after = (evaluated(program, times[1:-1] + side)[0] for side in (-1e-9, 1e-9))
    np.testing.assert_allclose(before.acceleration, after.acceleration, atol=1e-6)
    np.testing.assert_allclose(before.rate, after.rate, atol=1e-6)
    assert np.abs(after.acceleration).max() > 1


def test_a_constant_rate_is_reproduced():
    times = np.linspace(0.0, 2.0, 12) ** 2
    rate = np.array([0.3, -1.0, 0.4])
    attitudes = Rotation.from_rotvec(times[:, None] * rate).as_quat(scalar_first=True)
    program = TableProgram(times, attitudes, outside="extrapolate")
    at, _, _ = evaluated(program, np.linspace(-1, 5, 313))  # the end pieces are extrapolated
    np.testing.assert_allclose(at.rate, np.tile(rate, (313, 1)), atol=1e-13)
    np.testing.assert_allclose(at.acceleration, 0, atol=1e-11)  # the first intervals are short
    still = TableProgram([0, 1, 2], [[2, 0, 0, 0]] * 3)(0.4)
    assert still.quaternion.tolist() == [1, 0, 0, 0]
    assert still.rate.tolist() == [0, 0, 0]


@pytest.mark.slow
def test_gradients_with_respect_to_the_table():
    times, _, quaternions = table(5, 0.6)
    direction = np.random.default_rng(1).normal(size=(5, 5))

    weights = np.random.default_rng(2).normal(size=10)

    def f(table):
        at = TableProgram(times + 0.1 * table[:, 0], table[:, 1:])(0.4 * times[-1])
        return weights @ jnp.concatenate([at.quaternion, at.rate, at.acceleration])

    h, x = 1e-5, np.concatenate([0 * quaternions[:, :1], quaternions], axis=1)
    value = jax.jit(f)
    difference = (value(x + h * direction) - value(x - h * direction)) / (2 * h)
    np.testing.assert_allclose(np.sum(jax.jit(jax.grad(f))(x) * direction), difference, rtol=1e-7, atol=1e-7)


def test_first_and_second_derivatives_of_the_rates_are_exact():
    rotations, change = np.random.default_rng(4).normal(size=(2, 2, 3)) * 0.6
    widths = np.array([0.5, 0.8])

    def f(s):
        return rotation_spline.knot_rates(rotations + s * change, widths * (1 + 0.2 * s))[0]

    def first(s):
        return jax.jvp(f, (s,), (1.0,))[1]

    h = 1e-4
    below, value, above = jax.jit(jax.vmap(f))(np.array([-h, 0.0, h]))
    slope, second = jax.jit(lambda s: jax.jvp(first, (s,), (1.0,)))(0.0)
    np.testing.assert_allclose(slope, (above - below) / (2 * h), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(second, (above - 2 * value + below) / h**2, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_is_stored_exactly(suffix, tmp_path):
    times, _, quaternions = table(12, 0.6)
    program = TableProgram(times, quaternions)
    program.save(tmp_path / f"program{suffix}")
    assert jax.tree.all(jax.tree.map(np.array_equal, load(tmp_path / f"program{suffix}"), program))


def test_single_precision():
    times, _, quaternions = (jnp.asarray(x, jnp.float32) if isinstance(x, np.ndarray) else x for x in table(12, 0.6))
    program = TableProgram(times, quaternions)
    expected = TableProgram(np.asarray(times, float), np.asarray(quaternions, float))
    t = np.linspace(0, float(times[-1]), 313).astype(np.float32)
    at, same = evaluated(program, t)[0], evaluated(expected, t.astype(float))[0]
    assert at.acceleration.dtype == np.float32
    np.testing.assert_allclose(at.acceleration, same.acceleration, rtol=1e-4, atol=1e-3)


def test_precisions_can_be_mixed():
    times, _, quaternions = table(5, 0.6)
    times_32, quaternions_32 = (jnp.asarray(x, jnp.float32) for x in (times, quaternions))
    single = TableProgram(times, quaternions_32)
    again = TableProgram(times_32, quaternions_32, jnp.asarray(single.rates, jnp.float32))
    assert single(0.5).rate.dtype == np.float64
    assert again(0.5).rate.dtype == np.float32
    np.testing.assert_allclose(again(0.5).rate, single(0.5).rate, atol=1e-5)


@pytest.mark.parametrize(
    ("times", "quaternions", "message"),
    [
        ([0.0], [[1.0, 0, 0, 0]], "at least two quaternions"),
        ([0.0, 1.0], [[1.0, 0, 0], [1.0, 0, 0]], "at least two quaternions"),
        ([0.0, 1.0, 2.0], [[1.0, 0, 0, 0]] * 2, "one time for each attitude"),
        ([0.0, 1.0, 1.0], [[1.0, 0, 0, 0]] * 3, r"times\[2\] = 1 s follows times\[1\] = 1 s"),
        ([0.0, math.nan], [[1.0, 0, 0, 0]] * 2, "times of a table program must be finite"),
        ([0.0, 1.0], [[1.0, 0, 0, 0], [0.0, 0, 0, 0]], "quaternion 1 is zero"),
        ([0.0, 1.0], [[1.0, 0, 0, 0], [math.inf, 0, 0, 0]], "attitudes of a table program must be finite"),
    ],
)
def test_bad_input_is_refused(times, quaternions, message):
    with pytest.raises(ValueError, match=message):
        TableProgram(times, quaternions)


def test_scipy_stops_before_its_iteration_converges():
    """For large steps, SciPy's spline is off by 1e-5 to 1e-3; ours agrees with more iterations of SciPy."""
    gaps = []
    for seed in range(7, 10):
        times, rotations, quaternions = table(12, 1.1, seed)
        t = np.linspace(0, times[-1], 100)
        ours = Rotation.from_quat(evaluated(TableProgram(times, quaternions), t)[0].quaternion, scalar_first=True)
        stopped = RotationSpline(times, rotations)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(RotationSpline, "TOL", 1e-15)
            patch.setattr(RotationSpline, "MAX_ITER", 300)
            assert (ours.inv() * RotationSpline(times, rotations)(t)).magnitude().max() < SPLINE
        gaps.append((ours.inv() * stopped(t)).magnitude().max())
    assert 1e-5 < max(gaps) < 2e-3


def product(a, b):
    """Hamilton's product of two lists."""
    (s, x, y, z), (t, u, v, w) = a, b
    return [
        s * t - x * u - y * v - z * w,
        s * u + x * t + y * w - z * v,
        s * v - x * w + y * t + z * u,
        s * w + x * v - y * u + z * t,
    ]


def exponential(theta):
    half = mpmath.sqrt(sum(x * x for x in theta)) / 2
    return [mpmath.cos(half), *(mpmath.sinc(half) / 2 * x for x in theta)]


class ExactSpline:
    """The rotation spline through attitudes in mpmath, without the formulas of ours and SciPy's.

    On each interval λ = λ_i∘exp(θ/2) with a cubic θ. The derivatives of θ at the end of an interval follow from the
    rate there, and the rates from the continuity of the acceleration 2 vec(λ⁻¹∘λ̈). Derivatives are central differences
    with 50 digits, which are exact to 1e-24.
    """

    H = mpmath.mpf(10) ** -12

    def __init__(self, widths, steps, guess):
        self.widths, self.steps = [mpmath.mpf(x) for x in widths], [[mpmath.mpf(x) for x in s] for s in steps]
        first, last = (
            [x / h for x in s] for s, h in ((self.steps[0], self.widths[0]), (self.steps[-1], self.widths[-1]))
        )
        count = len(self.widths) - 1

        def rates(x):
            return [first, *([x[3 * k], x[3 * k + 1], x[3 * k + 2]] for k in range(count)), last]

        def jumps(*x):
            self.cubics = [self._cubic(k, *rates(x)[k : k + 2]) for k in range(count + 1)]
            ends = [(self._acceleration(k, self.widths[k]), self._acceleration(k + 1, 0)) for k in range(count)]
            return [a - b for end, start in ends for a, b in zip(end, start, strict=True)]

        mpmath.findroot(jumps, [mpmath.mpf(x) for x in np.ravel(guess)], tol=1e-30, maxsteps=20)

    def _turned(self, k, t):
        return exponential([((c[2] * t + c[1]) * t + c[0]) * t for c in self.cubics[k]])

    def _acceleration(self, k, t):
        before, here, after = (self._turned(k, t + x) for x in (-self.H, 0, self.H))
        second = [(a - 2 * b + c) / self.H**2 for a, b, c in zip(before, here, after, strict=True)]
        return [2 * x for x in product([here[0], *(-x for x in here[1:])], second)[1:]]

    def _cubic(self, k, first, last):
        """θ and θ̇ at both ends: exp(θ + hθ̇) = exp(θ)∘(1 + ½hω) to first order, solved for θ̇."""
        step, width = self.steps[k], self.widths[k]
        columns = []
        for axis in range(3):
            moved = [[x + sign * self.H * (i == axis) for i, x in enumerate(step)] for sign in (1, -1)]
            slope = [(a - b) / (2 * self.H) for a, b in zip(*map(exponential, moved), strict=True)]
            here = exponential(step)
            columns.append([2 * x for x in product([here[0], *(-x for x in here[1:])], slope)[1:]])
        end = mpmath.lu_solve(mpmath.matrix(columns).T, mpmath.matrix(last))
        mean = [x / width for x in step]
        return [
            (a, (3 * m - 2 * a - b) / width, (a + b - 2 * m) / width**2)
            for a, b, m in zip(first, end, mean, strict=True)
        ]

    def __call__(self, k, share):
        """The attitude relative to the k-th, at a share of the k-th interval."""
        return np.array([float(x) for x in self._turned(k, share * self.widths[k])])


def test_agrees_with_a_solution_of_fifty_digits_where_scipy_has_not_converged():
    """Steps of 0.9 rad, and intervals that differ by a factor of 40."""
    rng = np.random.default_rng(116)
    steps = rng.normal(size=(4, 3))
    steps *= 0.9 / np.linalg.norm(steps, axis=1)[:, None]
    widths = np.exp(rng.uniform(np.log(0.1), np.log(10), 4))
    rotations = [Rotation.identity()]
    for step in steps:
        rotations.append(rotations[-1] * Rotation.from_rotvec(step))
    rotations = Rotation.concatenate(rotations)
    times = np.cumsum([0.0, *widths])
    program, theirs = TableProgram(times, rotations.as_quat(scalar_first=True)), RotationSpline(times, rotations)
    with mpmath.workdps(50):
        exact = ExactSpline(widths, steps, theirs(times, 1)[1:-1])
        shares = [(k, share) for k in range(4) for share in (0.25, 0.5, 0.75)]
        turned = Rotation.from_quat([exact(k, share) for k, share in shares], scalar_first=True)
    expected = rotations[[k for k, _ in shares]] * turned
    t = np.array([times[k] + share * widths[k] for k, share in shares])
    ours = Rotation.from_quat([np.asarray(program(x).quaternion) for x in t], scalar_first=True)
    assert (ours.inv() * expected).magnitude().max() < SPLINE
    assert 1e-4 < (theirs(t).inv() * expected).magnitude().max() < 1e-3


HALF = [[1.0, 0, 0, 0], [0.0, 1, 0, 0], [0.0, 1, 1, 0]]


@pytest.mark.parametrize("rates", [None, np.zeros((3, 3))])
def test_attitudes_that_are_a_half_turn_apart_are_refused(rates):
    with pytest.raises(ValueError, match=r"attitudes 0 and 1 of a table program, at 5 s and 6 s, are a half turn"):
        TableProgram([5.0, 6.0, 7.0], HALF, rates)
    near = np.array(HALF, float)
    near[0, 1] = 1e-5  # 2e-5 rad less than a half turn: the axis is known
    assert np.isfinite(TableProgram([5.0, 6.0, 7.0], near, np.zeros((3, 3)))(0.5).quaternion).all()
    traced = jax.jit(lambda q: TableProgram([5.0, 6.0, 7.0], q, rates).rates)
    assert np.isnan(traced(jnp.asarray(HALF))).all()
    assert np.isfinite(traced(jnp.asarray(near))).all()


@pytest.mark.parametrize("absolute", [True, False])
def test_a_time_outside_the_table_is_refused(absolute):
    times, _, quaternions = table(5, 0.4)
    program = TableProgram(times + 100.0 * absolute, quaternions)
    for t in (-1e-3, times[-1] + 1e-3, 100.0):
        with pytest.raises(ValueError, match=r"a table program lasts from 0 to .* pass outside='hold'") as error:
            program(t)
        assert ("the table starts at 100 s" in str(error.value)) == absolute
        assert np.isnan(jax.jit(lambda t: program(t).rate)(t)).all()
    last = program(program.duration * (1 + 1e-8))  # round-off
    np.testing.assert_allclose(last.rate, program.rates[-1], atol=1e-6)


def test_attitudes_are_held_outside_the_table():
    times, _, quaternions = table(5, 0.4)
    program, held = TableProgram(times, quaternions), TableProgram(times, quaternions, outside="hold")
    for t, end in ((-3.0, 0.0), (1e6, times[-1])):
        at = held(t)
        np.testing.assert_allclose(at.quaternion, program(end).quaternion, atol=1e-15)
        assert not np.any(at.rate)
        assert not np.any(at.acceleration)
    inside = held(0.3)
    np.testing.assert_allclose(inside.rate, program(0.3).rate, atol=1e-14)
    with pytest.raises(ValueError, match=r"outside must be 'error' or 'hold' or 'extrapolate', but 'clip' was given"):
        TableProgram(times, quaternions, outside="clip")


def test_hard_tables_are_exact_or_refused():
    """Steps of 2 to 3.1 rad: inside a trace, the acceleration is continuous, or the rates are NaN."""

    @jax.jit
    def checked(times, quaternions):
        program = TableProgram(times, quaternions)
        before, after = (jax.vmap(program)(times[1:-1] * side).acceleration for side in (1 - 1e-12, 1.0))
        return program.rates, jnp.max(jnp.abs(after - before)) / jnp.max(jnp.abs(after))

    found = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        rotations = [Rotation.random(random_state=seed)]
        for axis in rng.normal(size=(11, 3)):
            rotations.append(rotations[-1] * Rotation.from_rotvec(rng.uniform(2, 3.1) * axis / np.linalg.norm(axis)))
        quaternions = Rotation.concatenate(rotations).as_quat(scalar_first=True)
        rates, jump = checked(np.concatenate([[0.0], np.cumsum(rng.uniform(0.05, 3, 11))]), quaternions)
        found.append(bool(np.isfinite(rates).all()))
        assert jump < 1e-6 or not found[-1]
    assert sum(found) > 50


def test_user_rates_must_fit():
    with pytest.raises(ValueError, match="one row for each attitude"):
        TableProgram([0.0, 1.0], [[1.0, 0, 0, 0]] * 2, rates=[[0.0, 0, 0]])
