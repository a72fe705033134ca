"""The result of a fit: the path, how well it follows its recording, and how the search ended."""

import os
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput
from qtraj.path.residual import Residual
from qtraj.path.spiral_helix import SpiralHelix


@storable
class Fitted(AbstractOutcome):
    """The result of `fit`.

    `path`, the spiral-helix, whose time 0 is the first sample; `residual`, how well it follows the recording;
    `code`, a `ResultCode`, and `result`, its text, which says what to do; `iterations`, the steps of the search that
    won; `radius_bounds` [m], between which the radius is held on the whole path.
    """

    path: SpiralHelix
    residual: Residual
    code: Int[Array, ""]
    iterations: Int[Array, ""]
    radius_bounds: Float[Array, "2"]

    def __init__(
        self,
        path: SpiralHelix,
        residual: Residual,
        code: ArrayInput,
        iterations: ArrayInput,
        radius_bounds: ArrayInput,
    ):
        self.path, self.residual = path, residual
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.radius_bounds = as_float(radius_bounds)

    def explain(self, at: tuple[int, ...]) -> str:
        """How the fit ended, and what to do."""
        code, steps, bounds = (np.asarray(x)[at] for x in (self.code, self.iterations, self.radius_bounds))
        code = ResultCode(int(code))
        if code == ResultCode.successful:
            return f"converged in {steps} steps."
        if code == ResultCode.held_by_bounds:
            held = f"the radius is held by its bounds, {bounds[0]:.4g} to {bounds[1]:.4g} m"
            return f"converged in {steps} steps: {held}. {code.text}"
        if code == ResultCode.not_converged:
            return (
                f"not converged after {steps} steps: the numbers of this path are not the best ones with a radius from "
                f"{bounds[0]:.4g} to {bounds[1]:.4g} m. Pass a larger max_steps or wider radius_bounds, or choose a "
                "window with one clear bend."
            )
        return code.text

    def record(self) -> Record:
        """The path, the residual, each of its names with `residual_` in front, and how the fit ended."""
        path, residual = self.path.record(), self.residual.record()
        variables: dict[str, Any] = {
            **path.variables,
            **{f"residual_{name}": quantity for name, quantity in residual.variables.items()},
            "radius_bounds": Quantity(self.radius_bounds, "m", "bounds of the radius", ("bound",)),
            "iterations": Quantity(self.iterations, "1", "steps of the search that won"),
            "result": Quantity(np.asarray(self.result), "", "how the fit ended"),
            "code": Quantity(self.code, "1", "how the fit ended, as a number"),
        }
        summary = f"{path.summary}; {residual.summary}"
        return Record(summary, variables, attributes={"frame": "world"}, labels={"bound": ["low", "high"]})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix.
        """
        document.save(self, file)
