"""`qtraj tune`: the default run against the library and against independent arithmetic."""

import csv
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from html import escape
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from rich.console import Console
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.cli import layout
from qtraj.foundation.plain import plain
from qtraj.foundation.size_text import length_text
from qtraj.io.saved import saved_path
from qtraj.scenario.path import lay
from qtraj.scenario.path_parts import TunePart
from qtraj.scenario.reader import read_scenario
from qtraj.viz.report.page import report_of

ROOT = Path(__file__).parents[2]
DATA, EXAMPLES = ROOT / "src" / "qtraj" / "io" / "data", ROOT / "examples"

FILES = {"paths.nc", "path.toml", "tuning.toml", "tuning.png", "tuning.svg"}
LIMITS = {"curvature": 1 / 22.5, "lateral_acceleration": 1.5}
SPLINE = 1e-7  # [m], [m/s] what a cubic spline through 513 samples leaves
ROUND_OFF = 1e-9  # UTM coordinates carry about 1e-9 m

INFEASIBLE = """
[start]
position = [12.0, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 12.0, 1.5]
velocity = [-4.5, 0.0, 0.2]
[placement]
origin = [0.0, 0.0, 0.0]
[limits]
speed = 0.1
lateral_acceleration = 1.8
"""
"""No path is slow enough, and the slowest takes as long as a tuned one may."""


def test_the_default_succeeds_and_writes_its_files(default_run):
    assert default_run.result.exit_code == 0
    assert {file.name for file in default_run.out.iterdir()} == FILES
    assert [str(default_run.out / name) for name in ("paths.nc", "path.toml")] == default_run.content["files"][:2]
    assert all((default_run.out / name).stat().st_size > 500 for name in FILES)


COUNTED = """
import sys
import jax

compiled = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, *_, **__: compiled.append(name) if name.endswith("backend_compile_duration") else None
)
from qtraj.cli.main import main

sys.argv = ["qtraj", "tune"]
try:
    main()
except SystemExit as end:
    sys.exit(end.code or (f"{len(compiled)} compilations" if compiled else 0))
"""
"""A program that runs `qtraj tune`, and fails if JAX compiles anything."""


def test_the_default_compiles_nothing(tmp_path):
    """In a new process, because JAX keeps compiled code."""
    run = subprocess.run([sys.executable, "-c", COUNTED], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "qtraj-out" / "path.toml").exists()


def test_no_progress_where_stderr_is_no_terminal(default_run):
    assert default_run.result.stderr == ""
    assert "\x1b" not in default_run.result.stdout


def test_both_limits_are_broken_before_and_met_after(default_run):
    before, after = default_run.content["before"], default_run.content["tuned"]
    for found, status in ((before, "broken"), (after, "proved")):
        assert found["limit"] == list(LIMITS)
        assert found["bound"] == list(LIMITS.values())
        assert found["status"] == [status] * len(LIMITS)
    assert before["worst_value"] == [pytest.approx(0.05236, abs=5e-5), pytest.approx(2.180, abs=5e-3)]
    for value, limit in zip(after["worst_value"], LIMITS.values(), strict=True):
        assert 0 <= limit - value <= 1e-6 * limit


def test_the_limits_have_their_purposes(default_run):
    purpose = default_run.content["purpose"]
    assert "city bus with a wheelbase L of 6 m" in purpose["curvature"]
    assert "standing passengers" in purpose["lateral_acceleration"]
    assert pytest.approx(0.8) == 6.0**2 / (2 * 22.5)  # the off-tracking that the purpose states


def test_the_json_is_what_the_library_says(default_run):
    tuned = qt.load(default_run.out / "tuning.toml")
    tuning = default_run.content["tuning"]
    assert tuned.converged
    assert tuning == {
        "objective": "nearest",
        "motion": "hermite",
        "method": "sqp",
        "options": {},
        "fixed": [],
        "bounds": {},
        "status": tuned.status,
        "result": tuned.result,
    }
    assert default_run.content["tuned"] == plain(tuned.record())
    assert default_run.content["change"]["duration"][1] == float(tuned.path.duration)
    again = qt.certify(tuned.path, qt.Limits(**LIMITS)).record()
    for name in ("worst_time", "worst_value"):
        assert default_run.content["tuned"][name] == plain(again)[name]


def test_the_saved_path_is_the_tuned_one(default_run):
    path = qt.load(default_run.out / "path.toml")
    tuned = qt.load(default_run.out / "tuning.toml").path
    for a, b in zip(jax.tree.leaves(path), jax.tree.leaves(tuned), strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(saved_path(default_run.out / "tuning.toml").radius, path.radius)
    after = default_run.dataset.sel(path="after")
    positions = jax.vmap(path.position)(jnp.asarray(after["time"].values))
    assert np.max(np.abs(positions - after["position"].values)) < ROUND_OFF


def recording(t0, t1):
    with (DATA / "boreas_right_angle.csv").open() as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    names = ("time", "easting", "northing", "altitude", "vel_east", "vel_north", "vel_up")
    table = np.array([[float(row[name]) for name in names] for row in rows])
    return table[(table[:, 0] >= t0) & (table[:, 0] <= t1)]


def test_the_fit_figures_follow_from_the_recording(default_run):
    """From the rows of the CSV file and the samples of the dataset, without the library."""
    rows = recording(1093.5, 1099.5)
    before = default_run.dataset.sel(path="before")
    fit = default_run.content["fit"]
    times = rows[:, 0] - rows[0, 0]
    offset = CubicSpline(before["time"], before["position"])(times) - rows[:, 1:4]
    tangent = CubicSpline(before["time"], before["velocity"])(times)
    recorded = rows[:, 4:]
    lengths = np.linalg.norm(tangent, axis=1) * np.linalg.norm(recorded, axis=1)
    cosine = np.sum(tangent * recorded, axis=1) / lengths
    assert fit["samples"] == len(rows)
    assert fit["horizontal_rms"] == pytest.approx(np.sqrt(np.mean(offset[:, 0] ** 2 + offset[:, 1] ** 2)), abs=SPLINE)
    assert fit["vertical_rms"] == pytest.approx(np.sqrt(np.mean(offset[:, 2] ** 2)), abs=SPLINE)
    assert fit["direction_rms"] == pytest.approx(np.sqrt(np.mean(np.arccos(cosine) ** 2)), abs=SPLINE)
    radius = np.hypot(*(CubicSpline(before["time"], before["position"])(times)[:, :2] - fit["axis"]).T)
    assert (fit["radius_min"], fit["radius_max"]) == pytest.approx((radius.min(), radius.max()), abs=SPLINE)
    assert np.array_equal(default_run.dataset["recorded_position"].values, rows[:, 1:4])


@pytest.mark.parametrize("when", ["before", "after"])
def test_the_boundary_velocities_follow_from_the_dataset(default_run, when):
    path = default_run.dataset.sel(path=when)
    told, row = default_run.content["change"], ("before", "after").index(when)
    angles = []
    for end, k in enumerate((0, -1)):
        x, y = path["position"].values[k, :2] - default_run.content["fit"]["axis"]
        vx, vy, vz = path["velocity"].values[k]
        r = np.hypot(x, y)
        angles.append(np.arctan2(y, x))
        assert told["velocity"][row][end] == pytest.approx([(x * vx + y * vy) / r, (x * vy - y * vx) / r, vz], abs=1e-8)
    duration = told["duration"][row]
    assert duration == path["time"].values[-1]
    assert told["mean_rate"][row] == pytest.approx(np.mod(angles[1] - angles[0], 2 * np.pi) / duration, abs=1e-8)


FITTED = f"""
[track]
file = "{ROOT / "tests" / "data" / "boreas_bends.csv"}"
window = [78.4, 87.6]
[fit]
motion = "MOTION"
[limits]
lateral_acceleration = 9.0
"""
"""A left bend in which a car slows down by more than half: at a constant rate about an axis it would be much faster."""


@pytest.mark.parametrize(
    ("motion", "status", "words"),
    [
        (
            "uniform",
            "poor_fit",
            "the fitted path differs from the recorded speed by up to 66.1%, more than 50%: the path does not",
        ),
        (
            "hermite",
            "loose_fit",
            "the fitted path differs from the recorded speed by up to 27.1%, more than 25%: the path follows ",
        ),
    ],
)
def test_a_fit_that_misses_its_recording_is_told_everywhere(qtraj, tmp_path, motion, status, words):
    """In red on the terminal, in JSON, in the report and in the exit code, whatever the proof of the limits says."""
    (tmp_path / "s.toml").write_text(FITTED.replace("MOTION", motion))
    out = tmp_path / "out"
    result = qtraj("tune", tmp_path / "s.toml", "--out", out, "--json")
    content = json.loads(result.stdout)
    assert content["tuning"]["status"] == "converged"
    assert result.exit_code == (1 if status == "poor_fit" else 0)
    fit = content["fit"]
    assert (fit["status"], fit["successful"]) == (status, status == "loose_fit")
    assert words in fit["warning"]
    console = Console(file=io.StringIO(), width=1000, force_terminal=True, color_system="standard")
    layout.show(console, layout.fit(lay(read_scenario(tmp_path / "s.toml", "path")).fitted))
    assert f"\x1b[1;31mWarning: {fit['warning']}" in console.file.getvalue()
    assert qtraj("report", out).exit_code == 0
    warning = fit["warning"][0].upper() + fit["warning"][1:]
    assert f'<p class="note warning">Warning: {escape(warning)}</p>' in (out / "report.html").read_text("utf-8")
    table = qtraj("evaluate", tmp_path / "s.toml", "--out", out)
    assert table.exit_code == result.exit_code
    assert words[:40] in " ".join(table.stdout.split())
    assert xarray.load_dataset(out / "table.nc").attrs["fit_status"] == status


def test_the_report_shows_the_fit_as_the_terminal_does(qtraj, default_run, tmp_path):
    assert default_run.content["fit"]["warning"] is None
    assert qtraj("report", default_run.out, "--out", tmp_path).exit_code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    table = page.partition("Fitted spiral-helix against the recording")[2].partition("</table>")[0]
    rows = [re.findall(r"<td[^>]*>([^<]*)", row) for row in re.findall(r"<tr>.*?</tr>", table, flags=re.S)]
    text = shown_default(qtraj, tmp_path).partition("Fitted spiral-helix against the recording")[2]
    terminal = [re.split(r"  +", line.strip(), maxsplit=1) for line in text.partition("Limits")[0].splitlines()]
    assert rows == [line for line in terminal if len(line) == 2]
    assert len(rows) == 10
    assert 'class="note warning"' not in page
    dataset = default_run.dataset
    for name in ("horizontal_rms", "relative_rms", "recorded_turn", "samples"):
        assert float(dataset[f"fit_{name}"]) == default_run.content["fit"][name]
    assert dataset["fit_horizontal_rms"].attrs["units"] == "m"


def shown_default(qtraj, folder):
    """What the terminal shows of the default run."""
    return qtraj("tune", "--out", folder / "shown").stdout


def test_the_terminal_shows_it_all_within_80_columns(qtraj, default_run, tmp_path):
    text = shown_default(qtraj, tmp_path)
    numbers = default_run.content["fit"]
    for fragment in (
        "Right-angle turn for a city bus",
        "Source: Boreas dataset (Burnett et al.",
        "CC BY 4.0",
        f"{length_text(numbers['horizontal_rms'], 3)} RMS",
        f"{length_text(numbers['vertical_rms'], 3)} RMS",
        f"{np.degrees(numbers['direction_rms']):.2f}° RMS",
        f"{length_text(numbers['radius_min'])} to {length_text(numbers['radius_max'])}",
        "V_φ at B",
        f"deviates from the original path by at most {default_run.content['change']['deviation']:.3g} m",
        "The direction of travel changes by 7.1° to the left at A and",
        "mean rate",
        "standing passengers",
        "shown/paths.nc",
    ):
        assert fragment in text
    assert len(re.findall(r"broken", text)) == 2
    assert default_run.content["warning"] is None
    assert not re.findall(r"Fixed|Bounded", text)
    assert len(re.findall(r"active ", text)) >= 2
    wide = [line for line in text.splitlines() if len(line) > 80 and not line.startswith(("Scenario:", str(tmp_path)))]
    assert wide == []


@pytest.mark.parametrize("method", ["lbfgs", "adam"])
def test_a_scenario_chooses_the_method(method):
    ramp = read_scenario(EXAMPLES / "ramp_from_states.toml", "path")
    options = {"max_steps": 50, "inner_steps": 300} | ({"learning_rate": 0.02} if method == "adam" else {})
    tune = TunePart(method=method, **options)
    job = lay(replace(ramp, scenario=ramp.scenario.model_copy(update={"tune": tune})))
    assert (job.part.method, job.part.options) == (method, options)
    arguments = job.tuning()
    assert (arguments["max_steps"], arguments["inner_steps"]) == (50, 300)
    assert arguments["method"] is job.tuning()["method"], "one object, or each call compiles anew"
    assert arguments["method"] == "lbfgs" or callable(arguments["method"].update)


def test_what_cannot_be_met_is_written_and_explained(qtraj, tmp_path):
    (tmp_path / "tight.toml").write_text(INFEASIBLE + "[tune]\nstarts = 2\n")
    out = tmp_path / "out"
    result = qtraj("tune", tmp_path / "tight.toml", "--out", out, "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 1
    assert content["tuning"]["status"] == "infeasible"
    assert "What would help" in content["tuning"]["result"]
    assert content["tuned"]["status"][content["tuned"]["limit"].index("speed")] == "broken"
    assert content["fit"] is None
    assert content["warning"].startswith("The tuned path takes ")
    assert content["warning"].endswith("To keep the path near the original path, use tune.corridor or [tune.bounds].")
    text = qtraj("tune", tmp_path / "tight.toml", "--out", out).stdout
    assert content["warning"] in " ".join(text.split())
    assert qtraj("report", out).exit_code == 0
    assert f'<p class="note">{content["warning"]}</p>' in (out / "report.html").read_text(encoding="utf-8")
    assert {file.name for file in out.iterdir()} == FILES | {"report.html"}


def test_boundary_states_that_disagree_are_tuned_from_the_nearest_rate(qtraj, tmp_path):
    result = qtraj("tune", EXAMPLES / "ramp_from_states.toml", "--out", tmp_path / "out", "--json")
    change = json.loads(result.stdout)["change"]
    assert result.exit_code == 0
    assert change["cylindrical"] == ["V_rho", "V_phi", "V_h"]
    assert [velocity[1] for velocity in change["given_velocity"]] == pytest.approx([5.0, 4.5])
    # Both radii are 12 m: the rate that changes V_φ least is the mean one.
    assert change["mean_rate"][0] == pytest.approx(4.75 / 12)
    assert change["velocity"][0][0][1] == pytest.approx(4.75)


def test_what_the_scenario_fixes_and_bounds_holds(qtraj, tmp_path):
    text = (EXAMPLES / "ramp_from_states.toml").read_text(encoding="utf-8")
    assert "[tune]" in text
    held = text.replace(
        "[tune]", '[tune]\nfixed = ["end.V_h"]\nbounds = {duration = [6.0, 6.5], "start.V_h" = {min = 0.1}}'
    )
    (tmp_path / "held.toml").write_text(held, encoding="utf-8")
    result = qtraj("tune", tmp_path / "held.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    change, tuning = content["change"], content["tuning"]
    after = change["velocity"][1]
    assert after[1][2] == pytest.approx(change["given_velocity"][1][2], abs=ROUND_OFF)
    assert 6.0 - ROUND_OFF <= change["duration"][1] <= 6.5 + ROUND_OFF
    assert after[0][2] >= 0.1 - ROUND_OFF
    assert (tuning["fixed"], tuning["bounds"]) == (["end.V_h"], {"duration": [6.0, 6.5], "start.V_h": [0.1, None]})
    text = qtraj("tune", tmp_path / "held.toml", "--out", tmp_path / "out", env={"COLUMNS": "100"}).stdout
    assert "Fixed: end.V_h.\n" in text
    assert "Bounded: duration from 6 to 6.5 s, start.V_h at least 0.1 m/s.\n" in text
    notes = xarray.load_dataset(tmp_path / "out" / "paths.nc").attrs
    assert (notes["tuning_fixed"], notes["tuning_bounds"][:8]) == ("end.V_h", "duration")


@pytest.mark.parametrize(
    ("given", "job"), [({"max": 0.0}, (None, 0.0)), ({"min": 1}, (1.0, None)), ([0.0, 1.0], (0.0, 1.0))]
)
def test_a_scenario_may_bound_a_variable_on_one_side(given, job):
    ramp = read_scenario(EXAMPLES / "ramp_from_states.toml", "path")
    tune = TunePart.model_validate({"bounds": {"end.V_rho": given}})
    scenario = ramp.scenario.model_copy(update={"tune": tune})
    assert lay(replace(ramp, scenario=scenario)).tuning()["bounds"] == {"end.V_rho": job}


@pytest.mark.parametrize(
    "name",
    [
        "turn_from_recording",
        "helix_slower",
        "free_flyer",
        pytest.param("truck_on_a_ramp", marks=pytest.mark.slow),
    ],
)
def test_the_examples_run(qtraj, tmp_path, name):
    result = qtraj("tune", EXAMPLES / f"{name}.toml", "--out", tmp_path / "out")
    assert result.exit_code == 0
    assert "active" in result.stdout
    assert result.stderr == ""


def test_no_example_is_left_out():
    """Those of `slew`, `simulate` and `route` are run where these commands are tested."""
    scenarios = {"turn_from_recording", "helix_slower", "ramp_from_states", "truck_on_a_ramp", "free_flyer"}
    others = {"slew_through_attitudes", "simulate_ramp", "simulate_disturbed", "bus_route", "bus_timing"}
    assert {file.stem for file in EXAMPLES.glob("*.toml")} == scenarios | others | {"helix", "slew"}


def test_the_command_line_may_choose_motion_and_objective():
    ramp = read_scenario(EXAMPLES / "ramp_from_states.toml", "path")
    job = lay(ramp, "hermite", "smoothest")
    assert (job.motion, job.objective, job.duration) == ("hermite", "smoothest", None)
    # A polynomial angle satisfies both V_φ from the start.
    speeds = [float(jnp.linalg.norm(job.path.velocity(t))) for t in (0.0, float(job.path.duration))]
    assert speeds == pytest.approx([5.0, np.hypot(4.5, 0.2)])
    assert lay(ramp).motion == "uniform"


def test_a_recording_is_fitted_and_tuned_with_a_polynomial_angle(tmp_path):
    """Unless the scenario or the command line says otherwise; between states the rate is constant."""
    text = (EXAMPLES / "turn_from_recording.toml").read_text(encoding="utf-8").replace('"../src', f'"{ROOT}/src')
    plain = re.sub(r"(?m)^motion = .*$", "", text)
    chosen = {"": ("hermite", "hermite"), '\n[tune]\nmotion = "uniform"\n': ("uniform", "uniform")}
    for more, motions in chosen.items():
        (tmp_path / "s.toml").write_text(plain + more, encoding="utf-8")
        given = read_scenario(tmp_path / "s.toml", "path")
        job = lay(given)
        assert (job.motion, "hermite" if len(job.path.angle) == 4 else "uniform") == motions
        assert lay(given, "uniform").path.angle.shape == (2,)
    assert lay(read_scenario(EXAMPLES / "ramp_from_states.toml", "path")).motion == "uniform"


def test_a_path_keeps_its_turns_and_its_duration():
    job = lay(read_scenario(EXAMPLES / "helix_slower.toml", "path"), "hermite")
    assert job.turn == pytest.approx(float(job.path.turn), rel=1e-15)
    assert job.duration == 24.0


def test_an_objective_that_the_limits_do_not_bound_is_bad_input(qtraj, tmp_path):
    (tmp_path / "s.toml").write_text(
        INFEASIBLE.replace("lateral_acceleration = 1.8", "").replace("speed = 0.1", "curvature = 0.1")
    )
    result = qtraj("tune", tmp_path / "s.toml", "--objective", "fastest", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "there is no fastest path" in result.stderr
    assert not (tmp_path / "out").exists()


def test_the_dataset_says_where_it_comes_from(default_run):
    notes = default_run.dataset.attrs
    assert notes["source"] == f"qtraj {qt.__version__}"
    assert notes["scenario_sha256"] == read_scenario(None, "path").hash == default_run.content["scenario"]["sha256"]
    assert "CC BY 4.0" in notes["recording"]
    assert notes["tuning_status"] == "converged"


def test_a_vehicle_stays_upright_and_the_page_has_the_terminals_peaks(default_run):
    """The frame of the results is the upright one, and the peaks in paths.nc are those of the certificates."""
    dataset = default_run.dataset
    assert dataset.attrs["frame"] == default_run.content["frame"] == "upright"
    assert dataset["dcm"].sel(body="up", world="z").values.min() > 0.9
    [limits] = [table for table in report_of(dataset).tables if table.title == "Limits"]
    for row in limits.rows:
        name = row[0].partition(" [")[0].replace(" ", "_")
        found = default_run.content[{"before": "before", "after": "tuned"}[row[1]]]
        k = found["limit"].index(name)
        assert row[2] == f"{found['worst_value'][k]:.6g}"
        assert row[5:] == [f"{found['worst_time'][k]:.4g}", found["status"][k]]
    assert len(limits.rows) == 2 * len(LIMITS)


def test_help_explains_the_frames_where_they_are_chosen(qtraj):
    for command in ("tune", "evaluate", "simulate", "report"):
        text = " ".join(qtraj(command, "--help", env={"COLUMNS": "200"}).stdout.replace("│", " ").split())
        assert "--frame" in text
        for words in (
            "upright (x forward, y left, z up",
            "natural (tangent, principal normal, binormal",
            "zero rate about the tangent",
        ):
            assert words in text, command
