"""Define the scenario tables of attitude programs for `qtraj simulate`, and build the program."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import AfterValidator

from qtraj.foundation.naming import naming
from qtraj.io.input_file import read_input
from qtraj.io.saved import saved_path, saved_program
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.programs.euler_turn import SlewSequence
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.program_sequence import ProgramSequence
from qtraj.motion.programs.rotation_minimizing import Frame, frame_named, name_of
from qtraj.path.existence import require_defined
from qtraj.path.frame_axes import FRAMES, UPRIGHT
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import AbstractFrame, Upright
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key, one_of, radians, with_hyphens
from qtraj.scenario.path import lay
from qtraj.scenario.reader import scenario_in
from qtraj.scenario.slew import NextSlewPart, SlewPart
from qtraj.scenario.spin import SpinPart

SOURCES = "[{0}.slew], [{0}.spin], path = 'a path scenario or a saved path', or file = 'a saved program'"
MORE = ", or [[program.sequence]]"


class SourcePart(Part):
    """One attitude program: a slew, a spin, the frame of a path, or a saved program."""

    table: ClassVar[str] = "[program]"

    slew: SlewPart | None = key("a slew within limits", None, values="a table [program.slew]")
    spin: SpinPart | None = key("a rotation at a constant rate", None, values="a table [program.spin]")
    path: keys.Text | None = key(
        "a path; the program is the attitude of a frame along it",
        None,
        values="the name of a path scenario or a saved path, relative to the scenario",
    )
    frame: Annotated[str, one_of(FRAMES), AfterValidator(with_hyphens)] | None = key(
        "frame of the path: 'upright' (x forward, y left, z up; the default), 'natural' (tangent, principal normal, "
        "binormal; flips at inflections of the path), 'rotation-minimizing' (zero rate about the tangent) or "
        "'thrust-aligned' (z along the thrust, for multirotors)",
        None,
    )
    up: keys.Vector | None = key("up direction of the upright frame; default: [0, 0, 1]", None)
    heading: keys.Number | None = key(
        "heading of the thrust-aligned frame, from world x towards world y; default: along the velocity",
        None,
        unit="angle",
    )
    file: keys.Text | None = key(
        "a saved program, such as program.toml from `qtraj slew`",
        None,
        values="the name of a saved program, relative to the scenario",
    )

    def _faults(self) -> Iterator[str]:
        if self.path is None and (extra := self.given("frame", "up", "heading")):
            yield f"the key '{extra[0]}' requires a program along a path: add path in {self.table}, or remove the key"
        self.path_frame("rad")  # raises for settings of another frame

    def path_frame(self, angles: str, chosen: str | None = None) -> Frame:
        """Return the frame of the path; a `chosen` frame overrides the frame of the scenario."""
        own = self.frame or UPRIGHT
        if chosen not in (None, own):
            return frame_named(chosen)
        return frame_named(own, self.up, None if self.heading is None else radians(angles) * self.heading)

    def along(self, path: SpiralHelix, chosen: str | None, angles: str) -> FrameProgram:
        """Return the frame of a path as a program; a `chosen` frame overrides the frame of the scenario."""
        frame = self.path_frame(angles, chosen)
        if isinstance(frame, AbstractFrame):
            with naming(f"{self.table}: " if chosen is None else "--frame: "):
                require_defined(path, frame)
        return FrameProgram(path, frame)

    def sources(self) -> list[str]:
        """Return the names of the programs that are specified."""
        return self.given("slew", "spin", "path", "file")

    def describe(self, program: AbstractProgram) -> str:
        """Describe the program as text."""
        if self.path is not None:
            return f"{name_of(program.frame if isinstance(program, FrameProgram) else Upright())} frame of {self.path}"
        if self.spin is not None:
            return "spin"
        if self.file is not None:
            return f"{type(program).__name__} of {self.file}"
        return "sequence of slews" if isinstance(program, SlewSequence) else "slew"


class NextPart(SourcePart):
    """One program of a sequence, which starts with the attitude and the rate of the end of the program before.

    A slew or a spin without a start attitude starts there.
    """

    table: ClassVar[str] = "[[program.sequence]]"

    slew: NextSlewPart | None = key(  # pyright: ignore[reportIncompatibleVariableOverride]
        "a slew within limits", None, values="a table [program.sequence.slew]"
    )
    spin: SpinPart | None = key("a rotation at a constant rate", None, values="a table [program.sequence.spin]")

    def _faults(self) -> Iterator[str]:
        yield from _one_source(self.sources(), SOURCES.format("program.sequence"))
        yield from super()._faults()


class ProgramPart(SourcePart):
    """The attitude program: a slew, a spin, the frame of a path, a saved program, or a sequence of these."""

    sequence: list[NextPart] = key(
        "programs one after the other, such as a slew that ends at the rate of a spin",
        [],
        values="tables [[program.sequence]] with one program each",
    )

    def _faults(self) -> Iterator[str]:
        names = [*self.sources(), *(["sequence"] if self.sequence else [])]
        yield from _one_source(names, SOURCES.format("program").replace(" or file", " file") + MORE)
        yield from super()._faults()
        if self.sequence and (slew := self.sequence[0].slew) is not None and slew.start is None:
            yield "the first program of a sequence needs a start: add [program.sequence.slew.start]"

    def describe(self, program: AbstractProgram) -> str:
        """Describe the program as text."""
        if self.sequence and isinstance(program, ProgramSequence):
            parts = zip(self.sequence, program.programs, strict=True)
            return f"sequence of {', '.join(part.describe(each) for part, each in parts)}"
        return super().describe(program)


def build_program(
    part: ProgramPart, beside: Callable[[str], Path], angles: str, frame: str | None = None
) -> AbstractProgram:
    """Build the program of a scenario; `beside` returns the path of a file, and `frame` overrides the frame of a path.

    **Raises:** OSError if a file cannot be read; ValueError for invalid data.
    """
    if frame is not None and part.path is None:
        raise ValueError(
            f"--frame {frame} requires a program along a path, but [program] has no path: add path in [program], or "
            "omit --frame"
        )
    if not part.sequence:
        return _single(part, beside, angles, "program", None, frame)
    programs: list[AbstractProgram] = []
    for k, each in enumerate(part.sequence):
        start = None if k == 0 else np.asarray(programs[-1](programs[-1].duration).quaternion)
        programs.append(_single(each, beside, angles, f"program.sequence[{k}]", start))
    with naming("[[program.sequence]]: "):
        return ProgramSequence(programs)


def _single(
    part: SourcePart,
    beside: Callable[[str], Path],
    angles: str,
    where: str,
    start: np.ndarray | None,
    frame: str | None = None,
) -> AbstractProgram:
    """Build one program; without a start attitude of its own, it starts with `start`. `where` is for messages."""
    if part.slew is not None:
        with naming(f"in [{where}.slew], "):
            return part.slew.program_within_limits(angles, start)
    if part.spin is not None:
        with naming(f"in [{where}.spin], "):
            return part.spin.program(angles, start)
    if part.path is None:
        return saved_program(beside(str(part.file)))
    given = read_input(beside(part.path))
    path = saved_path(given.file) if given.is_saved else lay(scenario_in(given, "path")).path
    return part.along(path, frame, angles)


def _one_source(names: list[str], expected: str) -> Iterator[str]:
    if len(names) != 1:
        problem = f"there are several programs ({', '.join(names)})" if names else "there is no program"
        yield f"{problem}: specify one of {expected}"
