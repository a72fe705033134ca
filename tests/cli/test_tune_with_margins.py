"""`qtraj tune` and `qtraj sweep` with the tables [spread] and [box]: the library's results, and refusals."""

import json

import numpy as np
import pytest

import qtraj as qt

TURN = """
[start]
position = [20.0, 0.0, 0.0]
velocity = [0.0, 6.0, 0.0]
[end]
position = [0.0, 22.0, 1.0]
velocity = [-6.0, 0.0, 0.2]
[limits]
lateral_acceleration = 1.5
[tune]
motion = "hermite"
starts = 1
"""
SPREAD = "[spread]\nstart_velocity = 0.1\nlimits = {lateral_acceleration = 0.02}\nsamples = 2048\nshare = 0.9\n"
START, END = qt.BoundaryState([20.0, 0, 0], [0, 6.0, 0]), qt.BoundaryState([0, 22.0, 1.0], [-6.0, 0, 0.2])
LIMITS = qt.Limits(lateral_acceleration=1.5)


def tuned(qtraj, folder, text):
    (folder / "s.toml").write_text(text)
    result = qtraj("tune", folder / "s.toml", "--json", "--out", folder / "out")
    return result.exit_code, json.loads(result.stdout) if result.stdout else " ".join(result.stderr.split())


def test_a_spread_is_that_of_the_library(qtraj, tmp_path):
    code, content = tuned(qtraj, tmp_path, TURN + SPREAD)
    spread = qt.Spread(start_velocity=0.1, limits={"lateral_acceleration": 0.02})
    found = qt.robust_tune(START, END, LIMITS, spread, 0.9, samples=2048, motion="hermite", starts=1)
    assert code == 0
    robust = content["robust"]
    assert robust["sampled_share"] == pytest.approx(float(found.sampled_share))
    tight = float(np.asarray(found.limits.lateral_acceleration))
    assert robust["tightened_limits"]["lateral_acceleration"] == pytest.approx(tight)
    assert tight < 1.5
    assert qt.load(tmp_path / "out" / "robust.toml").result == robust["result"]
    saved = qt.load(tmp_path / "out" / "tuning.toml")
    assert float(saved.certificate.worst["lateral_acceleration"][2]) == 1.5  # the specified limit


def test_a_box_is_proved(qtraj, tmp_path):
    code, content = tuned(qtraj, tmp_path, TURN + "[box]\nstart_speed = 0.2\n")
    assert code == 0
    assert content["robust"]["result"].startswith("converged: every limit is proved for all deviations")
    path = qt.load(tmp_path / "out" / "path.toml")
    assert qt.certify_box(path, LIMITS, qt.Box(start_speed=0.2)).holds


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("[spread]\n", "every standard deviation is zero"),
        ("[spread]\nstart_velocity = -0.1\n", "0 or more"),
        ("[spread]\nstart_velocity = [0.1, 0.2]\n", "spread.start_velocity"),
        ("[spread]\nstart_velocty = 0.1\n", "start_velocty"),
        ("[spread]\nlimits = {curvature = 0.1}\n", "spread.limits.curvature is the deviation of a limit that is not"),
        ("[spread]\nstart_velocity = 0.1\nshare = 2.0\n", "'spread.share' has the value 2.0: expected a number from"),
        ("[spread]\nstart_velocity = 0.1\nsamples = 100\n", "the key 'spread.samples': it must be a power of two"),
        ("[spread]\nmass = 100.0\n", "spread.mass is a deviation of the vehicle: add the table [vehicle]"),
        ("[box]\nstart_lateral_speed = 0.1\n", "[box]: start_lateral_speed is only for routes"),
        ("[box]\nlimits = {friction = 0.1}\n", "box.limits.friction is the deviation of a limit that is not in"),
        ("[box]\n", "every deviation is zero"),
        ("[box]\nstart_speed = [0.2, 0.1]\n", "start_speed"),
        ("[box]\nstart_speed = 0.1\n[spread]\nstart_velocity = 0.1\n", "specify one of them"),
    ],
)
def test_bad_deviations_are_refused(qtraj, tmp_path, table, message):
    code, text = tuned(qtraj, tmp_path, TURN + table)
    assert code == 2
    assert message in text
    assert not (tmp_path / "out").exists()


def test_a_sweep_over_a_spread_needs_larger_margins(qtraj, tmp_path):
    pytest.importorskip("zarr")
    (tmp_path / "s.toml").write_text(f"{TURN}{SPREAD}[sweep]\nspread.start_velocity = {{values = [0.05, 0.1]}}\n")
    result = qtraj("sweep", tmp_path / "s.toml", "--json", "--workers", 0, "--out", tmp_path / "out")
    assert result.exit_code == 0
    content = json.loads(result.stdout)
    assert (content["points"], content["failed"]) == (2, 0)
    worst = content["summary"]["worst_lateral_acceleration"]
    assert (worst["maximum_point"], worst["minimum_point"]) == (0, 1)
    assert content["summary"]["sampled_share"]["minimum"] >= 0.88
