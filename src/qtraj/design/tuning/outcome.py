"""The outcome of a tuning, of one problem or of many."""

import os
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.certificate import Certificate
from qtraj.design.tuning import verdict
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float, concrete, require_lane
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, counted, extent, in_lanes
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState
from qtraj.path.spiral_helix import SpiralHelix

STATUSES = ("converged", "infeasible", "not converged")
"""By their codes."""

CONVERGED, INFEASIBLE, NOT_CONVERGED = range(len(STATUSES))


@storable
class Tuned(AbstractResult):
    """The outcome of `tune`, of one problem or of many (`*lanes` in front of every array).

    `path`, with its boundary states `start` and `end` (world axes); `objective`, the attained value in its own units;
    `certificate`, the findings on the given limits; `code` of `STATUSES`; `iterations`, the steps of the search that
    won. `advice` says what would help where the limits cannot be met, of one problem. `outcome[k]` is one of many.
    """

    path: SpiralHelix
    start: BoundaryState
    end: BoundaryState
    objective: Float[Array, "*lanes"]
    certificate: Certificate
    code: Int[Array, "*lanes"]
    iterations: Int[Array, "*lanes"]
    advice: str = eqx.field(static=True)

    def __init__(
        self,
        path: SpiralHelix,
        start: BoundaryState,
        end: BoundaryState,
        objective: ArrayInput,
        certificate: Certificate,
        code: ArrayInput,
        iterations: ArrayInput,
        advice: str = "",
    ):
        self.path, self.start, self.end = path, start, end
        self.objective, self.certificate = as_float(objective), certificate
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.advice = advice

    @property
    def status(self) -> Any:
        """ "converged", "infeasible" or "not converged": a text, or an array of texts."""
        texts = np.asarray(STATUSES)[self._known()]
        return texts.item() if texts.ndim == 0 else texts

    @property
    def converged(self) -> Any:
        """Whether the tuning ended at a path that meets every limit and whose objective is stationary."""
        good = self._known() == CONVERGED
        return good.item() if good.ndim == 0 else good

    @property
    def result(self) -> Any:
        """The outcome in words, with what to do: a text, or a list of them."""
        if self.code.ndim > 0:
            return [self[k].result for k in range(self.code.shape[0])]
        say = {CONVERGED: verdict.converged, INFEASIBLE: verdict.infeasible, NOT_CONVERGED: verdict.not_converged}
        parts = [say[int(self.code)](self.certificate, int(self.iterations)), self.advice, verdict.remark(self.path)]
        return " ".join(part for part in parts if part)

    def record(self) -> Record:
        """Path, boundary states and findings, with the objective and how the search ended."""
        findings, status = self.certificate.record(), np.asarray(self.status)
        variables = {
            "objective": Quantity(self.objective, "", "attained value of the objective, in its own units"),
            "outcome": Quantity(status, "", f"one of {', '.join(STATUSES)}"),
            "iterations": Quantity(self.iterations, "1", "steps of the search that won"),
            **findings.variables,
            **self.path.record().variables,
        }
        for side, state in (("start", self.start), ("end", self.end)):
            for name, unit in (("position", "m"), ("velocity", "m s-1")):
                values, text = getattr(state, name), f"{name} at the {side}, world axes"
                variables[f"{side}_{name}"] = Quantity(values, unit, text, ("world",))
        steps = extent(self.iterations)
        search = f"objective {extent(self.objective)}, {steps} {'step' if steps == '1' else 'steps'}"
        summary = f"{in_lanes(self.code.shape, 'problems')}{counted(status)}, {search}; {self.certificate.summary}"
        return Record(summary, variables, findings.coordinates, findings.attributes)

    def __getitem__(self, lane: Any) -> "Tuned":
        if self.code.ndim == 0:
            raise TypeError("this is the outcome of one problem: only that of many has lanes")
        require_lane(lane, len(self), "problems")
        return Tuned(
            jax.tree.map(lambda x: x[lane], self.path),
            jax.tree.map(lambda x: x[lane], self.start),
            jax.tree.map(lambda x: x[lane], self.end),
            self.objective[lane],
            self.certificate[lane],
            self.code[lane],
            self.iterations[lane],
        )

    def __bool__(self) -> bool:
        return True  # it is there, whatever it says; else Python would ask for its length

    def __len__(self) -> int:
        if self.code.ndim == 0:
            raise TypeError("this is the outcome of one problem: only that of many has a length")
        return self.code.shape[0]

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for the outcome of many problems: save one lane, or the paths as a dataset.
        """
        if self.code.ndim > 0:
            raise ValueError(
                f"the outcome of {len(self)} problems does not go into one document: save outcome[k].save(...)"
            )
        document.save(self, file)

    def __str__(self) -> str:
        if self.code.ndim == 0:
            return f"{self.result}\n{self.certificate}"
        counts = np.bincount(self._known().ravel(), minlength=len(STATUSES))
        found = ", ".join(f"{count} {text}" for count, text in zip(counts, STATUSES, strict=True) if count)
        return f"{self.code.size} tunings: {found}\n{self.certificate}"

    def _known(self) -> np.ndarray:
        known = concrete(self.code)
        if known is None:
            raise ValueError("inside a trace the status of a tuning is known as an array only: use its code")
        return known
