"""The centre line of a race track of about 2.3 km, made by a formula: points 5 m apart, with widths."""

import numpy as np
from scipy.interpolate import CubicSpline

LENGTH, COUNT = 2300.0, 460


def race_track(length=LENGTH, count=COUNT):
    """Points (count, 2) [m] at equal distances along a closed curve, and widths (count, 2) [m]: right, left."""
    angle = np.linspace(0, 2 * np.pi, 20001)
    radius = 1 + 0.32 * np.cos(2 * angle + 0.4) + 0.16 * np.sin(3 * angle) + 0.07 * np.cos(5 * angle)
    fine = np.stack([radius * np.cos(angle), 0.7 * radius * np.sin(angle)], axis=1)
    fine[-1] = fine[0]
    s = np.append(0, np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1)))
    at = np.arange(count) * s[-1] / count
    points = CubicSpline(s, fine, bc_type="periodic")(at) * length / s[-1]
    turn = 2 * np.pi * np.arange(count) / count
    widths = np.stack([5.5 + np.cos(3 * turn), 5.0 + np.sin(2 * turn)], axis=1)
    return points, widths


def write_race_track(file, **options):
    """Write a table of the TU Munich's race tracks."""
    points, widths = race_track(**options)
    np.savetxt(file, np.hstack([points, widths]), fmt="%.6f", delimiter=",", header="x_m,y_m,w_tr_right_m,w_tr_left_m")
    return file
