"""Sequences of programs and slews with whole turns in scenarios, against the same programs built in Python."""

import numpy as np
import pytest
from tests.cli.loop_scenarios import LAW

import qtraj as qt
from qtraj.scenario import KINDS
from qtraj.scenario.reader import read_scenario

START = "start = {rotation_vector = [30, 0, 0]}\n"
SLEW = "[[program.sequence]]\n[program.sequence.slew]\naxis = [0, 0, 1]\nangle = 9\n"
UP = SLEW + "law = {max_acceleration = 2, end_rate = 6}\n"
SPIN = "[[program.sequence]]\nspin = {rate = [0, 0, 6], duration = 20}\n"
DOWN = SLEW + "law = {max_acceleration = 2, start_rate = 6}\n"
ANGLES = "angles = 'deg'\n"


def test_a_slew_a_spin_and_a_slew(prepared):
    """9° from rest to 6°/s at 2°/s² in 3 s, 120° in 20 s, and 9° to rest in 3 s, about the same body axis."""
    program = prepared(ANGLES + UP + START + SPIN + DOWN + LAW).program
    assert isinstance(program, qt.ProgramSequence)
    np.testing.assert_allclose(program.times, [0, 3, 23, 26], rtol=1e-12)
    first = qt.rotation.from_rotation_vector([np.radians(30), 0, 0])
    for t, angle, rate in [(0, 0, 0), (1.5, 2.25, 3), (3, 9, 6), (13, 69, 6), (23, 129, 6), (26, 138, 0), (40, 138, 0)]:
        at = program(float(t))
        right = qt.quaternion.product(first, qt.rotation.from_rotation_vector([0, 0, np.radians(angle)]))
        assert float(qt.rotation.angle_between(at.quaternion, right)) < 1e-12
        np.testing.assert_allclose(at.rate, [0, 0, np.radians(rate)], atol=1e-13)


def test_a_sequence_that_ends_at_rest_is_simulated_for_longer(prepared):
    longer = LAW + "[simulation]\nduration = 60\n"
    assert prepared(ANGLES + UP + START + SPIN + DOWN + longer).times[-1] == 60.0
    with pytest.raises(ValueError, match="must be at most 23 s, the duration of the program"):
        prepared(ANGLES + UP + START + SPIN + longer)


def test_a_sequence_of_files_and_paths(prepared, tmp_path):
    """The spin turns with a circle at 0.1 rad/s; the saved slew starts where the upright frame ends."""
    path = qt.SpiralHelix([10.0], [0.0, 0.1], [0.0], 5.0)
    path.save(tmp_path / "path.toml")
    turn = qt.FrameProgram(path, qt.Upright())
    qt.Spin([0, 0, 0.1], 4.0, turn(5.0).quaternion).save(tmp_path / "spin.toml")
    files = "[[program.sequence]]\npath = 'path.toml'\n[[program.sequence]]\nfile = 'spin.toml'\n"
    program = prepared(ANGLES + files + LAW).program
    assert float(program.duration) == 9.0
    at = program(9.0)
    np.testing.assert_allclose(
        np.asarray(qt.rotation.to_dcm(at.quaternion))[0], qt.trihedral(path, 9.0).tangent, atol=1e-12
    )
    described = read_scenario(tmp_path / "s.toml", "loop").scenario.program.describe(program)
    assert described == "sequence of upright frame of path.toml, Spin of spin.toml"


def test_a_spin_starts_without_rotation_or_where_the_program_before_ends(prepared):
    alone = prepared(ANGLES + "[[program.sequence]]\nspin = {rate = [0, 0, 6], duration = 15}\n" + SPIN + LAW).program
    np.testing.assert_allclose(alone(0.0).quaternion, [1, 0, 0, 0])
    right = qt.rotation.from_rotation_vector([0, 0, np.radians(90)])
    np.testing.assert_allclose(alone(15.0).quaternion, right, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (UP + SPIN, r"\[program\]: the first program of a sequence needs a start: add \[program.sequence.slew.start\]"),
        (UP + START + SPIN.replace("6]", "7]"), r"\[\[program.sequence\]\]: program 1 of a sequence must start with"),
        (UP + START + "[[program.sequence]]\n", r"\[program.sequence\[1\]\]: there is no program: specify one of"),
        (UP + START + "[program.spin]\nrate = [0, 0, 1]\nduration = 1\n", r"several programs \(spin, sequence\)"),
        (UP + START + SPIN.replace("rate", "rates"), r"unknown key 'program.sequence\[1\].spin.rates'; did you mean"),
        (
            UP + START + SPIN.replace("20", "-1"),
            r"'program.sequence\[1\].spin.duration' has the value -1: expected a pos",
        ),
        (
            UP + START + SPIN + "frame = 'natural'\n",
            r"requires a program along a path: add path in \[\[program.sequence\]\]",
        ),
        (
            UP + START + SPIN.replace("20", "1e16"),
            r"in \[program.sequence\[1\].spin\], the angle of a spin must be at most",
        ),
    ],
)
def test_sequences_that_are_none(prepared, text, message):
    with pytest.raises(ValueError, match=message):
        prepared(ANGLES + text + LAW)


@pytest.mark.parametrize(
    ("keys", "turned"),
    [("angle = 30\nturns = 2", 750), ("turns = -1", -360), ("angle = -90\nturns = 1", 270), ("angle = 400", 400)],
)
def test_whole_turns_of_a_slew(tmp_path, keys, turned):
    text = ANGLES + f"axis = [0, 3, 4]\n{keys}\n[start]\nquaternion = [1, 0, 0, 0]\n[law]\nmax_acceleration = 2\n"
    (tmp_path / "s.toml").write_text(text)
    program = KINDS["slew"].build(read_scenario(tmp_path / "s.toml", "slew"))
    assert float(program.duration) == pytest.approx(2 * np.sqrt(abs(turned) / 2))
    middle = program(0.5 * program.duration)
    right = qt.rotation.from_rotation_vector(np.radians(turned / 2) * np.array([0, 0.6, 0.8]))
    assert float(qt.rotation.angle_between(middle.quaternion, right)) < 1e-9
    rate = np.sign(turned) * np.radians(np.sqrt(2 * abs(turned)))
    np.testing.assert_allclose(middle.rate, rate * np.array([0, 0.6, 0.8]), rtol=1e-9)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ("turns = 1", "axis and angle must be specified together"),
        ("axis = [0, 0, 1]", "axis and angle must be specified together"),
        ("axis = [0, 0, 1]\nturns = 1.5", "the key 'turns' has the value 1.5: expected an integer"),
        ("axis = [0, 0, 1]\nturns = nan", "the key 'turns' has the value nan: expected an integer from -1000000000 to"),
        ("axis = [0, 0, 1]\nturns = 1e9", "has the value 1000000000.0: expected an integer .*, without a point"),
        ("axis = [0, 0, 1]\nturns = 1000000001", "the key 'turns' has the value 1000000001: expected an integer from"),
        ("axis = [0, 0, 1]\nturns = 1\nend = {quaternion = [1, 0, 0, 0]}", "axis and angle describe the whole slew"),
    ],
)
def test_whole_turns_of_no_slew(tmp_path, keys, message):
    others = "\n[start]\nquaternion = [1, 0, 0, 0]\n[law]\nmax_acceleration = 2\n"
    (tmp_path / "s.toml").write_text(ANGLES + keys + others)
    with pytest.raises(ValueError, match=message):
        read_scenario(tmp_path / "s.toml", "slew")
