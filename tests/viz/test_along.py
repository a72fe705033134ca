"""Distances between two paths along their way."""

import numpy as np
import pytest

from qtraj.viz.report.along import distance_travelled, match

from .drives import drive

COARSE = 1e-3
"""[m] deviation of an arc from the chords of its samples."""


def circle(radius, count, turns=1.0):
    angle = np.linspace(0.0, 2 * np.pi * turns, count)
    return radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)


@pytest.mark.parametrize("radius", [49.5, 50.8])
def test_the_lateral_distance_of_circles_is_the_difference_of_their_radii(radius):
    """Counter-clockwise, the inner circle is on the left."""
    found = match(circle(radius, 901), circle(50.0, 1301))
    assert found.lateral == pytest.approx(50.0 - radius, abs=COARSE)
    assert found.way == pytest.approx(np.linspace(0.0, 100 * np.pi, 901), abs=0.1)


def test_a_road_that_is_driven_twice_is_matched_lap_by_lap():
    """The second lap is 0.3 m farther out; a comparison without order would find the wrong lap."""
    spiral = circle(1.0, 2001, turns=2.0) * np.linspace(40.0, 40.6, 2001)[:, None]
    shifted = circle(1.0, 2001, turns=2.0) * np.linspace(40.25, 40.85, 2001)[:, None]
    found = match(shifted, spiral)
    assert found.lateral[100:-100] == pytest.approx(-0.25, abs=5 * COARSE)
    assert (np.diff(found.way) >= 0).all()


def test_stops_do_not_disturb_it():
    line = np.stack([np.linspace(0.0, 30.0, 61), np.zeros(61), np.zeros(61)], axis=1)
    stopped = np.concatenate([line[:30], np.repeat(line[30:31], 500, axis=0), line[31:]])
    found = match(stopped + np.array([0.0, 0.2, 5.0]), stopped)
    assert found.lateral == pytest.approx(np.full(len(stopped), 0.2))  # the height does not count
    assert found.way == pytest.approx(stopped[:, 0])


def test_a_path_without_motion_has_no_lateral_distance():
    still = np.zeros((5, 3))
    assert np.isnan(match(still, still).lateral).all()


def test_many_points_are_matched_in_parts():
    line = np.stack([np.linspace(0.0, 900.0, 5001), np.zeros(5001), np.zeros(5001)], axis=1)
    found = match(line + np.array([0.0, -0.5, 0.0]), line)
    assert found.lateral == pytest.approx(np.full(5001, -0.5))
    assert found.way == pytest.approx(line[:, 0])


def test_the_distance_travelled():
    time, position, _, _ = drive([(30, 0), (20, 1.0)], 5.0)
    assert distance_travelled(position) == pytest.approx(5.0 * time, rel=1e-4)
