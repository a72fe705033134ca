"""The distance between paths, against circles about one centre."""

import numpy as np
import pytest

from qtraj.path.deviation import max_deviation

ANGLES = np.linspace(0.0, 2.0, 2001)
CIRCLE = np.stack([np.cos(ANGLES), np.sin(ANGLES), 0.0 * ANGLES], axis=1)


def test_circles_about_one_centre_and_planes_apart():
    assert max_deviation(1.5 * CIRCLE, CIRCLE) == pytest.approx(0.5, abs=1e-6)
    assert max_deviation(1.5 * CIRCLE + [0.0, 0.0, 1.2], CIRCLE) == pytest.approx(1.3, abs=1e-6)


def test_times_do_not_matter_and_a_point_that_stands_still_is_a_line():
    assert max_deviation(CIRCLE[::-7], CIRCLE) == pytest.approx(0.0, abs=1e-12)
    assert max_deviation(np.array([[3.0, 4.0, 0.0]]), np.zeros((2, 3))) == 5.0


def test_long_rows_are_judged_piece_by_piece():
    angles = np.linspace(0.0, 2.0, 30_001)
    circle = np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    assert max_deviation(1.5 * circle, circle) == pytest.approx(0.5, abs=1e-6)
    assert np.isnan(max_deviation(np.full((3, 3), np.nan), circle))
