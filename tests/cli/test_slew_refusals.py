"""What `qtraj slew` refuses, and in which words."""

import pytest

from qtraj.scenario import KINDS
from qtraj.scenario.slew import SlewLawPart

from .slew_scenarios import ABOUT, LAW, REST


@pytest.mark.parametrize(
    ("law", "missing"),
    [({}, "max_acceleration"), ({"kind": "s_curve", "max_acceleration": 1.0}, "max_jerk")],
)
def test_laws_say_what_they_need(law, missing):
    with pytest.raises(ValueError, match=f"needs '{missing}', which is missing"):
        SlewLawPart.model_validate(law)


def embedded(kind):
    return KINDS[kind].embedded.read_text(encoding="utf-8")


BAD = {
    "no unit": (REST.replace('angles = "deg"', "") + LAW, ["the key 'angles' is missing", "'deg' or 'rad'"]),
    "another unit": (
        REST.replace('"deg"', '"grad"') + LAW,
        ["the key 'angles' has the value 'grad'", "'deg' or 'rad'"],
    ),
    "no law": (REST, ["the key 'law' is missing", "a table [law]"]),
    "no end": (REST.split("[end]")[0] + LAW, ["the key 'end' is missing"]),
    "no angle": (ABOUT.replace("angle = 450", "") + LAW, ["axis and angle must be specified together"]),
    "no axis": (ABOUT.replace("[0, 0, 2]", "[0, 0, 0]") + LAW, ["axis must not be zero"]),
    "an end twice": (ABOUT + "[end]\ngibbs = [0, 0, 1]\n" + LAW, ["axis and angle describe the whole slew"]),
    "no attitude": (REST.replace("quaternion = [1, 0, 0, 0]", "") + LAW, ["[start]: there is no attitude"]),
    "two attitudes": (
        REST.replace("[end]", "[end]\ngibbs = [0, 0, 1]") + LAW,
        ["[end]: the attitude is specified in"],
    ),
    "a zero quaternion": (REST.replace("[1, 0", "[0, 0") + LAW, ["[start]: the quaternion is zero"]),
    "three components": (
        REST.replace("[1, 0, 0, 0]", "[1, 0, 0]") + LAW,
        ["'start.quaternion' has the value [1, 0, 0]", "four finite numbers"],
    ),
    "angles without a sequence": (
        REST.replace("rotation_vector", "euler") + LAW,
        ["[end]: euler and sequence must be specified together"],
    ),
    "a strange sequence": (
        REST.replace("rotation_vector", "sequence = 'xxy'\neuler") + LAW,
        ["[end]: an Euler sequence must be", "'xxy' was given"],
    ),
    "a misspelt limit": (
        REST + LAW.replace("max_rate", "maxrate"),
        ["unknown key 'law.maxrate'", "did you mean 'max_rate'?"],
    ),
    "the beginning of a limit": (
        "[law]\nmax_acc = 1\n" + REST,
        ["unknown key 'law.max_acc'", "did you mean 'max_acceleration'?"],
    ),
    "a misspelt key in a list": (
        REST + "[[via]]\ngibs = [0, 0, 1]\n" + LAW,
        ["unknown key 'via[0].gibs'", "did you mean 'gibbs'?"],
    ),
    "a text for a component": (
        REST + "[[via]]\ngibbs = [0, 'x', 1]\n" + LAW,
        ["'via[0].gibbs[1]' has the value 'x'", "three finite numbers"],
    ),
    "a negative limit": (REST + LAW.replace("= 1", "= -1"), ["'law.max_rate' has the value -1", "[angle/s]"]),
    "another law": (
        REST + LAW + "kind = 'linear'\n",
        ["'law.kind' has the value 'linear'", "'time_optimal', 's_curve'"],
    ),
    "a jerk of jumps": (REST + LAW + "max_jerk = 1\n", ["[law]: max_jerk cannot be used with a time_optimal slew"]),
    "a jerk of the jumps of a cubic": (
        REST + "[law]\nkind = 'cubic'\nduration = 9\nmax_jerk = 1\n",
        ["[law]: max_jerk cannot be used with a cubic slew", "'quintic'"],
    ),
    "an end rate of a smooth law": (
        REST + LAW + "kind = 'cubic'\nend_rate = 0.1\n",
        ["[law]: 'end_rate' is valid only with kind = 'time_optimal'"],
    ),
    "an end rate beyond the limit": (
        REST + LAW + "end_rate = 3\n",
        ["[law]: |end_rate| must not exceed max_rate, but end_rate = 3.0 and max_rate = 1.0 were given"],
    ),
    "an acceleration that the limit on the rate forbids": (
        REST + "[law]\nkind = 's_curve'\nmax_rate = 1\nmax_acceleration = 2\nmax_jerk = 4\nend_acceleration = 2\n"
        "end_rate = -0.9\n",
        ["[law]: with end_acceleration = 2.0, end_rate = -0.9", "the rate is at -1.4 before the end"],
    ),
    "an end rate a little beyond the limit": (
        REST + LAW + "end_rate = 1.00000001\n",
        ["[law]: |end_rate| must not exceed max_rate, but end_rate = 1.00000001 and max_rate = 1.0 were given"],
    ),
    "an end rate of a chain": (
        REST + "[[via]]\ngibbs = [0, 0, 1]\n" + LAW + "end_rate = 0.1\n",
        ["[law]: a slew sequence is at rest at each attitude", "omit end_rate"],
    ),
    "nothing that takes time": (REST + "[law]\nkind = 'cubic'\n", ["needs a duration or a limit"]),
    "too short a time": (
        REST + LAW + "duration = 100\n",
        ["[law]: a motion of", "but a duration of 100 s was given", "Increase the duration"],
    ),
    "a saved program": (
        "format = 'qtraj/1'\ntype = 'EulerTurn'\n",
        [
            "this is a saved EulerTurn, not a scenario",
            "to simulate a program, write a scenario with file = 'scenario.toml' in [program]",
        ],
    ),
    "a scenario of simulate": (
        KINDS["loop"].embedded.read_text(encoding="utf-8"),
        ["this is a scenario for `qtraj simulate`"],
    ),
    "a scenario of tune": (
        KINDS["path"].embedded.read_text(encoding="utf-8"),
        ["this is a scenario for `qtraj tune`, `qtraj evaluate` and"],
    ),
}


@pytest.mark.parametrize("content", BAD.values(), ids=BAD)
def test_bad_scenarios(qtraj, tmp_path, content):
    text, fragments = content
    file = tmp_path / "scenario.toml"
    file.write_text(text)
    result = qtraj("slew", file, "--out", tmp_path / "out")
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    assert result.stderr.startswith(f"error: {file}: ")
    assert result.stderr.count("\n") == 1
    for fragment in fragments:
        assert fragment in result.stderr
    assert list(tmp_path.iterdir()) == [file]
