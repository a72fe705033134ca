"""From the keys of a scenario of `qtraj simulate` to a law, a state, and what surrounds the body."""

import jax.numpy as jnp
import numpy as np
import pytest
from tests.cli.loop_scenarios import LAW, SLEW

import qtraj as qt
from qtraj.motion.control.errors import error_quaternion
from qtraj.motion.control.response import spectral_abscissa
from qtraj.motion.programs.rotation_minimizing import name_of
from qtraj.scenario.loop import prepare
from qtraj.scenario.loop_parts import FeedbackPart
from qtraj.scenario.reader import read_scenario


@pytest.mark.parametrize(
    ("table", "gains"),
    [
        ({"kind": "inertial", "k1": 3, "k2": 2.0}, (3.0, 2.0)),
        ({"kind": "body", "damping": 0.5, "frequency": 3.0}, (3.0, 9.0)),
        ({"kind": "additive", "weights": {"error": 16.0, "rate": 1.0}}, (3.0, 4.0)),
        ({"kind": "quaternion", "k1": [1, 2, 3.0], "k2": np.eye(3).tolist()}, ([1, 2, 3], np.eye(3))),
        ({"kind": "body", "k1": np.eye(4).tolist(), "k2": [1, 2, 3, 4]}, (np.eye(4), [1, 2, 3, 4])),
    ],
)
def test_gains(table, gains):
    law = FeedbackPart.model_validate(table).law()
    assert np.asarray(law.k1) == pytest.approx(np.array(gains[0]))
    assert np.asarray(law.k2) == pytest.approx(np.array(gains[1]))
    assert getattr(law, "error", "quaternion") == table["kind"]


def test_the_gain_of_a_rate_law():
    law = FeedbackPart(kind="rate", settling_time=2.0, residual=0.01).law()
    assert isinstance(law, qt.RateLaw)
    assert np.exp(-2.0 * float(law.k)) == pytest.approx(0.01)


def test_the_sign_is_chosen(prepared):
    """An error of 200° is one of 160° from the other side: μ0 = cos 100° < 0."""
    error = "[error]\nrotation_vector = [200, 0, 0]\nsign = '{}'\n"
    signs = {sign: prepared(SLEW + LAW + error.format(sign)) for sign in ("near", "far", "auto")}
    near = signs["near"].quaternion
    assert float(near[0]) == pytest.approx(np.cos(np.radians(80)))
    assert np.array_equal(signs["far"].quaternion, -near)
    assert np.array_equal(signs["auto"].quaternion, near)  # at rest the nearer one
    start = signs["near"].program(jnp.asarray(0.0))
    scalars = [float(error_quaternion(start, signs[name].quaternion)[0]) for name in ("near", "far", "auto")]
    assert [scalar < 0 for scalar in scalars] == [False, True, False]


def test_the_gibbs_normalization(prepared):
    job = prepared(SLEW + LAW + "[error]\nrotation_vector = [90, 0, 0]\nrate = [10, 0, 0]\nnormalization = 'gibbs'\n")
    assert np.asarray(job.quaternion) == pytest.approx([1, 1, 0, 0])  # μ0 = 1, μ_v = tan 45°
    assert np.asarray(job.rate) == pytest.approx([np.radians(10), np.radians(10), 0, 0])


@pytest.mark.parametrize(
    ("gains", "rate"),
    [
        ("k1 = 3\nk2 = 2\n", -1.0),
        ("k1 = [3, 3, 3, -1]\nk2 = [2, 2, 2, 2]\n", 0.5),
        ("k1 = [1, 0, 1, 1]\nk2 = 9\n", 0.0),
    ],
)
def test_the_stability_of_a_law(prepared, gains, rate):
    assert spectral_abscissa(prepared(SLEW + "[law]\n" + gains).law) == pytest.approx(rate, abs=1e-12)


def test_a_turn_is_followed_beyond_its_end_only_where_it_rests(prepared, tmp_path):
    longer = LAW + "[simulation]\nduration = 9\n"
    assert prepared(SLEW + longer).times[-1] == 9.0
    law = qt.TimeOptimal(0.5, 0.1, end_rate=0.2)
    qt.EulerTurn([1.0, 0, 0, 0], [0.9, 0.3, 0, 0], law).save(tmp_path / "moving.toml")
    text = "angles = 'deg'\n[program]\nfile = 'moving.toml'\n"
    assert prepared(text + LAW).times[-1] == float(qt.load(tmp_path / "moving.toml").duration)
    with pytest.raises(ValueError, match="only a slew that ends at rest can be simulated for longer"):
        prepared(text + longer)


def test_the_duration_of_a_path_may_be_written_with_fewer_digits(prepared, tmp_path):
    qt.SpiralHelix([1.0, 2.0, 0.0, 0.0], [0.3, 0.0], [0.0, 0.5, 0.0, 0.0], 3.1234567891234).save(tmp_path / "p.toml")
    text = "angles = 'deg'\n[program]\npath = 'p.toml'\nframe = 'upright'\n" + LAW + "[simulation]\nduration = {}\n"
    assert prepared(text.format(3.12345679)).times[-1] == 3.1234567891234
    with pytest.raises(ValueError, match=r"has the value 3\.1234568, but must be at most 3\.1234567891234 s"):
        prepared(text.format(3.1234568))


def test_everything_around_the_body_is_in_radians(prepared):
    job = prepared(
        SLEW
        + LAW
        + "[sensor]\nsampling = 0.1\nrate_bias = [1, 2, 3]\nattitude_noise = 0.5\nseed = 3\n"
        + "[actuator]\nlimit = [1, 2, 3]\nsaturation = 'axis'\n"
        + "[disturbance]\ntorque = [3, 2, 1]\ninertia = [1.5, 1, 0.5]\nperiod = 4\nphase = 90\n"
    )
    assert np.asarray(job.sensor.rate_bias) == pytest.approx(np.radians([1, 2, 3]))
    assert float(job.sensor.attitude_noise) == pytest.approx(np.radians(0.5))
    assert np.asarray(job.actuator.limit) == pytest.approx(np.radians([1, 2, 3]))
    assert np.asarray(job.disturbance.acceleration(jnp.asarray(0.0))) == pytest.approx([2, 2, 2])
    assert np.asarray(job.disturbance.acceleration(jnp.asarray(2.0))) == pytest.approx([-2, -2, -2])


@pytest.mark.parametrize(
    ("key", "option", "expected"),
    [
        ("", None, "upright"),
        ("frame = 'natural'", None, "natural"),
        ("frame = 'rotation_minimizing'", None, "rotation-minimizing"),
        ("frame = 'rotation-minimizing'", None, "rotation-minimizing"),
        ("frame = 'natural'", "upright", "upright"),
        ("up = [0, 1, 1]", None, "upright"),
        ("frame = 'thrust-aligned'\nheading = 30", None, "thrust-aligned"),
        ("", "thrust-aligned", "thrust-aligned"),
    ],
)
def test_the_frame_of_a_path_is_upright_unless_another_is_asked_for(tmp_path, key, option, expected):
    qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 5.0).save(tmp_path / "path.toml")
    file = tmp_path / "loop.toml"
    file.write_text(f"angles = 'deg'\n[program]\npath = 'path.toml'\n{key}\n{LAW}")
    given = read_scenario(file, "loop")
    program = prepare(given, frame=option).program
    assert name_of(program.frame) == expected
    assert given.scenario.program.describe(program) == f"{expected} frame of path.toml"


def test_a_frame_without_a_path_is_refused(tmp_path):
    file = tmp_path / "loop.toml"
    file.write_text(SLEW + LAW)
    with pytest.raises(ValueError, match="--frame natural requires a program along a path"):
        prepare(read_scenario(file, "loop"), frame="natural")
