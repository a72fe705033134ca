"""Settling times of solutions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

TIMES = np.arange(4.0)


def solution(angle):
    return qt.Solution(TIMES, np.ones((4, 4)), np.zeros((4, 4)), 0, angle=jnp.asarray(angle))


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        ([3.0, 2.0, 0.5, 0.2], 1 + 1 / 1.5),
        ([3.0, 0.5, 2.0, 0.0], 2.5),
        ([0.5, 0.2, 0.1, 0.9], 0.0),
        ([1.0, 1.0, 1.0, 1.0], 0.0),
        ([3.0, 0.5, 0.5, 2.0], np.nan),
        ([3.0, 0.5, np.nan, np.nan], np.nan),
    ],
)
def test_settling(angle, expected):
    assert float(solution(angle).settling_time(1.0)) == pytest.approx(expected, nan_ok=True)


def test_settling_times_of_a_batch():
    angles = jnp.asarray([[3.0, 2.0, 0.5, 0.2], [3.0, 0.5, 2.0, 0.0]])
    batch = jax.vmap(solution)(angles)
    np.testing.assert_allclose(batch.settling_time(1.0), [1 + 1 / 1.5, 2.5])


def test_the_derivative_of_the_settling_time():
    """t = 1 + (a − w)/(a − b) between the angles a = 2 and b = 0.5, at w = 1."""
    slope = jax.grad(lambda angle: solution(angle).settling_time(1.0))(jnp.asarray([3.0, 2.0, 0.5, 0.2]))
    np.testing.assert_allclose(slope, [0.0, 0.5 / 1.5**2, 1.0 / 1.5**2, 0.0], rtol=1e-14)
    never = jax.grad(lambda angle: solution(angle).settling_time(0.3))(jnp.asarray([3.0, 2.0, 0.5, 0.2]))
    assert np.isfinite(never).all()


def test_an_open_loop_has_no_settling_time():
    with pytest.raises(ValueError, match="use simulate for a closed loop"):
        qt.Solution(TIMES, np.ones((4, 4)), np.zeros((4, 4)), 0).settling_time(1.0)
