"""`qtraj simulate` with a rigid body: its facts, its table, its report; and a sequence of programs."""

import json

import numpy as np
import pytest

from .loop_scenarios import LAW, SLEW

WHEELS = "[body.wheels]\naxes = [[1,0,1], [0,1,1], [-1,0,1], [0,-1,1]]\nmax_momentum = 20\nmomentum = [1, 1, 2, 1]\n"
BODY = "[body]\ninertia = [12, 15, 9]\nassumed = [11, 15, 9]\n"
ERROR = "[error]\nrotation_vector = [5, -3, 2]\n[simulation]\nsamples = 5\nrtol = 1e-7\natol = 1e-9\n"


def test_the_command_shows_torques_and_momenta(qtraj, tmp_path):
    xarray = pytest.importorskip("xarray")
    file, out = tmp_path / "s.toml", tmp_path / "out"
    file.write_text(SLEW + LAW + ERROR + BODY + WHEELS)
    result = qtraj("simulate", file, "--out", out, "--json")
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)["body"]
    assert facts["inertia_is_exact"] is False
    assert facts["momentum_limits"] == [20] * 4
    with xarray.open_dataset(out / "table.nc") as table:
        momenta, torque = table["momentum"].values, table["torque"].values
        assert table["momentum"].attrs["limit"].tolist() == [20] * 4
        mismatch = table["mismatch"].values
    assert np.all(np.abs(momenta).max(axis=0) <= np.array(facts["largest_momenta"]) * (1 + 1e-12))
    np.testing.assert_allclose(momenta[0], [1, 1, 2, 1])
    assert 0 < np.linalg.norm(torque, axis=1).max() <= facts["largest_torque"] * (1 + 1e-12)
    assert np.linalg.norm(mismatch, axis=1).max() > 1e-4
    header = (out / "table.csv").read_text().splitlines()[0]
    assert "torque_x [N·m]" in header
    assert "momentum_3 [N·m·s]" in header
    page = qtraj("report", out)
    assert page.exit_code == 0, page.output
    text = (out / "report.html").read_text()
    assert "momenta of the wheels" in text
    assert "torque, body axes" in text


def test_a_sequence_is_simulated_and_its_jumps_are_known(qtraj, tmp_path):
    """Without an error the body follows the program through its switches, to the tolerance of a step."""
    slew = "[[program.sequence]]\n[program.sequence.slew]\naxis = [0, 0, 1]\nangle = 9\n"
    up = slew + "start = {rotation_vector = [30, 0, 0]}\nlaw = {max_acceleration = 2, end_rate = 6}\n"
    spin = "[[program.sequence]]\nspin = {rate = [0, 0, 6], duration = 20}\n"
    down = slew + "law = {max_acceleration = 2, start_rate = 6}\n"
    more = "[simulation]\nsamples = 27\nrtol = 1e-8\natol = 1e-10\n"
    (tmp_path / "s.toml").write_text("angles = 'deg'\n" + up + spin + down + LAW + more)
    result = qtraj("simulate", tmp_path / "s.toml", "--json")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert content["program"] == {"description": "sequence of slew, spin, slew", "duration": pytest.approx(26.0)}
    assert max(content["columns"]["angle"]) < 1e-6
    assert content["verdict"]["closed_form"] == "agrees"
