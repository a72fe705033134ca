"""Actuator, sensor and disturbance by themselves, and the errors they raise."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.control import AccelerationLaw, RateLaw
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.disturbance import DisturbanceAcceleration, DisturbanceTorque, Sinusoid
from qtraj.motion.simulation.sensor import Gyros, Sensor
from qtraj.motion.simulation.simulate import simulate

from ..rigs import Rest

IDENTITY = np.array([1.0, 0, 0, 0])


@pytest.mark.parametrize(
    ("actuator", "expected"),
    [
        (Actuator(), [9.0, 3.0, -4.0, 12.0]),
        (Actuator(6.5), [9.0, 1.5, -2.0, 6.0]),
        (Actuator(13.0), [9.0, 3.0, -4.0, 12.0]),
        (Actuator(5.0, "axis"), [9.0, 3.0, -4.0, 5.0]),
        (Actuator([1.0, 9.0, 2.0], "axis"), [9.0, 1.0, -4.0, 2.0]),
    ],
)
def test_limits_do_not_affect_the_virtual_part(actuator, expected):
    command = jnp.asarray([9.0, 3.0, -4.0, 12.0])
    np.testing.assert_allclose(actuator(command), expected, rtol=1e-15)
    slope = jax.jacfwd(actuator)(jnp.zeros(4))
    np.testing.assert_array_equal(slope, np.eye(4))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_a_sinusoid(dtype):
    wave = Sinusoid(jnp.asarray([1.0, -2.0, 0.0], dtype), 8.0, np.pi / 2)
    value = wave(jnp.asarray(1.0, dtype))
    assert value.dtype == dtype
    np.testing.assert_allclose(value, np.array([1.0, -2.0, 0.0]) / np.sqrt(2), rtol=1e-6)
    np.testing.assert_allclose(DisturbanceTorque(wave, 2.0).acceleration(jnp.asarray(0.0, dtype)), [0.5, -1.0, 0.0])


@pytest.mark.parametrize(
    ("function", "signature"),
    [
        (lambda: jnp.zeros(3), r"\(\)"),
        (lambda t, q: jnp.zeros(3), r"\(t, q\)"),
        (lambda *, t: jnp.zeros(3), r"\(\*, t\)"),
    ],
)
@pytest.mark.parametrize("wrap", [lambda f: f, DisturbanceAcceleration, lambda f: DisturbanceTorque(f, 2.0)])
def test_a_function_of_other_arguments_is_refused(function, signature, wrap):
    with pytest.raises(ValueError, match=rf"a function t .*rate \(3,\)\) → \(3,\), but its signature is {signature}"):
        simulate(Rest(), AccelerationLaw(2.0, 1.0), IDENTITY, np.zeros(4), [0.0, 1.0], wrap(function))


def test_functions_with_defaults_and_callable_objects_are_disturbances():
    assert (
        DisturbanceAcceleration(lambda t, size=2.0: jnp.full(3, size)).acceleration(jnp.asarray(1.0)).tolist()
        == [2] * 3
    )
    assert DisturbanceAcceleration(Sinusoid([1.0, 0, 0], 4.0)).acceleration(jnp.asarray(1.0))[0] == pytest.approx(1.0)


def test_noise_depends_on_its_key_and_has_its_standard_deviation():
    def readings(key):
        sensor = Sensor(rate_noise=0.2, attitude_noise=0.01, rate_bias=[1.0, 0, 0], sampling=0.1, key=key)

        def one(k):
            q, w, _ = sensor.measure(k, jnp.asarray(0.1), jnp.asarray(2 * IDENTITY), jnp.zeros(4), None)
            return q, w

        return jax.jit(jax.vmap(one))(jnp.arange(4000))

    q, w = readings(jax.random.key(1))
    for typed, raw in zip((q, w), readings(jax.random.key_data(jax.random.key(1))), strict=True):
        np.testing.assert_array_equal(typed, raw)
    assert not np.allclose(w, readings(jax.random.key(2))[1])
    np.testing.assert_allclose(np.std(w[:, 1:], axis=0), 0.2, rtol=0.05)
    np.testing.assert_allclose(np.mean(w, axis=0), [0, 1, 0, 0], atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 2, rtol=1e-14)  # |λ| is known exactly
    np.testing.assert_allclose(np.std(2 * q[:, 1:] / q[:, :1], axis=0), 0.01, rtol=0.05)


@pytest.mark.parametrize(
    ("thing", "message"),
    [
        (lambda: Actuator(-1.0), "limit must be positive"),
        (lambda: Actuator([1.0, 2, 3]), "a limit for each axis requires saturation = 'axis'"),
        (lambda: Actuator([1.0, 2], "axis"), r"must be a scalar or have shape \(3,\), but shape \(2,\) was given"),
        (lambda: Actuator(saturation="box"), "'norm' or 'axis'"),
        (lambda: Actuator(sampling=0.0), "sampling period must be positive"),
        (lambda: Actuator(sampling=[0.0, 2.0, 1.0]), "increase strictly"),
        (lambda: Sensor(rate_noise=0.1, sampling=0.1), "needs a key"),
        (lambda: Sensor(rate_noise=0.1, key=jax.random.key(0)), "must be sampled"),
        (lambda: Gyros(0.1, noise=-1.0), "a scalar and not negative"),
        (lambda: Gyros(0.1, bias=[1.0]), r"bias must have shape \(3,\)"),
        (lambda: Sinusoid([1.0, 0, 0], 0.0), "the period must be positive"),
        (lambda: Sinusoid([1.0, 0, 0], 1.0, np.nan), "phase"),
        (lambda: Sinusoid([1.0, 0], 1.0), r"amplitude must have shape \(3,\)"),
        (lambda: DisturbanceTorque([0.0, 0, 1], [1.0, 1, -1]), "positive principal moments"),
        (lambda: DisturbanceAcceleration([0.0, 1.0]), r"must have shape \(3,\)"),
    ],
)
def test_invalid_parts_are_refused(thing, message):
    with pytest.raises(ValueError, match=message):
        thing()


def test_contradictory_parts_are_refused():
    def loop(law=None, times=(0.0, 1.0), **parts):
        simulate(Rest(), law or AccelerationLaw(2.0, 1.0), IDENTITY, np.zeros(4), times, **parts)

    with pytest.raises(ValueError, match="a disturbance has no effect"):
        loop(RateLaw(1.0), disturbance=lambda t: jnp.zeros(3))
    with pytest.raises(ValueError, match="gyros need a continuous rate"):
        loop(RateLaw(1.0), sensor=Gyros(0.1))
    with pytest.raises(ValueError, match="sensor and actuator must have the same sampling"):
        loop(sensor=Gyros(0.1), actuator=Actuator(sampling=0.2))
    with pytest.raises(ValueError, match=r"is later than times\[0\]"):
        loop(actuator=Actuator(sampling=[0.1, 0.2]))
    with pytest.raises(ValueError, match=r"requires 1e\+07 commands in 1 s, but the maximum is 1000000"):
        loop(actuator=Actuator(sampling=1e-7))
    with pytest.raises(ValueError, match="pass the instants"):
        jax.jit(lambda period: loop(actuator=Actuator(sampling=period)))(0.1)


@pytest.mark.parametrize(
    "part",
    [
        Actuator([1.0, 2, 3], "axis", sampling=[0.0, 0.3]),
        Sensor(rate_noise=0.1, sampling=0.1, key=jax.random.key(7)),
        Gyros(0.2, bias=[0.1, 0, 0]),
        DisturbanceTorque([0.1, 0.2, 0.3], 2.0),
        DisturbanceAcceleration(Sinusoid([0.1, 0.2, 0.3], 4.0, 0.5)),
    ],
)
def test_parts_are_stored_and_read_back(part, tmp_path):
    qt.foundation.document.save(part, tmp_path / "part.json")
    back = qt.load(tmp_path / "part.json")
    assert jax.tree.structure(back) == jax.tree.structure(part)
    for a, b in zip(jax.tree.leaves(back), jax.tree.leaves(part), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_former_name_of_the_signal_is_accepted(tmp_path):
    with pytest.warns(DeprecationWarning, match=r"'course' of DisturbanceTorque\(\) is now called 'signal'"):
        former = qt.DisturbanceTorque(course=[1.0, 0.0, 0.0], inertia=2.0)
    np.testing.assert_array_equal(former.acceleration(jnp.asarray(0.0)), [0.5, 0.0, 0.0])
    file = tmp_path / "disturbance.toml"
    qt.foundation.document.save(former, file)
    file.write_text(file.read_text(encoding="utf-8").replace("signal", "course"), encoding="utf-8")
    np.testing.assert_array_equal(qt.load(file).signal, former.signal)
