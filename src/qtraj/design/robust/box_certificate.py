"""Certificates about all paths of a box."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.certificate import BROKEN, STATUSES, UNDECIDED, UNDEFINED, Certificate
from qtraj.design.robust.box import UNITS, Box, text_of
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import quantity

ADVICE = {
    STATUSES[UNDECIDED]: "For undecided limits, use fewer parameters, or divide the box into smaller ones and certify "
    "each of them.",
    STATUSES[UNDEFINED]: "Where a quantity is undefined, omit its limit, or make the box smaller.",
}
"""What to do about limits that are neither proved nor violated, by status."""

LONG_ORDER = 3
"""Order of the derivatives in quantities whose proofs with several parameters can be too long in boxes of any size."""


@storable
class BoxCertificate(AbstractOutcome):
    """The findings on limits for all deviations in a box.

    - `names`: the names of the limited quantities.
    - `box`: the box of the deviations; `parameters` are the names of its parameters.
    - `codes`: the codes of the statuses; `status` contains them as strings. "proved" is about all deviations in the
      box, "broken" about the reported ones.
    - `times` [s], `deviations` and `values`: the worst value found, at which time, and for which deviations. They come
      from a grid and from the counterexamples of the proof; no status "proved" depends on it.
    - `limits`: the strictest values of the limits.
    - `code`: a `ResultCode`; `result` explains it.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    box: Box
    codes: Int[Array, " n"]
    times: Float[Array, " n"]
    deviations: Float[Array, "n p"]
    values: Float[Array, " n"]
    limits: Float[Array, " n"]

    def __init__(
        self,
        names: Sequence[str],
        box: Box,
        codes: ArrayInput,
        times: ArrayInput,
        deviations: ArrayInput,
        values: ArrayInput,
        limits: ArrayInput,
    ):
        self.names, self.box, self.codes = tuple(names), box, as_array(codes, jnp.int32)
        self.times, self.deviations = as_float(times), as_float(deviations)
        self.values, self.limits = as_float(values), as_float(limits)

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the parameters that deviate."""
        return self.box.names

    @property
    def _as_certificate(self) -> Certificate:
        return Certificate(self.names, self.codes, self.times, self.values, self.limits)

    @property
    def status(self) -> dict[str, str]:
        """The status of each limit, by name: "proved", "broken", "undecided" or "undefined"."""
        return {name: STATUSES[code] for name, code in zip(self.names, np.asarray(self.codes).tolist(), strict=True)}

    @property
    def holds(self) -> bool:
        """Whether every limit is proved for all deviations in the box."""
        return self._as_certificate.holds

    @property
    def worst(self) -> dict[str, tuple[float, dict[str, float], float, float]]:
        """The tuple (time [s], deviations by name, value, limit) for the worst value found of each quantity."""
        columns = (np.asarray(x).tolist() for x in (self.times, self.deviations, self.values, self.limits))
        rows = zip(self.names, *columns, strict=True)
        return {n: (t, dict(zip(self.parameters, d, strict=True)), v, b) for n, t, d, v, b in rows}

    @property
    def code(self) -> Int[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The `ResultCode` of the whole box, from its worst finding."""
        return self._as_certificate.code

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result, with the deviations for which a limit is not satisfied."""
        if ResultCode(int(np.asarray(self.code))) == ResultCode.successful:
            return "every limit is proved to be satisfied on the whole path, for all deviations in the box."
        return unmet_text(
            self, "Raise the limits, make the box smaller, or tune with robust_tune or robust_tune_route."
        )

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the certificate to a TOML or JSON file without loss of precision; `qtraj.load` reads the file.

        **Raises:** ValueError if the suffix is neither .toml nor .json.
        """
        document.save(self, file)

    def record(self) -> Record:
        """Return the findings over the dimension `limit`, and the deviations of the worst values."""
        inner = self._as_certificate.record()
        at: dict[str, Any] = {
            f"worst_{name}": Quantity(
                np.asarray(self.deviations)[:, k], UNITS[name], "deviation of the worst value", ("limit",)
            )
            for k, name in enumerate(self.parameters)
        }
        summary = f"for all deviations in the box: {inner.summary}"
        return Record(summary, {**inner.variables, **at}, inner.coordinates, {"box": text_of(self.box)})

    def __str__(self) -> str:
        findings = self._as_certificate.findings()
        lines = [f"{finding.name} {finding.text}: {finding.status}" for finding in findings]
        return "\n".join([f"for all deviations in the box {text_of(self.box)}:", *lines])


def unmet_text(certificate: BoxCertificate, advice: str) -> str:
    """Describe the limits that are not proved, with `advice` about those that are violated."""
    c = certificate
    inner = Certificate(c.names, c.codes, c.times, c.values, c.limits)
    unmet = [(k, finding) for k, finding in enumerate(inner.findings()) if not finding.met]
    texts = [f"{x.statement}, for {_deviations_text(c, k) or 'the strictest limit'}" for k, x in unmet]
    statuses = {finding.status for _, finding in unmet}
    sentences = [advice] if STATUSES[BROKEN] in statuses else []
    sentences += [text for status, text in ADVICE.items() if status in statuses]
    undecided = [c.names[k] for k, finding in unmet if finding.status == STATUSES[UNDECIDED]]
    long = [name for name in undecided if quantity(name).order >= LONG_ORDER]
    if long and len(c.parameters) > 1:
        sentences.append(
            f"With {len(c.parameters)} parameters, proofs of {', '.join(long)} can take too long in boxes of any size: "
            "then only fewer parameters help, or a sweep over the deviations, which proves nothing between its points."
        )
    return f"{'; '.join(texts)}. {' '.join(sentences)}"


def _deviations_text(certificate: BoxCertificate, k: int) -> str:
    numbers = zip(certificate.parameters, np.asarray(certificate.deviations)[k].tolist(), strict=True)
    return ", ".join(f"{name} {with_unit(x, UNITS[name])}" for name, x in numbers)
