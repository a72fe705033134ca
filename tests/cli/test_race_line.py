"""`qtraj route` of a race line: heading and curvature are compared with the route fitted to its positions."""

import json

import numpy as np
import pytest

RADIUS, COUNT = 50.0, 200
EXACT, CURVED = 1e-5, 1e-5
"""[rad], [1/m] Differences of a fitted circle from the exact one, which is printed with nine decimals."""

WAY = np.linspace(0.0, 1.8 * np.pi * RADIUS, COUNT)
SPEED = np.linspace(10.0, 12.0, COUNT)
HEADER = "s_m; x_m; y_m; psi_rad; kappa_radpm; vx_mps; ax_mps2"


def save(folder, sign=1, header=HEADER, turned=0.0, factor=1.0, scale=1.0):
    """A circle to the left (`sign` 1) or right; psi is 0 along +y, and wrong by `turned` [rad], kappa by a factor."""
    angle = WAY / RADIUS
    x, y = RADIUS * np.sin(angle), sign * RADIUS * (1 - np.cos(angle))
    psi = np.angle(np.exp(1j * (sign * angle - np.pi / 2 + turned))) * scale
    kappa = np.full(COUNT, sign * factor / RADIUS)
    rows = np.column_stack([WAY, x, y, psi, kappa, SPEED, 0 * WAY])
    file = folder / "race.csv"
    lines = ["; ".join(f"{cell:.9f}" for cell in row) for row in rows]
    file.write_text("\n".join(["# 9b3e", "# a race line", f"# {header}", *lines]))
    return file


def run(qtraj, folder, file, *options):
    result = qtraj("route", file, "--json", "--out", folder / "out", *options)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_exact_line_agrees(qtraj, tmp_path, sign):
    """Both senses, and through the jump of psi from π to −π."""
    line = run(qtraj, tmp_path, save(tmp_path, sign))["race_line"]
    assert line["heading_rms"] < EXACT
    assert line["curvature_rms"] < CURVED
    assert line["samples"] == COUNT


def test_wrong_headings_and_curvatures_are_seen(qtraj, tmp_path):
    """A heading from the x axis is wrong by 90°, and a curvature of the other sign by twice its size."""
    line = run(qtraj, tmp_path, save(tmp_path, turned=np.pi / 2, factor=-1.0))["race_line"]
    np.testing.assert_allclose(line["heading_rms"], np.pi / 2, rtol=1e-4)
    np.testing.assert_allclose(line["curvature_rms"], 2 / RADIUS, rtol=1e-4)


def test_units_and_missing_columns(qtraj, tmp_path):
    degrees = save(tmp_path, header=HEADER.replace("psi_rad", "psi_deg").replace("kappa_radpm", "k"), scale=180 / np.pi)
    line = run(qtraj, tmp_path, degrees)["race_line"]
    assert line["heading_rms"] < EXACT
    assert line["curvature_rms"] is None
    neither = save(tmp_path, header=HEADER.replace("psi_rad", "p").replace("kappa_radpm", "k"))
    assert run(qtraj, tmp_path, neither)["race_line"] is None


def test_a_window_is_compared_at_its_own_times(qtraj, tmp_path):
    save(tmp_path)
    scenario = tmp_path / "race.toml"
    scenario.write_text("[track]\nfile = 'race.csv'\nwindow = [5.0, 15.0]\n")
    line = run(qtraj, tmp_path, scenario)["race_line"]
    assert line["heading_rms"] < EXACT
    assert 50 < line["samples"] < COUNT


def test_the_terminal_states_both(qtraj, tmp_path):
    text = qtraj("route", save(tmp_path, turned=0.1), "--out", tmp_path / "out").stdout
    assert "heading: psi_rad, rad, 0 along +y, positive to the left; curvature: kappa_radpm" in text
    assert "left out: ax_mps2\n" in text
    assert "heading           differs by 0.1 rad RMS" in text
    assert "1/m RMS" in text
