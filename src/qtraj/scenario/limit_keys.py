"""Define the scenario keys of the limits, one for each entry of the registry of path quantities."""

from collections.abc import Iterator
from typing import Any

from pydantic import create_model

from qtraj.design.bound import bound_of
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import QUANTITIES
from qtraj.path.sides import has_sides
from qtraj.scenario import keys
from qtraj.scenario.keys import Part, key


class LimitedPart(Part):
    """Limits on path quantities, for the whole path.

    A number limits the magnitude of a quantity. A range [lower, upper], {min = lower} or {max = upper} limits its
    signed value: longitudinal_acceleration = [-6, 2] is for braking and accelerating, and speed = {min = 5} is a lower
    limit.
    """

    def limits(self) -> dict[str, Any]:
        """Return the limits that are set, by name: numbers, or pairs (lower, upper)."""
        return {name: _bound(value) for name, value in self.model_dump().items() if value is not None}

    def _faults(self) -> Iterator[str]:
        for name, value in self.limits().items():
            try:
                bound_of(value, name)
            except ValueError as error:
                yield str(error)


def _bound(value: Any) -> Any:
    if isinstance(value, dict):
        return value.get("min"), value.get("max")
    return tuple(value) if isinstance(value, list) else value


def _limit_key(entry: PathQuantity) -> tuple[Any, Any]:
    kind: Any = keys.Positive | keys.Range if has_sides(entry) else keys.Positive
    values = f"a positive finite number{' or a range' if has_sides(entry) else ''} [{entry.label}]"
    return kind | None, key(entry.meaning, None, values=values)


_limits: dict[str, Any] = {name: _limit_key(entry) for name, entry in QUANTITIES.items()}
LimitsPart = create_model("LimitsPart", __base__=LimitedPart, __doc__=LimitedPart.__doc__, **_limits)
"""The table [limits]."""
