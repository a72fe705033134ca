"""Rotation-minimizing frames of closed paths: the twist closes them, and its angle is that of the total torsion."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt


def trefoil(t):
    """A knot whose speed and torsion vary; its curvature is never zero."""
    radius = 3 + jnp.cos(3 * t)
    return jnp.stack([radius * jnp.cos(2 * t), radius * jnp.sin(2 * t), 0.7 * jnp.sin(3 * t + 0.4)])


KNOT = qt.Curve(trefoil, 2 * np.pi)
KNOTS = np.linspace(0.0, 8.0, 13)
POINTS = np.stack(
    [5 * np.cos(np.pi / 4 * KNOTS), 3 * np.sin(np.pi / 4 * KNOTS), np.sin(np.pi / 2 * KNOTS + 0.3)], axis=1
)
POINTS[-1] = POINTS[0]
LOOP = qt.Route.from_piecewise(CubicSpline(KNOTS, POINTS, bc_type="periodic"))
CLOSED = qt.RotationMinimizing(closed=True)


@pytest.mark.parametrize("path", [KNOT, LOOP], ids=["curve", "route"])
class TestAClosedFrame:
    def test_ends_as_it_starts(self, path):
        program = qt.FrameProgram(path, CLOSED)
        first, last = (qt.rotation.to_dcm(program(t).quaternion) for t in (0.0, path.duration))
        np.testing.assert_allclose(last, first, atol=1e-9)
        np.testing.assert_allclose(program(path.duration).rate, program(0.0).rate, atol=1e-9)

    def test_its_angle_is_that_by_which_the_frame_without_twist_misses(self, path):
        free = qt.FrameProgram(path, qt.RotationMinimizing())
        start, end = (np.asarray(qt.rotation.to_dcm(free(t).quaternion)) for t in (0.0, path.duration))
        angle = np.arctan2(start[2] @ end[1], start[1] @ end[1])
        assert abs(angle) > 0.05
        assert float(qt.FrameProgram(path, CLOSED).closing_angle) == pytest.approx(angle, abs=1e-8)

    def test_its_rate_about_the_path_is_in_proportion_to_the_speed(self, path):
        program, free = qt.FrameProgram(path, CLOSED), qt.FrameProgram(path, qt.RotationMinimizing())
        for t in (0.3, 2.0, 5.1):
            rate = -float(program.closing_angle) * np.linalg.norm(path.velocity(t)) / float(path.length())
            assert float(program(t).rate[0]) == pytest.approx(rate, rel=1e-9)
            assert np.linalg.norm(program(t).rate[1:]) == pytest.approx(np.linalg.norm(free(t).rate), rel=1e-9)

    def test_rate_and_acceleration_are_the_derivatives_of_the_attitude(self, path):
        program, step = qt.FrameProgram(path, CLOSED), 1e-5
        for t in (0.31, 2.02, 5.13):
            before, at, after = (program(x) for x in (t - step, t, t + step))
            slope = (np.asarray(after.quaternion) - np.asarray(before.quaternion)) / (2 * step)
            np.testing.assert_allclose(qt.quaternion.rate(np.asarray(at.quaternion), slope), at.rate, atol=1e-7)
            slope = (np.asarray(after.rate) - np.asarray(before.rate)) / (2 * step)
            np.testing.assert_allclose(slope, at.acceleration, atol=1e-6)


def test_the_closing_angle_is_the_total_torsion():
    """The natural frame of a path with curvature closes, and the frame turns in it by minus the total torsion."""
    t = np.linspace(0, 2 * np.pi, 4001)[:-1]
    torsion = np.asarray(qt.evaluate(KNOT, t, ("torsion", "speed")).torsion)
    speed = np.asarray(qt.evaluate(KNOT, t, ("speed",)).speed)
    total = -np.sum(torsion * speed) * (2 * np.pi / 4000)  # the rule is exact for periodic functions
    wrapped = (total + np.pi) % (2 * np.pi) - np.pi
    assert float(qt.FrameProgram(KNOT, CLOSED).closing_angle) == pytest.approx(wrapped, abs=1e-8)


def test_a_plane_path_needs_no_twist():
    circle = qt.SpiralHelix([4.0], [0, 1.0], [2.0], 2 * np.pi)
    assert abs(float(qt.FrameProgram(circle, CLOSED).closing_angle)) < 1e-12


def test_evaluation_documents_and_derivatives_support_it(tmp_path):
    table = qt.evaluate(LOOP, np.linspace(0.0, 8.0, 9), ("dcm", "rate"), frame=CLOSED)
    np.testing.assert_allclose(table.dcm[0], table.dcm[-1], atol=1e-9)
    program = qt.FrameProgram(LOOP, CLOSED)
    program.save(tmp_path / "program.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "program.toml")(3.3).quaternion, program(3.3).quaternion)

    def moving(height):
        scale = jnp.stack([1.0, 1.0, height])
        r = [scale[None] * LOOP.joints()[:, k] for k in range(3)]
        return qt.FrameProgram(qt.Route(KNOTS, *r), qt.RotationMinimizing([0, 0, 1.0], closed=True)).closing_angle

    slope = jax.jit(jax.grad(moving))(1.0)
    assert float(slope) == pytest.approx(float(moving(1.0 + 1e-5) - moving(1.0 - 1e-5)) / 2e-5, rel=1e-6)


def test_what_is_not_closed_is_refused():
    with pytest.raises(ValueError, match="ends as it starts, but its ends are"):
        qt.FrameProgram(qt.SpiralHelix([4.0], [0, 1.0], [0.0, 1.0], 2 * np.pi), CLOSED)
    corner = jnp.array([np.cos(0.25), np.sin(0.25), 0.0])
    drop = qt.Curve(lambda t: t * (1 - t) * jnp.stack([1 - 2 * t, 1.0, 0.0]) * corner, 1.0)
    with pytest.raises(ValueError, match=r"differ by 0\.5 rad"):
        qt.FrameProgram(drop, CLOSED)
    with pytest.raises(ValueError, match="closed=True"):
        _ = qt.FrameProgram(LOOP).closing_angle
    with pytest.raises(ValueError, match="True or False"):
        qt.RotationMinimizing(closed=1)
