"""Let own path classes declare their duration as a number, a static field or a class attribute."""

import dataclasses
import inspect
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.foundation.arrays import as_float


def as_duration(duration: Any) -> Any:
    """Return a duration [s] as an array of floats; such arrays are returned unchanged."""
    known = isinstance(duration, jax.Array | np.ndarray) and duration.dtype.kind == "f"
    return duration if known else as_float(duration)


def with_array_duration(cls: type) -> None:
    """Change the declaration of `duration` in a new class, so that its value is always an array.

    The library needs the dtype and the shape of a duration, which a number does not have.
    """
    declared = cls.__dict__.get("duration", dataclasses.MISSING)
    annotation = inspect.get_annotations(cls).get("duration")
    if isinstance(declared, property):
        getter: Any = declared.fget
        cls.duration = property(lambda self: as_duration(getter(self)), doc=declared.__doc__)  # pyright: ignore
    elif annotation is None and declared is dataclasses.MISSING:
        return  # declared in a base class
    elif "AbstractVar" not in str(annotation):
        cls.__annotations__ = {**inspect.get_annotations(cls), "duration": Any}
        cls.duration = _field(declared)  # pyright: ignore


def _field(declared: Any) -> Any:
    """Return a dataclass field with the default of `declared`, whose values are converted to arrays."""
    if not isinstance(declared, dataclasses.Field):
        options = {} if declared is dataclasses.MISSING else {"default": declared}
        return eqx.field(converter=as_duration, **options)
    if "converter" in declared.metadata:
        return declared
    options = {name: getattr(declared, name) for name in ("default", "default_factory")}
    options = {name: value for name, value in options.items() if value is not dataclasses.MISSING}
    return eqx.field(converter=as_duration, init=declared.init, repr=declared.repr, kw_only=declared.kw_only, **options)
