"""What is known of a path against its limits, and how it is known."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import as_array, as_float, concrete, require_element
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, counts_text
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import with_unit
from qtraj.path.quantity import quantity

STATUSES = ("proved", "sampled", "broken", "undecided", "undefined")
"""By their codes.

Met on the whole path, by proof; met on a refined grid whose peaks were polished, which is strong evidence and no proof;
exceeded at a known time; left open, for being too near to the limit for the rounding or for want of a proof that the
quantity exists; not to be told from one that does not exist at a known time.
"""
PROVED, SAMPLED, BROKEN, UNDECIDED, UNDEFINED = range(len(STATUSES))

_WORST = (
    (BROKEN, ResultCode.limits_broken),
    (UNDEFINED, ResultCode.limits_undefined),
    (UNDECIDED, ResultCode.limits_undecided),
    (SAMPLED, ResultCode.limits_sampled),
)
"""The result of a whole path by the worst of its findings, worst first."""

BINDING = 1e-6
"""A limit whose relative margin is smaller than this binds."""


class Finding(NamedTuple):
    """What is known of one limit on one path, in Python's numbers."""

    name: str
    status: str
    time: float
    value: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether the limit holds, be it by proof or by refined sampling."""
        return self.status in STATUSES[: SAMPLED + 1]

    @property
    def binding(self) -> bool:
        """Whether it holds with nothing to spare."""
        return self.met and self.limit - self.value <= BINDING * self.limit

    @property
    def text(self) -> str:
        """The largest value against the limit."""
        if math.isnan(self.value):
            return f"without a value at t = {self.time:.4g} s, where the path stops or straightens"
        texts = f"{self.value:.6g}", with_unit(self.limit, quantity(self.name).unit)
        told = not self.met and self.value > self.limit and f"{self.limit:.6g}" == texts[0]
        beyond = f" (above it by a part of {self.value / self.limit - 1:.1e})" if told else ""
        return f"{texts[0]} of {texts[1]}{beyond} at t = {self.time:.4g} s"


@storable
class Certificate(AbstractOutcome):
    """The findings on each given limit, of one path or of many (`*lanes` in front).

    `names`, and arrays over them: `codes` of `STATUSES`; `times` [s] and `values` of the largest values found, or the
    instant where the quantity does not exist, and NaN; `limits`. A batch of findings gives arrays where one path gives
    a text or a number; `certificate[k]` is that of one lane. `code` is the `ResultCode` of the whole path and `result`
    its text.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    codes: Int[Array, "*batch n"]
    times: Float[Array, "*batch n"]
    values: Float[Array, "*batch n"]
    limits: Float[Array, "*batch n"]

    def __init__(
        self, names: Sequence[str], codes: ArrayInput, times: ArrayInput, values: ArrayInput, limits: ArrayInput
    ):
        self.names, self.codes = tuple(names), as_array(codes, jnp.int32)
        self.times, self.values, self.limits = as_float(times), as_float(values), as_float(limits)

    @property
    def status(self) -> dict[str, Any]:
        """The finding on each limit, by its name."""
        texts = np.asarray(STATUSES)[_known(self.codes)]
        return {name: _plain(texts[..., k]) for k, name in enumerate(self.names)}

    @property
    def worst(self) -> dict[str, tuple[Any, Any, Any]]:
        """(time [s], value, limit) at the largest value of each, by its name."""
        rows = [_known(x) for x in (self.times, self.values, self.limits)]
        return {name: (*(_plain(x[..., k]) for x in rows),) for k, name in enumerate(self.names)}

    @property
    def met(self) -> Any:
        """Whether every limit was found met, be it by proof or by refined sampling."""
        return _plain((_known(self.codes) <= SAMPLED).all(axis=-1))

    @property
    def holds(self) -> Any:
        """Whether every limit is proved on the whole path; refined sampling alone proves nothing."""
        return _plain((_known(self.codes) == PROVED).all(axis=-1))

    @property
    def unmet(self) -> list[str]:
        """Names of the limits that were not found met, of one path."""
        return [found.name for found in self.findings() if not found.met]

    def margin(self, name: str) -> Any:
        """Limit less the largest value, in the limit's unit; negative where the limit is broken."""
        _, value, limit = self.worst[name]
        return limit - value

    @property
    def binding(self) -> list[str]:
        """Names of the limits that are met with nothing to spare (a relative margin below 1e-6), of one path."""
        return [found.name for found in self.findings() if found.binding]

    @property
    def summary(self) -> str:
        """The finding on each limit in a line, of many paths how often each."""
        found = (f"{name} {counts_text(status)}" for name, status in self.status.items())
        return "; ".join(found) or "no limits"

    def describe(self, name: str) -> str:
        """The largest value of one quantity against its limit, of one path, in words."""
        return self.findings()[self.names.index(name)].text

    def findings(self, at: tuple[int, ...] = ()) -> list[Finding]:
        """What is known of each limit on one path; `at` is its place in a batch."""
        # No bound method here: Equinox makes a Module of each, which would take longer than all the rest.
        codes, *numbers = (_known(x)[at] for x in (self.codes, self.times, self.values, self.limits))
        rows = zip(self.names, codes.tolist(), *(x.tolist() for x in numbers), strict=True)
        return [Finding(name, STATUSES[code], *rest) for name, code, *rest in rows]

    @property
    def code(self) -> Int[Array, "*batch"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The `ResultCode` of the whole path: that of its worst finding."""
        code = jnp.full(self.codes.shape[:-1], ResultCode.successful, jnp.int32)
        for finding, result in reversed(_WORST):
            code = jnp.where(jnp.any(self.codes == finding, axis=-1), int(result), code)
        return code

    def explain(self, at: tuple[int, ...]) -> str:
        """What the findings on one path come to."""
        code, found = ResultCode(int(np.asarray(self.code)[at])), self.findings(at)
        if code == ResultCode.successful:
            return "every limit is proved on the whole path."
        unmet = "; ".join(f"{x.name} is {x.status}: {x.text}" for x in found if not x.met)
        return f"{code.text} {unmet}." if unmet else code.text

    def record(self) -> Record:
        """The findings over `limit`, whose coordinate `limit_unit` holds the unit of each."""
        along = ("limit",)
        statuses = np.asarray(STATUSES)[_known(self.codes)]
        variables = {
            "status": Quantity(statuses, "", f"one of {', '.join(STATUSES)}", along),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit", along),
            "worst_value": Quantity(self.values, "", "largest value found, in limit_unit; NaN for none", along),
            "worst_time": Quantity(self.times, "s", "when it is attained, or where it does not exist", along),
        }
        coordinates = {
            "limit": Quantity(np.array(self.names, dtype=str), "", "what is limited", along),
            "limit_unit": Quantity(np.array([quantity(x).unit for x in self.names], dtype=str), "", "its unit", along),
        }
        summary = f"{batch_prefix(self.codes.shape[:-1], 'paths')}{self.summary}"
        return Record(summary, variables, coordinates, {"frame": "natural"})

    def __bool__(self) -> bool:
        return True  # it is there, whatever it says; else Python would ask for its length

    def __len__(self) -> int:
        if self.codes.ndim == 1:
            raise TypeError("this is the certificate of one path: only the certificate of a batch has a length")
        return self.codes.shape[0]

    def __getitem__(self, index: Any) -> "Certificate":
        if self.codes.ndim == 1:
            raise TypeError("this is the certificate of one path: only the certificate of a batch can be indexed")
        require_element(index, len(self), "paths")
        return Certificate(self.names, self.codes[index], self.times[index], self.values[index], self.limits[index])

    def __str__(self) -> str:
        if self.codes.ndim > 1:
            counts = np.bincount(_known(self.codes).ravel(), minlength=len(STATUSES))
            found = ", ".join(f"{count} {text}" for count, text in zip(counts, STATUSES, strict=True) if count)
            return f"findings on {', '.join(self.names)} of {self.codes[..., 0].size} paths: {found}"
        return "\n".join(f"{name} {self.describe(name)}: {status}" for name, status in self.status.items())


def _known(x: Array) -> np.ndarray:
    known = concrete(x)
    if known is None:
        raise ValueError("inside a trace a certificate's findings are known as arrays only: use its codes and values")
    return known


def _plain(x: Any) -> Any:
    """A Python value where there is one only."""
    return x.item() if np.ndim(x) == 0 else x
