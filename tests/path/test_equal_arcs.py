"""Points of a path at equal fractions of its arc length."""

import numpy as np

import qtraj as qt
from qtraj.path.equal_arcs import equal_arcs

ACCURACY = 1e-9  # [m]


def retimed(path):
    """The same shape with another timing."""
    return qt.Curve(lambda t: path.position(path.duration * (t / 3.0) * (1 + 0.3 * (1 - t / 3.0))), 3.0)


def test_points_at_equal_fractions_of_the_arc_length():
    circle = qt.SpiralHelix([10.0], [0.0, 0.4, 0.1], [0.0, 0.0], 5.0)
    angle = np.linspace(0.0, float(circle.turn), 65)
    expected = 10 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    np.testing.assert_allclose(equal_arcs(circle, 64), expected, atol=ACCURACY)
    np.testing.assert_allclose(equal_arcs(retimed(circle), 64), expected, atol=ACCURACY)


def test_points_of_a_route_that_stops():
    line = np.linspace(0.0, 10.0, 6)[:, None] * np.array([1.0, 0.0, 0.0])
    route = qt.Route([0.0, 1.0, 2.0, 4.0, 5.0, 6.0], line[[0, 1, 2, 2, 3, 4]], np.zeros((6, 3)), np.zeros((6, 3)))
    points = np.asarray(equal_arcs(route, 16))
    np.testing.assert_allclose(points[:, 0], np.linspace(0.0, 8.0, 17), atol=1e-6)
