"""What one search is about."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.design.limits import Limits
from qtraj.design.tuning.constraints import CORRIDOR_AT
from qtraj.design.tuning.problem import Problem
from qtraj.foundation.arrays import concrete
from qtraj.path.quantity import CORRIDOR, QUANTITIES

SLOTS = len(QUANTITIES) + 1
"""Room for every limit there is, and a corridor: one compiled search serves every set of them."""

AIM = 1 - 4e-9
"""Tuning aims at this part of each limit, so that round-off at a peak does not violate the limit that was given."""

LEAST_LIMIT = 1e-100
"""A smaller limit counts as this: its square would vanish, and with it the way to go."""


class Present(eqx.Module):
    """Which limits there are: the first `count` slots hold places in the registry. Shared by a whole batch."""

    index: Any  # Int[" slots"] of NumPy or JAX
    count: Any  # Int[""]


class Task(eqx.Module):
    """A problem, limits by slots, the box of its variables, and the weight of its cost: one, or a batch of them.

    With weight 0 the search minimises the largest violation alone.
    """

    problem: Problem
    limits: Any  # Float["*batch slots"], of NumPy or JAX like all of these
    low: Any  # Float["*batch n"]
    high: Any  # Float["*batch n"]
    weight: Any  # Float["*batch"]


def bounds_of(limits: Limits, corridor: Any = None) -> dict[str, Any]:
    """The limits that are given by name, in the order of their slots; a corridor is the last."""
    return limits.given() | ({} if corridor is None else {CORRIDOR.name: corridor})


def names_of(limits: Limits, corridor: Any = None) -> tuple[str, ...]:
    """The names of `bounds_of`."""
    return tuple(bounds_of(limits, corridor))


def present(names: Sequence[str]) -> Present:
    """Which limits are given."""
    known = [*QUANTITIES]
    places = [CORRIDOR_AT if name == CORRIDOR.name else known.index(name) for name in names]
    index = np.zeros(SLOTS, np.int32)
    index[: len(places)] = places
    return Present(index, np.asarray(len(places), np.int32))


def by_slots(limits: Limits, corridor: Array | None, count: int) -> Array | np.ndarray:
    """The limits that are given, as the search aims at them, for each of so many problems: (count, slots).

    In NumPy arrays where they are known. A slot without a limit holds one.
    """
    given = bounds_of(limits, corridor)
    known = all(concrete(x) is not None for x in given.values())
    xp: Any = np if known else jnp
    aims = [xp.maximum(AIM * (np.asarray(x) if known else x), LEAST_LIMIT) for x in given.values()]
    rows = [xp.broadcast_to(xp.asarray(x, float), (count,)) for x in aims]
    return xp.stack([*rows, *[xp.ones(count)] * (SLOTS - len(rows))], axis=1)
