"""Routes whose limits contradict each other: the result says which limit, by how much, and what helps."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from tests.design.test_tune_route import drive

import qtraj as qt
from qtraj.design.tuning_route import rounds
from qtraj.design.tuning_route.remedy import reached
from qtraj.foundation.outcome import ResultCode

TIMES = np.arange(0.0, 36.0, 2.0)
WAVES = qt.Route.from_piecewise(CubicSpline(TIMES, np.stack([8 * TIMES, 30 * np.sin(TIMES / 9), 0.02 * TIMES], axis=1)))
LIFT = qt.Route.from_piecewise(CubicSpline(TIMES[:6], np.outer(TIMES[:6], [0.0, 0.0, 2.0])))

FREE_ENDS = {"fixed": np.zeros(len(TIMES), bool)}


def contradiction(route, limits, **arguments):
    tuned = qt.tune_route(route, qt.Limits(**limits), **arguments)
    assert tuned.code == ResultCode.limits_contradict
    assert not tuned.certificate.holds
    return tuned


@pytest.mark.parametrize("limit", [0.1, pytest.param(0.2, marks=pytest.mark.slow)])
def test_a_limit_that_the_tube_does_not_allow(limit):
    """The advice is a higher limit, with which a search succeeds."""
    tuned = contradiction(WAVES, {"lateral_acceleration": limit}, tube=0.05)
    advised = float(re.search(r"With lateral_acceleration = ([\d.]+) m/s², every limit is", tuned.result)[1])
    assert limit < tuned.certificate.worst["lateral_acceleration"][1] < advised < 0.25
    assert qt.tune_route(WAVES, qt.Limits(lateral_acceleration=advised), tube=0.05).successful


@pytest.mark.parametrize(
    ("route", "limits", "arguments", "changes"),
    [
        (WAVES, {"speed": 4.0}, {"objective": "smoothest"}, {"objective": "nearest", **FREE_ENDS}),
        (WAVES, {"speed": 4.0}, {}, FREE_ENDS),
        (WAVES, {"jerk": 0.03, "speed": 9.0, "lateral_acceleration": 0.3}, {"tube": 2.0}, FREE_ENDS),
        (LIFT, {"speed": 1.9}, {}, {"fixed": np.zeros(6, bool)}),
    ],
    ids=["duration", "ends", "jerk", "lift"],
)
def test_states_that_cannot_change(route, limits, arguments, changes):
    """The advice names them, and with its change a search succeeds."""
    tuned = contradiction(route, limits, **arguments)
    assert "the states at the ends of the route" in tuned.result
    assert ("and the duration cannot change" in tuned.result) == ("objective" in changes)
    assert qt.tune_route(route, qt.Limits(**limits), **arguments | changes).successful


def test_a_quantity_that_does_not_exist():
    tuned = qt.tune_route(LIFT, qt.Limits(yaw_rate=0.1))
    assert tuned.code == ResultCode.limits_undefined
    np.testing.assert_array_equal(tuned.displacement, 0.0)


def test_a_fastest_route_that_does_not_exist():
    """With a limit on the lateral acceleration alone, the speed may jump; with one on its changes, all is proved."""
    route, lateral = drive(6, 3.0), qt.BySpeed([0, 30], magnitude=[9, 7])
    best = qt.tune_route(route, qt.Limits(lateral_acceleration=lateral, speed=30), 2.0, "fastest", max_steps=60)
    assert not best.certificate.holds
    assert "also limit longitudinal_acceleration" in best.advice
    assert "also limit longitudinal_acceleration" in best.result


@pytest.mark.parametrize("lateral", [8.0, qt.BySpeed([0, 30], magnitude=[9, 7])], ids=["constant", "by speed"])
def test_the_fastest_route_along_curved_constraints(lateral):
    """Without second-order corrections, the steps become tiny, and 300 of them do not suffice."""
    limits = qt.Limits(lateral_acceleration=lateral, longitudinal_acceleration=(-6, 3))
    best = qt.tune_route(drive(6, 3.0), limits, 2.0, "fastest")
    assert best.code == 0
    assert best.certificate.holds
    assert best.iterations < 150
    assert best.objective < 4.1043


@pytest.mark.parametrize("indefinite", [False, True])
def test_the_second_search_runs_only_where_it_differs_from_the_first_one(monkeypatch, indefinite):
    """Both searches together take no more steps than one may take."""
    calls = []

    def solved(task, begin=None):
        calls.append(task)
        return SimpleNamespace(
            proved=task.convex, exhausted=False, indefinite=indefinite, steps=7, _replace=lambda steps: steps
        )

    monkeypatch.setattr(rounds, "_solved", solved)
    task = rounds.Task(*[None] * 5, most=20)
    result = rounds._attempted(task, None)
    assert [(own.convex, own.most) for own in calls] == [(False, 20), (True, 13)][: 1 + indefinite]
    assert (result == 14) == indefinite


def test_advice_does_not_reduce_other_limits():
    """A limit that is satisfied between its value and the reduced margin of the search is not part of the advice."""
    worst = {"speed": (0.0, np.array([4.9, 4.93]), 5.0), "lateral_acceleration": (0.0, np.array([1.0, 1.2]), 1.0)}
    certificate = SimpleNamespace(segments=SimpleNamespace(worst=worst))
    found: Any = SimpleNamespace(judged=SimpleNamespace(certificate=certificate), missed=np.ones((4, 2), bool))
    assert reached({"speed": 5.0, "lateral_acceleration": 1.0}, found) == {"lateral_acceleration": 1.2}
