"""Programs of long paths: the number of anchors follows the path, or the call says that it does not."""

import jax
import numpy as np
import pytest

import qtraj as qt

RISE, RADIUS = 3.0, 10.0


def helix(duration):
    return qt.SpiralHelix([RADIUS], [0.0, 1.0], [0.0, RISE], duration)


def minimizing_normal(path, t):
    """The normal of the frame in closed form: the principal normal, turned by −∫χ ds about the tangent."""
    at = qt.trihedral(path, t, qt.Natural())
    angle = -RISE / np.hypot(RADIUS, RISE) * t  # torsion times speed times time
    return np.cos(angle) * np.asarray(at.normal) + np.sin(angle) * np.asarray(at.binormal)


@pytest.mark.parametrize("duration", [100.0, 300.0, 700.0, 1000.0, 5000.0])
def test_a_rotation_minimizing_frame_of_a_long_path_is_exact(duration):
    path = helix(duration)
    program = qt.FrameProgram(path, qt.RotationMinimizing())
    for t in (0.37 * duration, duration):
        got = np.asarray(qt.rotation.to_dcm(program(t).quaternion))[1]
        np.testing.assert_allclose(got, minimizing_normal(path, t), atol=1e-11)


def test_a_route_with_long_segments_is_exact():
    times = np.linspace(0.0, 60.0, 31)
    r = [RADIUS * np.cos(times), RADIUS * np.sin(times), RISE * times]
    v = [-RADIUS * np.sin(times), RADIUS * np.cos(times), RISE + 0 * times]
    a = [-RADIUS * np.cos(times), -RADIUS * np.sin(times), 0 * times]
    j = [RADIUS * np.sin(times), -RADIUS * np.cos(times), 0 * times]
    coarse = qt.Route(times, *(np.stack(x, axis=1) for x in (r, v, a, j)))
    program = qt.FrameProgram(coarse, qt.RotationMinimizing())
    normal = np.asarray(qt.rotation.to_dcm(program(60.0).quaternion))[1]
    finer = qt.FrameProgram(coarse.window(0.0, 60.0), qt.RotationMinimizing(), anchors=None)
    np.testing.assert_allclose(normal, np.asarray(qt.rotation.to_dcm(finer(60.0).quaternion))[1], atol=1e-12)
    assert program.anchors.shape[0] > 4 * 32 + 1


def test_a_traced_path_that_turns_too_fast_is_not_a_number():
    def last(duration):
        return qt.FrameProgram(helix(duration), qt.RotationMinimizing())(duration).quaternion

    assert np.isfinite(jax.jit(last)(300.0)).all()
    assert np.isnan(jax.jit(last)(700.0)).all()


def test_a_path_that_turns_too_fast_for_any_number_of_anchors_is_said():
    with pytest.warns(UserWarning, match="divide the path into windows"):
        qt.FrameProgram(helix(200_000.0), qt.RotationMinimizing())


@pytest.mark.parametrize("duration", [3.0, 2000.0, 512 * 2 * np.pi])
def test_the_sign_of_the_quaternion_is_continuous_on_long_paths(duration):
    path = helix(duration)
    program = qt.FrameProgram(path, qt.Natural())
    times = np.linspace(0.0, duration, 9 * int(duration) + 20)
    table = qt.evaluate(path, times, ("quaternion",), qt.Natural(), continuous=True)
    for k in (1, len(times) // 3, len(times) - 1):
        np.testing.assert_allclose(program(times[k]).quaternion, table.quaternion[k], atol=1e-9)


def test_a_batch_of_long_paths_is_refused():
    def table(durations):
        paths = jax.vmap(helix)(np.array(durations))
        return qt.evaluate(paths, [0.0, 1.0], ("quaternion",), frame=qt.RotationMinimizing())

    assert np.isfinite(table([10.0, 20.0]).quaternion).all()
    with pytest.raises(ValueError, match="turns too fast"):
        table([10.0, 2e4])


def test_anchors_of_a_route_must_fit_its_joints():
    route = qt.fit_route(qt.Track(np.arange(30.0), np.stack([np.arange(30.0) * 5] * 3, axis=1))).path
    with pytest.raises(ValueError, match="the anchors of a route must be"):
        qt.FrameProgram(route, qt.Upright(), anchors=np.tile([1.0, 0, 0, 0], (100, 1)))
