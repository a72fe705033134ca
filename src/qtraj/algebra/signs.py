"""Signs of a + b·√s, derived from the signs of a, b and a² − b²s."""

from __future__ import annotations

from typing import Any, NamedTuple


class Signs(NamedTuple):
    """What is known about the sign of a number, or of a function on an interval: Booleans, or arrays of Booleans.

    `ge` and `le` mean that it is proved to be at least zero and at most zero; `gt` and `lt` are strict. All are false
    if nothing is known.
    """

    ge: Any
    le: Any
    gt: Any
    lt: Any


def with_root(a: Signs, b: Signs, difference: Signs) -> Signs:
    """Return the signs of a + b·√s for s ≥ 0, from the signs of a, b and of the `difference` a² − b²s.

    If a and b have opposite signs, the larger magnitude determines the sign, and the difference shows which one is
    larger. Where a changes its sign, b and the difference suffice, so no point needs both signs.
    """
    d = difference
    return Signs(
        ge=(a.ge & (b.ge | d.ge)) | (b.ge & d.le),
        le=(a.le & (b.le | d.ge)) | (b.le & d.le),
        gt=(a.gt & (b.ge | d.gt)) | (b.gt & d.lt),
        lt=(a.lt & (b.le | d.gt)) | (b.lt & d.lt),
    )
