"""Tunings at the points of an atlas: the same as single tunings, and the closed form of an arc."""

import numpy as np
import pytest

import qtraj as qt

LATERAL, CURVATURE = 1.5, 1 / 12  # [m/s²], [1/m]
TANGENT = ["start.V_rho", "start.V_phi", "start.V_h", "end.V_rho", "end.V_h"]
"""The variables of a bus that enters with a given speed, and leaves with any, along both streets."""

OPTIONS = {"motion": "hermite", "fixed": TANGENT, "starts": 1}


def corner(radius, speed):
    """A corner of 90° about the origin. With both directions fixed, the radius is constant: the path is an arc."""
    start = qt.BoundaryState([radius, 0.0, 0.0], [0.0, speed, 0.0])
    end = qt.BoundaryState([0.0, radius, 0.0], [-speed, 0.0, 0.0])
    return start, end, qt.Limits(curvature=CURVATURE, lateral_acceleration=LATERAL)


RADII, SPEEDS = np.array([10.0, 20.0, 20.0, 30.0]), np.array([3.0, 5.0, 6.0, 9.0])


@pytest.fixture(scope="module")
def found():
    return qt.tuned_points(corner, **OPTIONS)(RADII, SPEEDS)


def test_points_are_classified_with_the_limit_that_is_violated(found):
    assert found["status"].tolist() == ["infeasible", "feasible", "infeasible", "infeasible"]
    assert found["first_limit"].tolist() == ["curvature", "", "lateral_acceleration", "lateral_acceleration"]
    entry = np.minimum(0.0, 1 - SPEEDS**2 / RADII / LATERAL)
    np.testing.assert_allclose(np.minimum(found["margin_lateral_acceleration"], 0.0)[1:], entry[1:], atol=1e-6)
    assert found["margin_curvature"][0] == pytest.approx(1 - 1 / 10 / CURVATURE, abs=1e-6)


def test_values_are_those_of_single_tunings(found):
    single = qt.tune(*corner(20.0, 5.0), **OPTIONS)
    assert found["duration"][1] == pytest.approx(float(single.path.duration), rel=1e-9)
    assert found["objective"][1] == pytest.approx(float(single.objective), abs=1e-9)
    margins = [float(single.certificate.margin(name)) for name in ("curvature", "lateral_acceleration")]
    assert found["margin_curvature"][1] == pytest.approx(margins[0] / CURVATURE, abs=1e-9)
    assert found["margin_lateral_acceleration"][1] == pytest.approx(margins[1] / LATERAL, abs=1e-9)
    assert np.isnan(found["duration"][[0, 2, 3]]).all()


def test_an_atlas_of_tunings_has_the_border_of_the_closed_form():
    radius = qt.AtlasAxis("radius", 8.0, 40.0, tolerance=4.0, steps=2, unit="m")
    speed = qt.AtlasAxis("speed", 3.0, 9.0, tolerance=0.75, steps=2, unit="m/s")
    border = np.concatenate(qt.atlas(qt.tuned_points(corner, **OPTIONS), radius, speed).border)
    _require_border(border, radius, speed)


def _require_border(border, radius, speed):
    """The border is v = √(a R) and R = 1/κ, within half a tolerance along one axis."""
    r, v = border.T
    along_v, along_r = abs(v - np.sqrt(LATERAL * r)) / speed.tolerance, abs(r - v**2 / LATERAL) / radius.tolerance
    tight = abs(r - 1 / CURVATURE) / radius.tolerance
    assert np.minimum(np.minimum(along_v, along_r), tight).max() <= 0.5


@pytest.mark.slow
def test_the_atlas_of_a_bus_turn_costs_a_twentieth_of_its_grid():
    radius = qt.AtlasAxis("radius", 10.0, 50.0, tolerance=0.16, steps=8, unit="m")
    speed = qt.AtlasAxis("speed", 2.0, 10.0, tolerance=0.04, steps=8, unit="m/s")
    found = qt.atlas(qt.tuned_points(corner, **OPTIONS), radius, speed)
    _require_border(np.concatenate(found.border), radius, speed)
    assert found.evaluations <= 0.05 * (found.cells[0] + 1) * (found.cells[1] + 1)
    r, v = np.meshgrid(*(np.linspace(a.low, a.high, n) for a, n in ((radius, 127), (speed, 131))))
    clear = (abs(v - np.sqrt(LATERAL * r)) > speed.tolerance) & (abs(r - 1 / CURVATURE) > radius.tolerance)
    exact = (v < np.sqrt(LATERAL * r)) & (r > 1 / CURVATURE)
    assert (found.at(r, v)["status"] == "feasible")[clear].tolist() == exact[clear].tolist()


def test_limits_durations_and_turns_may_be_parameters():
    def problem(limit, duration):
        start, end, _ = corner(20.0, 5.0)
        return {"start": start, "end": end, "limits": qt.Limits(speed=limit), "duration": duration, "turn": np.pi / 2}

    tuned = qt.tuned_points(problem, objective="smoothest", motion="hermite", starts=1)
    found = tuned(np.array([9.0, 9.0, 2.0]), np.array([6.0, 7.0, 6.0]))
    assert found["duration"][:2].tolist() == [6.0, 7.0]
    assert found["status"][0] == "feasible"
    assert found["status"][2] == "infeasible"  # the chord is longer than 2 m/s · 6 s
    assert np.linalg.norm([20.0, 20.0]) > 2.0 * 6.0


def test_ill_posed_points_fail_alone():
    def problem(radius, speed):
        return *corner(max(radius, 0.0), speed)[:2], qt.Limits(lateral_acceleration=LATERAL)

    found = qt.tuned_points(problem, **OPTIONS)(np.array([0.0, 20.0]), np.array([5.0, 5.0]))
    assert found["status"].tolist() == ["failed", "feasible"]
    assert np.isnan(found["duration"][0])
    assert found["first_limit"][0] == ""


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (lambda x, y: corner(x, y)[:2], r"must return \(start, end, limits\)"),
        (lambda x, y: {"start": 1, "end": 2, "limits": 3, "motion": "hermite"}, "but it returned .*'motion'"),
        (
            lambda x, y: (*corner(x, y)[:2], qt.Limits(speed=9.0) if x > 15 else qt.Limits(jerk=9.0)),
            "limits must have the same form",
        ),
    ],
)
def test_problems_of_another_form_are_refused(problem, message):
    with pytest.raises(ValueError, match=message):
        qt.tuned_points(problem)(RADII, SPEEDS)
