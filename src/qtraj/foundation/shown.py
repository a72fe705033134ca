"""Format the `repr` and the HTML of Modules: the fields that are not None, with their values and units."""

import dataclasses
from html import escape
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from qtraj.foundation.result import extent

MAX_SHOWN = 9
"""Maximum size of an array that is shown in full; for larger arrays the shape and the range are shown."""


class Shown(str):
    """The `repr` of a Module, with its parts: the name of the class, and the names and texts of the fields."""

    name: str
    fields: dict[str, str]

    def __new__(cls, name: str, fields: dict[str, str]) -> "Shown":
        """Join the parts to a `repr`."""
        text = super().__new__(cls, f"{name}({', '.join(f'{field}={x}' for field, x in fields.items())})")
        text.name, text.fields = name, fields
        return text


def shown(module: Any, **units: str) -> Shown:
    """Format a Module, for example as "Limits(curvature=0.1 1/m, speed=5 m/s)", without fields that are None.

    `units` are the units of the fields in display form, by the names of the fields.
    """
    if dataclasses.is_dataclass(module):
        names = [f.name for f in dataclasses.fields(module) if f.repr]
    else:  # a named tuple
        names = getattr(module, "_fields", ())
    fields = {name: getattr(module, name, None) for name in names}
    return Shown(
        type(module).__name__, {name: _text(x, units.get(name, "")) for name, x in fields.items() if x is not None}
    )


def shown_html(module: Any) -> str:
    """Format a Module as an HTML table of its fields for notebooks; one whose `repr` is not by `shown`, as text."""
    text = repr(module)
    if not isinstance(text, Shown):
        return f"<pre>{escape(text)}</pre>"
    rows = [f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in text.fields.items()]
    return f"<div><strong>{escape(text.name)}</strong><table><tbody>{''.join(rows)}</tbody></table></div>"


def _text(value: Any, unit: str) -> str:
    if isinstance(value, jax.tree_util.Partial) and not (value.args or value.keywords):
        return getattr(value.func, "__qualname__", repr(value.func))
    if not isinstance(value, jax.Array | np.ndarray | np.generic):
        return repr(value)
    if isinstance(value, Tracer):
        return eqx.tree_pformat(value)
    if value.size > MAX_SHOWN:
        return f"<{' × '.join(map(str, value.shape))} numbers, {f'{extent(value)} {unit}'.rstrip()}>"
    written = np.array2string(np.asarray(value), separator=", ", formatter={"float_kind": lambda x: f"{x:.6g}"})
    return f"{' '.join(written.split())} {unit}".rstrip()
