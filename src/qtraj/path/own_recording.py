"""Record the function of a quantity of one's own: its formula, and the same formula as a text.

`own_expression` reads the text again. Its operations, in the same order, result in the same formula.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import numpy as np

from qtraj.path.product import Product, product_of
from qtraj.path.product_vector import ProductVector

LONGEST = 1000
"""The maximum number of characters of a text; a longer one, such as that of x² squared ten times, is not recorded."""

SUM, TERM, SIGN, ATOM = range(4)
"""How tightly the parts of a text are bound: sums, products and quotients, a sign, and names, calls and powers."""

Operator = Callable[[Any, Any], Any]
OPERATORS: dict[str, tuple[Operator, int]] = {
    "+": (operator.add, SUM),
    "-": (operator.sub, SUM),
    "*": (operator.mul, TERM),
    "/": (operator.truediv, TERM),
}


def _binary(symbol: str, reflected: bool = False) -> Operator:
    """Return the method of a binary operator; `reflected` means that the object is the right operand."""
    compute, rank = OPERATORS[symbol]

    def method(self: Any, other: Any) -> Any:
        a, b = (other, self) if reflected else (self, other)
        value = compute(_plain(a), _plain(b))
        return recorded(value, _joined(_written(a, rank), f" {symbol} ", _written(b, rank + 1)), rank)

    return method


class RecordedNumber:
    """A number computed from the motion: its formula `value`, and its `text`, None if it is too long."""

    __slots__ = ("rank", "text", "value")
    __array_ufunc__ = None  # a NumPy number on the left of an operator leaves the operation to this class

    def __init__(self, value: Product, text: str | None, rank: int = ATOM):
        self.value, self.text, self.rank = value, text, rank

    __add__, __radd__ = _binary("+"), _binary("+", reflected=True)
    __sub__, __rsub__ = _binary("-"), _binary("-", reflected=True)
    __mul__, __rmul__ = _binary("*"), _binary("*", reflected=True)
    __truediv__, __rtruediv__ = _binary("/"), _binary("/", reflected=True)

    def __neg__(self) -> RecordedNumber:
        return RecordedNumber(-self.value, _joined("-", _written(self, SIGN)), SIGN)

    def __pow__(self, power: Any) -> RecordedNumber:
        power = power.item() if isinstance(power, np.generic) else power
        return RecordedNumber(self.value**power, _joined(_written(self, ATOM), f"**{power!r}"), SIGN)

    def __abs__(self) -> RecordedNumber:
        return RecordedNumber(abs(self.value), _joined("abs(", self.text, ")"))

    def sqrt(self) -> RecordedNumber:
        """Return the root of the number."""
        return RecordedNumber(self.value.sqrt(), _joined("sqrt(", self.text, ")"))

    def __bool__(self) -> bool:
        raise TypeError("a formula of a quantity has no truth value")

    def __eq__(self, other: object) -> bool:
        raise TypeError("a formula of a quantity cannot be compared")

    __hash__ = None  # type: ignore[assignment]


class RecordedVector:
    """A vector computed from the motion: its formulas `value`, and its `text`, None if it is too long."""

    __slots__ = ("rank", "text", "value")
    __array_ufunc__ = None

    def __init__(self, value: ProductVector, text: str | None, rank: int = ATOM):
        self.value, self.text, self.rank = value, text, rank

    __add__, __radd__ = _binary("+"), _binary("+", reflected=True)
    __sub__, __rsub__ = _binary("-"), _binary("-", reflected=True)
    __mul__, __rmul__ = _binary("*"), _binary("*", reflected=True)
    __truediv__ = _binary("/")

    def __neg__(self) -> RecordedVector:
        return RecordedVector(-self.value, _joined("-", _written(self, SIGN)), SIGN)

    def dot(self, other: Any) -> RecordedNumber:
        """Return the scalar product with another vector, or with three numbers."""
        return RecordedNumber(self.value.dot(_plain(other)), self._called("dot", other))

    def cross(self, other: Any) -> RecordedVector:
        """Return the cross product with another vector, or with three numbers."""
        return RecordedVector(self.value.cross(_plain(other)), self._called("cross", other))

    def norm(self) -> RecordedNumber:
        """Return the length of the vector."""
        return RecordedNumber(self.value.norm(), self._called("norm"))

    def __getitem__(self, axis: Any) -> RecordedNumber:
        value = self.value[axis]
        return RecordedNumber(value, _joined(_written(self, ATOM), f"[{axis % 3}]"))

    def __iter__(self) -> Iterator[RecordedNumber]:
        return iter((self[0], self[1], self[2]))

    def __len__(self) -> int:
        return 3

    def _called(self, method: str, *arguments: Any) -> str | None:
        texts = [_written(x, SUM) for x in arguments]
        return _joined(_written(self, ATOM), f".{method}(", *texts, ")")


def recorded(value: Any, text: str | None, rank: int = ATOM) -> Any:
    """Return a formula, or a vector of formulas, with its text."""
    if isinstance(value, ProductVector):
        return RecordedVector(value, text, rank)
    return RecordedNumber(value, text, rank)


def _plain(x: Any) -> Any:
    """Return an operand without its text."""
    if isinstance(x, RecordedNumber | RecordedVector):
        return x.value
    return [_plain(part) for part in x] if isinstance(x, list | tuple) else x


def _written(x: Any, rank: int) -> str | None:
    """Return the text of an operand, in parentheses if it is bound less tightly than `rank`."""
    text, own = (x.text, x.rank) if isinstance(x, RecordedNumber | RecordedVector) else _constant(x)
    return text if text is None or own >= rank else f"({text})"


def _constant(x: Any) -> tuple[str | None, int]:
    """Return the text of a number, or of three numbers, and how tightly it is bound."""
    if product_of(x) is None:
        return _joined("[", *_separated([_written(part, SUM) for part in x]), "]"), ATOM
    x = x.item() if isinstance(x, np.ndarray | np.generic) else x
    if isinstance(x, int | float):
        return repr(x), SIGN if x < 0 else ATOM
    exact = Fraction(x)
    if exact.denominator == 1:
        return repr(exact.numerator), SIGN if exact < 0 else ATOM
    return f"{exact.numerator} / {exact.denominator}", TERM


def _separated(texts: list[str | None]) -> list[str | None]:
    return [part for text in texts for part in (", ", text)][1:]


def _joined(*parts: str | None) -> str | None:
    """Return a text, or None if a part of it is None or it is too long."""
    known = [part for part in parts if part is not None]
    return None if len(known) < len(parts) or sum(map(len, known)) > LONGEST else "".join(known)
