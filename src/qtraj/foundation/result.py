"""What every result can do: become a labelled dataset, say what it is in a line, and show itself in a notebook."""

import abc
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from qtraj.foundation.record import Quantity, Record, require_concrete, to_dataset

if TYPE_CHECKING:
    import xarray

MOST_VALUES = 10_000_000
"""Of a larger array the range is not looked up for display."""
MOST_TEXTS = 4
"""Different texts shown of one variable."""


class AbstractResult(eqx.Module):
    """The outcome of a call: labelled arrays, of one problem or of many (batch axes in front of every array)."""

    @abc.abstractmethod
    def record(self) -> Record:
        """What the result consists of, with units and meanings."""

    def to_xarray(self, attributes: Mapping[str, Any] | None = None) -> "xarray.Dataset":
        """The result as an `xarray.Dataset` (extra `io`), which `qtraj.save_dataset` writes.

        Units and meanings stand in the attributes of its variables; conventions of frames and quaternions, versions and
        dtype in its own, with further `attributes`, such as the hash of a scenario.

        **Raises:** ModuleNotFoundError, naming the extra, where xarray is missing; ValueError inside a trace.
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
    """How often each text occurs: "3 converged, 1 infeasible", "all proved"; one text alone as it is."""
    if np.ndim(texts) == 0:
        return str(texts)
    if np.unique(texts).size == 1:
        return f"all {np.ravel(texts)[0]}"
    found, counts = np.unique(np.asarray(texts), return_counts=True)
    most = np.argsort(-counts, kind="stable")
    shown = [f"{counts[k]} {found[k]}" for k in most[:MOST_TEXTS]]
    return ", ".join([*shown, *([f"{len(most) - MOST_TEXTS} others"] if len(most) > MOST_TEXTS else [])])


def batch_prefix(shape: tuple[int, ...], what: str = "") -> str:
    """ "3 paths, ", "batch of 2 × 3, ", or nothing for one problem alone: the beginning of a summary."""
    count = " × ".join(map(str, shape))
    return "" if not shape else f"{count} {what}, " if what else f"batch of {count}, "


def extent(values: Any, unit: str = "") -> str:
    """ "0 … 12 s": the least and the largest number, one number where they agree, and whether any is missing."""
    known = np.asarray(values)
    finite = known[np.isfinite(known)]
    missing = "" if finite.size == known.size else " and others that are not finite" if finite.size else "not finite"
    if not finite.size:
        return missing or "none"
    low, high = f"{finite.min():.6g}", f"{finite.max():.6g}"
    return f"{low if low == high else f'{low} … {high}'} {unit}".rstrip() + missing


def vector_text(vector: Any) -> str:
    """ "(0.707107, 0, 0, 0.707107)": a few numbers, in a summary."""
    return f"({', '.join(f'{x:.6g}' for x in np.asarray(vector).tolist())})"


def times_text(times: Any) -> str:
    """ "101 instants, 0 … 12 s": what a result runs over, in its summary."""
    return f"{np.shape(times)[-1]} instants, {extent(times, 's')}"


def _record(result: AbstractResult) -> Record | None:
    """The record of a whole result; of one that is traced, or that a transformation has left half built, nothing."""
    leaves = jax.tree.leaves(result)
    if not leaves or not all(isinstance(x, jax.Array | np.ndarray) and not isinstance(x, Tracer) for x in leaves):
        return None
    try:
        return result.record()
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError):
        return None  # to be shown must not fail where to be used would


def _row(name: str, dims: tuple[str, ...], quantity: Quantity) -> str:
    shape = ", ".join(f"{dim} {size}" for dim, size in zip(dims, np.shape(quantity.values), strict=True))
    unit = "" if quantity.unit == "1" else quantity.unit
    cells = (name, shape, unit, _shown(quantity.values), quantity.meaning)
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"


def _shown(values: Any) -> str:
    if np.size(values) > MOST_VALUES:
        return ""
    known = np.asarray(values)
    if known.dtype.kind in "iuf":
        return extent(known)
    return counts_text(known)
