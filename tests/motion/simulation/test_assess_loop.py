"""A closed loop simulated at dense instants and assessed, and the facts about it as text."""

import equinox as eqx
import numpy as np
import pytest

import qtraj as qt
from qtraj.motion.simulation.loop_facts import (
    deviation_text,
    gains_of,
    gains_text,
    limit_of,
    loop_fact_rows,
    motion_headers,
    stability_text,
)
from qtraj.motion.simulation.loop_history import judging_times

PROGRAM = qt.EulerTurn([1.0, 0.0, 0.0, 0.0], [0.8, 0.6, 0.0, 0.0], qt.TimeOptimal(0.2, 0.1))
LAW = qt.AccelerationLaw(2.0, 1.0)
START = np.array([0.995, 0.0, 0.0998, 0.0])
TIMES = np.linspace(0.0, 12.0, 5)
STILL = np.zeros(4)


@pytest.fixture(scope="module")
def assessed():
    return qt.assess_loop(PROGRAM, LAW, START, STILL, TIMES, without_feedback=True)


def test_the_instants_are_dense_and_contain_those_of_the_user(assessed):
    history, verdict = assessed
    assert np.isin(TIMES, history.times).all()
    assert int(verdict.instants) == len(history.times) > 1200
    switch = float(PROGRAM.switches[1])
    assert np.abs(history.times - switch).min() == 0.0  # a jump of the acceleration is an instant
    assert history.at(TIMES).times.tolist() == TIMES.tolist()


@pytest.mark.parametrize("jumps", [None, [3.0], [1.1, 5.7, 6.03]])
def test_the_number_of_instants_is_that_of_other_jumps(jumps):
    """One compiled simulation serves all of them; both sides of each jump are among the instants."""
    jumps = None if jumps is None else np.array(jumps)
    times = judging_times(TIMES, jumps)
    assert times.size == 1216
    assert np.diff(times).min() > 0
    assert (times[[0, -1]] == TIMES[[0, -1]]).all()
    if jumps is not None:
        before = times[np.searchsorted(times, jumps) - 1]
        np.testing.assert_allclose(jumps - before, 1e-9 * TIMES[-1], rtol=1e-6)


def test_the_motion_is_that_of_simulate(assessed):
    history, verdict = assessed
    solution = qt.simulate(PROGRAM, LAW, START, STILL, TIMES, jumps=PROGRAM.switches)
    assert np.asarray(history.at(TIMES).solution.quaternion) == pytest.approx(np.asarray(solution.quaternion), abs=1e-9)
    assert verdict.agrees
    assert float(history.open_loop_angle[-1]) > 10 * float(verdict.final_angle)


def test_a_far_sign_is_changed_unless_it_is_wanted():
    for sign, scalar in (("nearer", 1.0), ("as given", -1.0)):
        history, _ = qt.assess_loop(PROGRAM, LAW, -START, STILL, TIMES, sign=sign)
        assert np.sign(float(history.solution.error[0, 0])) == scalar


def test_facts_as_text(assessed):
    rows = dict(loop_fact_rows(assessed[1], qt.Actuator(0.5)))
    assert rows["closed form"].startswith("agrees within ")
    assert rows["limit of command"] == "28.6479 °/s², on the magnitude"
    assert rows["evaluated at"] == f"{len(assessed[0].times)} instants, more than in the table"
    assert stability_text(assessed[1]) is None
    assert gains_text(gains_of(qt.AccelerationLaw([1.0, 2.0, 3.0, 4.0], np.eye(4)))) == "k1 = (1, 2, 3, 4), k2 = matrix"


def test_the_limit_of_the_actuator_as_data():
    assert limit_of(None) == limit_of(qt.Actuator()) == {"command_limit": None, "saturation": None}
    assert limit_of(qt.Actuator([1.0, 2.0, 3.0], saturation="axis")) == {
        "command_limit": [1.0, 2.0, 3.0],
        "saturation": "axis",
    }


def test_the_open_loop_and_a_deviation_are_described(assessed):
    history, verdict = assessed
    assert dict(loop_fact_rows(verdict, open_loop_angle=np.pi))["without feedback"].startswith("180° from the program")
    assert dict(loop_fact_rows(verdict, open_loop_angle=np.nan))["without feedback"] == "-"
    assert deviation_text(verdict) is None
    wrong = eqx.tree_at(lambda v: v.deviation, verdict, 2 * verdict.bound)
    assert deviation_text(wrong).startswith(f"The deviation from the closed form exceeds {float(verdict.bound):.3g}")
    title, headers = motion_headers(verdict, open_loop=True)
    assert "magnitude of the command [°/s²]" in title
    assert set(headers) <= set(history.record().everything())
    assert "open_loop_angle" not in motion_headers(verdict)[1]
    assert "closed_form_angle" in headers


def test_the_last_instant_that_was_reached():
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))
    states = (quaternion, np.where(np.arange(3)[:, None] < 2, quaternion, np.nan), np.full((3, 4), np.nan))
    found = [qt.Solution([0.0, 1.0, 2.0], state, np.zeros((3, 4)), 0).reached_text() for state in states]
    assert found == ["", "Last instant reached: t = 1 s.", "No instant was reached."]
