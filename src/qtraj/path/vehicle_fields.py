"""Check and convert the parameters of a vehicle."""

from typing import Any

import numpy as np
from jaxtyping import Array

from qtraj.foundation.arrays import as_float, concrete, require_positive
from qtraj.foundation.namespace import xp
from qtraj.foundation.types import ArrayInput
from qtraj.path.road import Road


def require_road(road: Any, bank: Array, friction: Array) -> None:
    """Raise a ValueError for anything else than a road, or one that defines what the vehicle defines."""
    if not isinstance(road, Road):
        raise ValueError(f"the road of a vehicle must be a Road, such as Road([0, 50], bank=[0, 0.1]), not {road!r}")
    given = {"bank": (bank, road.bank, 0.0), "friction": (friction, road.friction, 1.0)}
    for name, (own, of_road, default) in given.items():
        known = concrete(own)
        if of_road is not None and (known is None or np.any(known != default)):
            raise ValueError(f"the vehicle and its road both define the {name}: omit one of them")


def scalar_field(value: ArrayInput, name: str, unit: str) -> Array:
    """Return a parameter of a vehicle as a finite scalar, or raise an error that names it."""
    try:
        number = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the {name} of a vehicle must be a number [{unit}], but {value!r} was given") from error
    if isinstance(value, bool | np.bool_):
        raise ValueError(f"the {name} of a vehicle must be a number [{unit}], but {value!r} was given")
    if number.ndim != 0:
        raise ValueError(
            f"the {name} of a vehicle must be one number, but an array of shape {number.shape} was given; "
            "create many vehicles with jax.vmap"
        )
    if not np.all(np.isfinite(0.0 if (known := concrete(number)) is None else known)):
        raise ValueError(f"the {name} of a vehicle must be finite [{unit}], but {value!r} was given")
    return number


def not_negative_field(value: ArrayInput, name: str, unit: str) -> Array:
    """Return a parameter of a vehicle that must not be negative."""
    number = scalar_field(value, name, unit)
    known = concrete(number)
    if known is not None and np.any(known < 0):
        raise ValueError(f"the {name} of a vehicle must not be negative [{unit}], but {known.tolist()} was given")
    return number


def friction_field(value: ArrayInput) -> Array:
    """Return the coefficients of friction along and across the vehicle."""
    try:
        friction = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(f"the friction of a vehicle must be one or two numbers, but {value!r} was given") from error
    if friction.shape not in ((), (2,)):
        raise ValueError(
            "the friction of a vehicle must be one number, or two (along and across the vehicle), but an array of "
            f"shape {friction.shape} was given"
        )
    require_positive(friction, "the friction of a vehicle", "-")
    return xp.broadcast_to(friction, (2,)) if friction.ndim == 0 else friction
