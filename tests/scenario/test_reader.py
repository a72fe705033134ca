"""Scenario files: the embedded one, what is optional, and what messages name."""

import hashlib
import inspect
import tomllib
from pathlib import Path

import pytest

import qtraj as qt
from qtraj.scenario import KINDS
from qtraj.scenario.keys import Part
from qtraj.scenario.path import LimitsPart
from qtraj.scenario.path_parts import TunePart
from qtraj.scenario.reader import read_scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
DEFAULT, SLEW, LOOP = (KINDS[name].embedded for name in ("path", "slew", "loop"))
OF_KIND = {
    "bus_route": "route",
    "slew": "slew",
    "slew_through_attitudes": "slew",
    "simulate": "loop",
    "simulate_ramp": "loop",
    "simulate_disturbed": "loop",
}
STATES = """
[start]
position = [12, 0.0, 0.0]
velocity = [0.0, 5.0, 0.0]
[end]
position = [0.0, 12.0, 1.5]
velocity = [-4.5, 0.0, 0.2]
"""


def test_the_embedded_scenario():
    given = read_scenario(None, "path")
    scenario = given.scenario
    assert scenario.limits.limits() == {"curvature": 1 / 22.5, "lateral_acceleration": 1.5}
    assert scenario.purpose.keys() == scenario.limits.limits().keys()
    assert (scenario.tune.objective, scenario.tune.motion) == ("nearest", "hermite")
    assert scenario.track.window == [1093.5, 1099.5]
    assert given.beside(scenario.track.file).is_file()
    assert "CC BY 4.0" in scenario.track.source


def test_the_source_is_that_of_the_recording_itself():
    """The attribution in the scenario has the words of the comment in the recording."""
    given = read_scenario(None, "path")
    comment = given.beside(given.scenario.track.file).read_text().splitlines()
    [attribution] = [line for line in comment if line.startswith("# Source: ")]
    words = attribution.removeprefix("# Source: ").rstrip(".")
    assert words in given.scenario.track.source


@pytest.mark.parametrize("file", [DEFAULT, SLEW, LOOP, *sorted(EXAMPLES.glob("*.toml"))], ids=lambda file: file.stem)
def test_the_hash_is_that_of_the_bytes(file):
    if "format" in tomllib.loads(file.read_text(encoding="utf-8")):
        return  # a saved path or program, not a scenario
    assert (
        read_scenario(file, OF_KIND.get(file.stem, "path")).hash == hashlib.sha256(file.read_bytes()).hexdigest()[:16]
    )


def test_what_is_left_out_has_defaults(read):
    scenario = read(STATES).scenario
    assert scenario.tune == TunePart(objective="nearest", motion=None)
    assert scenario.motion == "uniform"
    assert scenario.limits == LimitsPart()
    assert scenario.start.acceleration is None
    assert scenario.start.position == [12.0, 0.0, 0.0]  # whole numbers are numbers


def test_files_stand_beside_the_scenario(read, tmp_path):
    given = read('path = "saved/path.toml"')
    assert given.beside(given.scenario.path) == tmp_path / "saved" / "path.toml"


def test_a_byte_order_mark_is_no_error(read):
    assert read("\ufeff" + STATES).scenario.end is not None


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_says_what_it_expects(kind):
    def descend(model):
        for name, field in model.model_fields.items():
            yield model.__name__, name, field.description
            for part in [field.annotation, *getattr(field.annotation, "__args__", ())]:
                if isinstance(part, type) and hasattr(part, "model_fields"):
                    yield from descend(part)

    assert [entry for entry in descend(KINDS[kind].model) if not entry[2]] == []


@pytest.mark.parametrize(
    ("file", "kind", "command"),
    [(SLEW, "path", "slew"), (LOOP, "slew", "simulate"), (DEFAULT, "loop", "tune")],
)
def test_a_scenario_of_another_command_is_recognised(file, kind, command):
    with pytest.raises(ValueError, match=f"this is a scenario for `qtraj {command}`"):
        read_scenario(file, kind)


@pytest.mark.parametrize("name", ["slew", "helix"])
def test_a_saved_thing_is_no_scenario(name):
    with pytest.raises(ValueError, match=r"this is a saved (EulerTurn|SpiralHelix), not a scenario"):
        read_scenario(EXAMPLES / f"{name}.toml", "path")


def test_a_misspelt_key_of_the_right_kind_is_named(read):
    """Not taken for a scenario of another command."""
    with pytest.raises(ValueError, match="unknown key 'limit'; did you mean 'limits'"):
        read(STATES + "[limit]\nspeed = 1\n")


def test_several_faults_are_counted_and_the_misspelt_key_comes_first(read):
    with pytest.raises(
        ValueError, match=r"s\.toml: unknown key 'start\.positon'; did you mean 'position'\? \(and 2 more\)"
    ):
        read(STATES.replace("position = [12", "positon = [12") + "[tune]\nstarts = -1\n")


@pytest.mark.parametrize(
    "line", ["friction = [1.0, -1.0]", 'inertia = [1.0, 2.0, "x"]', "inertia = [1.0, 2.0]", "inertia = 'x'"]
)
def test_a_key_with_several_forms_counts_once(read, line):
    with pytest.raises(ValueError, match=f"the key 'vehicle.{line[:7]}.*numbers") as error:
        read(f"{STATES}[vehicle]\nmass = 1.0\n{line}\n")
    assert " more)" not in str(error.value)


STEERING = "[limits]\nsteering_angle = [-0.3, 0.4]\nload_factor = 1.4\n"


def test_limits_on_steering_need_a_wheelbase(read):
    limits = read(f"{STATES}{STEERING}[vehicle]\nmass = 1.0\nwheelbase = 2.7\n").scenario.all_limits(Path)
    assert set(limits.given()) == {"steering_angle_min", "steering_angle_max", "load_factor"}
    assert float(limits.vehicle.wheelbase) == 2.7
    for vehicle, message in (
        ("", r"limits\.steering_angle needs a vehicle: .* with the mass and the wheelbase"),
        ("[vehicle]\nmass = 1.0\n", r"limits\.steering_angle needs .*: set the key 'vehicle\.wheelbase' \[m\]"),
        ("[vehicle]\nmass = 1.0\nwheelbase = 0\n", "'vehicle.wheelbase' .* positive"),
    ):
        with pytest.raises(ValueError, match=message):
            read(STATES + STEERING + vehicle)
    with pytest.raises(ValueError, match=r"steering_angle must be an angle below 1\.5708 rad, but 25 rad"):
        read(STATES + "[limits]\nsteering_angle = 25\n")


def test_a_faulty_entry_is_named_and_its_key_counts_once(read):
    text = STATES.replace("[12, 0.0, 0.0]", "[12, 'x', 'y']") + "[tune]\nstarts = -1\n"
    with pytest.raises(ValueError, match=r"'start\.position\[1\]' has the value 'x': .* \(and 1 more\)$"):
        read(text)


def test_defaults_in_prose_are_those_of_the_search():
    defaults = inspect.signature(qt.tune).parameters
    for name in ("max_steps", "inner_steps"):
        assert str(TunePart.model_fields[name].title).endswith(f"default: {defaults[name].default}")


def test_a_long_value_is_cut(read):
    with pytest.raises(ValueError, match="…: expected three finite") as error:
        read(STATES.replace("[12, 0.0, 0.0]", str(list(range(100)))))
    assert len(str(error.value)) < 300


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_model_a_builder_and_an_embedded_scenario(kind):
    entry = KINDS[kind]
    assert issubclass(entry.model, Part)
    loaded = read_scenario(None, kind)
    assert (loaded.file, loaded.warnings) == (entry.embedded, ())
    assert entry.build(loaded) is not None


RENAMED = """
angles = "deg"
[program.turn]
start = {quaternion = [1, 0, 0, 0]}
end = {rotation_vector = [0, 0, 30]}
law = {max_acceleration = 20}
[law]
settling_time = 3
[error]
gauge = "gibbs"
"""


def test_an_old_key_is_read_and_told(tmp_path):
    (tmp_path / "s.toml").write_text(RENAMED)
    given = read_scenario(tmp_path / "s.toml", "loop")
    assert given.scenario.program.slew.end.rotation_vector == [0.0, 0.0, 30.0]
    assert given.scenario.error.normalization == "gibbs"
    assert given.warnings == tuple(
        f"{tmp_path / 's.toml'}: '{old}' is now '{new}'"
        for old, new in (("program.turn", "program.slew"), ("error.gauge", "error.normalization"))
    )


def test_a_fault_below_an_old_key_is_told_by_the_users_name(tmp_path):
    (tmp_path / "s.toml").write_text(RENAMED.replace("max_acc", "max_ac"))
    with pytest.raises(ValueError, match=r"unknown key 'program\.turn\.law\.max_aceleration'; did you mean"):
        read_scenario(tmp_path / "s.toml", "loop")


def test_an_old_key_beside_the_new_one_is_refused(tmp_path):
    (tmp_path / "s.toml").write_text(RENAMED.replace("[law]", "[program.slew]\n[law]"))
    with pytest.raises(ValueError, match=r"program\.(slew\.start|turn)'"):
        read_scenario(tmp_path / "s.toml", "loop")
