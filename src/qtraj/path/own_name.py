"""Names of quantities of one's own, which carry the entries of the quantity, so that no global registry is needed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from qtraj.foundation.document import stored_as
from qtraj.path.path_quantity import PathQuantity


def name_of(quantity: Any) -> Any:
    """Return the name of a quantity of one's own; any other argument, such as a name, unchanged."""
    return getattr(quantity, "key", quantity)


def _fields(name: Any) -> dict[str, Any]:
    return {"text": str(name), "quantity": name.quantity}


def _built(text: str, quantity: Any) -> Any:
    if not isinstance(entries := getattr(quantity, "entries", None), Mapping) or text not in entries:
        raise ValueError(f"{text!r:.80} is not the name of a quantity of one's own or of a side of it")
    return OwnName(text, quantity)


@stored_as(_fields, _built)
class OwnName(str):
    """The name of a quantity of one's own, or of a side of it, which carries the entries of the quantity.

    It equals the same text, so results are found by the text. Two quantities with the same name are different.
    """

    quantity: Any

    def __new__(cls, text: str, quantity: Any) -> OwnName:
        """Return the name `text`, which must be one of the quantity's `entries`."""
        found = super().__new__(cls, text)
        found.quantity = quantity
        return found

    @property
    def entry(self) -> PathQuantity:
        """The entry with this name."""
        return self.quantity.entries[str(self)]

    @property
    def output(self) -> PathQuantity:
        """The entry whose output in `evaluate` has this name."""
        return next(entry for entry in self.quantity.entries.values() if entry.variable == str(self))

    def __getnewargs__(self) -> Any:
        return str(self), self.quantity

    def __add__(self, other: str) -> str:
        text = str(self) + other
        return OwnName(text, self.quantity) if text in self.quantity.entries else text

    def __eq__(self, other: object) -> bool:
        return str.__eq__(self, other) is True and (not isinstance(other, OwnName) or self.quantity == other.quantity)

    def __ne__(self, other: object) -> bool:
        return not self == other

    __hash__ = str.__hash__
