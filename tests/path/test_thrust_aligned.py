"""The frame of a multirotor on a figure-eight, against the closed form of its flat outputs and finite differences."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.derivatives import with_jacobians

import qtraj as qt
from qtraj.viz.report.paths import path_report

G = 9.80665
W = 1.3
A, B, C = 4.0, 2.0, 0.6
TIMES = np.linspace(0.05, 2 * math.pi / W - 0.05, 41)
EIGHT = qt.Curve(
    lambda t: jnp.stack([A * jnp.sin(W * t), B * jnp.sin(2 * W * t), 3 + C * jnp.cos(W * t)]), 2 * math.pi / W
)
SPIRAL = qt.SpiralHelix([10.0, 0.4, -0.02], [0.2, 0.6, 0.05], [1.0, 0.5, 0.3], 6.0)
EXACT, DIFFERENCES = 1e-12, 2e-7


def swinging(t):
    return 0.4 + 0.8 * jnp.sin(0.7 * t)


class Swing(eqx.Module):
    """A heading with a parameter that can be differentiated."""

    size: jax.Array

    def __call__(self, t):
        return self.size * jnp.sin(0.7 * t)


FRAMES = {
    "velocity": qt.ThrustAligned(),
    "constant": qt.ThrustAligned(0.7),
    "function": qt.ThrustAligned(swinging),
    "wind": qt.ThrustAligned(-2.0, gravity=[0.5, -1.0, -9.0]),
}
HEADINGS = {"constant": lambda t: 0.7, "function": lambda t: 0.4 + 0.8 * math.sin(0.7 * t)}

at = jax.jit(qt.trihedral)


def eight(t):
    """Velocity and acceleration, derived by hand."""
    s, c = math.sin, math.cos
    v = W * np.array([A * c(W * t), 2 * B * c(2 * W * t), -C * s(W * t)])
    return v, W**2 * np.array([-A * s(W * t), -4 * B * s(2 * W * t), -C * c(W * t)])


@pytest.mark.parametrize("name", HEADINGS)
def test_the_attitude_agrees_with_the_flat_outputs(name):
    """Mellinger and Kumar: after removing the heading, roll and pitch (Z-X-Y) depend on the acceleration only."""
    for t in TIMES[::4]:
        psi, thrust = HEADINGS[name](t), eight(t)[1] + [0, 0, G]
        x, y, z = Rotation.from_euler("z", -psi).apply(thrust)
        roll, pitch = math.atan2(-y, z), math.atan2(x, math.hypot(y, z))
        expected = Rotation.from_euler("ZXY", [psi, roll, pitch]).as_matrix().T
        np.testing.assert_allclose(at(EIGHT, t, FRAMES[name]).dcm(), expected, atol=EXACT)


def test_yaw_along_the_velocity_has_no_sideslip():
    for t in TIMES[::4]:
        v, a = eight(t)
        here = at(EIGHT, t, FRAMES["velocity"])
        assert here.normal @ v == pytest.approx(0.0, abs=EXACT * 10)
        assert here.tangent @ v > 0
        thrust = a + np.array([0, 0, G])
        np.testing.assert_allclose(here.binormal, thrust / np.linalg.norm(thrust), atol=EXACT)
        assert float(here.speed) == pytest.approx(np.linalg.norm(v))


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("path", [EIGHT, SPIRAL], ids=["eight", "spiral"])
def test_rate_and_acceleration_are_derivatives_of_the_axes(name, path):
    frame, h = FRAMES[name], 1e-4
    for t in TIMES[::8]:
        here, before, after = (at(path, s, frame) for s in (t, t - h, t + h))
        alpha = np.asarray(here.dcm())
        np.testing.assert_allclose(alpha @ alpha.T, np.eye(3), atol=EXACT)
        assert bool(here.defined)
        turned = Rotation.from_matrix(np.asarray(before.dcm()).T).inv() * Rotation.from_matrix(after.dcm().T)
        np.testing.assert_allclose(turned.as_rotvec() / (2 * h), here.rate, atol=DIFFERENCES)
        np.testing.assert_allclose(
            (after.rate - before.rate) / (2 * h), here.acceleration, rtol=1e-6, atol=DIFFERENCES * 10
        )
        skew = alpha @ np.asarray(jax.jvp(lambda t: qt.trihedral(path, t, frame).dcm(), (t,), (1.0,))[1]).T
        np.testing.assert_allclose([skew[2, 1], skew[0, 2], skew[1, 0]], here.rate, atol=EXACT * 10)
        exact = jax.jvp(lambda t: qt.trihedral(path, t, frame).rate, (t,), (1.0,))[1]
        np.testing.assert_allclose(here.acceleration, exact, rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("name", FRAMES)
@pytest.mark.parametrize("path", [EIGHT, SPIRAL], ids=["eight", "spiral"])
def test_tables_and_programs_agree_with_the_frame_at_each_instant(name, path):
    frame = FRAMES[name]
    table = qt.evaluate(path, TIMES, ("dcm", "quaternion", "rate", "angular_acceleration", "defined"), frame=frame)
    program = qt.FrameProgram(path, frame)
    assert table.frame == "thrust-aligned"
    for k in range(0, len(TIMES), 8):
        here, attitude = at(path, TIMES[k], frame), program(TIMES[k])
        np.testing.assert_allclose(table.dcm[k], here.dcm(), atol=1e-11)
        np.testing.assert_allclose(table.rate[k], here.rate, atol=1e-10)
        np.testing.assert_allclose(table.angular_acceleration[k], here.acceleration, atol=1e-9)
        np.testing.assert_allclose(qt.rotation.to_dcm(attitude.quaternion), here.dcm(), atol=EXACT)
        np.testing.assert_allclose(attitude.rate, here.rate, atol=EXACT)
    quaternions = np.stack([program(t).quaternion for t in np.linspace(0, path.duration, 300)])
    assert (np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.9).all()


def test_propagating_the_rate_gives_the_attitude():
    program = qt.FrameProgram(EIGHT, FRAMES["function"])
    qs = qt.propagate(lambda t: program(t).rate, program(TIMES[0]).quaternion, TIMES[[0, 20, 40]])
    for q, t in zip(qs, TIMES[[0, 20, 40]], strict=True):
        np.testing.assert_allclose(q, program(t).quaternion, atol=1e-10)


def test_forward_and_reverse_derivatives_agree_with_differences():
    def thrust(size):
        """A scalar from all outputs, for a path and a heading with one parameter."""
        path = qt.SpiralHelix(jnp.stack([10 + size, 0.4]), [0.2, 0.6], [1.0, 0.5], 6.0)
        here = qt.trihedral(path, 1.1, qt.ThrustAligned(Swing(size), gravity=9.0 + size))
        return here.dcm().sum() + here.rate @ jnp.arange(1.0, 4.0) + here.acceleration.sum()

    x, h = 0.3, 1e-5
    _, forward, reverse = jax.jit(with_jacobians(thrust))(x)
    assert float(forward) == pytest.approx(float(reverse), rel=1e-11)
    assert float(forward) == pytest.approx(float(thrust(x + h) - thrust(x - h)) / (2 * h), rel=1e-7)

    def rates(heading):
        return jnp.sum(qt.evaluate(EIGHT, TIMES, ("rate",), frame=qt.ThrustAligned(heading)).rate ** 2)

    slope = float(rates(0.7 + h) - rates(0.7 - h)) / (2 * h)
    assert float(jax.grad(rates)(0.7)) == pytest.approx(slope, rel=1e-6)
    assert float(jax.jacfwd(rates)(0.7)) == pytest.approx(slope, rel=1e-6)


SINGULAR = {
    "free fall": (lambda t: jnp.stack([3 * t, 0 * t, -G * t**2 / 2]), None, 0.4),
    "climbing straight up": (lambda t: jnp.stack([0 * t, 0 * t, 2 * t + t**2]), None, 0.4),
    "at rest": (lambda t: jnp.stack([(t - 1) ** 3, 0 * t, 0 * t]), None, 1.0),
    "thrust along the heading": (lambda t: jnp.stack([t**2, 0 * t, -G * t**2 / 2]), 0.0, 0.4),
}


@pytest.mark.parametrize("name", SINGULAR)
def test_singular_points_are_reported_and_finite(name):
    function, heading, t = SINGULAR[name]
    path, frame = qt.Curve(function, 2.0), qt.ThrustAligned(heading)
    here = at(path, t, frame)
    assert not bool(here.defined)
    assert all(np.isfinite(x).all() for x in jax.tree.leaves(here))
    np.testing.assert_allclose(here.dcm() @ here.dcm().T, np.eye(3), atol=EXACT)
    for derivative in (jax.jacfwd, jax.jacrev):
        slopes = derivative(lambda t: jax.tree.leaves(eqx.filter(qt.trihedral(path, t, frame), eqx.is_inexact_array)))(
            t
        )
        assert all(np.isfinite(x).all() for x in slopes)
    table = qt.evaluate(path, [t], ("dcm", "rate", "defined"), frame=frame)
    assert not table.defined.any()
    assert np.isfinite(table.rate).all()
    np.testing.assert_allclose(table.dcm[0], here.dcm(), atol=EXACT)


def test_in_hover_the_frame_exists_only_with_a_given_heading():
    hover = qt.Curve(lambda t: jnp.stack([0 * t, 0 * t, 0 * t + 5.0]), 2.0)
    here = at(hover, 1.0, qt.ThrustAligned(0.5))
    assert bool(here.defined)
    np.testing.assert_allclose(here.dcm(), Rotation.from_euler("z", 0.5).as_matrix().T, atol=EXACT)
    assert not bool(at(hover, 1.0, qt.ThrustAligned()).defined)


def test_labels_in_datasets_figures_and_reports():
    dataset = qt.evaluate(SPIRAL, TIMES, ("position", "dcm", "rate", "defined"), frame=qt.ThrustAligned()).to_xarray()
    assert dataset["body"].values.tolist() == ["forward", "left", "thrust"]
    assert "z = thrust" in dataset.attrs["frame_convention"]
    axes = SPIRAL.plot(frame=qt.ThrustAligned()).axes[0]
    assert axes.get_legend_handles_labels()[1] == ["path", "forward", "left", "thrust"]
    report = path_report(dataset)
    assert [arrow.meaning for arrow in report.arrows] == ["forward", "left", "thrust"]
    assert any(panel.title.startswith("pitch") for panel in report.panels)


def test_a_program_with_a_heading_is_stored(tmp_path):
    program = qt.FrameProgram(SPIRAL, qt.ThrustAligned(0.7, gravity=3.7))
    program.save(tmp_path / "program.toml")
    loaded = qt.load(tmp_path / "program.toml")
    assert repr(loaded.frame) == "ThrustAligned(heading=0.7 rad, gravity=[0, 0, -3.7] m/s²)"
    np.testing.assert_array_equal(loaded(1.2).quaternion, program(1.2).quaternion)
    with pytest.raises(ValueError, match="cannot be stored"):
        qt.FrameProgram(SPIRAL, FRAMES["function"]).save(tmp_path / "function.toml")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"heading": [0.1, 0.2]}, "the heading of a thrust-aligned frame must be one number"),
        ({"heading": math.nan}, "must be finite"),
        ({"heading": lambda t: jnp.stack([t, t])}, "must be one angle"),
        ({"heading": lambda t: math.sin(t)}, "cannot be traced by JAX"),
        ({"gravity": -9.8}, "must be a magnitude ≥ 0"),
        ({"gravity": [0.0, 9.8]}, r"must have shape \(3,\)"),
    ],
)
def test_invalid_arguments_are_errors(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.ThrustAligned(**arguments)
