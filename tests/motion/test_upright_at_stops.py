"""The frame `Upright` on routes that stop: the heading is held where the path has no tangent."""

import numpy as np
import pytest

import qtraj as qt

TIMES = np.array([0.0, 8.0, 11.0, 20.0])
POINTS = np.array([[0.0, 0.0, 0.0], [-30.0, 5.0, 0.0], [-30.0, 5.0, 0.0], [-60.0, 40.0, 1.0]])
DIRECTIONS = np.array([[-5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-4.0, 4.0, 0.0]])
LIMITS = qt.Limits(speed=6.0, lateral_acceleration=2.0, longitudinal_acceleration=1.5)


def drive(last=POINTS[3], end=DIRECTIONS[3]):
    """A drive to the west, where the fallback attitude is the opposite one, with a stop of 3 s."""
    return qt.Route(TIMES, np.vstack([POINTS[:3], last]), np.vstack([DIRECTIONS[:3], end]), np.zeros((4, 3)))


def largest_turn(q):
    """The largest angle [rad] between neighbours."""
    return float(2 * np.max(np.arccos(np.clip(np.abs(np.sum(q[1:] * q[:-1], axis=1)), 0.0, 1.0))))


@pytest.mark.parametrize("retimed", [False, True], ids=["route", "retimed"])
def test_the_heading_is_held_at_stops(retimed):
    path = qt.retime(drive(), LIMITS).path if retimed else drive()
    t = np.arange(0.0, float(path.duration), 0.01)
    held = np.asarray(qt.evaluate(path, t, ["quaternion"], frame=qt.Upright()).quaternion)
    assert largest_turn(held) < np.radians(1.0)
    known = np.asarray(qt.evaluate(path, t, ["quaternion"]).quaternion)
    np.testing.assert_array_equal(held, known)
    program = qt.FrameProgram(path, qt.Upright())
    assert abs(np.asarray(program(9.0).quaternion) @ held[900]) == pytest.approx(1.0, abs=1e-9)


def test_upright_stays_along_the_path_in_reverse():
    """x stays along the velocity, so the frame is not replaced on a route that reverses."""
    path = drive(last=[0.0, 0.0, 0.0], end=(5.0, 0.0, 0.0))
    forward = np.asarray(qt.evaluate(path, [19.0], ["quaternion"], frame=qt.Upright()).quaternion)[0]
    assert 2 * np.arctan2(forward[3], forward[0]) == pytest.approx(0.0, abs=0.3)
    assert isinstance(qt.FrameProgram(path, qt.Upright()).frame, qt.Upright)
