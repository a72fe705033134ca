"""The result of a fit: the path, how well it follows its recording, and how the search ended."""

import math
import os
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.fitting.quality import LOOSE, POOR, Quality
from qtraj.design.fitting.radius_bounds import held
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.attitude_residual import AttitudeResidual
from qtraj.path.residual import Residual
from qtraj.path.spiral_helix import SpiralHelix


@storable
class Fitted(AbstractOutcome):
    """The result of `fit`.

    `path`, the spiral-helix, whose time 0 is the first sample; `residual`, how well it follows the recording; `code`, a
    `ResultCode`, and `result`, its text, which says what to do; `iterations`, the steps of the search that won;
    `relative_rms`, the horizontal root mean square of the distance over the turn's radius (its length over all that it
    turns), and `relative_speed`, the largest difference of speeds over the root mean square of the recorded one (NaN in
    older documents); `radius_bounds` [m], between which the radius is held on the whole path; `attitude`, where the
    recording has attitudes, how they differ from the path's upright frame, and how the recorder is mounted in it.
    """

    path: SpiralHelix
    residual: Residual
    code: Int[Array, ""]
    iterations: Int[Array, ""]
    radius_bounds: Float[Array, "2"]
    relative_rms: Scalar
    relative_speed: Scalar
    attitude: AttitudeResidual | None

    def __init__(
        self,
        path: SpiralHelix,
        residual: Residual,
        code: ArrayInput,
        iterations: ArrayInput,
        radius_bounds: ArrayInput,
        relative_rms: ArrayInput = math.nan,
        relative_speed: ArrayInput = math.nan,
        attitude: AttitudeResidual | None = None,
    ):
        self.path, self.residual = path, residual
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.radius_bounds = as_float(radius_bounds)
        self.relative_rms, self.relative_speed = as_float(relative_rms), as_float(relative_speed)
        self.attitude = attitude

    def explain(self, at: tuple[int, ...]) -> str:
        """How the fit ended, and what to do."""
        code, steps, bounds = (np.asarray(x)[at] for x in (self.code, self.iterations, self.radius_bounds))
        code, span = ResultCode(int(code)), f"{bounds[0]:.4g} to {bounds[1]:.4g} m"
        if code == ResultCode.successful:
            return f"converged in {steps} steps."
        if code == ResultCode.held_by_bounds:
            return f"converged in {steps} steps: the radius is held by its bounds, {span}. {code.text}"
        if code == ResultCode.not_converged:
            return (
                f"not converged after {steps} steps: the numbers of this path are not the best ones with a radius from "
                f"{span}. Pass a larger max_steps or wider radius_bounds, or choose a "
                "window with one clear bend."
            )
        if code in (ResultCode.loose_fit, ResultCode.poor_fit) and np.isfinite(np.asarray(self.relative_rms)[at]):
            radius, duration = np.asarray(self.path.radius)[at], float(np.asarray(self.path.duration)[at])
            by = f" Its radius is held by its bounds, {span}." if held(radius, duration, tuple(bounds)) else ""
            return f"{self._misfit(at, LOOSE if code == ResultCode.loose_fit else POOR)}: {code.text}{by}"
        return code.text

    def _misfit(self, at: tuple[int, ...], most: Quality) -> str:
        """What is beyond the limits of a good fit, and by how much."""
        rms, part, speed = (
            float(np.asarray(x)[at]) for x in (self.residual.horizontal_rms, self.relative_rms, self.relative_speed)
        )
        beyond = []
        if not part <= most.rms:
            beyond.append(f"{rms:.3g} m RMS are {part:.1%} of the turn's radius, more than {most.rms:.0%}")
        if not speed <= most.speed:
            beyond.append(f"its speed differs by {speed:.1%} of the recorded one, more than {most.speed:.0%}")
        return " and ".join(beyond)

    def record(self) -> Record:
        """The path, the residual, each of its names with `residual_` in front, and how the fit ended."""
        path, residual = self.path.record(), self.residual.record()
        variables: dict[str, Any] = {
            **path.variables,
            **{f"residual_{name}": quantity for name, quantity in residual.variables.items()},
            "radius_bounds": Quantity(self.radius_bounds, "m", "bounds of the radius", ("bound",)),
            "relative_rms": Quantity(self.relative_rms, "1", "horizontal root mean square over the turn's radius"),
            "relative_speed": Quantity(
                self.relative_speed, "1", "largest difference of speeds over the recorded root mean square"
            ),
            "iterations": Quantity(self.iterations, "1", "steps of the search that won"),
            "result": Quantity(np.asarray(self.result), "", "how the fit ended"),
            "code": Quantity(self.code, "1", "how the fit ended, as a number"),
        }
        if self.attitude is not None:
            found = self.attitude.record().variables
            variables |= {f"attitude_{name}": quantity for name, quantity in found.items() if name != "samples"}
        summary = f"{path.summary}; {residual.summary}"
        return Record(summary, variables, attributes={"frame": "world"}, labels={"bound": ["low", "high"]})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix.
        """
        document.save(self, file)
