"""The input of a search: a problem, its limits in slots, bounds on the variables, and the weight of the cost."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from qtraj.design.limits import Limits
from qtraj.design.tuning.constraints import CORRIDOR_INDEX
from qtraj.design.tuning.problem import Problem
from qtraj.foundation.arrays import concrete
from qtraj.path.quantity import CORRIDOR, QUANTITIES
from qtraj.path.road_quantities import ROAD_QUANTITIES

ON_ROAD = len(ROAD_QUANTITIES)
"""The number of limits that depend on forces between the vehicle and the road."""

TARGET_RATIO = 1 - 4e-9
"""The fraction of each limit that the search uses, so that rounding errors cannot violate the user's limit."""

MIN_LIMIT = 1e-100
"""Lower bound on the limits in a search; the square of a smaller limit would underflow."""


class LimitSlots(eqx.Module):
    """The set of limits of a batch: the first `count` elements of `index` are indices into the registry.

    Both arrays are unsigned. Signed indices would compile to more operations, because negative indices count from the
    end.
    """

    index: Any  # UInt32[" slots"] of NumPy or JAX
    count: Any  # UInt32[""]


class Task(eqx.Module):
    """The input of a search for one problem or a batch.

    `limits` are the limits in slots, `low` and `high` the bounds on the variables, and `weight` the weight of the cost.
    With weight 0 the search minimises only the largest violation. All arrays are NumPy or JAX arrays.
    """

    problem: Problem
    limits: Any  # Float["*batch slots"]
    low: Any  # Float["*batch n"]
    high: Any  # Float["*batch n"]
    weight: Any  # Float["*batch"]


def over_slots(slots: LimitSlots, of_slot: Callable[[Int[Array, ""], Any], Any], start: Any) -> Any:
    """Call `of_slot(slot, carry)` for each used slot in turn, with the initial carry `start`; return the last carry."""
    count = jnp.asarray(slots.count)
    return jax.lax.fori_loop(jnp.zeros_like(count), count, of_slot, start)


def named_limits(limits: Limits, corridor: Any = None) -> dict[str, Any]:
    """Return the limits that are set, by name and in the order of their slots; the corridor is the last."""
    return limits.given() | ({} if corridor is None else {CORRIDOR.name: corridor})


def limit_names(limits: Limits, corridor: Any = None) -> tuple[str, ...]:
    """Return the names of the limits that are set, in the order of their slots."""
    return tuple(named_limits(limits, corridor))


def slot_count(names: Iterable[str]) -> int:
    """Return the number of slots.

    The corridor and every limit that does not depend on forces on the road have a slot, so that one compiled search
    serves all sets of these limits. The other limits have slots only in problems that set one of them.
    """
    on_road = any(name != CORRIDOR.name and QUANTITIES[name].on_road for name in names)
    return len(QUANTITIES) + 1 - (0 if on_road else ON_ROAD)


def limit_slots(names: Sequence[str]) -> LimitSlots:
    """Return the slots for the limits with the given names."""
    registry = [*QUANTITIES]
    places = [CORRIDOR_INDEX if name == CORRIDOR.name else registry.index(name) for name in names]
    index = np.zeros(slot_count(names), np.uint32)
    index[: len(places)] = places
    return LimitSlots(index, np.asarray(len(places), np.uint32))


def slot_limits(limits: Limits, corridor: Array | None, count: int) -> Array | np.ndarray:
    """Return the limits (count, slots) of each of `count` problems, divided by their divisors and tightened.

    The result is a NumPy array if the limits have concrete values. The values of unused slots are one.
    """
    user_limits = named_limits(limits, corridor) | limits.reduced()
    is_concrete = all(concrete(x) is not None for x in user_limits.values())
    xp: Any = np if is_concrete else jnp
    targets = [
        xp.maximum(TARGET_RATIO * (np.asarray(x) if is_concrete else x), MIN_LIMIT) for x in user_limits.values()
    ]
    columns = [xp.broadcast_to(xp.asarray(x, float), (count,)) for x in targets]
    return xp.stack([*columns, *[xp.ones(count)] * (slot_count(user_limits) - len(columns))], axis=1)
