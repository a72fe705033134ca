"""The result of a tuning for all deviations in a box."""

import os

import jax.numpy as jnp
from jaxtyping import Array, Int

from qtraj.design.limits import Limits
from qtraj.design.robust.box_certificate import BoxCertificate, unmet_text
from qtraj.design.robust.outcome import record_with, tightened_text
from qtraj.design.tuning.outcome import Tuned
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Record
from qtraj.foundation.types import ArrayInput


@storable
class BoxTuned(AbstractOutcome):
    """A path that satisfies limits for all deviations in a box.

    - `tuned`: the result of `tune` or `tune_route` within the tightened limits; its certificate is for these limits.
    - `limits`: the tightened limits.
    - `certificate`: the `BoxCertificate` of the path and the original limits, with the box; None if no
      path was found.
    - `rounds`: the number of tunings.
    - `code`: a `ResultCode`; `result` explains it.
    """

    tuned: Tuned | TunedRoute
    limits: Limits
    certificate: BoxCertificate | None
    rounds: Int[Array, ""]
    code: Int[Array, ""]

    def __init__(
        self,
        tuned: "Tuned | TunedRoute",
        limits: "Limits",
        certificate: "BoxCertificate | None",
        rounds: ArrayInput,
        code: ArrayInput,
    ):
        self.tuned, self.limits, self.certificate = tuned, limits, certificate
        self.rounds, self.code = as_array(rounds, jnp.int32), as_array(code, jnp.int32)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the proof, the tightened limits and, after a failure, what to do."""
        if self.certificate is not None and self.certificate.holds:
            return (
                "converged: every limit is proved for all deviations in the box. "
                f"Tightened limits: {tightened_text(self.limits)}."
            )
        if self.certificate is not None:
            unmet = unmet_text(self.certificate, "Raise the limits, or make the box smaller.")
            return f"not converged after {int(self.rounds)} tunings: {unmet}"
        if ResultCode(int(self.code)) == ResultCode.infeasible and self.tuned.converged:
            return "infeasible: the box is too large for the limits. Raise the limits, or make the box smaller."
        return f"no path satisfies the limits for all deviations. With tightened limits: {self.tuned.result}"

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json.
        """
        document.save(self, file)

    def record(self) -> Record:
        """Return the quantities of the tuned path; `certificate.record()` describes the proof."""
        holds = self.certificate is not None and self.certificate.holds
        return record_with(self.tuned, f"limits {'proved' if holds else 'not proved'} for all deviations in the box")
