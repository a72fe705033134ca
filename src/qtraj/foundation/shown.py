"""Format the `repr` of Modules: the fields that are not None, with their values and units."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer

from qtraj.foundation.result import extent

MAX_SHOWN = 9
"""Maximum size of an array that is shown in full; for larger arrays the shape and the range are shown."""


def shown(module: Any, **units: str) -> str:
    """Format a Module, for example as "Limits(curvature=0.1 1/m, speed=5 m/s)", without fields that are None.

    `units` are the units of the fields in display form, by the names of the fields.
    """
    if dataclasses.is_dataclass(module):
        names = [f.name for f in dataclasses.fields(module) if f.repr]
    else:  # a named tuple
        names = getattr(module, "_fields", ())
    fields = {name: getattr(module, name, None) for name in names}
    texts = [f"{name}={_text(x, units.get(name, ''))}" for name, x in fields.items() if x is not None]
    return f"{type(module).__name__}({', '.join(texts)})"


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
