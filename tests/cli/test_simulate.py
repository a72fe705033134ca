"""`qtraj simulate`: the error against independent arithmetic, the findings, the examples, failures."""

import csv
import io
import json
import re
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from rich.console import Console
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.cli import simulate as command
from qtraj.cli.layout import show
from qtraj.foundation.plain import plain
from qtraj.motion.simulation import assess_loop as assessment, loop_verdict
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.loop_verdict import judge_loop
from qtraj.scenario import KINDS
from qtraj.scenario.reader import read_scenario
from qtraj.viz.report.page import report_of
from qtraj.viz.simulation_figure import simulation_figure

from .loop_scenarios import LAW, SLEW

EXAMPLES = Path(__file__).parents[2] / "examples"
FILES = ["solution.toml", "table.nc", "table.csv", "simulation.png", "simulation.svg"]
DEVIATION = 1e-9  # of a closed loop from its closed form at the default tolerances
ROUND_OFF = 1e-12
BETWEEN = 1e-3  # relative, of a linear interpolation between two instants of the table
NEAR_CRITICAL = 1e-6  # relative, of a double eigenvalue: the square root of round-off


@pytest.fixture(scope="module")
def default(qtraj, tmp_path_factory):
    out = tmp_path_factory.mktemp("loop") / "new"
    result = qtraj("simulate", "--json", "--out", out)
    return result, json.loads(result.stdout), out


def columns_of(content):
    return {name: np.array(values, float) for name, values in content["columns"].items()}


def test_the_embedded_loop_follows_its_closed_form(default):
    result, content, out = default
    assert (result.exit_code, result.stderr) == (0, "")
    assert content["finished"]
    assert content["verdict"]["closed_form"] == "agrees"
    assert content["verdict"]["deviation"] < DEVIATION
    assert content["verdict"]["norm_drift"] < DEVIATION
    assert content["files"] == [str(out / name) for name in FILES]
    assert all((out / name).stat().st_size > 500 for name in FILES)


def test_the_error_is_the_exponential_of_a_matrix(default):
    """From the keys of the scenario, without the library: (1 + kt)e^(−kt) = 0.02 at 40 s, so k = 5.834/40."""
    content = default[1]
    columns = columns_of(content)
    k1, k2 = content["law"]["k1"], content["law"]["k2"]
    k = k1 / 2
    assert k2 == pytest.approx(k**2)
    assert (1 + 40 * k) * np.exp(-40 * k) == pytest.approx(0.02)
    mu = Rotation.from_rotvec([20.0, -9.0, 12.0], degrees=True).as_quat(scalar_first=True)
    rate = np.radians([0.3, 0.2, -0.4])
    # 2μ̇ = μ∘(0, Ω): the program is at rest at the start.
    slope = 0.5 * np.array([-mu[1:] @ rate, *(mu[0] * rate + np.cross(mu[1:], rate))])
    move = [expm(np.array([[0.0, 1.0], [-k2, -k1]]) * t)[0] for t in columns["time"][::60]]
    expected = np.array([a * (mu - [1, 0, 0, 0]) + b * slope + [1, 0, 0, 0] for a, b in move])
    assert np.max(np.abs(columns["error"][::60] - expected)) < DEVIATION
    angle = 2 * np.arctan2(np.linalg.norm(expected[:, 1:], axis=1), np.abs(expected[:, 0]))
    assert np.max(np.abs(columns["angle"][::60] - angle)) < DEVIATION


def test_the_findings_follow_from_the_table(default):
    content = default[1]
    columns, found = columns_of(content), content["verdict"]
    assert found["initial_angle"] == pytest.approx(np.radians(25.0))
    assert found["final_angle"] == columns["angle"][-1]
    settled = found["settling_time"]
    assert np.interp(settled, columns["time"], columns["angle"]) == pytest.approx(np.radians(1.0), rel=BETWEEN)
    assert np.all(columns["angle"][columns["time"] > settled] < np.radians(1.0))
    sizes = np.linalg.norm(columns["command"], axis=1)
    assert found["peak_command"] == pytest.approx(sizes.max())
    assert found["peak_time"] == columns["time"][sizes.argmax()]
    assert found["peak_components"] == pytest.approx(np.abs(columns["command"]).max(axis=0), rel=BETWEEN)
    assert found["least_norm"] <= columns["norm"].min() <= columns["norm"].max() <= found["largest_norm"]
    k1, k2 = content["law"]["k1"], content["law"]["k2"]
    assert found["growth"] == pytest.approx(-k1 / 2, rel=NEAR_CRITICAL)
    assert found["stable"]
    # The least |μ| of the closed form, by a dense scan.
    mu, rate = columns["error"][0], columns["rate"][0]
    slope = 0.5 * np.array([-mu[1:] @ rate, *(mu[0] * rate + np.cross(mu[1:], rate))])
    dense = qt.error_response(qt.AccelerationLaw(k1, k2), mu, slope, np.linspace(0, 30, 100_001))
    assert found["least_error"] == pytest.approx(np.linalg.norm(dense, axis=1).min(), abs=ROUND_OFF)
    assert found["least_error_exact"]


def test_the_findings_do_not_depend_on_the_table(qtraj, default, tmp_path):
    """601 instants in the scenario, two on the command line."""
    few = json.loads(qtraj("simulate", "--samples", 2, "--json", "--out", tmp_path / "out").stdout)
    assert few["columns"]["time"] == [0.0, 130.0]
    assert [few["columns"][name][-1] for name in few["columns"]] == [v[-1] for v in default[1]["columns"].values()]
    assert few["verdict"] == default[1]["verdict"]
    assert few["verdict"]["instants"] > 1200
    assert few["result"] == default[1]["result"]


@pytest.fixture(scope="module")
def simulated():
    task = KINDS["loop"].build(read_scenario(None, "loop"))
    return task, *qt.assess_loop(**task.arguments())


def test_a_jump_of_the_command_is_seen_from_both_sides(simulated):
    """Of bang–coast–bang: at 90 s the program begins to brake."""
    _, history, _ = simulated
    at = int(np.searchsorted(history.times, 90.0))
    assert history.times[at] == pytest.approx(90.0)
    assert history.times[at] - history.times[at - 1] < 1e-6
    before, after = np.linalg.norm(np.asarray(history.solution.physical_command), axis=1)[at - 1 : at + 1]
    assert after - before == pytest.approx(np.radians(0.05), rel=1e-2)


def printed(content, found):
    screen = Console(file=io.StringIO(), width=80)
    show(screen, command._text(content, found, Actuator()))
    return " ".join(screen.file.getvalue().split())


def test_a_departure_from_the_closed_form_is_no_agreement(simulated, default):
    task, history, good = simulated
    assert good.agrees
    assert 1e-9 < good.bound < 1e-7
    wrong = eqx.tree_at(lambda h: h.solution.error, history, history.solution.error.at[700, 2].add(1e-6))
    found = judge_loop(wrong, task.law, actuator=task.actuator)
    assert (found.applies, found.agrees) == (True, False)
    assert found.deviation == pytest.approx(1e-6, rel=1e-2)
    text = printed(default[1] | {"verdict": plain(found.record())}, found)
    assert "differs from it by 1e-06, relative to the largest |μ|" in text
    assert "exceeds 1.01e-08, the largest value that the tolerances explain" in text


def test_a_passage_near_zero_between_two_instants_is_told(simulated, monkeypatch):
    task, history, _ = simulated
    for least, code in ((0.11, qt.ResultCode.successful), (0.09, qt.ResultCode.near_zero_error)):
        monkeypatch.setattr(loop_verdict, "least_norm", lambda *_, least=least: least)
        found = judge_loop(history, task.law, actuator=task.actuator)
        assert (int(found.code), float(found.least_error)) == (code, least)


def test_an_unstable_loop_is_reported_on_the_terminal(simulated, default):
    unstable = eqx.tree_at(lambda v: v.growth, simulated[2], jnp.asarray(0.25))
    text = printed(default[1], unstable)
    assert "The closed loop is unstable: with these gains the error grows as exp(0.25 t)." in text


def test_the_files_hold_the_motion(default):
    _, content, out = default
    dataset = xarray.load_dataset(out / "table.nc")
    for name, values in content["columns"].items():
        assert np.array_equal(dataset[name].values, values)
        assert dataset[name].attrs["units"] == content["units"][name]
    assert dataset.attrs["scenario_sha256"] == read_scenario(None, "loop").hash
    solution = qt.load(out / "solution.toml")
    assert isinstance(solution, qt.Solution)
    assert np.array_equal(solution.quaternion, content["columns"]["quaternion"])
    with (out / "table.csv").open() as file:
        header, *rows = csv.reader(file)
    table = dict(zip(header, np.array(rows, float).T, strict=True))
    assert np.array_equal(table["angle [rad]"], content["columns"]["angle"])
    assert np.array_equal(table["command_x [rad/s²]"], np.array(content["columns"]["command"])[:, 0])
    assert np.array_equal(table["virtual_command [1/s²]"], content["columns"]["virtual_command"])
    assert np.array_equal(solution.virtual_command, content["columns"]["virtual_command"])
    assert np.array_equal(table["virtual_rate [1/s]"], solution.rate[:, 0])


def test_a_path_is_followed(qtraj, tmp_path):
    result = qtraj("simulate", EXAMPLES / "simulate_ramp.toml", "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (0, "")
    text = " ".join(result.stdout.split())
    assert "natural frame of ramp_from_states.toml" in text
    assert "initial error 13°, near sign of λ" in text
    assert "closed form agrees within" in text
    wide = [
        line
        for line in result.stdout.splitlines()
        if len(line) > 80 and not line.startswith(("Scenario:", str(tmp_path)))
    ]
    assert wide == []
    # The program is the trihedral of the path, which turns by a quarter while it climbs.
    program = xarray.load_dataset(tmp_path / "out" / "table.nc")["program_quaternion"].values
    tangent = Rotation.from_quat(program, scalar_first=True).apply([1.0, 0.0, 0.0])
    headings = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    assert headings[-1] - headings[0] == pytest.approx(np.pi / 2)


def test_a_real_loop_has_no_closed_form(qtraj, tmp_path):
    result = qtraj("simulate", EXAMPLES / "simulate_disturbed.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert (result.exit_code, content["finished"]) == (0, True)
    found = content["verdict"]
    assert (found["closed_form"], found["deviation"]) == ("does not apply: a disturbance acts on the body", None)
    assert found["norm_drift"] is None
    columns = columns_of(content)
    commands = np.linalg.norm(columns["command"], axis=1)
    assert commands.max() == pytest.approx(np.radians(4.0))  # the limit
    held = columns["command"][2:5]  # 0.2, 0.3 and 0.4 s: renewed at 0.25 s
    assert not np.array_equal(held[0], held[1])
    assert np.array_equal(held[1], held[2])
    assert found["settling_time"] < 15


def test_a_stop_is_written_and_explained(qtraj, tmp_path):
    """From −λ on the program, μ = −1: the error runs straight through zero, where there is no command."""
    (tmp_path / "s.toml").write_text(SLEW + '[law]\nk1 = 2\nk2 = 1\n[error]\nsign = "far"\n')
    result = qtraj("simulate", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 1
    assert not content["finished"]
    assert "negative scalar part" in content["result"]
    assert "sign = 'auto' in [error]" in content["result"]
    assert content["start"]["sign"] == "far"
    assert content["verdict"]["final_angle"] is None
    assert content["verdict"]["settling_time"] is None
    assert "did not finish" in content["verdict"]["closed_form"]
    assert content["columns"]["angle"][-1] is None
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == sorted(FILES)


def test_a_stiff_law_stops_with_advice_in_terms_of_the_scenario(qtraj, tmp_path):
    (tmp_path / "s.toml").write_text(SLEW + "[law]\nk1 = 1e9\nk2 = 1e9\n")
    result = qtraj("simulate", tmp_path / "s.toml", "--out", tmp_path / "out")
    assert result.exit_code == 1
    text = " ".join(result.stdout.split())
    assert "stopped: too many steps" in text
    assert "Use smaller gains, such as those of settling_time = 1.22 in [law]." in text
    assert "rtol" not in text  # larger tolerances do not help
    (tmp_path / "s.toml").write_text(SLEW + "[law]\nsettling_time = 1.22\n")
    assert qtraj("simulate", tmp_path / "s.toml", "--out", tmp_path / "out").exit_code == 0
    assert "Last instant reached: t = 0 s" in text
    assert "max_steps" not in text


def test_an_interrupt_and_a_folder_that_is_none_leave_nothing(qtraj, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    result = qtraj("simulate", "--out", tmp_path / "file")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "a folder to write into was expected" in result.stderr

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(assessment, "judging_times", interrupted)
    result = qtraj("simulate", "--out", tmp_path / "out")
    assert (result.exit_code, result.stderr) == (130, "interrupted\n")
    monkeypatch.setattr(assessment, "judging_times", lambda times, *_: times.astype(int).item(1) * 10**400 / 3)
    result = qtraj("simulate", "--samples", 3, "--out", tmp_path / "out")
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith("error: a number is too large for the computation (")
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_a_baseline_under_a_constant_disturbance_stays_beside_the_program(qtraj, tmp_path):
    """After the turn Ω̇ = −K1Ω − K2e + d rests where K2 sin Φ = |d|."""
    text = SLEW + '[law]\nkind = "geometric"\nk1 = 4.0\nk2 = 4.0\n[disturbance]\nacceleration = [0, 20, 0]\n'
    (tmp_path / "s.toml").write_text(text + "[simulation]\nduration = 20\nsamples = 21\nsettled = 6\n")
    result = qtraj("simulate", tmp_path / "s.toml", "--out", tmp_path / "out", "--json")
    content = json.loads(result.stdout)
    assert result.exit_code == 0
    found = content["verdict"]
    assert np.sin(found["final_angle"]) == pytest.approx(np.radians(20.0) / 4.0, abs=1e-6)
    assert "not linear" in found["closed_form"]
    assert "closed_form_angle" not in content["columns"]
    assert found["norm_drift"] < DEVIATION  # nothing steers |λ|
    assert found["settling_time"] == 0.0


@pytest.mark.parametrize(
    ("limit", "shown"),
    [("[0.25, 0.25, 0.3]", "0.25, 0.25, 0.3 °/s² along x, y, z"), ("0.3", "0.3 °/s² along each axis")],
)
def test_a_limit_of_each_axis_stands_beside_the_components(qtraj, tmp_path, limit, shown):
    """A magnitude of 0.43 °/s² within limits of 0.25, 0.25 and 0.3 °/s² must not look like a violated limit."""
    scenario = tmp_path / "loop.toml"
    actuator = f"[actuator]\nsaturation = 'axis'\nlimit = {limit}\n"
    error = "[error]\nrotation_vector = [20, 20, 20]\n"
    scenario.write_text(
        SLEW.replace("max_acceleration = 20", "duration = 40\nkind = 'quintic'") + LAW + error + actuator
    )
    out = tmp_path / "out"
    result = qtraj("simulate", scenario, "--out", out, env={"COLUMNS": "140"})
    assert result.exit_code == 0, result.output
    lines = dict(
        re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in result.stdout.splitlines() if "command" in line[:20]
    )
    assert lines["limit of command"] == shown
    along, magnitude = lines["largest command"].split(" °/s² along x, y, z; magnitude ")
    limits = np.broadcast_to(np.fromstring(limit.strip("[]"), sep=","), 3)
    assert np.all(np.fromstring(along, sep=",") <= limits * (1 + 1e-9))
    assert float(magnitude.split()[0]) > limits.max()  # which is why it must not be compared
    dataset = qt.load_dataset(out / "table.nc")
    assert dataset.attrs["saturation"] == "axis"
    report = report_of(dataset)
    [command] = [panel for panel in report.panels if panel.title == "command, body axes"]
    assert [line.name for line in command.series] == ["u₁", "u₂", "u₃"]
    [largest] = [row for row in report.tables[0].rows if row[0].startswith("command")]
    assert largest[0] == "command, each axis [°/s²]"


def test_a_closed_form_that_does_not_apply_is_in_no_picture(qtraj, tmp_path):
    """With a disturbance the closed form is that of another motion: the figure, the page and the table leave it out."""
    scenario = tmp_path / "loop.toml"
    scenario.write_text(SLEW + LAW + "[disturbance]\nacceleration = [0.0, 0.0, 0.5]\n")
    result = qtraj("simulate", scenario, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    dataset = qt.load_dataset(tmp_path / "out" / "table.nc")
    assert dataset.attrs["closed_form"] == "does not apply: a disturbance acts on the body"
    assert "closed form does not apply: a disturbance" in " ".join(result.stdout.split())
    [header] = [line for line in result.stdout.splitlines() if "|λ|" in line and "error" in line and "ω1" in line]
    assert "closed form" not in header
    figure = simulation_figure(dataset, 0.1, None)
    assert not any("closed form" in axes.get_legend_handles_labels()[1] for axes in figure.axes)
    panels = {panel.title: panel for panel in report_of(dataset).panels}
    assert [line.name for line in panels["error angle"].series] == ["angle"]


def test_a_spin_is_a_program(qtraj, tmp_path):
    """A rate in inertial axes; the body starts with the attitude and the rate of the spin."""
    scenario = tmp_path / "loop.toml"
    spin = "[program.spin]\nrate = [0, 20, 0]\naxes = 'inertial'\nduration = 9\nstart.mrp = [0.1, 0, 0]\n"
    scenario.write_text('angles = "deg"\n' + spin + LAW + "[simulation]\nsamples = 10\n")
    result = qtraj("simulate", scenario, "--json", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    with xarray.open_dataset(tmp_path / "out" / "table.nc") as table:
        found = Rotation.from_quat(np.asarray(table["quaternion"]), scalar_first=True)
        assert float(np.abs(table["angle"]).max()) < 1e-8
    turned = Rotation.from_rotvec(np.radians([[0, 20.0 * t, 0] for t in range(10)]))
    assert (found.inv() * turned * Rotation.from_mrp([0.1, 0, 0])).magnitude().max() < 1e-7


def test_the_open_loop_beside_the_feedback(qtraj, tmp_path):
    """A disturbance about the axis of the slew is integrated twice, exactly; the feedback leaves d/k2."""
    scenario = tmp_path / "loop.toml"
    disturbance = "[disturbance]\nacceleration = [0, 0, 0.3]\n"
    scenario.write_text(SLEW + LAW + disturbance + "[simulation]\nduration = 8\nsamples = 9\n")
    result = qtraj("simulate", scenario, "--open-loop", "--json", "--out", tmp_path / "out")
    content = json.loads(result.stdout)
    expected = 0.5 * np.radians(0.3) * np.arange(9.0) ** 2
    np.testing.assert_allclose(columns_of(content)["open_loop_angle"], expected, atol=1e-8)
    assert content["open_loop"]["final_angle"] == pytest.approx(expected[-1])
    assert content["open_loop"]["largest_angle"] == pytest.approx(expected[-1])
    assert content["verdict"]["final_angle"] < 0.02 * expected[-1]
    with xarray.open_dataset(tmp_path / "out" / "table.nc") as table:
        np.testing.assert_allclose(table["open_loop_angle"], expected, atol=1e-8)
