"""The maximum distance between paths, for concentric circles."""

import numpy as np
import pytest

from qtraj.path.deviation import max_deviation

ANGLES = np.linspace(0.0, 2.0, 2001)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES], axis=1)


def test_concentric_circles_in_one_plane_and_in_parallel_planes():
    assert max_deviation(1.5 * CIRCLE, CIRCLE) == pytest.approx(0.5, abs=1e-6)
    assert max_deviation(1.5 * CIRCLE + [0.0, 0.0, 1.2], CIRCLE) == pytest.approx(1.3, abs=1e-6)


def test_order_of_points_does_not_matter_and_a_line_may_be_a_point():
    assert max_deviation(CIRCLE[::-7], CIRCLE) == pytest.approx(0.0, abs=1e-12)
    assert max_deviation(np.array([[3.0, 4.0, 0.0]]), np.zeros((2, 3))) == 5.0


def test_a_long_line_and_coordinates_that_are_not_finite():
    angles = np.linspace(0.0, 2.0, 30_001)
    circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    assert max_deviation(1.5 * circle, circle) == pytest.approx(0.5, abs=1e-6)
    assert np.isnan(max_deviation(np.full((3, 3), np.nan), circle))
