"""The evaluation of a user's rate outside a trace: in NumPy, at all instants at once where possible, or in JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.propagation.propagate import propagate
from qtraj.motion.propagation.sampling import Sampler, vectorized

TIMES = np.linspace(0.0, 2.0, 5)
QUATERNION = np.array([0.1, -0.7, 0.5, 0.4])
INSTANTS = np.linspace(-1.0, 2.0, 700)
ROUND_OFF = 1e-14


def in_numpy(t):
    return np.array([np.sin(3 * t), np.cos(2 * t), t * t])


def components_last(t):
    return np.stack([np.sin(3 * t), np.cos(2 * t), t * t], axis=-1)


def in_python(t):
    """It has a branch, and so does not accept an array of instants."""
    return [np.sin(3 * t), np.cos(2 * t), t * t if t > 0 else (-t) ** 2]


def partly_constant(t):
    """For an array of instants, the components have different shapes."""
    return np.array([np.sin(3 * t), np.cos(2 * t), 0.3])


def in_jax(t):
    return jnp.stack([jnp.sin(3 * t), jnp.cos(2 * t), t * t])


def wrong_for_arrays(t):
    """Its value at one instant depends on the other instants of an array."""
    return np.array([np.sin(3 * t), np.cos(2 * t), t * t + np.max(t) - np.mean(t)])


EXPECTED = components_last(INSTANTS)


@pytest.mark.parametrize("omega", [in_numpy, components_last, in_python, in_jax])
def test_all_kinds_of_functions_have_the_same_values(omega):
    np.testing.assert_allclose(Sampler(omega, float)(INSTANTS), EXPECTED, rtol=0, atol=ROUND_OFF)


def test_which_functions_accept_arrays():
    for omega, accepts in ((in_numpy, True), (in_python, False), (partly_constant, False), (wrong_for_arrays, False)):
        sampler = Sampler(omega, float)
        assert not sampler.uses_jax
        sampler(INSTANTS)
        assert sampler.accepts_arrays == accepts
    np.testing.assert_allclose(Sampler(wrong_for_arrays, float)(INSTANTS), EXPECTED, rtol=0, atol=ROUND_OFF)
    assert Sampler(in_jax, float).uses_jax


def test_many_instants_in_jax():
    many = np.linspace(0.0, 1.0, 20_000)
    np.testing.assert_allclose(Sampler(in_jax, float)(many), components_last(many), rtol=0, atol=ROUND_OFF)


@pytest.mark.parametrize("omega", [in_numpy, in_python, partly_constant])
def test_a_function_in_numpy_compiles_nothing(compiled, omega):
    qs = propagate(omega, QUATERNION, TIMES)
    assert isinstance(qs, np.ndarray)
    assert compiled == []


def test_a_program_compiles_nothing(compiled):
    turn = qt.EulerTurn([1.0, 0, 0, 0], [0.6, 0.5, -0.4, 0.3], qt.Quintic(duration=2.0))
    qs = propagate(lambda t: turn(t).rate, turn.start_q, TIMES)
    np.testing.assert_allclose(qs[-1], turn.end, rtol=0, atol=1e-12)
    assert compiled == []


def test_only_a_function_in_jax_is_compiled(compiled):
    for k in (1.0, 2.0):
        propagate(lambda t: k * in_jax(t), QUATERNION, TIMES)  # noqa: B023
    assert len(compiled) == 2


def test_numpy_and_jax_agree():
    host = propagate(in_numpy, QUATERNION, TIMES)
    device = jax.jit(lambda q, times: propagate(in_jax, q, times, max_steps=32))(QUATERNION, TIMES)
    np.testing.assert_allclose(device, host, rtol=0, atol=1e-12)
    for axes in ("body", "inertial"):
        host = propagate(in_numpy, QUATERNION, TIMES, qt.Magnus(6), axes, steps=3)
        device = jax.jit(lambda q: propagate(in_jax, q, TIMES, qt.Magnus(6), axes, steps=3))(QUATERNION)  # noqa: B023
        np.testing.assert_allclose(device, host, rtol=0, atol=ROUND_OFF)


def test_the_shape_of_a_rate():
    for omega in (lambda t: np.ones(5), lambda t: jnp.ones(5), lambda t: [1.0, 2.0]):
        with pytest.raises(ValueError, match=r"omega\(t\) must have shape"):
            propagate(omega, QUATERNION, TIMES)
    with pytest.raises(ValueError, match=r"omega\(t\) must have shape"):
        vectorized(lambda t: jnp.ones(2), jnp.zeros(3))
