"""Sums and products in which the integers 0 and 1 cost nothing.

The Python integer 0 represents a term that vanishes identically, and the integer 1 a factor of one. They are dropped
during tracing, so no operation is compiled for them. All other terms are numbers or arrays.
"""

from collections.abc import Sequence
from typing import Any


def mul(a: Any, b: Any) -> Any:
    """a·b; the integer 0 if a factor is the integer 0, and the other factor if one is the integer 1."""
    if is_zero(a) or is_zero(b):
        return 0
    if is_one(a):
        return b
    return a if is_one(b) else a * b


def add(terms: Sequence[Any]) -> Any:
    """The sum of the terms that are not the integer 0, or the integer 0 if there are none."""
    kept = [term for term in terms if not is_zero(term)]
    if not kept:
        return 0
    result = kept[0]
    for term in kept[1:]:
        result = result + term
    return result


def sub(a: Any, b: Any) -> Any:
    """a − b, where either may be the integer 0."""
    if is_zero(b):
        return a
    return -b if is_zero(a) else a - b


def is_zero(x: Any) -> bool:
    """Whether `x` is the integer 0, which stands for a term that vanishes identically."""
    return isinstance(x, int) and x == 0


def is_one(x: Any) -> bool:
    """Whether `x` is the integer 1, a factor that changes nothing."""
    return isinstance(x, int) and x == 1
