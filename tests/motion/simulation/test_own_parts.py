"""Own laws, also with a state, own frames, profiles, noise and lags, alone and all together."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg

import qtraj as qt

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
PROGRAM = qt.EulerTurn(IDENTITY, [1.0, 0.2, 0.0, 0.1], qt.Quintic(duration=4.0))
TORQUE = np.array([0.05, -0.02, 0.03])


class Proportional(qt.control.AbstractLaw):
    """Three components, without a virtual part."""

    k1: float
    k2: float

    def __call__(self, reference, quaternion, rate):
        return qt.QuaternionFeedback(self.k1, self.k2)(reference, quaternion, rate)[1:]


class Integral(qt.control.AbstractLaw):
    """Proportional, derivative and integral feedback; the state is the integral of the error."""

    k1: Any
    k2: Any
    k3: Any

    def start(self, reference, quaternion, rate):
        return {"integral": jnp.zeros(3)}

    def __call__(self, reference, quaternion, rate, state):
        proportional = qt.QuaternionFeedback(self.k1, self.k2)(reference, quaternion, rate)
        return proportional[1:] - self.k3 * state["integral"]

    def slope(self, state, reference, quaternion, rate):
        mu = qt.quaternion.unit(self.deviation(reference, quaternion))
        return {"integral": 2 * jnp.sign(mu[0]) * mu[1:]}


class RateCommand(qt.control.AbstractLaw):
    commands = "rate"

    def __call__(self, reference, quaternion, rate):
        return qt.RateLaw(1.0)(reference, quaternion, rate)[1:]


def run(law, span=40.0, n=11, **options):
    return qt.simulate(PROGRAM, law, IDENTITY, [0.0, 0.1, 0.0, 0.0], np.linspace(0.0, span, n), rtol=1e-8, **options)


def test_a_law_of_three_components_has_no_virtual_part():
    own, expected = (
        run(law, disturbance=qt.DisturbanceAcceleration(TORQUE))
        for law in (Proportional(2.0, 1.0), qt.QuaternionFeedback(2.0, 1.0))
    )
    np.testing.assert_allclose(own.command, expected.command, atol=1e-10)
    np.testing.assert_allclose(own.angle, expected.angle, atol=1e-10)
    rates = run(RateCommand())
    assert rates.commands == "rate"
    np.testing.assert_allclose(rates.quaternion[1:], run(qt.RateLaw(1.0)).quaternion[1:], atol=1e-2)


@pytest.mark.parametrize("actuator", [None, qt.Actuator(sampling=0.1, time_constant=0.05)])
def test_integral_action_removes_the_steady_state_error_of_a_constant_disturbance(actuator):
    law = Integral(3.0, 3.0, 1.0)
    without = run(Proportional(3.0, 3.0), disturbance=qt.DisturbanceAcceleration(TORQUE), actuator=actuator)
    motion = run(law, disturbance=qt.DisturbanceAcceleration(TORQUE), actuator=actuator)
    np.testing.assert_allclose(without.angle[-1], np.linalg.norm(TORQUE) / 3, rtol=1e-3)
    assert motion.angle[-1] < 1e-5
    np.testing.assert_allclose(motion.law_state[-1], TORQUE, atol=1e-5)
    assert motion.to_xarray()["law_state"].shape == (11, 3)


def test_the_state_of_a_law_on_a_rigid_body_and_its_derivatives():
    body = qt.RigidBody([1.0, 2.0, 2.5], torque=[0.05, 0.0, 0.0])

    def last(k3):
        return run(Integral(3.0, 3.0, k3), span=5.0, n=2, body=body, adjoint=diffrax.ForwardMode()).error[-1, 1]

    step, both = 1e-4, jax.jit(lambda k: jax.jvp(last, (k,), (1.0,)))
    for at in (0.5, 1.0):
        (before, _), (_, slope), (after, _) = (both(at + change) for change in (-step, 0.0, step))
        np.testing.assert_allclose(slope, (after - before) / (2 * step), atol=1e-7)


def test_the_lag_of_an_actuator_follows_its_equation():
    """Continuous: ω̇ = a, ȧ = (−kω − a)/τ, by a matrix exponential. Sampled: a = c(1 − e^(−t/τ)) after a jump to c."""

    class Damping(qt.control.AbstractLaw):
        def __call__(self, reference, quaternion, rate):
            return -2.0 * rate[1:]

    class Jump(qt.control.AbstractLaw):
        def __call__(self, reference, quaternion, rate):
            return jnp.where(rate[1] > 0.4, -1.0, 1.0) * jnp.array([1.0, 0.0, 0.0])

    still, lag, times = qt.EulerTurn(IDENTITY, IDENTITY, qt.Cubic(duration=1.0)), 0.3, np.linspace(0.0, 1.0, 3)
    slow = qt.Actuator(time_constant=lag)
    damped = qt.simulate(still, Damping(), IDENTITY, [0.0, 0.5, 0.0, 0.0], times, actuator=slow)
    system = np.array([[0.0, 1.0], [-2.0 / lag, -1.0 / lag]])
    expected = [(scipy.linalg.expm(system * t) @ [0.5, -1.0])[0] for t in times]
    np.testing.assert_allclose(damped.rate[:, 1], expected, atol=1e-9)
    held = qt.Actuator(time_constant=lag, sampling=0.5)
    jumped = qt.simulate(still, Jump(), IDENTITY, np.zeros(4), times, actuator=held)
    after = 0.5 - 0.5 + 2 * lag * (1 - np.exp(-0.5 / lag))
    np.testing.assert_allclose(jumped.rate[:, 1], [0.0, 0.5, after], atol=1e-9)


def test_a_short_lag_tends_to_none():
    body = qt.RigidBody([1.0, 2.0, 2.5], wheels=qt.ReactionWheels(np.eye(3)))
    law, span = qt.AccelerationLaw(2.0, 1.0), 4.0
    exact = run(law, span, 3, body=body, actuator=qt.Actuator(sampling=0.2))
    lagged = run(law, span, 3, body=body, actuator=qt.Actuator(sampling=0.2, time_constant=1e-8))
    np.testing.assert_allclose(lagged.quaternion, exact.quaternion, atol=1e-7)
    stiff = run(law, span, 3, body=body, actuator=qt.Actuator(time_constant=1e-3))
    np.testing.assert_allclose(stiff.angle, run(law, span, 3).angle, atol=1e-3)
    with pytest.raises(ValueError, match="much shorter than the simulation"):
        run(law, actuator=qt.Actuator(time_constant=1e-9))


def test_laws_that_a_function_does_not_support_are_refused():
    own, reference = Proportional(2.0, 1.0), PROGRAM(0.0)
    with pytest.raises(ValueError, match="has a closed form only for an AccelerationLaw or a RateLaw"):
        qt.control.closed_motion(
            own, jax.vmap(PROGRAM)(jnp.array([0.0, 1.0])), IDENTITY, np.zeros(4), np.array([0.0, 1.0])
        )
    with pytest.raises(ValueError, match="has a closed form only for"):
        qt.error_response(own, IDENTITY, np.zeros(4), 1.0)
    with pytest.raises(ValueError, match="has a closed form only for"):
        qt.control.choose_sign(own, reference, jnp.asarray(IDENTITY), jnp.zeros(4))
    with pytest.raises(ValueError, match="a HystereticLaw needs an AccelerationLaw or a QuaternionFeedback"):
        qt.HystereticLaw(own)
    with pytest.raises(ValueError, match="no discrete state, and none of its own"):
        qt.PoseLaw(Integral(1.0, 1.0, 1.0), 1.0, 1.0)

    class Wrong(qt.control.AbstractLaw):
        def __call__(self, reference, quaternion, rate):
            return jnp.zeros(2)

    with pytest.raises(ValueError, match=r"the command of Wrong must have shape \(3,\)"):
        run(Wrong())

    class Stuck(Wrong):
        def start(self, reference, quaternion, rate):
            return jnp.zeros(1)

        def __call__(self, reference, quaternion, rate, state):
            return jnp.zeros(3)

    with pytest.raises(TypeError, match="needs the method slope"):
        run(Stuck())


def east_north_up(position, velocity, acceleration):
    """The upright frame, from its definition."""
    up = jnp.array([0.0, 0.0, 1.0])
    x = velocity / jnp.linalg.norm(velocity)
    y = jnp.cross(up, x)
    y = y / jnp.linalg.norm(y)
    return [x, y, jnp.cross(x, y)]


PATH = qt.SpiralHelix([20.0, 0.1], [0.0, 0.3], [0.0, 0.5, 0.02], 10.0)
FRAME = qt.AxesFrame(east_north_up)


def test_an_own_frame_agrees_with_the_upright_frame_in_every_call():
    own, known = qt.trihedral(PATH, 2.0, FRAME), qt.trihedral(PATH, 2.0, qt.Upright())
    for name in ("tangent", "normal", "binormal", "speed", "curvature", "torsion", "rate", "acceleration"):
        np.testing.assert_allclose(getattr(own, name), getattr(known, name), atol=1e-12, err_msg=name)
    assert own.defined
    a, b = qt.FrameProgram(PATH, FRAME)(3.0), qt.FrameProgram(PATH, qt.Upright())(3.0)
    np.testing.assert_allclose(a.quaternion, b.quaternion, atol=1e-12)
    times = np.linspace(0.0, 10.0, 4)
    tables = [qt.evaluate(PATH, times, outputs=("quaternion", "rate"), frame=f) for f in (FRAME, qt.Upright())]
    np.testing.assert_allclose(tables[0]["rate"], tables[1]["rate"], atol=1e-12)
    forces = [qt.dynamics.forces(PATH, 2.0, 3.0, 9.81, frame=f) for f in (FRAME, qt.Upright())]
    np.testing.assert_allclose(*forces, atol=1e-10)
    with pytest.raises(ValueError, match="must return three axes"):
        qt.trihedral(PATH, 2.0, qt.AxesFrame(lambda r, v, a: v))


@qt.storable
class Spiral(qt.AbstractHodograph):
    pitch: float
    duration: float = 6.0

    def derivatives(self, t, order):
        def position(t):
            return jnp.stack([10 * jnp.sin(0.3 * t), 10 * jnp.cos(0.3 * t), self.pitch * t])

        rows = [position]
        for _ in range(order):
            rows.append(jax.jacfwd(rows[-1]))
        return jnp.stack([f(jnp.asarray(t, float)) for f in rows])


@qt.storable
class Wind(eqx.Module):
    size: Any

    def __call__(self, t, quaternion, rate):
        return -self.size * rate + 0.01 * jnp.array([0.0, 1.0, 0.0])


class Noise(qt.AbstractSensor):
    """Noise that is uniform, and grows with the rate."""

    seed: int
    sampling: Any = 0.1

    def start(self, quaternion, rate):
        return None

    def measure(self, k, elapsed, quaternion, rate, memory):
        noise = jax.random.uniform(jax.random.fold_in(jax.random.key(self.seed), k), (3,), minval=-1.0, maxval=1.0)
        return quaternion, rate.at[1:].add(1e-3 * (1 + jnp.abs(rate[1:])) * noise), memory


def test_own_parts_together():
    """Path, quantity, frame, law with a state, disturbance, sensor and profile of one's own, under jit and vmap."""
    path = Spiral(0.5)
    climb = qt.Quantity("climb", "m/s", lambda p: p.velocity[2])
    value = np.asarray(qt.evaluate(path, np.linspace(0.0, 6.0, 4), ("velocity", climb), frame=FRAME)["climb"])
    assert qt.certify(path, qt.Limits(own={climb: float(value.max()) + 1e-3})).met
    program = qt.FrameProgram(path, FRAME)
    start, times = program(0.0), np.linspace(0.0, 6.0, 4)
    rate = jnp.concatenate([jnp.zeros(1), start.rate])

    def last(size):
        arguments = {"disturbance": Wind(size), "sensor": Noise(1), "rtol": 1e-6}
        return qt.simulate(program, Integral(3.0, 3.0, 1.0), start.quaternion, rate, times, **arguments).angle

    batch = jax.jit(jax.vmap(last))(jnp.array([0.0, 0.2]))
    assert batch.shape == (2, 4)
    assert np.max(batch) < 0.1
    np.testing.assert_allclose(batch[1], last(0.2), atol=1e-5)
    slew = qt.EulerTurn(IDENTITY, [1.0, 0.3, 0.0, 0.0], qt.FunctionProfile(lambda t: t - jnp.sin(t), 2 * np.pi))
    motion = qt.simulate(slew, Proportional(3.0, 3.0), IDENTITY, np.zeros(4), np.linspace(0.0, 6.0, 4), Wind(0.0))
    assert np.max(motion.angle) < 0.01


def test_own_classes_are_saved_once_they_are_registered(tmp_path):
    file = tmp_path / "path.toml"
    Spiral(0.5).save(file)
    loaded = qt.load(file)
    np.testing.assert_array_equal(loaded(1.0), Spiral(0.5)(1.0))
    body = qt.RigidBody(1.0, torque=Wind(0.3))
    qt.foundation.document.save(body, tmp_path / "body.json")
    assert float(qt.load(tmp_path / "body.json").torque.size) == 0.3
    file.write_text(file.read_text(encoding="utf-8").replace("Spiral", "Spyral"), encoding="utf-8")
    with pytest.raises(
        ValueError, match=r"unknown type 'Spyral'; did you mean 'Spiral'\? If it is an own class, import"
    ):
        qt.load(file)
    with pytest.raises(ValueError, match=r"own classes that are registered with @qtraj.storable"):
        Proportional(1.0, 1.0).save(tmp_path / "law.toml")
    with pytest.raises(ValueError, match="can already be stored"):
        qt.storable(type("Route", (Wind,), {"__annotations__": {}}))
    with pytest.raises(TypeError, match="storable registers classes with fields"):
        qt.storable(lambda t: t)  # pyright: ignore
