"""Certificates: the finding on each limit of a path, and whether it is a proof."""

import math
import warnings
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
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.path_quantity import LOAD
from qtraj.path.quantity import quantity

STATUSES = ("proved", "sampled", "broken", "undecided", "undefined")
"""The findings, by their codes.

- proved: the limit is satisfied on the whole path.
- sampled: satisfied at the refined peaks of a fine grid. This is strong evidence, but not a proof.
- broken: violated at a known time.
- undecided: too close to the limit for the rounding error, or without a proof that the quantity is defined.
- undefined: at a known time, the quantity cannot be distinguished from one that is undefined.
"""
PROVED, SAMPLED, BROKEN, UNDECIDED, UNDEFINED = range(len(STATUSES))

_RESULT_OF_FINDING = (
    (BROKEN, ResultCode.limits_broken),
    (UNDEFINED, ResultCode.limits_undefined),
    (UNDECIDED, ResultCode.limits_undecided),
    (SAMPLED, ResultCode.limits_sampled),
)
"""The result code of a path for its worst finding; the worst come first."""

ACTIVE_MARGIN = 1e-6
"""A limit with a smaller relative margin is active."""


STANDSTILL = "stops or is straight"


class Finding(NamedTuple):
    """The finding on one limit of one path, in Python numbers."""

    name: str
    status: str
    time: float
    value: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether the limit is satisfied, by proof or by refined sampling."""
        return self.status in STATUSES[: SAMPLED + 1]

    @property
    def active(self) -> bool:
        """Whether the limit is satisfied with a relative margin below 1e-6."""
        return self.met and self.limit - self.value <= ACTIVE_MARGIN * self.limit

    @property
    def text(self) -> str:
        """The largest value and the limit, in words."""
        if math.isnan(self.value):
            where = "stops or the load on the road vanishes" if quantity(self.name).divisor == LOAD else STANDSTILL
            return f"undefined at t = {self.time:.4g} s, where the path {where}"
        texts = f"{self.value:.6g}", with_unit(self.limit, quantity(self.name).unit)
        rounds_to_limit = not self.met and self.value > self.limit and f"{self.limit:.6g}" == texts[0]
        violation = f" (relative violation {self.value / self.limit - 1:.1e})" if rounds_to_limit else ""
        return f"{texts[0]} of {texts[1]}{violation} at t = {self.time:.4g} s"


@storable
class Certificate(AbstractOutcome):
    """The findings on each limit, of one path or a batch (batch dimensions in front).

    `names` are the limited quantities, along the last axis of the arrays: `codes` index the statuses, `times` [s] and
    `values` give the largest values found, and `limits` are the limits. If a quantity is undefined, the time is an
    instant at which it is undefined, and the value is NaN. A batch gives arrays where one path gives a string or a
    number; `certificate[k]` is one element. `code` is the `ResultCode` of the whole path, and `result` its text.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    codes: Int[Array, "*batch n"]
    times: Float[Array, "*batch n"]
    values: Float[Array, "*batch n"]
    limits: Float[Array, "*batch n"]

    def __init__(
        self, names: "Sequence[str]", codes: ArrayInput, times: ArrayInput, values: ArrayInput, limits: ArrayInput
    ):
        self.names, self.codes = tuple(names), as_array(codes, jnp.int32)
        self.times, self.values, self.limits = as_float(times), as_float(values), as_float(limits)

    @property
    def status(self) -> dict[str, Any]:
        """The status of each limit, by name: "proved", "sampled", "broken", "undecided" or "undefined"."""
        texts = np.asarray(STATUSES)[_concrete(self.codes)]
        return {name: _plain(texts[..., k]) for k, name in enumerate(self.names)}

    @property
    def worst(self) -> dict[str, tuple[Any, Any, Any]]:
        """(time [s], value, limit) at the largest value of each quantity, by name."""
        arrays = [_concrete(x) for x in (self.times, self.values, self.limits)]
        return {name: (*(_plain(x[..., k]) for x in arrays),) for k, name in enumerate(self.names)}

    @property
    def met(self) -> Any:
        """Whether every limit is satisfied, by proof or by refined sampling."""
        return _plain((_concrete(self.codes) <= SAMPLED).all(axis=-1))

    @property
    def holds(self) -> Any:
        """Whether every limit is proved to be satisfied on the whole path; refined sampling is not a proof."""
        return _plain((_concrete(self.codes) == PROVED).all(axis=-1))

    @property
    def unmet(self) -> list[str]:
        """Names of the limits of one path that are not known to be satisfied."""
        return [finding.name for finding in self.findings() if not finding.met]

    def margin(self, name: str) -> Any:
        """The limit minus the largest value, in the unit of the limit; negative if the limit is violated."""
        _, value, limit = self.worst[name]
        return limit - value

    @property
    def active(self) -> list[str]:
        """Names of the active limits of one path: satisfied with a relative margin below 1e-6."""
        return [finding.name for finding in self.findings() if finding.active]

    @property
    def binding(self) -> list[str]:
        """Former name of `active`, until 1.0."""
        warnings.warn("Certificate.binding is now called active", DeprecationWarning, stacklevel=2)
        return self.active

    @property
    def summary(self) -> str:
        """The status of each limit in one line; for a batch, how often each status occurs."""
        texts = (f"{name} {counts_text(status)}" for name, status in self.status.items())
        return "; ".join(texts) or "no limits"

    def describe(self, name: str) -> str:
        """The largest value of one quantity of one path, and its limit, in words."""
        return self.findings()[self.names.index(name)].text

    def findings(self, at: tuple[int, ...] = ()) -> list[Finding]:
        """The finding on each limit of one path; `at` is its index in a batch."""
        # Bound methods are avoided: Equinox makes a Module of each, which would dominate the run time.
        codes, *numbers = (_concrete(x)[at] for x in (self.codes, self.times, self.values, self.limits))
        columns = zip(self.names, codes.tolist(), *(x.tolist() for x in numbers), strict=True)
        return [Finding(name, STATUSES[code], *rest) for name, code, *rest in columns]

    @property
    def code(self) -> Int[Array, "*batch"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The `ResultCode` of the whole path, from its worst finding."""
        code = jnp.full(self.codes.shape[:-1], ResultCode.successful, jnp.int32)
        for finding, result in reversed(_RESULT_OF_FINDING):
            code = jnp.where(jnp.any(self.codes == finding, axis=-1), int(result), code)
        return code

    def explain(self, at: tuple[int, ...]) -> str:
        """The result of one path in words."""
        code, findings = ResultCode(int(np.asarray(self.code)[at])), self.findings(at)
        if code == ResultCode.successful:
            return "every limit is proved to be satisfied on the whole path."
        unmet = "; ".join(f"{x.name} is {x.status}: {x.text}" for x in findings if not x.met)
        return f"{code.text} {unmet}." if unmet else code.text

    def record(self) -> Record:
        """The findings over the dimension `limit`; the coordinate `limit_unit` contains the unit of each limit."""
        dims = ("limit",)
        statuses = np.asarray(STATUSES)[_concrete(self.codes)]
        variables = {
            "status": Quantity(statuses, "", f"one of {', '.join(STATUSES)}", dims),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit", dims),
            "worst_value": Quantity(self.values, "", "largest value found, in limit_unit; NaN if undefined", dims),
            "worst_time": Quantity(self.times, "s", "time of the largest value, or at which it is undefined", dims),
        }
        coordinates = {
            "limit": Quantity(np.array(self.names, dtype=str), "", "limited quantity", dims),
            "limit_unit": Quantity(np.array([quantity(x).unit for x in self.names], dtype=str), "", "its unit", dims),
        }
        summary = f"{batch_prefix(self.codes.shape[:-1], 'paths')}{self.summary}"
        return Record(summary, variables, coordinates, {"frame": "natural"})

    def __bool__(self) -> bool:
        return True  # without this, Python would use the length

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
            counts = np.bincount(_concrete(self.codes).ravel(), minlength=len(STATUSES))
            texts = ", ".join(f"{count} {text}" for count, text in zip(counts, STATUSES, strict=True) if count)
            return f"findings on {', '.join(self.names)} of {self.codes[..., 0].size} paths: {texts}"
        return "\n".join(f"{name} {self.describe(name)}: {status}" for name, status in self.status.items())


def require_float64(path: AbstractHodograph) -> None:
    """Raise a ValueError for a path in lower precision than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"certificates need float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before building it."
        )


def _concrete(x: Array) -> np.ndarray:
    array = concrete(x)
    if array is None:
        raise ValueError("inside a trace the findings of a certificate are traced arrays: use its codes and values")
    return array


def _plain(x: Any) -> Any:
    """A Python value for a single element."""
    return x.item() if np.ndim(x) == 0 else x
