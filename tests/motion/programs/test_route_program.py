"""Frames along routes: continuity at joints, rotation-minimizing frames, stops, and driving in reverse."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.path import headings
from qtraj.path.driving import segments_of

NEAR = 1e-9


def winding(orders=3, count=9):
    """A route with uneven states: its jerk, or its fourth derivative, jumps at every joint."""
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.7, 1.5, count))
    rows = [
        [4 * t, 3 * np.sin(0.7 * t), 0.5 * np.cos(0.3 * t)],
        [4 + 0 * t, 2.1 * np.cos(0.7 * t), -0.15 * np.sin(0.3 * t)],
        [0 * t, -1.47 * np.sin(0.7 * t), -0.045 * np.cos(0.3 * t)],
        [0 * t, -1.03 * np.cos(0.7 * t), 0.0135 * np.sin(0.3 * t)],
    ]
    return qt.Route(t, *(np.array(row).T + rng.normal(0, 0.05, (count, 3)) for row in rows[:orders]))


def reversing():
    """Forwards along x and back along a bend: the velocity is zero only at t = 2."""
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    x, v = 0.25 * t**2 * (4 - t) * 0 + 4 * t - t**2, 4 - 2 * t
    y = np.where(t > 2, 0.02 * (t - 2) ** 4, 0.0)
    y1 = np.where(t > 2, 0.08 * (t - 2) ** 3, 0.0)
    y2 = np.where(t > 2, 0.24 * (t - 2) ** 2, 0.0)
    zero = 0 * t
    states = [[x, y, zero], [v, y1, zero], [zero - 2, y2, zero]]
    return qt.Route(t, *(np.array(row).T for row in states))


def stopping(change=0.2, wait=5.0):
    """East to a stop, a wait, and on uphill in a direction that differs by `change`."""
    far = np.array([np.cos(change), np.sin(change), 0.1])
    start, stop = np.array([-6.0, 0, 0]), np.zeros(3)
    position = [start, stop, stop, 6 * far]
    velocity = [[4.0, 0.5, 0], [0, 0, 0], [0, 0, 0], 4 * far]
    return qt.Route([0, 3, 3 + wait, 6 + wait], position, velocity, np.zeros((4, 3)))


def attitudes(program, times):
    return jax.vmap(program)(jnp.asarray(times))


def consistent(program, times, tolerance):
    """Rate and acceleration agree with central differences of the attitude and the rate."""
    h = 1e-5
    q, before, after = (np.asarray(attitudes(program, t).quaternion) for t in (times, times - h, times + h))
    turn = Rotation.from_quat(before, scalar_first=True).inv() * Rotation.from_quat(after, scalar_first=True)
    at = attitudes(program, times)
    np.testing.assert_allclose(turn.as_rotvec() / (2 * h), at.rate, rtol=0, atol=tolerance)
    rates = [np.asarray(attitudes(program, t).rate) for t in (times - h, times + h)]
    np.testing.assert_allclose((rates[1] - rates[0]) / (2 * h), at.acceleration, rtol=0, atol=10 * tolerance)
    assert np.all(np.sum(before * after, axis=1) > 0)
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, rtol=0, atol=1e-14)


@pytest.mark.parametrize("frame", [None, qt.Upright(), qt.RotationMinimizing()], ids=str)
@pytest.mark.parametrize("orders", [3, 4])
def test_the_rate_is_continuous_at_joints_and_for_septics_the_acceleration(frame, orders):
    route = winding(orders)
    program = qt.FrameProgram(route, frame)
    joints = np.asarray(route.times)[1:-1]
    before, after = attitudes(program, joints - NEAR), attitudes(program, joints)
    np.testing.assert_allclose(before.quaternion, after.quaternion, rtol=0, atol=1e-7)
    np.testing.assert_allclose(before.rate, after.rate, rtol=0, atol=1e-6)
    jumps = np.max(np.abs(np.asarray(before.acceleration - after.acceleration)), axis=1)
    assert np.all(jumps < 1e-5) if orders == 4 else np.all(jumps > 1e-4)
    inside = np.linspace(0.01, float(route.duration) - 0.01, 211)
    inside = inside[np.min(np.abs(inside[:, None] - joints), axis=1) > 1e-3]
    consistent(program, inside, 1e-7)


@pytest.mark.parametrize("route", [winding, reversing, stopping, lambda: stopping(2.5)])
def test_the_rates_of_numpy_are_those_of_the_program(route):
    """Forwards, at a stop and in reverse; the vehicle may be tilted."""
    route, up = route(), np.array([0.1, -0.2, 2.0])
    program = qt.FrameProgram(route, qt.Driving.along(route, up))
    t = np.linspace(0.0, float(route.duration), 301)[1:-1]
    segments = segments_of(route)
    found = headings.body_rates(headings.along(segments, up), up, t, *segments.rows(t, 2)[1:])
    np.testing.assert_allclose(found, attitudes(program, t).rate, rtol=1e-9, atol=1e-9)


def test_without_a_frame_a_route_is_upright():
    route = winding()
    t = np.linspace(0, float(route.duration), 50)
    table = qt.evaluate(route, t, ("quaternion", "rate"))
    assert table.frame == "upright"
    given = qt.evaluate(route, t, ("quaternion", "rate"), frame=qt.Upright())
    np.testing.assert_array_equal(table.quaternion, given.quaternion)
    assert isinstance(qt.FrameProgram(route).frame, qt.Upright)
    np.testing.assert_array_equal(qt.trihedral(route, 1.0).dcm(), qt.trihedral(route, 1.0, qt.Upright()).dcm())


def test_the_rotation_minimizing_frame_is_that_of_an_integrator():
    """ω = τ × τ' in world axes, integrated by SciPy from joint to joint."""
    route = winding()
    program = qt.FrameProgram(route, qt.RotationMinimizing())

    def rate(t):
        r = np.asarray(route.derivatives(t, 2))
        return np.cross(r[1], r[2]) / (r[1] @ r[1])

    def flow(t, m):
        w = rate(t)
        return np.cross(w, m.reshape(3, 3)).ravel()

    rows = Rotation.from_quat(program(0.0).quaternion, scalar_first=True).as_matrix().T.ravel()
    for a, b in zip(np.asarray(route.times)[:-1], np.asarray(route.times)[1:], strict=True):
        rows = solve_ivp(flow, (a, b - 1e-13), rows, rtol=1e-11, atol=1e-12).y[:, -1]
    found = Rotation.from_quat(program(float(route.duration)).quaternion, scalar_first=True).as_matrix().T
    np.testing.assert_allclose(found, rows.reshape(3, 3), rtol=0, atol=1e-8)
    at = attitudes(program, np.linspace(0, float(route.duration), 77))
    assert float(jnp.max(jnp.abs(at.rate[:, 0]))) == 0.0


def test_heading_is_held_through_a_stop():
    route = stopping()
    program = qt.FrameProgram(route)
    assert isinstance(program.frame, qt.Driving)
    t = np.linspace(0.02, float(route.duration) - 0.02, 801)
    consistent(program, t[np.min(np.abs(t[:, None] - np.asarray(program.frame.starts)), axis=1) > 1e-3], 2e-6)
    forward = np.asarray(qt.evaluate(route, t, ("dcm",)).dcm)[:, 0]
    v = np.asarray(qt.evaluate(route, t, ("velocity",)).velocity)
    speed = np.linalg.norm(v, axis=1)
    moving = speed > 0.2
    np.testing.assert_allclose(forward[moving], v[moving] / speed[moving, None], rtol=0, atol=1e-9)
    heading = np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))
    standing = (t > 4.2) & (t < 6.8)
    assert heading.min() > -0.55
    assert heading.max() < 0.35  # no overshoot during the wait
    arrival, departure = heading[np.searchsorted(t, [3.0, 8.0])]
    assert arrival - 0.1 <= heading[standing].min()
    assert heading[standing].max() <= departure + 0.1
    starts = np.asarray(program.frame.starts)
    for border in starts[np.isfinite(starts)][1:]:
        before, after = attitudes(program, [border - NEAR]), attitudes(program, [border])
        np.testing.assert_allclose(before.quaternion, after.quaternion, rtol=0, atol=1e-7)
        np.testing.assert_allclose(before.rate, after.rate, rtol=0, atol=1e-6)
        np.testing.assert_allclose(before.acceleration, after.acceleration, rtol=0, atol=1e-4)
    assert np.asarray(qt.evaluate(route, t, ("defined",)).defined).all()


@pytest.mark.parametrize("ends", ["start", "end"])
def test_a_route_that_starts_or_ends_at_rest_has_a_heading_there(ends):
    route = stopping()
    part = route.window(4.0, float(route.duration)) if ends == "start" else route.window(0.0, 5.0)
    forward = np.asarray(qt.evaluate(part, [0.0, float(part.duration)], ("dcm",)).dcm)[:, 0]
    still = forward[0 if ends == "start" else 1]
    near = np.asarray(route.velocity(8.2 if ends == "start" else 2.8))
    np.testing.assert_allclose(still, near / np.linalg.norm(near), rtol=0, atol=0.12)


def test_reversing_is_recognised():
    route = reversing()
    program = qt.FrameProgram(route)
    t = np.linspace(0.01, 3.99, 400)
    forward = np.asarray(qt.evaluate(route, t, ("dcm",)).dcm)[:, 0]
    v = np.asarray(qt.evaluate(route, t, ("velocity",)).velocity)
    along = np.sum(forward * v, axis=1) / np.linalg.norm(v, axis=1)
    assert np.all(along[t < 1.9] > 1 - 1e-9)
    assert np.all(along[t > 2.1] < -1 + 1e-9)
    starts = np.asarray(program.frame.starts)
    inner = np.min(np.abs(t[:, None] - np.concatenate([starts, route.times])), axis=1) > 1e-3
    consistent(program, t[inner], 1e-6)
    ahead = qt.evaluate(route, t, ("quaternion",), frame=qt.Upright(), continuous=True).quaternion
    assert np.min(np.abs(np.sum(np.asarray(ahead)[1:] * np.asarray(ahead)[:-1], axis=1))) < 0.1  # the tangent reverses


def test_a_driving_frame_is_stored_and_has_its_own_up(tmp_path):
    route = stopping()
    tilted = qt.Driving.along(route, up=[0.1, -0.2, 2.0], hold_below=0.3)
    program = qt.FrameProgram(route, tilted)
    program.save(tmp_path / "driving.toml")
    again = qt.load(tmp_path / "driving.toml")
    t = np.linspace(0.02, float(route.duration) - 0.02, 101)
    np.testing.assert_array_equal(attitudes(again, t).quaternion, attitudes(program, t).quaternion)
    left = np.asarray(qt.evaluate(route, t, ("dcm",), frame=tilted).dcm)[:, 1]
    np.testing.assert_allclose(left @ [0.1, -0.2, 2.0], 0, rtol=0, atol=1e-12)


def test_a_route_that_never_moves():
    still = qt.Route([0.0, 1.0], np.ones((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    at = qt.FrameProgram(still)(0.5)
    assert np.all(np.isfinite(np.asarray(at.quaternion)))
    np.testing.assert_array_equal(at.rate, 0.0)


def test_inside_a_trace_a_route_is_upright_and_differentiable():
    route = winding()

    def heading_rate(shift):
        moved = jax.tree.map(lambda x: x, route)
        c = moved.coefficients + shift * 0.01
        from equinox import tree_at

        return qt.FrameProgram(tree_at(lambda r: r.coefficients, moved, c))(1.0).rate[2]

    slope = jax.grad(heading_rate)(0.3)
    known = (heading_rate(0.3 + 1e-5) - heading_rate(0.3 - 1e-5)) / 2e-5
    assert float(slope) == pytest.approx(float(known), rel=1e-5)


def test_invalid_arguments():
    with pytest.raises(ValueError, match="the route stops at t = 3"):
        qt.FrameProgram(stopping(), qt.RotationMinimizing())
    with pytest.raises(ValueError, match="one Route, or a retimed Route, was expected"):
        qt.Driving.along(qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 1.0))
    with pytest.raises(ValueError, match="hold_below must be positive"):
        qt.Driving.along(winding(), hold_below=-1.0)
    with pytest.raises(ValueError, match=r"Use Driving\.along"):
        qt.Driving([0.0], [1.0, 1.0], np.zeros((1, 2, 6)))


def test_a_spline_without_a_continuous_velocity_has_a_program():
    x = np.array([0.0, 1, 2, 3, 4])
    spline = CubicSpline(x, np.stack([x, np.abs(x - 2), 0 * x], axis=1))
    program = qt.FrameProgram(qt.Route.from_piecewise(spline))
    consistent(program, np.linspace(0.1, 3.9, 37) + 1e-3, 1e-6)
