"""Cubic splines in a given time: limits, continuity, and comparison with a discrete optimum from SciPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

import qtraj as qt

QUARTER = np.pi / 2
CASES = {
    "free": (QUARTER, 4.0, 0.8, 2.0),
    "rate": (QUARTER, 2.8, 0.8, 2.0),
    "acceleration": (QUARTER, 2.0, 3.0, 1.8),
    "both": (QUARTER, 2.4, 0.8, 2.0),
    "the least time": (QUARTER, QUARTER / 0.8 + 0.4, 0.8, 2.0),
    "bang-bang": (QUARTER, 2 * np.sqrt(QUARTER / 2.0), None, 2.0),
    "rate alone": (QUARTER, 2.1, 0.8, None),
    "no limit": (QUARTER, 2.0, None, None),
    "backwards": (-QUARTER, 2.5, 0.8, 2.0),
}
ROUND_OFF = 1e-12


@pytest.mark.parametrize("name", CASES)
def test_limits_ends_and_duration(name):
    angle, time, rate, acceleration = CASES[name]
    profile = qt.MultiKnotCubic(time, rate, acceleration).profile(angle)
    np.testing.assert_allclose(profile.duration, time, rtol=1e-15)
    np.testing.assert_allclose(profile.derivatives(0.0, 1), [0.0, 0.0], atol=ROUND_OFF)
    end = jax.vmap(lambda t: profile.derivatives(t, 1))(time * (1 - np.array([0.0, 1e-12])))
    np.testing.assert_allclose(end, [[angle, 0.0]] * 2, atol=1e-10)
    if rate is not None:
        assert profile.peak(1)[1] <= rate * (1 + 1e-9)
    if acceleration is not None:
        assert profile.peak(2)[1] <= acceleration * (1 + 1e-9)
    inner = np.unique(np.asarray(profile.switches)[:-1])
    inner = inner[(inner > 1e-6) & (inner < time - 1e-6)]
    if name in ("the least time", "bang-bang"):
        return  # its acceleration jumps
    near = jax.vmap(lambda t: profile.derivatives(t, 2))
    np.testing.assert_allclose(near(inner - 1e-9), near(inner + 1e-9), atol=1e-7)
    # Symmetric about the middle, and its derivatives are those of its angle.
    t = np.linspace(0.01, 0.99, 23) * time
    np.testing.assert_allclose(near(t)[:, 0] + near(time - t)[:, 0], angle, atol=1e-12)
    np.testing.assert_allclose(jax.vmap(jax.grad(profile.angle))(t), near(t)[:, 1], atol=1e-12)


def test_a_slew_that_is_impossible_with_a_single_cubic():
    """90° in 2.8 s within 0.8 rad/s and 2 rad/s²; the minimum time is 2.3635 s, that of the time-optimal slew."""
    with pytest.raises(ValueError, match="needs at least"):
        qt.Cubic(2.8, 0.8, 2.0).profile(QUARTER)
    assert qt.MultiKnotCubic(2.8, 0.8, 2.0).profile(QUARTER).feasible
    least = float(qt.TimeOptimal(0.8, 2.0).profile(QUARTER).duration)
    np.testing.assert_allclose(least, 2.36349540849362, rtol=1e-14)
    shortest, fastest = qt.MultiKnotCubic(least, 0.8, 2.0).profile(QUARTER), qt.TimeOptimal(0.8, 2.0).profile(QUARTER)
    t = np.linspace(0.0, least, 57)
    np.testing.assert_allclose(jax.vmap(shortest.angle)(t), jax.vmap(fastest.angle)(t), atol=1e-7)  # a root at 0
    with pytest.raises(ValueError, match=r"this multi-knot cubic profile needs at least 2\.3634"):
        qt.MultiKnotCubic(2.36, 0.8, 2.0).profile(QUARTER)


def cost(profile):
    """∫Φ̈² dt over the pieces; Simpson's rule is exact for quadratic functions."""
    total = 0.0
    for start, width in zip(np.asarray(profile.starts), np.asarray(profile.widths), strict=True):
        if width > 1e-9:
            ends = [start + width * u for u in (1e-9, 0.5, 1 - 1e-9)]
            a, b, c = (float(profile.acceleration(t)) ** 2 for t in ends)
            total += width * (a + 4 * b + c) / 6
    return total


@pytest.mark.parametrize("name", ["free", "rate", "acceleration", "both", "rate alone"])
def test_no_slew_has_a_smaller_cost(name):
    """Against SciPy's optimum over accelerations that are linear between 31 nodes."""
    angle, time, rate, acceleration = CASES[name]
    nodes = 31
    h = time / (nodes - 1)
    weights = np.full(nodes, h)
    weights[[0, -1]] = h / 2
    mass = (
        np.diag(np.full(nodes, 2 * h / 3))
        + np.diag(np.full(nodes - 1, h / 6), 1)
        + np.diag(np.full(nodes - 1, h / 6), -1)
    )
    mass[0, 0] = mass[-1, -1] = h / 3
    rates = np.tril(np.full((nodes, nodes), h)) - np.diag(np.full(nodes, h / 2))
    rates[:, 0] -= h / 2
    rates[0, 0] = 0.0  # the trapezoidal rule: exact between nodes
    # Φ(T) = ∫(T − t)Φ̈ dt, with Φ̈ linear between nodes.
    t = h * np.arange(nodes)
    moment = np.array([((time - t) * np.interp(t, t, np.eye(nodes)[k]) * weights).sum() for k in range(nodes)])
    moment[0] -= h**2 / 6
    moment[-1] += h**2 / 6
    equal = [
        {"type": "eq", "fun": lambda a: rates[-1] @ a, "jac": lambda a: rates[-1]},
        {"type": "eq", "fun": lambda a: moment @ a - angle, "jac": lambda a: moment},
        {"type": "ineq", "fun": lambda a: rate - rates @ a, "jac": lambda a: -rates},
    ]
    bound = np.inf if acceleration is None else acceleration
    found = minimize(
        lambda a: (a @ mass @ a, 2 * mass @ a),
        6 * angle / time**2 * (1 - 2 * t / time),
        jac=True,
        method="SLSQP",
        bounds=[(-bound, bound)] * nodes,
        constraints=equal,
        options={"maxiter": 500, "ftol": 1e-14},
    )
    assert found.success
    best = cost(qt.MultiKnotCubic(time, rate, acceleration).profile(angle))
    assert best <= found.fun * (1 + 1e-6)
    np.testing.assert_allclose(best, found.fun, rtol=0.02)


def test_derivatives_and_storage(tmp_path):
    def there(angle, time, rate):
        return qt.MultiKnotCubic(time, rate, 2.0).profile(angle).angle(0.7)

    point = jnp.asarray([QUARTER, 2.4, 0.8])
    slope = jax.jit(jax.grad(lambda x: there(*x)))(point)
    for k, step in enumerate(1e-6 * np.eye(3)):
        central = (there(*(point + step)) - there(*(point - step))) / 2e-6
        np.testing.assert_allclose(slope[k], central, rtol=1e-6, atol=1e-9)
    flat = jax.grad(lambda angle: there(angle, 2.4, 0.8))(0.0)
    assert np.isfinite(flat)
    law = qt.MultiKnotCubic(2.4, 0.8, 2.0)
    turn = qt.EulerTurn([1.0, 0, 0, 0], [1.0, 1.0, 0, 0], law)
    turn.save(tmp_path / "turn.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "turn.toml")(1.1).rate, turn(1.1).rate)
    whole = jax.vmap(turn)(jnp.linspace(0.0, 2.4, 41))
    assert np.linalg.norm(whole.rate, axis=1).max() <= 0.8 + 1e-12
    traced = jax.jit(lambda T: qt.MultiKnotCubic(T, 0.8, 2.0).profile(QUARTER).feasible)
    assert not traced(2.0)
    assert traced(2.4)


def test_single_precision_and_invalid_arguments():
    profile = qt.MultiKnotCubic(jnp.float32(2.4), 0.8, 2.0).profile(jnp.float32(QUARTER))
    assert profile.angle(1.0).dtype == np.float32
    np.testing.assert_allclose(profile.angle(jnp.float32(1.2)), QUARTER / 2, rtol=1e-6)
    for arguments, expected in (
        ((None,), "needs a duration"),
        ((-1.0,), "duration must be positive"),
        ((1.0, -1.0), "max_rate must be positive"),
        ((1.0, None, 0.0), "max_acceleration must be positive"),
    ):
        with pytest.raises(ValueError, match=expected):
            qt.MultiKnotCubic(*arguments)
