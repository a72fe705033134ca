"""Evaluate an attitude program at many instants."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.algebra import rotation
from qtraj.algebra.cosines import to_dcm
from qtraj.batch.table import Table
from qtraj.foundation.arrays import as_seconds, require_inside
from qtraj.foundation.namespace import needs_jax, xp
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.frame_axes import MINIMIZING
from qtraj.path.rate_axes import BODY
from qtraj.path.trihedral import AbstractFrame

OUTPUTS = ("quaternion", "rate", "angular_acceleration")
"""The outputs of a program, which are the default; "dcm" is available, too."""

FEW = 512
"""Largest number of instants that are evaluated one by one, without compilation."""


def program_table(
    program: AbstractProgram,
    times: Any,
    outputs: Sequence[str],
    axes: str,
    components: str = "last",
    continuous: bool = False,
    extrapolate: bool = False,
) -> Table:
    """Return the table of the given outputs of a program at `times` (n,) [s]; the arguments are those of `evaluate`.

    **Raises:** ValueError for an output of a path, such as the position, a batch of programs, or times of another shape
    or outside the program.
    """
    if components not in ("last", "first"):
        raise ValueError(f"components must be 'last' or 'first', but {components!r} was given")
    if np.ndim(program.duration):
        raise ValueError("evaluate accepts one program, but a batch was given: map evaluate over it with jax.vmap")
    if others := [name for name in outputs if name not in (*OUTPUTS, "dcm")]:
        raise ValueError(
            f"the output {others[0]!r} belongs to a path, but a program was given; its outputs are "
            f"{', '.join(OUTPUTS)} and dcm. Evaluate program.path for outputs of the path."
        )
    instants = as_seconds(times)
    if instants.ndim != 1 or not instants.size:
        raise ValueError(f"times must have shape (n,) with n ≥ 1 for a program, but shape {instants.shape} was given")
    if not extrapolate:
        require_inside(instants, program.duration, "program")
    few = instants.size <= FEW and not needs_jax(jax.tree.leaves((program, instants)))
    at = (_one_by_one if few else _mapped)(program, instants, axes)
    quaternion = rotation.continuous(at.quaternion) if continuous else at.quaternion
    values: dict[str, Any] = {"quaternion": quaternion, "rate": at.rate, "angular_acceleration": at.acceleration}
    if "dcm" in outputs:
        values["dcm"] = to_dcm(at.quaternion)
    if components == "first":
        values = {name: xp.moveaxis(x, 0, -1) for name, x in values.items()}
    form: Any = {"components": components, "frame": _frame(program), "axes": axes}
    return Table(time=instants, **form, **{name: values[name] for name in outputs})


def _frame(program: AbstractProgram) -> str:
    """Return the name of the frame whose axes are the body axes of a program."""
    if not isinstance(program, FrameProgram):
        return BODY
    return program.frame.name if isinstance(program.frame, AbstractFrame) else MINIMIZING


def _one_by_one(program: AbstractProgram, times: Any, axes: str) -> Attitude:
    attitudes = [program.at(t, axes) for t in times]
    return jax.tree.map(lambda *x: np.stack(x), *attitudes)


@eqx.filter_jit
def _mapped(program: AbstractProgram, times: Any, axes: str) -> Attitude:
    return jax.vmap(lambda t: program.at(t, axes))(times)
