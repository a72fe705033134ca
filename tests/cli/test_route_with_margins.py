"""`qtraj route` and `qtraj sweep` with the tables [spread] and [box]: the library's results, and refusals."""

import json

import numpy as np
import pytest

import qtraj as qt

DRIVE = """
[track]
file = "drive.csv"
[fit]
spacing = 2.0
smoothing = 1e-6
[limits]
lateral_acceleration = 1.75
[tune]
fixed_ends = false
"""
BOX = "[box]\nstart_lateral_speed = 0.05\nlimits = {lateral_acceleration = 0.02}\n"


@pytest.fixture
def routed(qtraj, tmp_path):
    """Return a function that runs the command for a drive with 6 m/s on a circle of 20 m."""
    t = np.linspace(0.0, 8.0, 81)
    rows = np.stack([t, 20 * np.sin(0.3 * t), 20 * np.cos(0.3 * t), 0 * t], axis=1)
    np.savetxt(tmp_path / "drive.csv", rows, delimiter=",", header="t,x,y,z", comments="")

    def run(text, command="route", *options):
        (tmp_path / "s.toml").write_text(text)
        result = qtraj(command, tmp_path / "s.toml", "--json", *options, "--out", tmp_path / "out")
        return result.exit_code, json.loads(result.stdout) if result.stdout else " ".join(result.stderr.split())

    return run


def test_a_box_is_proved(routed, tmp_path):
    code, content = routed(DRIVE + BOX)
    assert code == 0
    assert content["robust"]["result"].startswith("converged: every limit is proved for all deviations")
    assert content["robust"]["tightened_limits"]["lateral_acceleration"] < 1.73
    path, limits = qt.load(tmp_path / "out" / "route.json"), qt.Limits(lateral_acceleration=1.75)
    assert qt.certify_box(path, limits, qt.Box(start_lateral_speed=0.05, limits={"lateral_acceleration": 0.02})).holds
    assert qt.load(tmp_path / "out" / "robust.json").result == content["robust"]["result"]
    shown = qt.load(tmp_path / "out" / "tuning.json").certificate
    assert shown.worst["lateral_acceleration"][2] == 1.75  # the specified limit


def test_a_sweep_over_a_spread_needs_larger_margins(routed):
    pytest.importorskip("zarr")
    spread = "[spread]\nstart_velocity = 0.1\nsamples = 2048\nshare = 0.9\n"
    text = f"{DRIVE}{spread}[sweep]\nspread.start_velocity = {{values = [0.02, 0.06]}}\n"
    code, content = routed(text, "sweep", "--workers", 0)
    assert code == 0
    assert (content["points"], content["failed"]) == (2, 0)
    worst = content["summary"]["worst_lateral_acceleration"]
    assert (worst["maximum_point"], worst["minimum_point"]) == (0, 1)
    assert content["summary"]["sampled_share"]["minimum"] >= 0.89


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            "[spread]\nstart_velocity = 0.1\nshare = 2.0\n",
            "'spread.share' has the value 2.0: expected a number from 0.5",
        ),
        ("[spread]\nstart_velocity = 0.1\nsamples = 100\n", "the key 'spread.samples': it must be a power of two"),
        ("[spread]\nmass = 10.0\n", "spread.mass is a deviation of the vehicle: add the table [vehicle]"),
        ("[spread]\nlimits = {curvature = 0.1}\n", "spread.limits.curvature is the deviation of a limit that is not"),
        ("[spread]\nstart_velocity = nan\n", "spread.start_velocity"),
        ("[box]\nstart_axial_speed = 0.1\n", "[box]: start_axial_speed is only for spiral-helices"),
        ("[box]\nstart_speed = [0.2, 0.1]\n", "[box]: start_speed must be a number of 0 or more"),
        ("[box]\nstart_speed = inf\n", "box.start_speed"),
        ("[box]\ndrag_area = 1.0\n", "box.drag_area is a deviation of the vehicle"),
        ("[box]\nlimits = {speed = 0.1}\n", "box.limits.speed is the deviation of a limit"),
        ("[box]\nfriction = 0.1\n", "unknown key 'box.friction'"),
        (f"{BOX}[spread]\nstart_velocity = 0.1\n", "specify one of them"),
    ],
)
def test_bad_deviations_are_refused(routed, tmp_path, table, message):
    code, text = routed(DRIVE + table)
    assert code == 2
    assert message in text
    assert not (tmp_path / "out").exists()


def test_deviations_need_a_tuning(routed):
    code, text = routed(DRIVE.replace("[tune]\nfixed_ends = false\n", "") + BOX)
    assert code == 2
    assert "[box] is for a tuning: add the table [tune]" in text
