"""Sums and products in which the integers 0 and 1 generate no operations.

The Python integer 0 represents a term that is identically zero, and the Python integer 1 represents the factor one.
Both are omitted during tracing, so no operation is compiled for them. All other terms are numbers or arrays.
"""

from collections.abc import Sequence
from typing import Any


def mul(a: Any, b: Any) -> Any:
    """Return a·b. A factor that is the integer 0 yields the integer 0; the integer 1 yields the other factor."""
    # `type` is faster than `isinstance`, and these functions are called very often in NumPy.
    if type(a) is int:
        if a == 0 or (type(b) is int and b == 0):
            return 0
        if a == 1:
            return b
    elif type(b) is int:
        if b == 0:
            return 0
        if b == 1:
            return a
    return a * b


def add(terms: Sequence[Any]) -> Any:
    """Return the sum of the terms that are not the integer 0, or the integer 0 if there are none."""
    kept = [term for term in terms if type(term) is not int or term != 0]
    if not kept:
        return 0
    result = kept[0]
    for term in kept[1:]:
        result = result + term
    return result


def sub(a: Any, b: Any) -> Any:
    """Return a − b, where `a`, `b` or both may be the integer 0."""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def is_zero(x: Any) -> bool:
    """Return whether `x` is the integer 0, which represents a term that is identically zero."""
    return type(x) is int and x == 0


def is_one(x: Any) -> bool:
    """Return whether `x` is the integer 1, which represents the factor one."""
    return isinstance(x, int) and x == 1
