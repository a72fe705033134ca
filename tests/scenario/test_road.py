"""The table [vehicle.road] of scenarios."""

from pathlib import Path

import pytest

import qtraj as qt

STATES = """
[start]
position = [20, 0, 0]
velocity = [1, 7, 0.3]
[end]
position = [0, 28, 1.5]
velocity = [-9.8, -1, 0.1]
[vehicle]
mass = 1000.0
"""


def vehicle(read, text):
    scenario = read(f"{STATES}{text}").scenario
    return scenario.vehicle.vehicle(Path)


def test_a_road_in_a_scenario(read):
    table = "[vehicle.road]\ndistance = [0, 40.0]\nbank = [0, 0.1]\nfriction = [0.8, [0.5, 0.4]]\n"
    expected = qt.Road([0, 40], bank=[0, 0.1], friction=[(0.8, 0.8), (0.5, 0.4)])
    assert vehicle(read, table).road == expected


def test_a_road_in_a_file(read, tmp_path):
    (tmp_path / "road.csv").write_text("distance,friction\n0,0.8\n40,0.4\n")
    file = (tmp_path / "road.csv").as_posix()
    found = vehicle(read, f'[vehicle.road]\nfile = "{file}"\nkind = "step"\n')
    assert found.road == qt.Road([0, 40], friction=[0.8, 0.4], kind="step")


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ("left = [0, 1, 0]", qt.Road(left=(0, 1, 0))),
        ("distance = [0, 9]\nbank = [0, 0.1]\nleft = [0, 1, 0]", qt.Road([0, 9], bank=[0, 0.1], left=(0, 1, 0))),
        ("distance = [0, 9.5]\nleft = [[], [0, 1, 0]]", qt.Road([0, 9.5], left=[None, (0, 1, 0)])),
    ],
)
def test_a_direction_to_the_left(read, table, expected):
    assert vehicle(read, f"[vehicle.road]\n{table}\n").road == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("bank = 0.1\n[vehicle.road]\ndistance = [0]\nbank = [0.1]\n", "both define the bank"),
        ('[vehicle.road]\nfile = "a.csv"\nbank = [0.1]\n', "specify one of them"),
        ("[vehicle.road]\nbank = [0.1]\n", "needs 'distance', or 'file'"),
        ("[vehicle.road]\nbank = [0.1]\nleft = [0, 1, 0]\n", "needs 'distance', or 'file'"),
        ("[vehicle.road]\nleft = [0, 0, 0]\n", "not all zero"),
        ("[vehicle.road]\nleft = [0, 1]\n", "three components"),
        ("[vehicle.road]\ndistance = [1.0]\nbank = [0.1]\n", "the first one is 1 m: subtract it"),
    ],
)
def test_a_wrong_road_is_refused(read, text, message):
    with pytest.raises(ValueError, match=message):
        read(f"{STATES}{text}")
