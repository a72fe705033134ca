"""Certificates, which contain one finding for each limit of a path."""

import math
import warnings
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.where_undefined import where_undefined
from qtraj.foundation.arrays import as_code, as_float, concrete, require_element
from qtraj.foundation.codes import where_code
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, counts_text
from qtraj.foundation.types import ArrayInput
from qtraj.foundation.units import symbol, with_unit
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity

STATUSES = ("proved", "sampled", "broken", "undecided", "undefined")
"""The statuses of limits; the code of a finding is the index of its status.

- proved: the limit is proved to be satisfied on the whole path.
- sampled: the limit is satisfied at the refined maxima of a fine grid. This is strong evidence, but not a proof.
- broken: the limit is violated at the reported time.
- undecided: neither satisfaction nor violation is proved, because the quantity touches the limit, or because it is not
  proved that the quantity is defined everywhere.
- undefined: at the reported time, the divisor of the quantity cannot be distinguished from zero.
"""
PROVED, SAMPLED, BROKEN, UNDECIDED, UNDEFINED = range(len(STATUSES))

_RESULT_OF_FINDING = (
    (BROKEN, ResultCode.limits_broken),
    (UNDEFINED, ResultCode.limits_undefined),
    (UNDECIDED, ResultCode.limits_undecided),
    (SAMPLED, ResultCode.limits_sampled),
)
"""Pairs of a finding's status code and the resulting `ResultCode` of the path, in order of decreasing severity."""

ACTIVE_MARGIN = 1e-6
"""A satisfied limit is active if its relative margin is at most this value."""


class Finding(NamedTuple):
    """The finding on one limit of one path: its status, and the time [s] and value of the maximum of the quantity.

    For a lower bound, it is the minimum.
    """

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
        """Whether the limit is satisfied with a relative margin of at most 1e-6."""
        return self.met and self.margin <= ACTIVE_MARGIN * (abs(self.limit) or 1.0)

    @property
    def margin(self) -> float:
        """The distance of the value from the limit; negative if the limit is violated."""
        return quantity(self.name).side * (self.limit - self.value)

    @property
    def label(self) -> str:
        """The name of the quantity and the symbol of its unit, such as "speed [m/s]" or "speed min [m/s]"."""
        entry = quantity(self.name)
        side = self.name.removeprefix(entry.base).replace("_", " ") if entry.base else ""
        return f"{entry.base or self.name}{side} [{symbol(entry.unit) or '-'}]"

    @property
    def text(self) -> str:
        """A description of the worst value and the limit."""
        if math.isnan(self.value) and math.isinf(self.limit):
            return "not limited anywhere on the path"
        if math.isnan(self.value):
            return f"undefined at t = {self.time:.4g} s, where {where_undefined(quantity(self.name))}"
        if names_obstacle(self.name):
            return f"a clearance of {self.value:.6g} m at t = {self.time:.4g} s"
        texts = f"{self.value:.6g}", with_unit(self.limit, quantity(self.name).unit)
        rounds_to_limit = not self.met and self.margin < 0 and f"{self.limit:.6g}" == texts[0]
        violation = f" (relative violation {-self.margin / abs(self.limit):.1e})" if rounds_to_limit else ""
        if self.status == STATUSES[BROKEN] and self.margin >= 0:
            violation = " (violated by less than the rounding error of the value)"
        of = "for a lower bound of" if quantity(self.name).lower else "of"
        return f"{texts[0]} {of} {texts[1]}{violation} at t = {self.time:.4g} s"

    @property
    def statement(self) -> str:
        """A sentence with the name of the quantity, its status, the worst value and the limit."""
        if math.isnan(self.value):
            return f"{self.name} is {self.text}"
        return f"the limit on {self.name} is {self.status}: {self.text}"


@storable
class Certificate(AbstractOutcome):
    """The findings on the limits of one path or of a batch of paths.

    The last axis of the arrays corresponds to the limits; axes before it are batch axes.

    - `names`: the names of the limited quantities.
    - `codes`: the codes of the statuses; `status` contains them as strings.
    - `times` [s] and `values`: the time and value of the maximum found, or of the minimum for a lower bound. If a
      quantity is undefined, the time is an instant at which it is undefined, and the value is NaN.
    - `limits`: the values of the limits.
    - `code`: the `ResultCode` of the whole path; `result` explains it.

    For a batch, the properties contain arrays instead of strings and numbers. `certificate[k]` is the certificate of
    one path.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    codes: Int[Array, "*batch n"]
    times: Float[Array, "*batch n"]
    values: Float[Array, "*batch n"]
    limits: Float[Array, "*batch n"]

    def __init__(
        self, names: "Sequence[str]", codes: ArrayInput, times: ArrayInput, values: ArrayInput, limits: ArrayInput
    ):
        self.names = tuple(names)
        self.times, self.values, self.limits = as_float(times), as_float(values), as_float(limits)
        self.codes = as_code(codes, self.times, self.values, self.limits)

    @property
    def status(self) -> dict[str, Any]:
        """The status of each limit, by name: "proved", "sampled", "broken", "undecided" or "undefined"."""
        texts = np.asarray(STATUSES)[_concrete(self.codes)]
        return {name: _plain(texts[..., k]) for k, name in enumerate(self.names)}

    @property
    def worst(self) -> dict[str, tuple[Any, Any, Any]]:
        """The tuple (time [s], value, limit) for the worst value of each quantity, by name.

        This is the largest value, or the smallest one for a lower bound.
        """
        arrays = [_concrete(x) for x in (self.times, self.values, self.limits)]
        return {name: (*(_plain(x[..., k]) for x in arrays),) for k, name in enumerate(self.names)}

    @property
    def met(self) -> Any:
        """Whether every limit is satisfied, by proof or by refined sampling; inside a trace, an array."""
        return where_code(self.codes, lambda codes: (codes <= SAMPLED).all(axis=-1))

    @property
    def holds(self) -> Any:
        """Whether every limit is proved to be satisfied on the whole path; refined sampling is not a proof.

        Inside a trace, the result is an array.
        """
        return where_code(self.codes, lambda codes: (codes == PROVED).all(axis=-1))

    @property
    def unmet(self) -> list[str]:
        """Names of the limits of one path that are not known to be satisfied."""
        return [finding.name for finding in self.findings() if not finding.met]

    def margin(self, name: str) -> Any:
        """Return the distance of the worst value from the limit; negative if the limit is violated."""
        _, value, limit = self.worst[name]
        own = self.names[self.names.index(name)]  # the name of a quantity of one's own carries its entry
        return quantity(own).side * (limit - value)

    @property
    def active(self) -> list[str]:
        """Names of the active limits of one path, which are satisfied with a relative margin of at most 1e-6."""
        return [finding.name for finding in self.findings() if finding.active]

    @property
    def binding(self) -> list[str]:
        """Deprecated name of `active`; version 1.0 removes it."""
        warnings.warn("Certificate.binding is now called active", DeprecationWarning, stacklevel=2)
        return self.active

    @property
    def summary(self) -> str:
        """The status of each limit in one line; for a batch, the number of paths with each status."""
        texts = (f"{name} {counts_text(status)}" for name, status in self.status.items())
        return "; ".join(texts) or "no limits"

    def describe(self, name: str) -> str:
        """Describe the worst value of one quantity of one path, and its limit."""
        return self.findings()[self.names.index(name)].text

    def findings(self, at: tuple[int, ...] = ()) -> list[Finding]:
        """Return the finding on each limit of one path; `at` is the index of the path in a batch."""
        # No method is called here: Equinox wraps each bound method in a Module, and this would dominate the run time.
        codes, *numbers = (_concrete(x)[at] for x in (self.codes, self.times, self.values, self.limits))
        columns = zip(self.names, codes.tolist(), *(x.tolist() for x in numbers), strict=True)
        return [Finding(name, STATUSES[code], *rest) for name, code, *rest in columns]

    @property
    def code(self) -> Int[Array, "*batch"]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The `ResultCode` of the whole path, from its worst finding."""
        known = concrete(self.codes)
        findings = self.codes if known is None else known
        code = xp.full(findings.shape[:-1], int(ResultCode.successful), np.int32)
        for finding, result in reversed(_RESULT_OF_FINDING):
            code = xp.where(xp.any(findings == finding, axis=-1), np.int32(result), code)
        return as_code(code, self.codes)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result of one path."""
        code, findings = ResultCode(int(np.asarray(self.code)[at])), self.findings(at)
        if code == ResultCode.successful:
            return "every limit is proved to be satisfied on the whole path."
        unmet = "; ".join(x.statement for x in findings if not x.met)
        return f"{code.text} {unmet}." if unmet else code.text

    def record(self) -> Record:
        """Return the findings over the dimension `limit`, with the units of the limits in `limit_unit`."""
        dims = ("limit",)
        statuses = np.asarray(STATUSES)[_concrete(self.codes)]
        variables = {
            "status": Quantity(statuses, "", f"one of {', '.join(STATUSES)}", dims),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit", dims),
            "worst_value": Quantity(
                self.values,
                "",
                "largest value found, or smallest for a lower bound, in limit_unit; NaN if undefined",
                dims,
            ),
            "worst_time": Quantity(
                self.times, "s", "time of the worst value, or an instant at which the quantity is undefined", dims
            ),
        }
        coordinates = {
            "limit": Quantity(np.array(self.names, dtype=str), "", "limited quantity", dims),
            "limit_unit": Quantity(
                np.array([quantity(x).unit for x in self.names], dtype=str), "", "unit of the quantity", dims
            ),
        }
        summary = f"{batch_prefix(self.codes.shape[:-1], 'paths')}{self.summary}"
        return Record(summary, variables, coordinates, {"frame": "natural"})

    def __bool__(self) -> bool:
        return True  # without this method, an empty batch would be false

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
    """Raise a ValueError if the precision of a traced path is lower than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"inside jit, grad and vmap a certificate needs float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before creating the path."
        )


def _concrete(x: Array) -> np.ndarray:
    array = concrete(x)
    if array is None:
        raise ValueError(
            "findings need concrete values, but this certificate was created inside jit, grad or vmap: use its arrays "
            "codes, times and values"
        )
    return array


def _plain(x: Any) -> Any:
    """Return a zero-dimensional array as a Python value, and any other array unchanged."""
    return x.item() if np.ndim(x) == 0 else x
