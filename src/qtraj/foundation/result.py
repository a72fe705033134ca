"""Define the base class of all results, with conversion to xarray, a summary in one line, and HTML for notebooks."""

import abc
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from qtraj.foundation.record import Quantity, Record, require_concrete, to_dataset
from qtraj.foundation.units import symbol

if TYPE_CHECKING:
    import xarray

MAX_VALUES = 10_000_000
"""Maximum size of an array whose range is displayed."""
MAX_TEXTS = 4
"""Maximum number of different strings that are displayed for one variable."""


class AbstractResult(eqx.Module):
    """Result of a call as labelled arrays, for one problem or a batch (batch axes first in every array)."""

    @abc.abstractmethod
    def record(self) -> Record:
        """Return the contents of the result, with units and meanings."""

    def to_xarray(self, attributes: Mapping[str, Any] | None = None) -> "xarray.Dataset":
        """Convert the result to an `xarray.Dataset` (extra `io`), which `qtraj.save_dataset` writes to a file.

        The attributes of each variable are its unit and its meaning. The attributes of the dataset are the conventions
        for frames and quaternions, the versions, the dtype, and the given `attributes`, such as the hash of a scenario.

        **Raises:** ModuleNotFoundError with the extra to install, if xarray is missing; ValueError inside a trace.
        """
        require_concrete(self)
        return to_dataset(self.record(), {"type": type(self).__name__, **(attributes or {})})

    def __repr__(self) -> str:
        record = _record(self)
        return eqx.tree_pformat(self) if record is None else f"{type(self).__name__}({record.summary})"

    def _repr_html_(self) -> str:
        record = _record(self)
        if record is None:
            return f"<pre>{escape(eqx.tree_pformat(self))}</pre>"
        head = f"<strong>{escape(type(self).__name__)}</strong> {escape(record.summary)}"
        rows = [_row(name, record.dims(q), q) for name, q in record.everything().items()]
        titles = "".join(f"<th>{title}</th>" for title in ("", "dimensions", "unit", "values", "meaning"))
        return f"<div>{head}<table><thead><tr>{titles}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"


def counts_text(texts: Any) -> str:
    """Count equal strings, for example as "3 converged, 1 infeasible" or "all proved"; a single string is unchanged."""
    if np.ndim(texts) == 0:
        return str(texts)
    if np.unique(texts).size == 1:
        return f"all {np.ravel(texts)[0]}"
    distinct, counts = np.unique(np.asarray(texts), return_counts=True)
    order = np.argsort(-counts, kind="stable")
    shown = [f"{counts[k]} {distinct[k]}" for k in order[:MAX_TEXTS]]
    return ", ".join([*shown, *([f"{len(order) - MAX_TEXTS} others"] if len(order) > MAX_TEXTS else [])])


def batch_prefix(shape: tuple[int, ...], what: str = "") -> str:
    """Return the beginning of a summary: "3 paths, ", "batch of 2 × 3, ", or "" for a single problem."""
    count = " × ".join(map(str, shape))
    return "" if not shape else f"{count} {what}, " if what else f"batch of {count}, "


def extent(values: Any, unit: str = "") -> str:
    """Format the range of the values, such as "0 … 12 s", or one number if all are equal.

    NaN and infinities are not part of the range; if there are any, the text says so. `unit` is in netCDF notation, such
    as "m s-1".
    """
    values = np.asarray(values)
    finite = values[np.isfinite(values)]
    missing = "" if finite.size == values.size else " and others that are not finite" if finite.size else "not finite"
    if not finite.size:
        return missing or "none"
    low, high = f"{finite.min():.6g}", f"{finite.max():.6g}"
    return f"{low if low == high else f'{low} … {high}'} {symbol(unit)}".rstrip() + missing


def vector_text(vector: Any) -> str:
    """Format a vector, for example as "(0.707107, 0, 0, 0.707107)"."""
    return f"({', '.join(f'{x:.6g}' for x in np.asarray(vector).tolist())})"


def times_text(times: Any) -> str:
    """Format the number of instants and their range, for example as "101 instants, 0 … 12 s"."""
    return f"{np.shape(times)[-1]} instants, {extent(times, 's')}"


def _record(result: AbstractResult) -> Record | None:
    """Return the record of a result, or None if the result is traced, or incomplete after a JAX transformation."""
    leaves = jax.tree.leaves(result)
    if not leaves or not all(
        isinstance(x, jax.Array | np.ndarray | np.generic) and not isinstance(x, Tracer) for x in leaves
    ):
        return None
    try:
        return result.record()
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError):
        return None  # displaying an incomplete result must not fail


def _row(name: str, dims: tuple[str, ...], quantity: Quantity) -> str:
    shape = ", ".join(f"{dim} {size}" for dim, size in zip(dims, np.shape(quantity.values), strict=True))
    unit = "" if quantity.unit == "1" else quantity.unit
    cells = (name, shape, unit, _shown(quantity.values), quantity.meaning)
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"


def _shown(values: Any) -> str:
    if np.size(values) > MAX_VALUES:
        return ""
    values = np.asarray(values)
    if values.dtype.kind in "iuf":
        return extent(values)
    return counts_text(values)
