"""Scenarios of `qtraj simulate` with a rigid body, wheels, hysteresis and torques of the surroundings, as in Python."""

import numpy as np
import pytest
from tests.cli.loop_scenarios import LAW, SLEW

import qtraj as qt
from qtraj.foundation import document
from qtraj.motion.simulation.body_facts import body_fact_rows, body_facts

J = [12.0, 15.0, 9.0]
BODY = f"[body]\ninertia = {J}\n"
WHEELS = "[body.wheels]\naxes = [[1,0,1], [0,1,1], [-1,0,1], [0,-1,1]]\nmax_momentum = 20\nmomentum = [1, 1, 2, 1]\n"
ERROR = "[error]\nrotation_vector = [5, -3, 2]\n"
FAST = "[simulation]\nsamples = 5\nrtol = 1e-7\natol = 1e-9\n"
Q = np.array([0.8, 0.1, -0.5, 0.3]) / np.linalg.norm([0.8, 0.1, -0.5, 0.3])


def test_the_body_has_one_inertia_and_the_law_another(prepared):
    body = prepared(SLEW + LAW + BODY + "assumed = 10\nmax_torque = 0.5\n").body
    np.testing.assert_array_equal(body.inertia, np.diag(J))
    np.testing.assert_array_equal(body.assumed, 10 * np.eye(3))
    assert float(body.max_torque) == 0.5
    assert body.wheels is None
    assert prepared(SLEW + LAW).body is None


def test_wheels(prepared):
    wheels = prepared(SLEW + LAW + BODY + WHEELS + "max_torque = [1, 2, 3, 4]\n").body.wheels
    np.testing.assert_allclose(wheels.axes[0], np.array([1, 0, 1]) / np.sqrt(2))
    assert wheels.max_torque.tolist() == [1, 2, 3, 4]
    assert wheels.max_momentum.tolist() == [20] * 4
    assert wheels.momentum.tolist() == [1, 1, 2, 1]


def test_hysteresis(prepared):
    job = prepared(SLEW + LAW + "kind = 'quaternion'\n[law.hysteresis]\nsampling = 0.2\n")
    assert isinstance(job.law, qt.HystereticLaw)
    assert isinstance(job.law.law, qt.QuaternionFeedback)
    assert (float(job.law.half_width), float(job.law.sampling)) == (0.25, 0.2)
    of_sensor = prepared(SLEW + LAW + "[law.hysteresis]\nhalf_width = 0.1\n[sensor]\nsampling = 0.1\n").law
    assert of_sensor.sampling is None
    assert float(of_sensor.half_width) == 0.1


def test_the_lag_of_the_actuator(prepared):
    assert float(prepared(SLEW + LAW + "[actuator]\ntime_constant = 0.3\n").actuator.time_constant) == 0.3


def acceleration(job, t=100.0):
    return np.asarray(job.disturbance.acceleration(np.asarray(t), Q, np.array([0.1, 0.2, -0.1])))


def test_the_torques_of_the_surroundings_are_those_of_their_formulas(prepared):
    """M = 3μ/r⁵ r × Jr + m × B − ½ρC_D A|v| s × v + constant, on a circular orbit, in body axes."""
    job = prepared(
        SLEW + LAW + BODY + "[disturbance]\ntorque = [1e-3, 0, 2e-3]\n[disturbance.orbit]\nradius = 7e6\n"
        "start = [0, 2, 0]\nnormal = [0, 0, -1]\n[disturbance.gravity_gradient]\n"
        "[disturbance.magnetic]\ndipole = [1, 2, 3]\nfield = [3e-5, 0, 1e-5]\n"
        "[disturbance.aerodynamic]\ncentre = [0.1, 0, 0.2]\narea = 2\ndensity = 1e-9\n"
    )
    mu, radius = 3.986004418e14, 7e6
    n = np.sqrt(mu / radius**3)
    alpha = np.asarray(qt.rotation.to_dcm(Q))  # inertial to body
    r = alpha @ (radius * np.array([np.sin(100 * n), np.cos(100 * n), 0.0]))
    v = alpha @ (radius * n * np.array([np.cos(100 * n), -np.sin(100 * n), 0.0]))
    torque = 3 * mu / radius**5 * np.cross(r, np.array(J) * r) + np.cross([1, 2, 3], alpha @ [3e-5, 0, 1e-5])
    torque += -0.5 * 1e-9 * 2.2 * 2 * np.linalg.norm(v) * np.cross([0.1, 0, 0.2], v) + [1e-3, 0, 2e-3]
    np.testing.assert_allclose(acceleration(job), torque / J, rtol=1e-12)


@pytest.mark.parametrize(
    ("table", "own"),
    [
        ("gravity_gradient]\nposition = [7e6, 1, 0]", qt.torques.GravityGradient(J, [7e6, 1, 0])),
        ("gravity_gradient]\nposition = [7e6, 1, 0]\nmu = 4e13", qt.torques.GravityGradient(J, [7e6, 1, 0], 4e13)),
        ("magnetic]\ndipole = [0, 0, 5]\nfield = [3e-5, 0, 0]", qt.torques.MagneticDipole([0, 0, 5.0], [3e-5, 0, 0])),
        (
            "aerodynamic]\ncentre = [1, 0, 0]\narea = 2\ndensity = 1e-9\nvelocity = [0, 7e3, 0]\ndrag = 2",
            qt.torques.AerodynamicTorque([1, 0, 0], 2.0, 1e-9, [0, 7e3, 0], 2.0),
        ),
    ],
)
@pytest.mark.parametrize("where", [BODY, f"[disturbance]\ninertia = {J}\n"])
def test_one_torque_of_the_surroundings(prepared, table, own, where):
    job = prepared(SLEW + LAW + where + f"[disturbance.{table}\n")
    assert type(job.disturbance.signal) is type(own)
    np.testing.assert_allclose(acceleration(job), np.asarray(own(0.0, Q, np.zeros(3))) / J, rtol=1e-12)


def test_a_sum_of_torques_can_be_saved(tmp_path):
    both = qt.torques.TorqueSum([[1.0, 2.0, 3.0], qt.torques.MagneticDipole([0, 0, 5.0], [3e-5, 0, 0])])
    document.save(qt.RigidBody(J, torque=both), tmp_path / "body.toml")
    expected = np.array([1, 2, 3]) + np.asarray(both.torques[1](0.0, Q, np.zeros(3)))
    for each in (both, qt.load(tmp_path / "body.toml").torque):
        np.testing.assert_allclose(each(0.0, Q, np.zeros(3)), expected, rtol=1e-14)


def test_an_empty_sum_of_torques():
    with pytest.raises(ValueError, match="a sum needs at least one torque"):
        qt.torques.TorqueSum([])


REASONS = {
    "": "",
    "assumed = [11, 15, 9]\n": "the law assumes another inertia than that of the body",
    "max_torque = 0.5\n": "a limit of the torques is reached, first at t = 0 s",
    "[disturbance]\ntorque = [0.1, 0, 0]\n": "a disturbance acts on the body",
    "[actuator]\ntime_constant = 0.2\n": "the actuator follows the command with a lag",
    "[law.hysteresis]\nsampling = 0.5\n": "a hysteretic law may change the sign of λ",
}


@pytest.mark.parametrize(("more", "reason"), REASONS.items(), ids=[*map(str, range(len(REASONS)))])
def test_the_closed_form_applies_to_exact_torques_only(prepared, more, reason):
    job = prepared(SLEW + LAW + ERROR + FAST + BODY + more)
    history, verdict = qt.assess_loop(**job.arguments())
    assert verdict.reason == reason
    assert verdict.agrees is (None if reason else True)
    assert np.isfinite(float(verdict.norm_drift)) == (not reason)
    if reason == "the law assumes another inertia than that of the body":
        right = qt.simulate(
            job.program,
            job.law,
            job.quaternion,
            job.rate,
            job.times,
            body=qt.RigidBody(J, [11.0, 15.0, 9.0]),
            sign="as given",
            rtol=1e-9,
        )
        np.testing.assert_allclose(history.at(job.times).solution.angle, right.angle, atol=1e-6)
        assert float(right.body.largest()) > 1e-3


def test_facts_about_a_body_as_text(prepared):
    job = prepared(SLEW + LAW + ERROR + FAST + BODY + "max_torque = 0.5\n")
    history, _ = qt.assess_loop(**job.arguments())
    rows = dict(body_fact_rows(body_facts(job.body, history.solution.body)))
    assert rows["largest torque"] == "0.5 N m, limit 0.5 N m"
    assert rows["inertia of the law"] == "exact"
    assert "wheel momenta" not in rows
