"""Read a text such as "0.8 * start.speed" as a function of the parameters of a sweep.

The text is parsed, but never executed by Python: only the operations in `ALLOWED` are known.
"""

from __future__ import annotations

import ast
import functools
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

LONGEST, DEEPEST = 500, 60
"""The maximum number of characters, and the maximum depth of nested operations."""

BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}
FUNCTIONS: dict[str, tuple[Callable[..., Any], int]] = {
    **{name: (getattr(np, name), 1) for name in ("sqrt", "abs", "exp", "log", "sin", "cos", "tan")},
    "atan": (np.arctan, 1),
    "atan2": (np.arctan2, 2),
    "min": (np.minimum, 2),
    "max": (np.maximum, 2),
}
"""The functions and the numbers of their arguments."""

CONSTANTS = {"pi": np.pi}

ALLOWED = f"names of other parameters, finite numbers, pi, + - * / **, and {', '.join(FUNCTIONS)}"
"""What an expression may contain."""


@dataclass(frozen=True)
class PointExpression:
    """The function of other parameters that a text defines.

    **Raises:** ValueError for a text that is too long or nested too deeply, and for anything but the operations in
    `ALLOWED`.
    """

    text: str

    def __post_init__(self) -> None:
        for _ in _parts(self.text):  # raises for what is not allowed
            pass

    @property
    def names(self) -> frozenset[str]:
        """The names of the parameters that the expression contains."""
        return frozenset(x for x in _parts(self.text) if x not in CONSTANTS)

    def __call__(self, points: Mapping[str, Any]) -> Any:
        """Return the values for arrays of parameters by name; they may be infinite or NaN."""
        with np.errstate(all="ignore"):
            return _value(_tree(self.text), points)


@functools.lru_cache(maxsize=256)
def _tree(text: str) -> ast.expr:
    if len(text) > LONGEST:
        raise ValueError(f"an expression may have {LONGEST} characters, but one of {len(text)} was given")
    try:
        with warnings.catch_warnings(action="ignore"):  # of texts such as "1if 1else 2", which are refused below
            return ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise _fault(text, f"is not valid: {getattr(error, 'msg', None) or error}") from None


def _parts(text: str) -> Iterator[str]:
    """Yield the names in an expression."""
    waiting = [(_tree(text), 0)]
    while waiting:
        node, depth = waiting.pop()
        if depth > DEEPEST:
            raise _fault(text, f"is nested more than {DEEPEST} times")
        match node:
            case ast.Constant(value=int() | float() as x) if not isinstance(x, bool) and _is_finite(x):
                continue
            case ast.Name() | ast.Attribute() if (name := _dotted(node)) and name not in FUNCTIONS:
                yield name
                continue
            case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=x):
                inner = [x]
            case ast.BinOp(left=a, op=op, right=b) if type(op) in BINARY:
                inner = [a, b]
            case ast.Call(func=ast.Name(id=name), args=more, keywords=[]) if (
                name in FUNCTIONS and len(more) == FUNCTIONS[name][1]
            ):
                inner = more
            case _:
                part = ast.get_source_segment(text.strip(), node) or text
                raise _fault(text, f"contains {part!r:.60}, but it may contain only {ALLOWED}")
        waiting += [(x, depth + 1) for x in inner]


def _is_finite(x: float) -> bool:
    try:
        return bool(np.isfinite(float(x)))
    except OverflowError:
        return False


def _dotted(node: ast.expr) -> str:
    """Return a name such as "start.speed", or an empty text for another node."""
    match node:
        case ast.Name(id=name):
            return name
        case ast.Attribute(value=inner, attr=name) if outer := _dotted(inner):
            return f"{outer}.{name}"
    return ""


def _value(node: ast.expr, points: Mapping[str, Any]) -> Any:
    """Return the value of an expression whose parts are allowed."""
    match node:
        case ast.Constant(value=x):
            return np.float64(x)  # type: ignore[arg-type]
        case ast.UnaryOp(op=op, operand=x):
            return _value(x, points) if isinstance(op, ast.UAdd) else -_value(x, points)
        case ast.BinOp(left=a, op=op, right=b):
            return BINARY[type(op)](_value(a, points), _value(b, points))
        case ast.Call(func=ast.Name(id=name), args=more):
            return FUNCTIONS[name][0](*(_value(x, points) for x in more))
    name = _dotted(node)
    return np.float64(CONSTANTS[name]) if name in CONSTANTS else np.asarray(points[name], float)


def _fault(text: str, reason: str) -> ValueError:
    return ValueError(f"the expression {text!r:.80} {reason}")
