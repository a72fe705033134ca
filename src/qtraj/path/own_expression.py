"""Read a text such as "velocity[2] / speed" as the function of a quantity of one's own.

The text is parsed, but never executed by Python: only the operations of `own_recording` are known.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from fractions import Fraction
from typing import Any

from qtraj.path.own_motion import NAMES, PARAMETERS, sqrt
from qtraj.path.own_recording import LONGEST, OPERATORS

DEEPEST = 60
"""The maximum depth of nested operations."""

HIGHEST_POWER = 32
"""The maximum of an exponent, and of the product of nested exponents."""

CROSSES = 2
"""The maximum number of nested cross products, because every one of them multiplies the number of terms."""

ALLOWED = (
    f"{', '.join(NAMES)} with components such as velocity[2] and the methods dot, cross and norm; speed; "
    f"vehicle.{', vehicle.'.join(PARAMETERS)}; finite numbers; + - * / and powers; sqrt(...) and abs(...)"
)
"""What an expression may contain."""

BINARY: dict[type, Callable[[Any, Any], Any]] = {
    node: OPERATORS[symbol][0] for node, symbol in ((ast.Add, "+"), (ast.Sub, "-"), (ast.Mult, "*"), (ast.Div, "/"))
}
METHODS = {"dot": 1, "cross": 1, "norm": 0}
"""The methods of vectors, and the numbers of their arguments."""


class Expression:
    """The function of the motion that a text defines.

    **Raises:** ValueError, also when it is called, for a text that is too long or nested too deeply, and for anything
    but the operations in `ALLOWED`.
    """

    def __init__(self, text: str):
        self.text = text.strip()
        if len(self.text) > LONGEST:
            raise ValueError(f"an expression may have {LONGEST} characters, but one of {len(self.text)} was given")
        try:
            self._tree = ast.parse(self.text, mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            reason = getattr(error, "msg", None) or str(error)
            raise self._fault(f"is not valid: {reason}") from None

    def __call__(self, p: Any) -> Any:
        """Return the value for a motion."""
        try:
            return self._value(self._tree, p, 0)
        except (TypeError, IndexError, OverflowError, RecursionError) as error:
            raise self._fault(f"cannot be computed: {error}") from None

    def _value(self, node: ast.expr, p: Any, depth: int, power: float = 1.0, crosses: int = 0) -> Any:
        if depth > DEEPEST:
            raise self._fault(f"is nested more than {DEEPEST} times")
        value = lambda x, power=power, crosses=crosses: self._value(x, p, depth + 1, power, crosses)  # noqa: E731
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return Fraction(number) if isinstance(number, int) else number
            case ast.Name(id=name) if name in (*NAMES, "speed"):
                return getattr(p, name)
            case ast.Attribute(value=ast.Name(id="vehicle"), attr=name) if name in PARAMETERS:
                return getattr(p.vehicle, name)
            case ast.Subscript(value=vector, slice=ast.Constant(value=int() as axis)) if not isinstance(axis, bool):
                return self._part(value(vector), axis)
            case ast.List(elts=parts) | ast.Tuple(elts=parts):
                return [value(part) for part in parts]
            case ast.UnaryOp(op=ast.USub(), operand=x):
                return -value(x)
            case ast.BinOp(left=a, op=ast.Pow(), right=b):
                exponent = self._exponent(b, power)
                return value(a, power * max(abs(exponent), 1)) ** exponent
            case ast.BinOp(left=a, op=op, right=b) if type(op) in BINARY:
                x, y = value(a), value(b)
                if isinstance(x, list | tuple) and isinstance(y, list | tuple):
                    raise self._fault("has an operation on two lists of numbers, but one must be a vector of the path")
                return BINARY[type(op)](x, y)
            case ast.Call(func=ast.Name(id="sqrt"), args=[x], keywords=[]):
                return _root(value(x))
            case ast.Call(func=ast.Name(id="abs"), args=[x], keywords=[]):
                return abs(value(x))
            case ast.Call(func=ast.Attribute(value=x, attr=name), args=more, keywords=[]) if METHODS.get(name) == len(
                more
            ):
                crosses += name == "cross"
                if crosses > CROSSES:
                    raise self._fault(f"has more than {CROSSES} nested cross products")
                return self._method(value(x, crosses=crosses), name)(*[value(y, crosses=crosses) for y in more])
        raise self._fault(f"contains {ast.unparse(node)!r:.60}, but it may contain only {ALLOWED}")

    def _exponent(self, node: ast.expr, power: float) -> int | float:
        negative = isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub)
        number = node.operand if negative else node  # type: ignore[union-attr]
        found = number.value if isinstance(number, ast.Constant) else None
        if isinstance(found, bool) or not isinstance(found, int | float) or not (2 * found) % 1 == 0:
            raise self._fault("must have whole or half numbers as exponents, such as speed**3 or speed**-0.5")
        if found * power > HIGHEST_POWER:
            raise self._fault(f"has a power above {HIGHEST_POWER}")
        return -found if negative else found

    def _method(self, vector: Any, name: str) -> Any:
        if not hasattr(vector, name):
            raise self._fault(f"has the method {name} of a number, but only vectors have it")
        return getattr(vector, name)

    def _part(self, vector: Any, axis: int) -> Any:
        if not hasattr(vector, "__getitem__"):
            raise self._fault("has the component of a number, but only vectors have components")
        return vector[axis]

    def _fault(self, reason: str) -> ValueError:
        return ValueError(f"the expression {self.text!r:.80} {reason}")


def _root(x: Any) -> Any:
    """Return a root; numbers are real."""
    if isinstance(x, Fraction | int | float):
        if x < 0:
            raise TypeError("the root of a negative number")
        return float(x) ** 0.5
    return sqrt(x)
