"""The result of a robust tuning."""

import os

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import quantity


@storable
class RobustTuned(AbstractOutcome):
    """A path that satisfies limits with a stated probability, although boundary states and limits deviate.

    - `tuned`: the result of `tune` or `tune_route` within the tightened limits; its certificate is for these limits.
    - `limits`: the tightened limits.
    - `share`: the wanted probability that all limits are satisfied together.
    - `sampled_share`: the share of the sampled paths that satisfy all limits.
    - `factor`: the margins in standard deviations of first order.
    - `rounds`: the number of tunings.
    - `code`: a `ResultCode`; `result` explains it.
    """

    tuned: Tuned | TunedRoute
    limits: Limits
    share: Float[Array, ""]
    sampled_share: Float[Array, ""]
    factor: Float[Array, ""]
    rounds: Int[Array, ""]
    code: Int[Array, ""]

    def __init__(
        self,
        tuned: "Tuned | TunedRoute",
        limits: "Limits",
        share: ArrayInput,
        sampled_share: ArrayInput,
        factor: ArrayInput,
        rounds: ArrayInput,
        code: ArrayInput,
    ):
        self.tuned, self.limits = tuned, limits
        self.share, self.sampled_share, self.factor = (as_float(x) for x in (share, sampled_share, factor))
        self.rounds, self.code = as_array(rounds, jnp.int32), as_array(code, jnp.int32)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the share, the tightened limits and, after a failure, what to do."""
        shares = f"all limits are satisfied on {100 * float(self.sampled_share):.2f} % of the sampled paths"
        wanted = f"{100 * float(self.share):.4g} % are wanted"
        code = ResultCode(int(self.code))
        if code == ResultCode.successful:
            return f"converged: {shares} ({wanted}). Tightened limits: {tightened_text(self.limits)}."
        if code == ResultCode.not_converged and self.tuned.converged:
            return f"not converged after {int(self.rounds)} tunings: {shares}, but {wanted}. Pass more samples."
        if self.tuned.converged:
            return f"infeasible: the spread is too large for the limits; {shares}, but {wanted}. Raise the limits."
        return f"{shares}, but {wanted}. With tightened limits: {self.tuned.result}"

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json.
        """
        document.save(self, file)

    def record(self) -> Record:
        """Return the quantities of the tuned path, with the shares and the factor."""
        own = {
            "share": Quantity(self.share, "1", "wanted probability that all limits are satisfied"),
            "sampled_share": Quantity(self.sampled_share, "1", "share of the sampled paths that satisfy all limits"),
            "margin_factor": Quantity(self.factor, "1", "margins of the limits, in standard deviations of first order"),
        }
        summary = f"{100 * float(self.sampled_share):.2f} % of the sampled paths satisfy all limits"
        return record_with(self.tuned, summary, own)


def record_with(tuned: Tuned | TunedRoute, summary: str, own: dict[str, Quantity] | None = None) -> Record:
    """Return the record of a tuning with a summary before its own, and more quantities."""
    inner = tuned.record()
    return Record(
        f"{summary}; {inner.summary}", {**(own or {}), **inner.variables}, inner.coordinates, inner.attributes
    )


def tightened_text(limits: Limits) -> str:
    """Return the names and values of limits."""
    given = limits.given().items()
    return ", ".join(f"{name} {with_unit(float(np.asarray(x)), quantity(name).unit)}" for name, x in given)
