"""The outcome of a tuning, of one problem or of many."""

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
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.drawing import drawing
from qtraj.foundation.outcome import ILL_POSED, AbstractOutcome, ResultCode, known_codes, names_of, renumbered
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, counted, extent
from qtraj.foundation.types import ArrayInput
from qtraj.path.boundary import BoundaryState
from qtraj.path.spiral_helix import SpiralHelix

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CONVERGED, INFEASIBLE, NOT_CONVERGED = ResultCode.successful, ResultCode.infeasible, ResultCode.not_converged

STATUSES = {CONVERGED: "converged", INFEASIBLE: "infeasible", NOT_CONVERGED: "not converged"}
"""By their codes; every other code is that of a problem that is ill-posed."""

ILL_POSED_STATUS = "ill-posed"

_OLDER_CODES = {1: INFEASIBLE, 2: NOT_CONVERGED}
"""From the codes of older documents to those of `ResultCode`."""


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    return fields | {"code": renumbered(fields["code"], _OLDER_CODES)} if "code" in fields else fields


@reads_older(_from_older)
@storable
class Tuned(AbstractOutcome):
    """The outcome of `tune`, of one problem or of many (`*lanes` in front of every array).

    `path`, with its boundary states `start` and `end` (world axes); `objective`, the attained value in its own units;
    `certificate`, the findings on the given limits; `code`, a `ResultCode`, `status`, the same in a word, and `result`,
    the same in words with what to do; `iterations`, the steps of the search that won. `advice` says what would help
    where the limits cannot be met; of many problems `advisor` works it out when the `result` of one is asked for, whose
    `place` holds the number of its advisor and the row there. `outcome[k]` is one of many.
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
        advisor: Advisor | None = None,
        place: ArrayInput | None = None,
    ):
        self.path, self.start, self.end = path, start, end
        self.objective, self.certificate = as_float(objective), certificate
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)
        self.advice, self.advisor = advice, advisor
        self.place = None if place is None else as_array(place, jnp.int32)

    @property
    def status(self) -> Any:
        """ "converged", "infeasible", "not converged" or "ill-posed": a text, or an array of texts."""
        texts = names_of(known_codes(self), STATUSES, ILL_POSED_STATUS)
        return texts.item() if texts.ndim == 0 else texts

    @property
    def converged(self) -> Any:
        """Whether the tuning ended at a path that meets every limit and whose objective is stationary."""
        good = known_codes(self) == CONVERGED
        return good.item() if good.ndim == 0 else good

    def explain(self, at: tuple[int, ...]) -> str:
        """How the tuning of one problem ended, and what to do."""
        code, steps, radius, duration = (
            np.asarray(x)[at] for x in (self.code, self.iterations, self.path.radius, self.path.duration)
        )
        findings = self.certificate.findings(at)
        return verdict(ResultCode(int(code)), findings, int(steps), self._advice(at), radius, float(duration))

    def _advice(self, at: tuple[int, ...]) -> str:
        code, place = known_codes(self)[at], concrete(self.place)
        if self.advisor is None or place is None or code >= ILL_POSED:
            return self.advice
        number, row = place[at].tolist()
        return self.advisor(row, ResultCode(int(code))) if number == self.advisor.number else self.advice

    def record(self) -> Record:
        """Path, boundary states and findings, with the objective and how the search ended."""
        findings, status = self.certificate.record(), np.asarray(self.status)
        variables = {
            "objective": Quantity(self.objective, "", "attained value of the objective, in its own units"),
            "outcome": Quantity(status, "", f"one of {', '.join([*STATUSES.values(), ILL_POSED_STATUS])}"),
            "code": Quantity(self.code, "1", "how the tuning ended, as a number"),
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
        summary = f"{batch_prefix(self.code.shape, 'problems')}{counted(status)}, {search}; {self.certificate.summary}"
        return Record(summary, variables, findings.coordinates, findings.attributes)

    def __getitem__(self, index: Any) -> "Tuned":
        if self.code.ndim == 0:
            raise TypeError("this is the result of one problem: only the result of a batch can be indexed")
        require_element(index, len(self), "problems")
        return jax.tree.map(lambda x: part(x, index), self)

    def __bool__(self) -> bool:
        return True  # it is there, whatever it says; else Python would ask for its length

    def __len__(self) -> int:
        if self.code.ndim == 0:
            raise TypeError("this is the result of one problem: only the result of a batch has a length")
        return self.code.shape[0]

    def plot(self, frame: Any = None) -> "Figure":
        """The tuned path in space, and what its limits bound over time, as a matplotlib figure (extra `viz`).

        `frame` is that of the trihedra, as for `qtraj.evaluate`: the natural one unless it says otherwise.

        **Raises:** ModuleNotFoundError, naming the extra, where matplotlib is missing; ValueError for the outcome of
        many problems.
        """
        return drawing("tuned_plot", self, frame)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for the outcome of many problems: save one lane, or the paths as a dataset.
        """
        if self.code.ndim > 0:
            raise ValueError(
                f"the outcome of {len(self)} problems does not go into one document: save outcome[k].save(...)"
            )
        document.save(dataclasses.replace(self, advice=self._advice(()), advisor=None, place=None), file)

    def __str__(self) -> str:
        if self.code.ndim == 0:
            return f"{self.result}\n{self.certificate}"
        texts, names = np.ravel(self.status), [*STATUSES.values(), ILL_POSED_STATUS]
        found = ", ".join(f"{np.sum(texts == name)} {name}" for name in names if name in texts)
        return f"{self.code.size} tunings: {found}\n{self.certificate}"
