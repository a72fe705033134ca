"""Rates and accelerations in inertial axes ((1.6), (3.14)): against finite differences of λ, and one way for all."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt

from .rigs import ThreeAxis

STEP = 1e-4
"""Of the central differences [s], of fourth order."""
FIRST, SECOND = 1e-9, 3e-6
"""First and second differences of unit quaternions: truncation and round-off."""
INSTANTS = (0.4, 1.1, 1.9)


def helix(k=0.0):
    return qt.SpiralHelix(jnp.asarray([8.0, 0.3, 0.1]).at[0].add(k), [0.4, 0.5, 0.05], [1.0, 0.4, -0.2, 0.03], 2.5)


def placed():
    tilt = qt.rotation.from_euler("ZYX", jnp.asarray([0.4, -0.3, 0.2]))
    return qt.SpiralHelix([8.0, 0.3], [0.4, 0.5], [1.0, 0.4, -0.2], 2.5, qt.Placement([1.0, 2.0, 3.0], tilt))


PROGRAMS = ("turn", "natural", "upright", "minimizing", "three axes", "table")


@functools.cache
def programs():
    start, end = jnp.asarray([0.9, 0.1, -0.3, 0.2]), jnp.asarray([0.2, 0.8, 0.4, -0.5])
    table = qt.rotation.continuous(jax.vmap(lambda t: ThreeAxis()(t).quaternion)(jnp.linspace(0.0, 2.5, 9)))
    return {
        "turn": qt.EulerTurn(start, end, qt.Septic(duration=2.5)),
        "natural": qt.FrameProgram(helix()),
        "upright": qt.FrameProgram(placed(), qt.Upright()),
        "minimizing": qt.FrameProgram(placed(), qt.RotationMinimizing()),
        "three axes": ThreeAxis(),
        "table": qt.TableProgram(np.linspace(0.0, 2.5, 9), table),
    }


def differences(program, t):
    """ω_ξ = 2λ̇∘λ̄ and ε_ξ = 2λ̈∘λ̄ + 2λ̇∘(λ̄)˙, by SciPy's rotations alone."""
    offsets = STEP * np.arange(-3, 4)
    turns = Rotation.from_quat(np.asarray(jax.vmap(lambda d: program(t + d).quaternion)(offsets)), scalar_first=True)
    # Rotation vectors from the middle one, in inertial axes: to second order at 0 their derivatives are ω and ω̇.
    vectors = (turns * turns[3].inv()).as_rotvec()
    first = vectors.T @ (np.array([-1, 9, -45, 0, 45, -9, 1]) / 60) / STEP
    second = vectors.T @ (np.array([2, -27, 270, -490, 270, -27, 2]) / 180) / STEP**2
    return first, second


@pytest.mark.parametrize("name", PROGRAMS)
def test_programs_in_inertial_axes_are_the_differences_of_their_quaternion(name):
    program = programs()[name]
    for t in INSTANTS:
        rate, acceleration = differences(program, t)
        at = program.at(t, axes="inertial")
        np.testing.assert_allclose(at.rate, rate, rtol=0, atol=FIRST)
        np.testing.assert_allclose(at.acceleration, acceleration, rtol=0, atol=SECOND)
        np.testing.assert_array_equal(at.quaternion, program(t).quaternion)
        back = at.in_axes("body")
        np.testing.assert_allclose(back.rate, program(t).rate, atol=1e-14)
        np.testing.assert_allclose(back.acceleration, program(t).acceleration, atol=1e-13)


def test_the_acceleration_is_the_derivative_of_the_rate():
    """In inertial axes as in body axes, by automatic differentiation."""
    program = programs()["upright"]
    for t in INSTANTS:
        for axes in ("body", "inertial"):
            slope = jax.jvp(lambda t, axes=axes: program.at(t, axes).rate, (t,), (1.0,))[1]
            np.testing.assert_allclose(program.at(t, axes).acceleration, slope, atol=1e-12)


def test_a_turn_keeps_its_axis():
    """(3.14): ω_ξ⁰ = Φ̇ e_ξ and ε_ξ⁰ = Φ̈ e_ξ."""
    turn = programs()["turn"]
    at, e = turn.at(0.7, axes="inertial"), turn.axis("inertial")
    np.testing.assert_allclose(at.rate, turn.profile.rate(0.7) * e, atol=1e-14)
    np.testing.assert_allclose(at.acceleration, turn.profile.acceleration(0.7) * e, atol=1e-13)


FRAMES = [qt.Natural(), qt.Upright([0.1, -0.2, 1.0]), qt.ThrustAligned()]


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: frame.name)
@pytest.mark.parametrize("path", [helix(), placed()], ids=["helix", "placed"])
def test_trihedra_and_tables_agree_with_the_differences(frame, path):
    program, names = qt.FrameProgram(path, frame), ("rate", "angular_acceleration", "dcm")
    table = qt.evaluate(path, np.array(INSTANTS), names, frame, axes="inertial")
    assert table.axes == "inertial"
    for k, t in enumerate(INSTANTS):
        rate, acceleration = differences(program, t)
        at = qt.trihedral(path, t, frame, axes="inertial")
        for first, second in ((at.rate, at.acceleration), (table.rate[k], table.angular_acceleration[k])):
            np.testing.assert_allclose(first, rate, rtol=0, atol=FIRST)
            np.testing.assert_allclose(second, acceleration, rtol=0, atol=SECOND)


def test_every_form_of_evaluate_has_both_axes():
    """A stack of paths, components first, peaks, integrals, the trace, and the rotation-minimizing frame."""
    stack, times = jax.vmap(helix)(jnp.arange(3.0)), np.linspace(0.0, 2.5, 7)
    names = ("rate", "angular_acceleration")
    body, table = (qt.evaluate(stack, times, (*names, "dcm"), axes=axes) for axes in ("body", "inertial"))
    turned = np.einsum("...ij,...i->...j", body.dcm, body.rate)
    np.testing.assert_allclose(table.rate, turned, atol=1e-13)
    first = qt.evaluate(stack, times, names, axes="inertial", components="first")
    np.testing.assert_array_equal(np.moveaxis(first.rate, 0, -1), table.rate)
    peaks = qt.evaluate(stack, times, names, axes="inertial", reduce="max")
    np.testing.assert_allclose(peaks["rate"], np.max(turned, axis=1), atol=1e-13)
    traced = jax.jit(lambda t: qt.evaluate(stack, t, names, axes="inertial").rate)(times)
    np.testing.assert_allclose(traced, turned, atol=1e-13)
    frame = qt.RotationMinimizing()
    minimizing = qt.evaluate(placed(), times, names, frame, axes="inertial")
    program = qt.FrameProgram(placed(), frame)
    np.testing.assert_allclose(minimizing.rate, jax.vmap(lambda t: program.at(t, "inertial").rate)(times), atol=1e-13)
    assert table.to_xarray()["rate"].dims == ("path", "time", "world")
    assert "inertial axes" in table.to_xarray()["rate"].attrs["long_name"]
    assert peaks.to_xarray()["rate"].dims == ("path", "world")
    assert minimizing.to_xarray()["rate"].dims == ("time", "world")
    again = qt.evaluate(stack, times, (*names, "dcm"), axes="inertial", reuse=table)
    np.testing.assert_allclose(again.rate, turned, atol=1e-13)
    with pytest.raises(ValueError, match="reuse must be"):
        qt.evaluate(stack, times, (*names, "dcm"), reuse=again)


def test_labels_say_which_axes():
    at = programs()["turn"].at(0.7, axes="inertial").to_xarray()
    assert at["rate"].dims == ("world",)
    assert at.attrs["frame"] == "inertial"
    trihedral = qt.trihedral(helix(), 0.7, axes="inertial").to_xarray()
    assert trihedral["angular_acceleration"].dims == ("world",)
    assert "inertial axes" in trihedral["rate"].attrs["long_name"]


def test_other_axes_and_attitudes_in_the_wrong_ones_are_refused():
    program, law = programs()["turn"], qt.AccelerationLaw(2.0, 1.0)
    for call in (
        lambda: program.at(0.1, axes="world"),
        lambda: qt.trihedral(helix(), 0.1, axes="world"),
        lambda: qt.evaluate(helix(), [0.1], axes="world"),
    ):
        with pytest.raises(ValueError, match="axes must be 'body' or 'inertial', but 'world'"):
            call()
    wrong, q, still = program.at(0.1, axes="inertial"), jnp.asarray([1.0, 0, 0, 0]), jnp.zeros(4)
    for call in (
        lambda: law(wrong, q, still),
        lambda: qt.AccelerationLaw(2.0, 1.0, "additive")(wrong, q, still),
        lambda: qt.RateLaw(1.0)(wrong, q),
        lambda: qt.GeometricFeedback(2.0, 1.0)(wrong, q, still),
        lambda: qt.control.body_command(wrong, still),
        lambda: qt.control.state_from_error(wrong, q, still),
        lambda: qt.dynamics.torque(wrong, 1.0),
    ):
        with pytest.raises(ValueError, match=r"pass attitude.in_axes\('body'\)"):
            call()
