"""`qtraj sweep`: every run against the library, resumed stores, failures, bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray
from tests.cli.loop_scenarios import LAW, SLEW

import qtraj as qt
from qtraj.cli import sweep as command
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.sweep import read_sweep

TURN = """
[start]
position = [10.0, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 10.0, 0.0]
velocity = [-5.0, 0.0, 0.0]
[limits]
curvature = 0.15
lateral_acceleration = 2.0
[tune]
motion = "hermite"
starts = 2
"""
GRID = "[sweep]\nlimits.curvature = {from = 0.1, to = 0.2, steps = 3}\n"


@pytest.fixture
def run(qtraj, tmp_path):
    """Run a scenario, and return the exit code, the content or the error, and the dataset or None."""

    def ran(text, *options, out="out"):
        file = tmp_path / "scenario.toml"
        file.write_text(text)
        result = qtraj("sweep", file, "--out", tmp_path / out, "--workers", 0, "--json", *options)
        store = tmp_path / out / command.STORE
        dataset = xarray.open_zarr(store, chunks=None).load() if (store / "zarr.json").exists() else None
        return result.exit_code, json.loads(result.stdout) if result.stdout else result.stderr, dataset

    return ran


def state(position, velocity):
    return qt.BoundaryState(np.array(position), np.array(velocity))


def test_tuning_is_that_of_the_library(run):
    code, content, dataset = run(
        f"{TURN}{GRID}start.speed = {{values = [4, 6]}}\nend.position.z = {{values = [0.5]}}\n"
    )
    assert code == 0
    assert (content["points"], content["computed"], content["failed"]) == (6, 6, 0)
    assert set(dataset.coords) == {"limits.curvature", "start.speed", "end.position.z"}
    assert dataset["limits.curvature"].attrs["units"] == "m-1"
    assert dataset["duration"].attrs["units"] == "s"
    for k in range(6):
        point = dataset.isel(point=k)
        start = state([10.0, 0.0, 0.0], [0.0, float(point["start.speed"]), 0.0])
        limits = qt.Limits(curvature=float(point["limits.curvature"]), lateral_acceleration=2.0)
        best = qt.tune(start, state([0.0, 10.0, 0.5], [-5.0, 0.0, 0.0]), limits, motion="hermite", starts=2)
        assert float(point["objective"]) == pytest.approx(float(best.objective), rel=1e-6)
        assert float(point["duration"]) == pytest.approx(float(best.path.duration), rel=1e-6)
        assert bool(point["holds"])
    assert content["summary"]["duration"]["minimum"] == dataset["duration"].values.min()


def test_expressions_are_functions_of_other_parameters(run):
    """In any order, with the values of the parameters that they name; the same store completes the same sweep."""
    table = (
        'start.speed = {expression = "2 * end.speed - 1"}\nend.speed = {expression = "sqrt(tune.max_steps) / 2"}\n'
        "tune.max_steps = {values = [64, 100]}\n"
    )
    text = f'{TURN}[sweep]\nrun = "certify"\n{table}'
    code, content, dataset = run(text)
    assert (code, content["failed"]) == (0, 0)
    np.testing.assert_array_equal(dataset["end.speed"], [4.0, 5.0])
    np.testing.assert_array_equal(dataset["start.speed"], [7.0, 9.0])
    assert run(text)[0] == 0
    code, error, _ = run(text.replace("- 1", "- 2"))
    assert code == 2
    assert "start.speed" in error


@pytest.mark.parametrize("name", ["certify", "evaluate", "retime"])
def test_other_runs_of_paths(run, name):
    options = 'outputs = ["lateral_acceleration"]\n' if name == "evaluate" else ""
    text = TURN.replace("curvature = 0.15\n", "") if name == "retime" else TURN
    swept = "limits.lateral_acceleration = {values = [1.0, 2.0, 3.0]}\n"
    code, _, dataset = run(f'{text}[sweep]\nrun = "{name}"\n{options}{swept}')
    assert code == 0
    path = qt.SpiralHelix.hermite(
        state([10.0, 0, 0], [0, 5.0, 0]), state([0, 10.0, 0], [-5.0, 0, 0]), 10 * np.pi / 2 / 5
    )
    if name == "certify":
        checked = [qt.certify(path, qt.Limits(curvature=0.15, lateral_acceleration=x)) for x in (1.0, 2.0, 3.0)]
        np.testing.assert_array_equal(dataset["holds"], [x.holds for x in checked])
        np.testing.assert_allclose(dataset["worst_lateral_acceleration"], checked[0].worst["lateral_acceleration"][1])
    elif name == "evaluate":
        np.testing.assert_allclose(dataset["lateral_acceleration"], 2.5, rtol=1e-9)
    else:  # a circle with a radius of 10 m at its largest speed
        np.testing.assert_allclose(dataset["duration"], 5 * np.pi / np.sqrt(10 * np.array([1.0, 2.0, 3.0])), rtol=2e-3)


def test_retimings_have_own_limits_and_check_those_on_the_shape(run):
    """The path is a quarter of a circle with a radius of 10 m."""
    own = '[[limits.own]]\nname = "pace"\nunit = "m/s"\nexpression = "speed"\nlimit = 3.0\n'
    swept = '[sweep]\nrun = "retime"\nlimits.curvature = {values = [0.05, 0.15]}\n'
    code, _, dataset = run(f"{TURN}{own}{swept}")
    assert code == 0
    np.testing.assert_allclose(dataset["duration"], 5 * np.pi / 3, rtol=1e-3)
    np.testing.assert_array_equal(dataset["holds"], [False, True])


def test_a_recording_is_fitted_once_for_all_limits(run, monkeypatch):
    from qtraj.scenario import KINDS, path_parts

    scenario = KINDS["path"].embedded
    data = scenario.read_text().replace("boreas_right_angle.csv", str(scenario.parent / "boreas_right_angle.csv"))
    fits, fit = [], path_parts.fit
    monkeypatch.setattr(path_parts, "fit", lambda *x, **y: fits.append(1) or fit(*x, **y))
    swept = 'run = "certify"\nlimits.curvature = {from = 0.05, to = 0.08, steps = 4}\n'
    code, _, dataset = run(f"{data}\n[sweep]\n{swept}")
    assert code == 0
    assert len(fits) == 1
    path = KINDS["path"].build(read_scenario(None, "path")).path
    limits = [qt.Limits(curvature=x, lateral_acceleration=1.5) for x in (0.05, 0.06, 0.07, 0.08)]
    np.testing.assert_array_equal(dataset["holds"], [qt.certify(path, x).holds for x in limits])


def test_closed_loops_with_random_errors(run):
    text = f"{SLEW}{LAW}[error]\nrotation_vector = [1.0, 0, 0]\n[simulation]\nduration = 4.0\n"
    text += "[sweep]\nsamples = 5\nerror.rotation_vector.x = {uniform = [1, 9]}\n"
    code, content, dataset = run(text)
    assert code == 0, content
    angles = np.radians(dataset["error.rotation_vector.x"].values)
    np.testing.assert_allclose(dataset["peak_angle"], angles, rtol=1e-9)
    assert (dataset["final_angle"] < 0.02 * angles).all()
    assert dataset["final_angle"].attrs["units"] == "rad"


def test_points_that_are_no_scenario_fail_and_the_rest_is_computed(run):
    swept = 'run = "certify"\nlimits.curvature = {values = [-1.0, 0.05, 0.2]}\n'
    code, content, dataset = run(f"{TURN}[sweep]\n{swept}")
    assert code == 0
    assert content["failed"] == 1
    assert dataset["status"].values.tolist() == [2, 0, 0]
    assert np.isnan(dataset["worst_curvature"].values).tolist() == [True, False, False]
    assert dataset["holds"].values.tolist() == [False, False, False]


def test_the_text_names_the_failed_points(qtraj, tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text(f'{TURN}[sweep]\nrun = "certify"\nlimits.curvature = {{values = [-1.0, 0.05]}}\n')
    result = qtraj("sweep", file, "--out", tmp_path / "out", "--workers", 0)
    assert result.exit_code == 0
    assert "2 of 2 points were computed, of which 1 failed." in result.stdout
    assert "0: limits.curvature = -1 (failed)" in result.stdout
    assert "lateral_acceleration" in result.stdout


def test_an_interrupted_sweep_goes_on_and_another_one_is_refused(run, monkeypatch):
    from qtraj.sweeps import shards

    text = f'{TURN}[sweep]\nrun = "certify"\nshard = 2\nlimits.curvature = {{from = 0.05, to = 0.2, steps = 10}}\n'
    compute, computed = shards.call, []

    def interrupted(*arguments):
        computed.append(len(computed))
        if len(computed) == 4:
            raise KeyboardInterrupt
        return compute(*arguments)

    monkeypatch.setattr(shards, "call", interrupted)
    code, error, _ = run(text)
    assert (code, error) == (130, "interrupted\n")
    monkeypatch.setattr(shards, "call", lambda *x: computed.append(0) or compute(*x))
    code, content, dataset = run(text)
    assert (code, content["computed"]) == (0, 10)
    assert len(computed) == 4 + 2
    _, _, whole = run(text, out="whole")
    xarray.testing.assert_identical(dataset, whole)
    code, error, _ = run(text.replace("steps = 10", "steps = 11"))
    assert code == 2
    assert "this folder contains another sweep, because the parameter 'limits.curvature' differs" in error


def test_shards_that_cannot_be_computed_are_an_error_of_the_run(run, monkeypatch):
    from qtraj.scenario import sweep_runs

    certified = sweep_runs.RUNS["certify"]

    def fragile(tasks):
        if len(tasks) == 2 and float(tasks[0].limits.curvature) > 0.15:
            raise RuntimeError("singular")
        return certified(tasks)

    monkeypatch.setitem(sweep_runs.RUNS, "certify", fragile)
    text = f'{TURN}[sweep]\nrun = "certify"\nshard = 2\nlimits.curvature = {{from = 0.1, to = 0.2, steps = 4}}\n'
    code, content, _ = run(text, "--retries", 0)
    assert code == 1
    assert content["computed"] == 2
    [error] = content["errors"]
    assert (error["first"], error["stop"], error["text"]) == (2, 4, "RuntimeError: singular")


def test_a_dry_run_computes_sizes_and_stores_nothing(run, tmp_path):
    swept = 'run = "certify"\nshard = 500\nlimits.curvature = {from = 0.05, to = 0.2, steps = 1000}\n'
    swept += "limits.lateral_acceleration = {from = 1, to = 3, steps = 1000}\n"
    code, content, dataset = run(f"{TURN}[sweep]\n{swept}", "--dry-run")
    assert (code, dataset) == (0, None)
    assert (content["points"], content["shards"]) == (10**6, 2000)
    assert content["size"] == 10**6 * (2 * 8 + 2 * 8 + 1 + 1)  # parameters, worst values, holds, status
    assert content["seconds"] > 1.0
    assert not (tmp_path / "out").exists()


def test_a_moved_folder_is_the_same_sweep(run, tmp_path):
    (tmp_path / "table.csv").write_text("k\n0.1\n0.2\n")
    text = f'{TURN}[sweep]\nlimits.curvature = {{file = "table.csv", column = "k"}}\n'
    (tmp_path / "scenario.toml").write_text(text)
    task = read_sweep(tmp_path / "scenario.toml")
    other = tmp_path / "other"
    other.mkdir()
    for name in ("scenario.toml", "table.csv"):
        (other / name).write_bytes((tmp_path / name).read_bytes())
    from qtraj.sweeps.digests import digest

    moved = read_sweep(other / "scenario.toml")
    assert digest(moved.function) == digest(task.function)
    assert moved.parameters["limits.curvature"].values.tolist() == [0.1, 0.2]


def test_workers_with_another_folder_find_the_files_of_a_scenario(tmp_path, monkeypatch):
    qt.SpiralHelix([4.0], [0.0, 1.0], [0.0], 2.0).save(tmp_path / "saved.json")
    text = 'path = "saved.json"\n[limits]\nspeed = 9.0\n[sweep]\nrun = "certify"\nlimits.speed = {values = [3.0]}\n'
    (tmp_path / "scenario.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    function = read_sweep(Path("scenario.toml")).function
    monkeypatch.chdir("/")
    assert function({"limits.speed": np.array([3.0, 9.0])})["holds"].tolist() == [False, True]


BAD = [
    (TURN, "a scenario with a table [sweep] was expected"),
    (f"{TURN}[sweep]\nsamples = 3\n", "there are no parameters"),
    (f"{TURN}[sweep]\nlimits.curvature = 0.2\n", "the parameter 'limits.curvature' has the value the float 0.2"),
    (f"{TURN}[sweep]\nsample = 3\nlimits.curvature = {{values = [1]}}\n", "did you mean 'samples'?"),
    (f"{TURN}[sweep]\nlimits.curvature = {{from = 1, to = 2}}\n", "has the keys from, to, but must be"),
    (f"{TURN}[sweep]\nlimits.curvature = {{from = 1, to = 2, steps = 0}}\n", "the parameter 'limits.curvature': "),
    (f"{TURN}[sweep]\nlimits.curvature = {{from = 1, to = 2, steps = true}}\n", "the parameter 'limits.curvature': "),
    (f"{TURN}[sweep]\nlimits.curvature = {{from = 0, to = true, steps = 2}}\n", "the parameter 'limits.curvature': "),
    (f"{TURN}[sweep]\nlimits.curvature = {{values = []}}\n", "the parameter 'limits.curvature': it has no values"),
    (f"{TURN}[sweep]\nlimits.curvature = {{values = [nan]}}\n", "must be finite, but value 0 is not"),
    (f"{TURN}[sweep]\nlimits.curvature = {{uniform = [2, 1]}}\n", "low must be less than high"),
    (f"{TURN}[sweep]\nlimits.curvature = {{normal = [2, 1]}}\n", "is random: add samples, such as samples = 1000"),
    (f'{TURN}[sweep]\nlimits.curvature = {{file = "no.csv", column = "a"}}\n', "no.csv"),
    (f"{TURN}[sweep]\nlimits.curvatur = {{values = [1]}}\n", "did you mean 'curvature'"),
    (f"{TURN}[sweep]\nend.position.w = {{values = [1]}}\n", "must end with x, y or z"),
    (f"{TURN}[sweep]\nplacement.speed.x = {{values = [1]}}\n", "scenario.toml: "),
    (f"{TURN}[sweep]\ntune.starts = {{values = [1.5]}}\n", "tune.starts"),
    (f'{TURN}[sweep]\nrun = "fly"\nlimits.curvature = {{values = [1]}}\n', "the key 'sweep.run' has the value 'fly'"),
    (
        f"{TURN}{GRID}end.position.z = {{from = 0, to = 1, steps = 1000000000000}}\n",
        "a grid has at most 100000000 points",
    ),
    (f"{TURN}{GRID}samples = 1000000000000\nend.position.z = {{uniform = [0, 1]}}\n", "3e+12 points, but a sweep has"),
    (
        f"{TURN}{GRID}samples = 1000000000000\nend.position.z = {{uniform = [0, 1]}}\n",
        "use fewer steps or values, or {uniform = [low, high]} with samples = 1000000 and design = 'sobol'",
    ),
    (f"{TURN}{GRID}samples = 3\n", "no parameter is {uniform = [...]} or {normal = [...]}"),
    (f'{TURN}{GRID}end.speed = {{expression = "0.8 * start.sped"}}\n', "contains 'start.sped', which is no parameter"),
    (f"{TURN}{GRID}end.speed = {{expression = \"__import__('os')\"}}\n", "the parameter 'end.speed': the expression"),
    (f"{TURN}{GRID}end.speed = {{expression = 3}}\n", "but {from, to, steps}"),
    (f'{TURN}{GRID}end.speed = {{expression = "2 * end.speed"}}\n', "depend on each other"),
    (f'{TURN}[sweep]\nend.speed = {{expression = "3"}}\n', "give one of these parameters values"),
    (f'{TURN}{GRID}end.speed = {{expression = "1 / (limits.curvature - 0.1)"}}\n', "values that are not finite"),
    (f'{TURN}{GRID}design = "best"\n', "the key 'sweep.design'"),
]


@pytest.mark.parametrize(("text", "message"), BAD)
def test_bad_input(run, text, message):
    code, error, _ = run(text)
    assert code == 2
    assert message in " ".join(error.split())
    assert error.count("\n") == 1


def test_a_scheduler_that_does_not_answer(run, monkeypatch):
    monkeypatch.setattr(command, "CONNECTION", 0.5)
    code, error, _ = run(f"{TURN}{GRID}", "--scheduler", "tcp://127.0.0.1:1")
    assert code == 2
    assert "there is no Dask scheduler at this address" in error


def test_the_report_has_the_numbers_of_the_store(run, tmp_path):
    code, content, dataset = run(f"name = 'Turns <of a bus>'\n{TURN}{GRID}", "--report")
    assert code == 0
    assert [Path(file).name for file in content["files"]] == ["report.html"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Turns &lt;of a bus&gt;" in page
    assert "limits.curvature</td><td>3</td><td>0.1</td><td>0.2" in page
    assert f"{float(dataset['duration'].max()):.6g}" in page
    assert "<td>successful</td><td>3</td>" in page


def test_closed_loops_with_random_gains(run):
    """With k1 = 4 and k2 < 4 the error is overdamped: it decays more slowly for a smaller k2."""
    text = f"{SLEW}[law]\nk1 = 4.0\nk2 = 4.0\n[error]\nrotation_vector = [1.0, 0, 0]\n[simulation]\nduration = 4.0\n"
    code, content, dataset = run(f"{text}[sweep]\nsamples = 5\nlaw.k2 = {{uniform = [2.0, 3.9]}}\n")
    assert code == 0, content
    order = np.argsort(dataset["law.k2"].values)
    assert (np.diff(np.abs(dataset["final_angle"].values[order])) < 0).all()
    assert dataset["final_angle"].values.min() > 0
