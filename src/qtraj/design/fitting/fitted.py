"""The result of a fit: the path, its residual, and its result code."""

import math
import os
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.fitting.quality import LOOSE, POOR, Quality
from qtraj.design.fitting.radius_bounds import is_at_bound
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.attitude_residual import AttitudeResidual
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.motion.programs.rotation_minimizing import Frame
from qtraj.path.residual import Residual
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import Upright


@storable
class Fitted(AbstractOutcome):
    """The result of `fit`.

    - `path`: the spiral-helix; its time 0 is the time of the first sample.
    - `residual`: the differences between the path and the recording.
    - `code`: a `ResultCode`; `result` explains it and gives advice.
    - `iterations`: the number of steps of the best search.
    - `radius_bounds` [m]: the bounds of the radius on the whole path.
    - `relative_rms`: the RMS horizontal distance divided by the radius of the turn (its length divided by its total
      turning angle). NaN in older documents.
    - `relative_speed`: the largest speed difference divided by the RMS recorded speed. NaN in older documents.
    - `attitude`: for a recording with attitudes, their difference from the upright frame of the path, and the mounting
      of the recorder relative to this frame; otherwise None.
    - `factor` (p, p): a matrix F, such that FFᵀ is the `covariance` of the p parameters; (0, 0) in older documents.
    """

    path: SpiralHelix
    residual: Residual
    code: Int[Array, ""]
    iterations: Int[Array, ""]
    radius_bounds: Float[Array, "2"]
    relative_rms: Scalar
    relative_speed: Scalar
    attitude: AttitudeResidual | None
    factor: Float[Array, "p p"]

    def __init__(
        self,
        path: "SpiralHelix",
        residual: "Residual",
        code: ArrayInput,
        iterations: ArrayInput,
        radius_bounds: ArrayInput,
        relative_rms: ArrayInput = math.nan,
        relative_speed: ArrayInput = math.nan,
        attitude: "AttitudeResidual | None" = None,
        factor: ArrayInput = (),
    ):
        self.path, self.residual = path, residual
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.radius_bounds = as_float(radius_bounds)
        self.relative_rms, self.relative_speed = as_float(relative_rms), as_float(relative_speed)
        self.attitude = attitude
        root = np.asarray(factor, float)
        self.factor = as_float(root if root.ndim == 2 else root.reshape(0, 0))

    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Return the covariance of the p parameters of the path, in SI units.

        They are the axis (x, y) and the ascending coefficients of the radius, the azimuth and the height. The variance
        of the errors is estimated from the residuals, which are assumed to be independent; the bounds of the radius are
        ignored. The errors of the parameters are strongly correlated: `qtraj.uncertainty` computes the standard
        deviations of quantities along the path.
        """
        root = np.asarray(self.factor, float)
        return root @ root.T

    def program(self, frame: Frame | None = None) -> FrameProgram:
        """Return the attitude program along the path with `frame`, by default the upright frame (of a wheeled vehicle).

        `FrameProgram` and `evaluate` use the natural frame by default, but this frame flips at inflections of the path.
        """
        return FrameProgram(self.path, Upright() if frame is None else frame)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result, with advice."""
        code, steps, bounds = (np.asarray(x)[at] for x in (self.code, self.iterations, self.radius_bounds))
        code, span = ResultCode(int(code)), f"{bounds[0]:.4g} to {bounds[1]:.4g} m"
        if code == ResultCode.successful:
            return f"converged in {steps} steps."
        if code == ResultCode.held_by_bounds:
            return (
                f"converged in {steps} steps: the radius is at one of its bounds, {span}, so this window alone does "
                "not determine the axis. Choose a window with one clear bend, or pass other radius_bounds."
            )
        if code == ResultCode.not_converged:
            misfit = self._misfit(at, LOOSE)
            note = f" ({misfit})" if misfit else ""
            return (
                f"not converged after {steps} steps: this may not be the best path with a radius from {span}"
                f"{note}. Choose a window with one clear bend, or pass wider radius_bounds. "
                "A larger max_steps can help only if this number of steps is at least max_steps."
            )
        if code in (ResultCode.loose_fit, ResultCode.poor_fit) and np.isfinite(np.asarray(self.relative_rms)[at]):
            radius, duration = np.asarray(self.path.radius)[at], float(np.asarray(self.path.duration)[at])
            bound_note = (
                f" The radius is at one of its bounds, {span}." if is_at_bound(radius, duration, tuple(bounds)) else ""
            )
            return f"{self._misfit(at, LOOSE if code == ResultCode.loose_fit else POOR)}: {code.text}{bound_note}"
        return code.text

    def _misfit(self, at: tuple[int, ...], threshold: Quality) -> str:
        """Describe the misfits above the threshold."""
        rms, relative, speed = (
            float(np.asarray(x)[at]) for x in (self.residual.horizontal_rms, self.relative_rms, self.relative_speed)
        )
        problems = []
        if not relative <= threshold.rms:
            problems.append(
                f"the RMS distance of {rms:.3g} m is {relative:.1%} of the radius of the turn, more than "
                f"{threshold.rms:.0%}"
            )
        if not speed <= threshold.speed:
            problems.append(
                f"the speed of the fitted path differs from the recorded speed by up to {speed:.1%}, more than "
                f"{threshold.speed:.0%}"
            )
        return " and ".join(problems)

    def record(self) -> Record:
        """Return the variables of the path, of the residual (with the prefix `residual_`), and of the result."""
        path, residual = self.path.record(), self.residual.record()
        variables: dict[str, Any] = {
            **path.variables,
            **{f"residual_{name}": quantity for name, quantity in residual.variables.items()},
            "radius_bounds": Quantity(self.radius_bounds, "m", "bounds of the radius", ("bound",)),
            "relative_rms": Quantity(
                self.relative_rms, "1", "RMS horizontal distance divided by the radius of the turn"
            ),
            "relative_speed": Quantity(
                self.relative_speed, "1", "largest speed difference divided by the RMS recorded speed"
            ),
            "iterations": Quantity(self.iterations, "1", "number of steps of the best search"),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
            "code": Quantity(self.code, "1", "result code of the fit"),
        }
        if self.attitude is not None:
            attitude = self.attitude.record().variables
            variables |= {f"attitude_{name}": quantity for name, quantity in attitude.items() if name != "samples"}
        summary = f"{path.summary}; {residual.summary}"
        return Record(summary, variables, attributes={"frame": "world"}, labels={"bound": ["low", "high"]})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json.
        """
        document.save(self, file)
