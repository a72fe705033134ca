"""Limits on quantities of one's own in scenarios: expressions, all forms of limits, and hostile texts."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.cli.limit_option import limits
from qtraj.scenario.path import lay
from qtraj.scenario.reader import read_scenario
from qtraj.scenario.route import read_retiming, retiming

STATES = "[start]\nposition=[12, 0, 0]\nvelocity=[0, 5, 0]\n[end]\nposition=[0, 12, 1.5]\nvelocity=[-5, 0, 0.2]\n"
CLIMB = "name='climb'\nunit='m/s'\nexpression='velocity[2]'\n"


def read(folder, text):
    (folder / "s.toml").write_text(text, encoding="utf-8")
    return read_scenario(folder / "s.toml", "path")


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("0.8", 0.8),
        ("[-0.2, 0.8]", (-0.2, 0.8)),
        ("{min = -0.2}", (-0.2, None)),
        (
            "[{from = 0, value = [-0.9, 0.9]}, {from = 5, value = [-0.1, 0.8]}]",
            qt.Along([0, 5], [(-0.9, 0.9), (-0.1, 0.8)]),
        ),
        ("{distance = [0, 9], values = [0.9, 0.8], kind = 'linear'}", qt.Along([0, 9], [0.9, 0.8], kind="linear")),
        (
            "{regions = [{polygon = [[0, 0], [9, 0], [9, 9]], value = 0.7}], outside = 0.9}",
            qt.Regions([([(0, 0), (9, 0), (9, 9)], 0.7)], 0.9),
        ),
    ],
    ids=["number", "range", "lower", "steps", "linear", "areas"],
)
def test_every_form_of_limit_is_that_of_python(tmp_path, text, limit):
    task = lay(read(tmp_path, f"{STATES}[[limits.own]]\n{CLIMB}limit = {text}\n[purpose]\nclimb='comfort'\n"))
    found = qt.certify(task.path, task.limits)
    climb = qt.Quantity("climb", "m/s", lambda p: p.velocity[2])
    expected = qt.certify(task.path, qt.Limits(own={climb: limit}))
    assert found.status == expected.status
    assert found.worst == expected.worst
    assert task.limits.own.names[0].quantity == climb


def test_a_column_of_a_recording_limits_an_own_quantity(tmp_path):
    x = np.arange(101.0)
    rows = [f"{s / 10:.1f},{s},0,0,{'' if s < 50 else 9}" for s in x]
    (tmp_path / "drive.csv").write_text("\n".join(["t,x,y,z,top", *rows]))
    (tmp_path / "s.toml").write_text(
        "[track]\nfile='drive.csv'\n[limits]\nspeed=20\n[[limits.own]]\nname='ahead'\nunit='m/s'\n"
        "expression='velocity[0]'\nlimit={column='top'}\n"
    )
    task = retiming(read_retiming(tmp_path / "s.toml", limits(None)), {})
    found = qt.certify(task.path, task.limits)
    assert found.status == {"speed": "proved", "ahead": "broken"}
    assert found.worst["ahead"][2] == 9.0
    assert found.worst["ahead"][0] >= 4.9


@pytest.mark.parametrize(
    ("part", "message"),
    [
        (CLIMB, r"the key 'limits\.own\[0\]\.limit' is missing"),
        (f"{CLIMB}limit='soon'\n", r"'limits\.own\[0\]\.limit.*positive finite number"),
        (f"{CLIMB}limit=[2, 1]\n", r"\[limits\.own\[0\]\]: .*climb"),
        (f"{CLIMB}limit=1\nsides=2\n", "unknown key"),
        (f"{CLIMB}limit={{speeds=[0, 9], magnitude=[1, 2]}}\n", "limit"),
        (CLIMB.replace("climb", "speed") + "limit=1\n", "'speed' of a quantity is taken"),
        (CLIMB.replace("climb", "a b") + "limit=1\n", "must be an identifier"),
        (CLIMB.replace("m/s", "m") + "limit=1\n", "has the unit m/s, but the unit 'm' was given"),
        (CLIMB.replace("velocity[2]", "open(1)") + "limit=1\n", "contains 'open\\(1\\)', but it may contain only"),
        (CLIMB.replace("velocity[2]", "velocity") + "limit=1\n", "must return one number"),
        (CLIMB.replace("velocity[2]", "speed" + "**9" * 300) + "limit=1\n", "power|exponents"),
        (CLIMB.replace("velocity[2]", "(" * 300) + "limit=1\n", "not valid"),
        (CLIMB.replace("velocity[2]", "velocity[2] * vehicle.mass / vehicle.mass") + "limit=1\n", None),
        (f"{CLIMB}limit=1\n[[limits.own]]\n{CLIMB}limit=2\n", "several tables .* with the name 'climb'"),
        (f"{CLIMB}limit={{column='top'}}\n", "column of a recording"),
    ],
)
def test_other_tables_are_refused(tmp_path, part, message):
    text = f"{STATES}[[limits.own]]\n{part}"
    if message is None:
        assert lay(read(tmp_path, text)).limits.own is not None
        return
    with pytest.raises(ValueError, match=message) as caught:
        read(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "s.toml"))


def test_a_parameter_of_a_vehicle_needs_the_vehicle(tmp_path):
    thrust = "name='thrust'\nunit='N'\nexpression='vehicle.mass * (acceleration + [0, 0, 9.81]).norm()'\nlimit=9000\n"
    with pytest.raises(ValueError, match=r"limits\.thrust.*vehicle"):
        read(tmp_path, f"{STATES}[[limits.own]]\n{thrust}")
    task = lay(read(tmp_path, f"{STATES}[vehicle]\nmass=500\n[[limits.own]]\n{thrust}"))
    assert qt.certify(task.path, task.limits).status == {"thrust": "proved"}
