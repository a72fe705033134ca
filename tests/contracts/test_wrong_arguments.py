"""Arguments of a wrong type: each public function names the argument, and says what it expects and what was given."""

import numpy as np
import pytest

import qtraj as qt

START, END = qt.BoundaryState([10.0, 0, 0], [-1.0, 8, 0.5]), qt.BoundaryState([9.0, 2, 4], [1.0, 8, 0.5])
PATH = qt.SpiralHelix.hermite(START, END, 4.0)
ROUTE = qt.Route.from_path(PATH)
LIMITS = qt.Limits(speed=20.0, acceleration=40.0)
TIMES = np.linspace(0.0, 4.0, 40)
TRACK = qt.Track(TIMES, np.stack([PATH(t) for t in TIMES]))

CALLS = {
    "SpiralHelix.hermite": (qt.SpiralHelix.hermite, (START, END, 4.0), {0: "start", 1: "end"}),
    "SpiralHelix.from_boundary": (qt.SpiralHelix.from_boundary, (START, END), {0: "start", 1: "end"}),
    "SpiralHelix.between": (qt.SpiralHelix.between, (START, END, 4.0), {0: "start", 1: "end"}),
    "axis_between": (qt.axis_between, (START, END), {0: "start", 1: "end"}),
    "tune": (qt.tune, (START, END, LIMITS), {0: "start", 1: "end", 2: "limits"}),
    "certify": (qt.certify, (PATH, LIMITS), {0: "path", 1: "limits"}),
    "peak": (qt.peak, (PATH, "speed"), {0: "path", 1: "the name of a path quantity"}),
    "trihedral": (qt.trihedral, (PATH, 1.0), {0: "path"}),
    "FrameProgram": (qt.FrameProgram, (PATH,), {0: "path"}),
    "PoseProgram": (qt.PoseProgram, (PATH, qt.FrameProgram(PATH)), {0: "path"}),
    "Route.from_path": (qt.Route.from_path, (PATH,), {0: "path"}),
    "retime": (qt.retime, (PATH, LIMITS), {0: "path", 1: "limits"}),
    "tune_route": (qt.tune_route, (ROUTE, LIMITS), {0: "route", 1: "limits"}),
    "fit": (qt.fit, (TRACK,), {0: "track"}),
    "fit_route": (qt.fit_route, (TRACK,), {0: "track"}),
    "compare_paths": (qt.compare_paths, (PATH, PATH), {0: "before", 1: "after"}),
    "compare_attitude": (qt.compare_attitude, (qt.FrameProgram(PATH), TRACK), {0: "program", 1: "track"}),
    "compare_rates": (qt.compare_rates, (qt.FrameProgram(PATH), TRACK), {0: "program", 1: "track"}),
    "speed_profile": (qt.speed_profile, (None,), {0: "timed"}),
}
WRONG = {
    "None": None,
    "a tuple": ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)),
    "text": "path.toml",
    "an array": np.zeros(3),
    "a result": qt.certify(PATH, LIMITS),
}


@pytest.mark.parametrize(("call", "place"), [(call, place) for call, (_, _, names) in CALLS.items() for place in names])
@pytest.mark.parametrize("wrong", WRONG)
def test_the_message_names_the_argument(call, place, wrong):
    function, arguments, names = CALLS[call]
    if isinstance(WRONG[wrong], type(arguments[place])) and arguments[place] is not None:
        return
    given = [*arguments[:place], WRONG[wrong], *arguments[place + 1 :]]
    with pytest.raises(ValueError, match=f"^{names[place]} must be .*, but .* was given"):
        function(*given)


def test_long_arguments_are_shortened():
    with pytest.raises(ValueError, match="…") as caught:
        qt.certify(list(range(1000)), LIMITS)  # type: ignore[call-overload]
    assert len(str(caught.value)) < 200
