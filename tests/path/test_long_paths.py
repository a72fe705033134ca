"""Curvature, torsion and frames do not depend on how long a path is: from 1 to 10 million turns, in both precisions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

TURNS = [1, 10, 1e3, 1e5, 1e7]
DTYPES = [np.float32, np.float64]
CURVATURE, TORSION = 10 / 100.25, 0.5 / 100.25
OUTPUTS = ("curvature", "torsion", "defined", "rate")


def helix(turns, dtype):
    parts = (np.array(x, dtype) for x in ([10.0], [0.0, 1.0], [0.0, 0.5], 2 * np.pi * turns))
    return qt.SpiralHelix(*parts)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("turns", TURNS)
def test_a_helix_of_any_length_has_its_curvature(turns, dtype):
    path = helix(turns, dtype)
    times = (np.linspace(0.0, 0.999, 9) * 2 * np.pi * turns).astype(dtype)
    exact = 2e-6 if dtype == np.float32 else 1e-12
    for table in (
        qt.evaluate(path, times, OUTPUTS),
        qt.evaluate(jax.vmap(lambda _: path)(jnp.arange(2)), times, OUTPUTS),
    ):
        np.testing.assert_allclose(table.curvature, CURVATURE, rtol=exact)
        np.testing.assert_allclose(table.torsion, TORSION, rtol=50 * exact)
        assert np.asarray(table.defined).all()
    largest = qt.evaluate(path, times, ("curvature",), reduce="max")["curvature"]
    np.testing.assert_allclose(largest, CURVATURE, rtol=exact)
    at = qt.trihedral(path, times[5])
    assert bool(at.defined)
    np.testing.assert_allclose(at.curvature, CURVATURE, rtol=exact)
    traced = jax.jit(lambda t: qt.trihedral(path, t).curvature)(times[5])
    np.testing.assert_allclose(traced, CURVATURE, rtol=exact)


@pytest.mark.parametrize(("dtype", "turns"), [(np.float32, 1e4), (np.float64, 1e7)])
def test_a_function_may_oscillate_often(dtype, turns):
    """The phase must be resolved by the precision of the time."""
    curve = qt.Curve(
        lambda t: jnp.stack([10 * jnp.cos(t), 10 * jnp.sin(t), 0.5 * t]), np.array(2 * np.pi * turns, dtype)
    )
    times = (np.linspace(0.0, 0.999, 9) * 2 * np.pi * turns).astype(dtype)
    table = qt.evaluate(curve, times, ("curvature", "defined"))
    np.testing.assert_allclose(table.curvature, CURVATURE, rtol=2e-6)
    assert np.asarray(table.defined).all()


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_long_route_with_many_bends_has_frames_everywhere(dtype):
    """A slalom of ten minutes at 10 m/s, with a bend every 20 m, and a stop in the middle."""
    knots = np.arange(0.0, 601.0, 0.5)
    still = (knots >= 300) & (knots <= 310)
    driven = knots - np.clip(knots - 300, 0, 10)
    phase = np.pi * driven / 2
    shape = [10 * driven, 2 * np.sin(phase), 0 * driven]
    speed = [10 + 0 * phase, np.pi * np.cos(phase), 0 * phase]
    turn = [0 * phase, -0.5 * np.pi**2 * np.sin(phase), 0 * phase]
    states = [np.stack(x, axis=1) for x in (shape, speed, turn)]
    for state in states[1:]:
        state[still] = 0
    route = qt.Route(*(x.astype(dtype) for x in (knots, *states)))
    times = np.linspace(0.2, 600.0, 2001).astype(dtype)
    moving = (times < 299.5) | (times > 310.5)
    table = qt.evaluate(route, times, ("defined", "curvature"), qt.Upright())
    assert np.asarray(table.defined)[moving].all()
    assert not np.asarray(table.defined)[(times > 300.5) & (times < 309.5)].any()
    expected = np.abs(np.asarray(qt.evaluate(route, times, ("rate",), qt.Upright()).rate)[:, 2])
    got = np.asarray(table.curvature) * np.asarray(qt.evaluate(route, times, ("speed",)).speed)
    np.testing.assert_allclose(got[moving], expected[moving], rtol=1e-3, atol=1e-3)


def test_a_rotor_of_a_drone_at_full_speed_for_twenty_minutes():
    path = qt.SpiralHelix([0.12], [0.0, 10_000 * 2 * np.pi / 60], [0.0], 1200.0)
    table = qt.evaluate(path, np.linspace(0.0, 1200.0, 7), ("curvature", "defined"))
    np.testing.assert_allclose(table.curvature, 1 / 0.12, rtol=1e-12)
    assert np.asarray(table.defined).all()


@pytest.mark.parametrize("turns", [10, 1000])
def test_a_path_of_the_user_and_a_retimed_path_may_be_long(turns):
    class Circle(qt.AbstractHodograph):
        duration: jax.Array

        def derivatives(self, t, order):
            orders = jnp.arange(order + 1, dtype=self.duration.dtype)
            angle = 0.5 * jnp.asarray(t, self.duration.dtype) + 0.5 * jnp.pi * orders
            return 50 * 0.5 ** orders[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle), 0 * angle], axis=1)

    path = Circle(np.float32(4 * np.pi * turns))
    times = np.linspace(0.0, 0.99, 5, dtype=np.float32) * path.duration
    table = qt.evaluate(path, times, ("curvature", "defined"))
    np.testing.assert_allclose(table.curvature, 0.02, rtol=1e-4)
    assert np.asarray(table.defined).all()
    line = qt.SpiralHelix(*(np.array(x, np.float64) for x in ([50.0], [0.0, 0.5], [0.0], 4 * np.pi * turns)))
    timed = qt.retime(line, qt.Limits(speed=10.0, longitudinal_acceleration=1.0), start_speed=10.0, end_speed=10.0)
    times = np.linspace(0.0, float(timed.path.duration), 5)
    table = qt.evaluate(timed.path, times, ("curvature", "defined"))
    np.testing.assert_allclose(table.curvature, 0.02, rtol=1e-6)
    assert np.asarray(table.defined).all()
