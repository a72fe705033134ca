"""The limits on quantities of one's own, a field of `Limits`."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Collection, Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.design.bound import Bound, Limit, bound_of, part_of
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import concrete
from qtraj.foundation.document import stored_as
from qtraj.path.own_name import OwnName
from qtraj.path.own_quantity import Quantity
from qtraj.path.quantity import quantity


def _fields(limits: Any) -> dict[str, Any]:
    return {"names": limits.names, "bounds": limits.bounds}


def _built(names: list[Any], bounds: list[Any]) -> Any:
    """Return the limits that are stored, checked like those that are given to `Limits`."""
    return own_limits(dict(zip(names, bounds, strict=True)))


@stored_as(_fields, _built)
class OwnLimits(eqx.Module):
    """The bounds on quantities of one's own, in the order of their `names`; a bound may be None."""

    names: tuple[OwnName, ...] = eqx.field(static=True)
    bounds: tuple[Bound | None, ...]

    def __repr__(self) -> str:
        texts = [f"{name}: {_text(bound)} {quantity(name).label}" for name, bound in self.given().items()]
        return f"{{{', '.join(texts)}}}"

    def given(self) -> dict[str, Bound]:
        """Return the bounds that are set, by name."""
        return {name: x for name, x in zip(self.names, self.bounds, strict=True) if x is not None}

    def only(self, kept: Collection[str]) -> OwnLimits | None:
        """Return the bounds of which `kept` contains the names, also those of sides."""
        parts = {name: part_of(bound, name, kept) for name, bound in self.given().items()}
        return own_limits({name: x for name, x in parts.items() if x is not None})


OwnInput = Mapping[Quantity, Limit] | OwnLimits | None
"""The limits on quantities of one's own, by quantity; None means no limits."""


def own_limits(bounds: Mapping[Any, Any] | OwnLimits | None) -> OwnLimits | None:
    """Check the limits on quantities of one's own, by quantity or name; None without any.

    **Raises:** TypeError for anything but a dictionary whose keys are `Quantity`s, and ValueError for two quantities
    with one name, and for a limit that `Limits` does not accept.
    """
    if bounds is None or isinstance(bounds, OwnLimits):
        return bounds
    if not isinstance(bounds, Mapping):
        raise TypeError(f"own must be a dictionary such as {{climb: (-2.0, 3.0)}}, but {described(bounds)} was given")
    found: dict[Any, Bound] = {}
    for key, bound in bounds.items():
        name = key.key if isinstance(key, Quantity) else key
        if not isinstance(name, OwnName):
            raise TypeError(
                f"the keys of own must be quantities such as Quantity('climb_rate', 'm/s', ...), but {key!r} was given"
            )
        if str(name) in map(str, found):
            raise ValueError(f"own contains two quantities with the name {name}: give one of them another name")
        value = bound_of(bound, name)
        if value is not None:
            found[name] = value
    return OwnLimits(tuple(found), tuple(found.values())) if found else None


def require_reduced(names: Collection[str], what: str, in_world: bool = False, order: int = 4) -> None:
    """Raise a ValueError for a quantity of one's own that the search `what` cannot compute.

    Searches compute formulas in reduced units, in a basis that rotates with the path or, with `in_world`, in world
    axes; `order` is that of the highest derivative that they compute.
    """
    for name in names:
        entry = quantity(name)
        if entry.own is None:
            continue
        reasons = {
            "is not a formula of + - * / and qtraj.sqrt": entry.own.formula is None,
            "adds numbers with different units": entry.own.in_si,
            "contains components along x or y, or more of the position than its height": entry.own.world
            and not in_world,
            f"contains derivatives above the order {order}": entry.order > order,
        }
        if reason := next((text for text, holds in reasons.items() if holds), None):
            raise ValueError(
                f"{what} does not support the limit on {entry.base or entry.name}, because its function {reason}: "
                "remove the limit, and check the result with qtraj.certify"
            )


def _text(bound: Any) -> str:
    known = concrete(bound) if isinstance(bound, jax.Array | np.ndarray | np.generic) else None
    return repr(bound) if known is None or known.ndim else f"{known:.6g}"
