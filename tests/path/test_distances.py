"""Distances along routes, whatever their number of segments."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.path.distances import distances


def arc(segments):
    """An arc of 60 m at 2 m/s."""
    angle = np.linspace(0.0, 1.0, segments + 1)
    turn = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    ahead = np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return qt.Route(30.0 * angle, 60.0 * turn, 2.0 * ahead, -turn / 15.0)


@pytest.mark.parametrize("segments", [7, 8, 9, 16, 17])
def test_the_last_segment_is_whole(segments):
    """A route with 2ⁿ segments has no padding; the last quarter of its last segment was left out."""
    route = arc(segments)
    found = distances(route)
    np.testing.assert_allclose([found.length, found.ends[-1]], [route.length(), 30.0], rtol=1e-9)
    slow = qt.Limits(speed=qt.Along([0.0, 59.0], [3.0, 1.0]))
    assert qt.certify(route, slow).status["speed"] == "broken"
    np.testing.assert_allclose(slow.margins(route, 29.9)["speed"], -1.0, atol=1e-6)
    best = qt.tune_route(route, qt.Limits(speed=3.0), tube=2.0, nearest_to=route)
    assert float(best.objective) < 1e-3
