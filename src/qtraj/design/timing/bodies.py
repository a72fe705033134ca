"""Combine the constraints of several bodies that share one timing: of all of them, the search sees one list.

The rows of arrays have the order of `NAMES`, and for each kind of constraint, the order of the bodies.
"""

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from qtraj.design.timing.constraints import FORMS, NAMES, UPPER, Parts, listed
from qtraj.design.timing.sided import SIDED
from qtraj.foundation.namespace import namespace
from qtraj.path.quantity import COMBINED

KINDS = (UPPER, FORMS, SIDED, ("jerk",))
"""The kinds of limits that several bodies may have."""

SUPPORTED = tuple(name for name in NAMES if name != COMBINED and any(name in kind for kind in KINDS))


def rows_of(bounds: Sequence[Collection[str]], vehicle: bool = False) -> tuple[str, ...]:
    """Return the name of the limit of each row; `bounds` are the limits of each body."""
    if len(bounds) == 1:
        return listed(bounds[0], vehicle)
    return tuple(name for name, _ in _in_order(bounds))


def rows_of_body(bounds: Sequence[Collection[str]], body: int, names: Sequence[str]) -> np.ndarray:
    """Return the indices of the rows with the limits `names` of one body."""
    rows = _in_order(bounds)
    return np.array([rows.index((name, body)) for name in names])


def _in_order(bounds: Sequence[Collection[str]]) -> list[tuple[str, int]]:
    return [(name, body) for kind in KINDS for body, own in enumerate(bounds) for name in kind if name in own]


def joined(found: Sequence[Parts]) -> Parts:
    """Return the constraints of all bodies."""
    if len(found) == 1:
        return found[0]
    xp = namespace(*(x.upper for x in found))
    jerks: list[Any] = [x.jerk for x in found if x.jerk is not None]
    upper, forms, sides = (xp.concatenate([x[k] for x in found]) for k in range(3))
    return Parts(upper, forms, sides, xp.concatenate(jerks) if jerks else None)
