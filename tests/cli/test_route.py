"""`qtraj route`: the embedded drive against the library, planted violations, files, and bad input."""

import gzip
import html
import json
import re
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray

import qtraj as qt
from qtraj.scenario import KINDS

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["paths.nc", "route.json", "fit.json", "certificate.json", "route.png", "route.svg", "report.html"]


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("route") / "out"
    result = qtraj("route", "--out", out, "--json")
    return result, json.loads(result.stdout), out


def recording(file, bump=0.0):
    """A drive on a circle of 50 m at 10 m/s, moved outwards by `bump` [m] for about a second."""
    t = np.linspace(0.0, 20.0, 401)
    radius = 50.0 + bump * np.exp(-(((t - 11.0) / 0.5) ** 2))
    rows = np.stack([t, radius * np.cos(0.2 * t), radius * np.sin(0.2 * t), 0.1 * t], axis=1)
    np.savetxt(file, rows, delimiter=",", header="t,x,y,z", comments="", fmt="%.6f")
    return file


def test_the_embedded_drive_is_that_of_the_library(default):
    result, content, out = default
    assert result.exit_code == 0
    assert [Path(file).name for file in content["files"]] == FILES
    track = qt.read_track(KINDS["route"].embedded.parent / "boreas_right_angle.csv")
    fitted = qt.fit_route(track)
    assert content["fit"]["segments"] == fitted.path.segments
    assert content["fit"]["residual_distance_rms"] == pytest.approx(float(fitted.residual.distance_rms))
    assert content["fit"]["length"] == pytest.approx(float(fitted.path.length()))
    assert np.asarray(qt.load(out / "route.json").position(3.0)) == pytest.approx(np.asarray(fitted.path.position(3.0)))
    assert qt.load(out / "certificate.json").holds
    dataset = xarray.load_dataset(out / "paths.nc")
    assert dataset["path"].values.tolist() == ["route"]
    assert dataset.attrs["frame"] == "upright"
    assert dataset["lateral_acceleration"].attrs["limit"] == 2.5
    assert dataset.sizes["record"] == len(track.times)


def test_the_report_has_the_facts_that_the_terminal_prints(default, qtraj, tmp_path):
    _, content, out = default
    page = (out / "report.html").read_text(encoding="utf-8")
    table = page.partition("<h2>Route against the recording</h2>")[2].partition("</table>")[0]
    rows = dict(re.findall(r"<tr><td>([^<]+)</td><td>([^<]+)</td></tr>", table))
    assert {"length", "segments", "stops", "distance", "prediction error"} <= rows.keys()
    assert rows["segments"].startswith(f"{content['fit']['segments']}, ")
    printed = " ".join(qtraj("route", "--out", tmp_path).stdout.split())
    for name, text in rows.items():
        assert f"{name} {html.unescape(text)}" in printed


def test_the_terminal_shows_it_within_80_columns(qtraj, tmp_path):
    result = qtraj("route", "--out", tmp_path)
    assert result.exit_code == 0
    for text in ("m in 7.881 s", "17, 0.464 s each", "lateral_acceleration", "proved"):
        assert text in result.stdout
    paths = ("Scenario:", str(tmp_path))
    assert [line for line in result.stdout.splitlines() if len(line) > 80 and not line.startswith(paths)] == []


def test_recorded_rates_are_compared(qtraj, tmp_path):
    file = recording(tmp_path / "drive.csv")
    lines = file.read_text().splitlines()
    rows = [f"{line},{0.2 + 0.01 * (-1) ** k}" for k, line in enumerate(lines[1:])]
    file.write_text("\n".join([f"{lines[0]},wz", *rows]))
    result = qtraj("route", file, "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert "0.0100 (" in result.stdout
    assert [line for line in result.stdout.splitlines() if len(line) > 80 and "recorded rates" in line] == []


def test_a_violation_is_found_and_its_place_named(qtraj, tmp_path):
    recording(tmp_path / "drive.csv", bump=0.6)
    scenario = tmp_path / "s.toml"
    scenario.write_text('[track]\nfile = "drive.csv"\n[limits]\nlateral_acceleration = 2.6\nspeed = 20.0\n')
    result = qtraj("route", scenario, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 1
    found = json.loads(result.stdout)["certificate"]
    assert dict(zip(found["limit"], found["status"], strict=True)) == {
        "speed": "proved",
        "lateral_acceleration": "broken",
    }
    assert set(found["broken_limit"]) == {"lateral_acceleration"}
    assert min(found["broken_start"]) > 9.0
    assert max(found["broken_end"]) < 13.0


@pytest.mark.slow
def test_a_route_is_tuned_until_its_limits_are_proved(qtraj, tmp_path):
    recording(tmp_path / "drive.csv", bump=0.3)
    scenario = tmp_path / "s.toml"
    scenario.write_text('[track]\nfile = "drive.csv"\n[limits]\nlateral_acceleration = 2.6\n[tune]\ntube = 0.5\n')
    result = qtraj("route", scenario, "--out", tmp_path / "out", "--json")
    assert result.exit_code == 0, result.output
    content = json.loads(result.stdout)
    assert content["certificate"]["status"] == ["broken"]
    assert content["tuned"]["status"] == ["proved"]
    assert qtraj("report", tmp_path / "out").exit_code == 0
    dataset = xarray.load_dataset(tmp_path / "out" / "paths.nc")
    peak = dataset["lateral_acceleration"].sel(path="after").max()
    assert float(peak) == pytest.approx(2.6, rel=1e-3)
    assert float(peak) <= 2.6
    tuned = qt.load(tmp_path / "out" / "tuning.json").path
    assert np.asarray(qt.load(tmp_path / "out" / "route.json").coefficients) == pytest.approx(
        np.asarray(tuned.coefficients)
    )


def test_a_recording_alone_is_fitted_without_limits(qtraj, tmp_path):
    file = tmp_path / "drive.csv.gz"
    file.write_bytes(gzip.compress(recording(tmp_path / "plain.csv").read_bytes()))
    result = qtraj("route", file, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.stderr
    assert "No limits were checked" in result.stdout
    assert "200 m" in result.stdout
    assert not (tmp_path / "out" / "certificate.json").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[fit]\nsmoothing = 1.0\ntolerance = 0.1\n",
            "smoothing and tolerance were both specified: specify one",
        ),
        ("[tune]\ntube = 1.0\n", "[tune] needs limits: add a table [limits]"),
        ("[limits]\ntorsion = 1.0\n[tune]\n", "does not support limits on torsion"),
        ('[limits]\ncurvature = 1.0\n[tune]\nobjective = "fastest"\n', "needs a limit that bounds the speed"),
        ("[limits]\nspeed = 9.0\n[tune]\nmax_steps = 0\n", "expected an integer, 1 or more"),
        ("[fit]\nspacing = 0\n", "the key 'fit.spacing' has the value 0: expected a positive finite number"),
        ('[purpose]\nspeed = "slow"\n', "there is no limit 'speed' in [limits]"),
        ("[limits]\ncurvatur = 1.0\n", "unknown key 'limits.curvatur'; did you mean 'curvature'?"),
    ],
)
def test_bad_scenarios_are_refused(qtraj, tmp_path, text, message):
    recording(tmp_path / "drive.csv")
    scenario = tmp_path / "s.toml"
    scenario.write_text('[track]\nfile = "drive.csv"\n' + text)
    result = qtraj("route", scenario, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert result.stderr.startswith(f"error: {scenario}: ")
    assert message in result.stderr
    assert not (tmp_path / "out").exists()


def test_the_settings_of_the_tuning_are_passed_on(qtraj, tmp_path, monkeypatch):
    def refuse(route, limits, tube, objective, *, nearest_to, max_steps):
        raise ValueError(f"{tube} {objective} {max_steps}")

    monkeypatch.setattr("qtraj.scenario.route.tune_route", refuse)
    recording(tmp_path / "drive.csv")
    scenario = tmp_path / "s.toml"
    settings = '[limits]\nspeed = 9.0\n[tune]\ntube = 0.3\nobjective = "fastest"\nmax_steps = 17\n'
    scenario.write_text('[track]\nfile = "drive.csv"\n' + settings)
    result = qtraj("route", scenario, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "0.3 fastest 17" in result.stderr


def test_a_damaged_compressed_recording_is_refused(qtraj, tmp_path):
    whole = gzip.compress(recording(tmp_path / "plain.csv").read_bytes())
    for name, content in {"cut.csv.gz": whole[:-20], "plain.csv.gz": b"t,x,y,z\n"}.items():
        (tmp_path / name).write_bytes(content)
        result = qtraj("route", tmp_path / name, "--out", tmp_path / "out")
        assert result.exit_code == 2
        assert "not a complete gzip file" in result.stderr
        assert result.stderr.count("\n") == 1


def test_other_commands_name_it_for_recordings(qtraj, tmp_path):
    result = qtraj("tune", recording(tmp_path / "drive.csv"))
    assert result.exit_code == 2
    assert "`qtraj route` and `qtraj retime` read recordings" in result.stderr


@pytest.mark.slow
def test_the_whole_drive_of_the_examples(qtraj, tmp_path, compiled):
    """7.9 km: how well it is followed, its stops, and which limits of a bus it breaks before it is tuned."""
    jax.clear_caches()
    result = qtraj("route", EXAMPLES / "bus_route.toml", "--out", tmp_path, "--json")
    content = json.loads(result.stdout)
    fit, found, tuned = content["fit"], content["certificate"], content["tuned"]
    assert fit["length"] == pytest.approx(7940.0, abs=5.0)
    assert len(fit["stops"]) == 9
    assert fit["prediction_error"] < 0.009
    assert set(found["status"]) == {"broken"}
    assert set(tuned["status"]) == {"proved"}
    assert np.linalg.norm(np.array(tuned["displacement"])[:, :2], axis=1).max() < 0.75 + 1e-6
    assert (tmp_path / "report.html").stat().st_size < 8e6
    assert not compiled


def test_limits_of_a_recording_are_given_on_the_command_line(qtraj, tmp_path):
    arguments = ["route", EXAMPLES / "drive.csv", "--out", tmp_path / "out"]
    result = qtraj(*arguments, "--limit", "speed=20", "--limit", "lateral_acceleration=9", "--json")
    assert result.exit_code == 0, result.output
    certificate = json.loads(result.stdout)["certificate"]
    assert certificate["limit"] == ["speed", "lateral_acceleration"]
    assert certificate["status"] == ["proved", "proved"]
    broken = qtraj(*arguments, "--limit", "speed=3")
    assert broken.exit_code == 1
    wrong = qtraj(*arguments, "--limit", "sped=3")
    assert wrong.exit_code == 2
    assert "did you mean 'speed'?" in wrong.stderr
    for text in ("speed=nan", "speed=-1", "=3", "speed="):
        refused = qtraj(*arguments, "--limit", text)
        assert refused.exit_code == 2
        assert "--limit" in refused.stderr
