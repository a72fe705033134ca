"""Limits along the way in scenarios and on the command line: steps, areas, and columns of recordings."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.cli.limit_option import limits
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.scenario.path import lay
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.route import read_retiming, retiming

BY_HAND = 2.0, 6.0, 12.0, 5.0  # acceleration, braking, and the speeds of the zones

TRACK = '[track]\nfile = "drive.csv"\n'
AREA = "{polygon = [[0, 0], [1, 0], [1, 1]], value = 5}"
STATES = "[start]\nposition=[12, 0, 0]\nvelocity=[0, 5, 0]\n[end]\nposition=[0, 12, 1.5]\nvelocity=[-4.5, 0, 0.2]\n"


def by_hand():
    """Return the duration of 100 m from rest to rest, in zones of 12 m/s, 20 m of 5 m/s, and 12 m/s."""
    a, b, fast, slow = BY_HAND
    top = np.sqrt((40 + slow**2 / (2 * b)) / (1 / (2 * a) + 1 / (2 * b)))  # before braking to the slow zone
    first = top / a + (top - slow) / b
    peak = np.sqrt((40 + slow**2 / (2 * a)) / (1 / (2 * a) + 1 / (2 * b)))
    assert top < fast
    assert peak < fast
    return first + 20 / slow + (peak - slow) / a + peak / b


@pytest.fixture
def folder(tmp_path):
    x = np.arange(101.0)
    limit = np.where((x >= 40) & (x < 60), 18.0, 43.2)
    rows = [f"{s / 10:.1f},{s},0,0,{v}" for s, v in zip(x, limit, strict=True)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,x,y,z,limit [km/h]", *rows]))
    return tmp_path


def read(folder, text, options=None):
    (folder / "s.toml").write_text(text, encoding="utf-8")
    return read_retiming(folder / "s.toml", limits(options))


@pytest.mark.parametrize(
    "speed",
    [
        '{column = "limit"}',
        '{column = "limit", unit = "km/h"}',
        "[{from = 0, value = 12}, {from = 40, value = 5}, {from = 60, value = 12}]",
        "[{polygon = [[40, -5], [60, -5], [60, 5], [40, 5]], value = 5}, {polygon = [[-1, -9], [101, -9], [101, 9], "
        "[-1, 9]], value = 12}]",
        "{regions = [{polygon = [[40, -5], [60, -5], [60, 5], [40, 5]], value = 5}], outside = 12}",
    ],
    ids=["column", "column with unit", "steps", "areas", "areas with outside"],
)
def test_scenarios_take_the_time_of_the_closed_form(folder, speed):
    loaded = read(folder, f"{TRACK}[limits]\nspeed = {speed}\nlongitudinal_acceleration = [-6, 2]\n")
    task = retiming(loaded, {})
    timed = qt.retime(task.path, task.limits, start_speed=0.0, end_speed=0.0)
    assert float(timed.duration) == pytest.approx(by_hand(), rel=3e-4)
    assert float(timed.duration) >= by_hand()
    assert timed.certificate.holds
    assert qt.certify(timed.path, task.limits).holds


@pytest.mark.parametrize("option", ["speed=12,5@40,12@60", "speed=12@0,5@40,12@60", "speed=column:limit"])
def test_options_take_the_time_of_the_closed_form(folder, option):
    options = limits([option, "longitudinal_acceleration=-6:2"])
    task = retiming(read_retiming(folder / "drive.csv", options), options)
    timed = qt.retime(task.path, task.limits, start_speed=0.0, end_speed=0.0)
    assert float(timed.duration) == pytest.approx(by_hand(), rel=3e-4)
    assert repr(task.limits.speed) == "Along([0, 40, 60], [12, 5, 12])"


def test_the_command_line_times_a_drive_within_its_column(folder):
    from typer.testing import CliRunner

    from qtraj.cli.main import application

    def run(*args):
        return CliRunner().invoke(application(), [*map(str, args), "--json"], prog_name="qtraj")

    found = run("route", folder / "drive.csv", "--limit", "speed=column:limit", "--out", folder / "out")
    assert found.exit_code == 1
    assert '"broken"' in found.stdout
    for option, text in {
        "speed=column:speed": "no column 'speed'",
        "speed=12,5": "steps such as 13.9,8.3@120",
        "speed=12,5@40,6@30": "ascending",
        "speed=12,-5@40": "positive",
        "speed=column:": "name of a column",
    }.items():
        found = run("retime", folder / "drive.csv", "--limit", option)
        assert found.exit_code == 2
        assert text in " ".join((found.stdout + found.stderr).split())


def test_options_with_sides_and_without_limits():
    found = limits(["longitudinal_acceleration=-6:2,-3:1@50,none@90", "speed=8,none@5", "yaw_rate=column:w:deg/s"])
    assert repr(found["longitudinal_acceleration"]) == "Along([0, 50, 90], [(-6, 2), (-3, 1), (None, None)])"
    assert repr(found["speed"]) == "Along([0, 5], [8, None])"
    assert found["yaw_rate"] == LimitColumn("w", "deg/s")
    assert qt.Limits(speed=found["speed"]).varying == ["speed"]


@pytest.mark.parametrize(
    ("option", "name", "expected"),
    [
        ("lateral_acceleration=9@0m/s,7@30m/s", "lateral_acceleration", qt.BySpeed([0, 30], magnitude=[9, 7])),
        ("longitudinal_acceleration=:3@0m/s,:1@30m/s", "longitudinal_acceleration", qt.BySpeed([0, 30], upper=[3, 1])),
        (
            "longitudinal_acceleration=-6:3@0m/s,-4:1@30m/s",
            "longitudinal_acceleration",
            qt.BySpeed([0, 30], [-6, -4], [3, 1]),
        ),
        (
            "longitudinal_acceleration=-6:2,-3:1@50,none@70",
            "longitudinal_acceleration",
            qt.Along([0, 50, 70], [(-6, 2), (-3, 1), (None, None)]),
        ),
        ("speed=5:", "speed", (5, None)),
    ],
)
def test_options_replace_the_limits_of_a_recording(folder, option, name, expected):
    task = retiming(read_retiming(folder / "drive.csv", limits([option])), {})
    assert repr(task.limits) == repr(qt.Limits(**{name: expected}))


def test_options_by_speed():
    """They are those of a scenario with the same numbers."""
    found = limits(["longitudinal_acceleration=-6:3@0m/s,-4:0.8@30 m/s", "lateral_acceleration=9@0m/s,7@30m/s"])
    assert repr(found["longitudinal_acceleration"]) == "BySpeed([0, 30], lower=[-6, -4], upper=[3, 0.8])"
    assert repr(found["lateral_acceleration"]) == "BySpeed([0, 30], magnitude=[9, 7])"
    upper = limits(["longitudinal_acceleration=:3@0m/s,:0.8@30m/s"])["longitudinal_acceleration"]
    assert repr(upper) == "BySpeed([0, 30], upper=[3, 0.8])"
    assert qt.Limits(**found).varying == list(qt.Limits(**found).given())


@pytest.mark.parametrize(
    ("option", "text"),
    {
        "speed=9@0m/s,7@30m/s": "speed",
        "lateral_acceleration=9@0m/s,7@30": "each with its speed in m/s",
        "lateral_acceleration=9,7@30m/s": "each with its speed in m/s",
        "lateral_acceleration=9@30m/s,7@0m/s": "ascending",
        "lateral_acceleration=9@0km/h,7@30km/h": "speeds in m/s such as 3@0m/s,0.8@30m/s",
        "speed=9,7@30km": "distance in metres, without a unit",
        "longitudinal_acceleration=-6:3@0m/s,2@30m/s": "same sides at all speeds",
        "longitudinal_acceleration=-6:3@0m/s,:2@30m/s": "same sides at all speeds",
        "combined_acceleration=8@0m/s,7@30m/s": "in the table [limits] of a scenario",
    }.items(),
)
def test_wrong_options_by_speed(option, text):
    with pytest.raises(ValueError, match="--limit") as error:
        limits([option])
    assert text in str(error.value)


def test_a_window_starts_with_the_limit_before_it(folder):
    loaded = read(folder, f'{TRACK}window = [4.5, 9.0]\n[limits]\nspeed = {{column = "limit"}}\n')
    assert repr(retiming(loaded, {}).limits.speed) == "Along([0, 15], [5, 12])"


def test_a_spiral_helix_is_tuned_within_the_column_of_its_recording(tmp_path):
    t = np.arange(0, 5.01, 0.1)
    r, angle, limit = 20 + 0.3 * t, 0.36 * t, np.where((t >= 2) & (t < 3.5), 25, 30)
    columns = (t, r * np.cos(angle), r * np.sin(angle), 0.1 * t, limit)
    np.savetxt(tmp_path / "turn.csv", np.stack(columns, 1), delimiter=",", header="t,x,y,z,limit [km/h]", comments="")
    text = '[track]\nfile = "turn.csv"\n[limits]\nspeed = {column = "limit"}\nlateral_acceleration = 2.5\n'
    (tmp_path / "s.toml").write_text(text, encoding="utf-8")
    task = lay(read_scenario(tmp_path / "s.toml", "path"))
    best = task.tuned()
    assert best.converged
    assert best.certificate.holds
    assert best.certificate.worst["speed"][2] == pytest.approx(25 / 3.6)


def test_speeds_without_a_unit_that_are_probably_in_km_per_hour_are_noted(folder):
    (folder / "drive.csv").write_text((folder / "drive.csv").read_text().replace("limit [km/h]", "limit"))
    loaded = read(folder, f'{TRACK}[limits]\nspeed = {{column = "limit"}}\n')
    assert "if they are in km/h, write speed" in " ".join(retiming(loaded, {}).recording.notes)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{STATES}[limits]\nspeed = {{column = 'limit'}}\n", r"limits\.speed is a column of a recording"),
        (f"{TRACK}[limits]\nspeed = {{colum = 'limit'}}\n", "a column {column = …}"),
        (f"{TRACK}[limits]\nspeed = [{{polygon = [[0, 0], [1, 0], [1, 1]]}}]\n", "keys 'polygon' and 'value'"),
        (f"{TRACK}[limits]\nspeed = [{{polygon = [[0, 0], [1, 0]], value = 5}}]\n", "at least three corners"),
        (f"{TRACK}[limits]\nspeed = {{regions = 3}}\n", "list of areas"),
        (f"{TRACK}[limits]\nspeed = {{regions = []}}\n", "at least one pair"),
        (f"{TRACK}[limits]\nspeed = {{regions = [{AREA}], outside = -2}}\n", "must be positive"),
    ],
)
def test_bad_forms_are_named(folder, text, message):
    with pytest.raises(ValueError, match=message):
        read(folder, text)


def test_only_recordings_have_columns(folder):
    found = limits(["speed=column:limit"])
    (folder / "line.csv").write_text("x,y\n0,0\n50,0\n100,0\n")
    with pytest.raises(ValueError, match="needs a recording, but a file of points was given"):
        retiming(read_retiming(folder / "line.csv", found), found)
    qt.Route([0.0, 1.0], [[0, 0, 0], [9, 0, 0]], [[9, 0, 0]] * 2, [[0, 0, 0]] * 2).save(folder / "path.json")
    with pytest.raises(ValueError, match="needs a recording, but a saved path was given"):
        retiming(read_retiming(folder / "path.json", found), found)


def test_scenarios_contain_limits_by_speed(folder):
    curve = "longitudinal_acceleration = {speeds = [0, 10], lower = [-6, -4], upper = [3, 1]}\n"
    ellipse = "combined_acceleration = {braking = 8, accelerating = {speeds = [0], magnitude = [3]}, lateral = 9}\n"
    task = retiming(read(folder, f"{TRACK}[limits]\n{curve}{ellipse}"), {})
    ellipse = qt.Ellipse(8, qt.BySpeed([0], magnitude=[3]), 9)
    motor = qt.BySpeed([0, 10], [-6, -4], [3, 1])
    assert repr(task.limits) == repr(qt.Limits(longitudinal_acceleration=motor, combined_acceleration=ellipse))


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ("combined_acceleration = {braking = 8}", "accelerating is missing"),
        ("combined_acceleration = 3", "braking = …"),
        ("lateral_acceleration = {speeds = [0, 10], magnitude = [1]}", "for each of the 2 speeds"),
        ("speed = {speeds = [0], magnitude = [1]}", r"limits\.speed"),
    ],
)
def test_faulty_limits_by_speed_in_scenarios_are_named(folder, limit, message):
    with pytest.raises(ValueError, match=message):
        read(folder, f"{TRACK}[limits]\n{limit}\n")


def test_the_option_refers_to_scenarios_for_ellipses():
    with pytest.raises(ValueError, match="of a scenario"):
        limits(["combined_acceleration=9"])
    with pytest.raises(ValueError, match=r"combined_acceleration = \{braking = …, accelerating = …, lateral = …\}"):
        limits(["combined_acceleration=9@0m/s"])
