"""The outcome of tuning one problem or a batch of problems."""

import dataclasses
import os
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.certificate import Certificate
from qtraj.design.tuning.advisor import Advisor
from qtraj.design.tuning.verdict import verdict
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float, concrete, part, require_element
from qtraj.foundation.codes import where_code
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.drawing import draw
from qtraj.foundation.outcome import (
    ILL_POSED,
    AbstractOutcome,
    ResultCode,
    concrete_codes,
    names_of,
    renumbered,
)
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, counts_text, extent
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle import Vehicle
from qtraj.path.vehicle_data import vehicle_quantities

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONVERGED, INFEASIBLE, NOT_CONVERGED = ResultCode.successful, ResultCode.infeasible, ResultCode.not_converged

STATUSES = {CONVERGED: "converged", INFEASIBLE: "infeasible", NOT_CONVERGED: "not converged"}
"""The status for each code; all other codes belong to ill-posed problems."""

ILL_POSED_STATUS = "ill-posed"

_OLDER_CODES = {1: INFEASIBLE, 2: NOT_CONVERGED}
"""The `ResultCode` for each code of older documents."""


def _reads_older_codes(fields: dict[str, Any]) -> dict[str, Any]:
    return fields | {"code": renumbered(fields["code"], _OLDER_CODES)} if "code" in fields else fields


@reads_older(_reads_older_codes)
@storable
class Tuned(AbstractOutcome):
    """The outcome of `tune` for one problem or a batch of problems; for a batch, all arrays have leading batch axes.

    - `path`: the tuned path.
    - `start`, `end`: the boundary states of the tuned path in world axes.
    - `objective`: the value of the objective for the tuned path, in the unit of the objective.
    - `certificate`: the findings on the limits.
    - `code`: a `ResultCode`; `status` describes it in one or two words, and `result` explains it and gives advice.
    - `iterations`: the number of steps of the best search.
    - `starts_tried`: the number of starts from which searches ran; None in documents of older versions.
    - `advice`: notes on the search and, after a failure, advice. For a batch, `advisor` computes the advice on an
      element when its `result` is requested; `place` contains the number of the advisor and the index of the element.

    `outcome[k]` is one element of a batch. `vehicle` is the vehicle of the limits, or None; figures and reports use it
    to plot limited forces.
    """

    path: SpiralHelix
    start: BoundaryState
    end: BoundaryState
    objective: Float[Array, "*batch"]
    certificate: Certificate
    code: Int[Array, "*batch"]
    iterations: Int[Array, "*batch"]
    advice: str = eqx.field(static=True)
    advisor: Advisor | None = eqx.field(static=True)
    place: Int[Array, "*batch 2"] | None
    vehicle: Vehicle | None
    starts_tried: Int[Array, "*batch"] | None

    def __init__(
        self,
        path: "SpiralHelix",
        start: "BoundaryState",
        end: "BoundaryState",
        objective: ArrayInput,
        certificate: "Certificate",
        code: ArrayInput,
        iterations: ArrayInput,
        advice: str = "",
        advisor: "Advisor | None" = None,
        place: ArrayInput | None = None,
        vehicle: "Vehicle | None" = None,
        starts_tried: ArrayInput | None = None,
    ):
        self.path, self.start, self.end = path, start, end
        self.objective, self.certificate = as_float(objective), certificate
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.advice, self.advisor = advice, advisor
        self.place = None if place is None else as_array(place, jnp.int32)
        self.vehicle = vehicle
        self.starts_tried = None if starts_tried is None else as_array(starts_tried, jnp.int32)

    @property
    def status(self) -> Any:
        """One of "converged", "infeasible", "not converged" and "ill-posed"; an array of strings for a batch."""
        texts = names_of(concrete_codes(self), STATUSES, ILL_POSED_STATUS)
        return texts.item() if texts.ndim == 0 else texts

    @property
    def converged(self) -> Any:
        """Whether the path satisfies every limit and the Lagrangian is stationary; inside a trace, an array."""
        return where_code(self.code, lambda code: code == CONVERGED)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of one problem, with advice."""
        code, steps, radius, duration = (
            np.asarray(x)[at] for x in (self.code, self.iterations, self.path.radius, self.path.duration)
        )
        findings = self.certificate.findings(at)
        tried = None if self.starts_tried is None else int(np.asarray(self.starts_tried)[at])
        return verdict(ResultCode(int(code)), findings, int(steps), tried, self._advice(at), radius, float(duration))

    def _advice(self, at: tuple[int, ...]) -> str:
        code, place = concrete_codes(self)[at], concrete(self.place)
        if self.advisor is None or place is None or code >= ILL_POSED:
            return self.advice
        number, index = place[at].tolist()
        return self.advisor(index, ResultCode(int(code))) if number == self.advisor.number else self.advice

    def record(self) -> Record:
        """Return path, boundary states, vehicle, findings, objective and result codes as labelled quantities."""
        findings, status = self.certificate.record(), np.asarray(self.status)
        variables = {
            "objective": Quantity(self.objective, "", "value; the unit depends on the objective"),
            "outcome": Quantity(status, "", f"one of {', '.join([*STATUSES.values(), ILL_POSED_STATUS])}"),
            "code": Quantity(self.code, "1", "result code of the tuning"),
            "iterations": Quantity(self.iterations, "1", "number of steps of the best search"),
            **self._starts_record(),
            **findings.variables,
            **self.path.record().variables,
            **vehicle_quantities(self.vehicle),
        }
        for side, state in (("start", self.start), ("end", self.end)):
            for name, unit in (("position", "m"), ("velocity", "m s-1")):
                values, text = getattr(state, name), f"{name} at the {side}, world axes"
                variables[f"{side}_{name}"] = Quantity(values, unit, text, ("world",))
        steps = extent(self.iterations)
        search = f"objective {extent(self.objective)}, {steps} {'step' if steps == '1' else 'steps'}"
        summary = (
            f"{batch_prefix(self.code.shape, 'problems')}{counts_text(status)}, {search}; {self.certificate.summary}"
        )
        return Record(summary, variables, findings.coordinates, findings.attributes)

    def _starts_record(self) -> dict[str, Quantity]:
        if self.starts_tried is None:
            return {}
        return {"starts_tried": Quantity(self.starts_tried, "1", "number of starts from which searches ran")}

    def __getitem__(self, index: Any) -> "Tuned":
        if self.code.ndim == 0:
            raise TypeError("this is the result of one problem: only the result of a batch can be indexed")
        require_element(index, len(self), "problems")
        return jax.tree.map(lambda x: part(x, index), self)

    def __bool__(self) -> bool:
        return True  # without this method, an empty batch would be false

    def __len__(self) -> int:
        if self.code.ndim == 0:
            raise TypeError("this is the result of one problem: only the result of a batch has a length")
        return self.code.shape[0]

    def plot(self, frame: Any = None) -> "Figure":
        """Plot the tuned path in space and its limited quantities against time (needs the extra `viz`).

        `frame` selects the trihedra as in `qtraj.evaluate`; the default is the natural frame.

        **Raises:** ModuleNotFoundError if matplotlib is not installed. ValueError for the outcome of a batch.
        """
        return draw("tuned_plot", self, frame)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json, or for the outcome of a batch. Save single
        elements of a batch, or its paths as a dataset.
        """
        if self.code.ndim > 0:
            raise ValueError(
                f"a file can contain only one result, but this is a batch of {len(self)}: save one of them with "
                "outcome[k].save(...), or save the paths as a dataset"
            )
        document.save(dataclasses.replace(self, advice=self._advice(()), advisor=None, place=None), file)

    def __str__(self) -> str:
        if self.code.ndim == 0:
            return f"{self.result}\n{self.certificate}"
        texts, names = np.ravel(self.status), [*STATUSES.values(), ILL_POSED_STATUS]
        counts = ", ".join(f"{np.sum(texts == name)} {name}" for name in names if name in texts)
        return f"{self.code.size} tunings{self._starts_text()}: {counts}\n{self.certificate}"

    def _starts_text(self) -> str:
        if self.starts_tried is None:
            return ""
        noun = "start" if np.max(self.starts_tried, initial=0) == 1 else "starts"
        return f" from {extent(self.starts_tried)} {noun} each"
