"""The input of a search: a problem, its limits by slots, bounds on the variables, and the weight of the cost."""

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
"""The number of limits that need a vehicle."""

TARGET_RATIO = 1 - 4e-9
"""The search uses this fraction of each limit, so that round-off at a peak does not violate the user's limit."""

MIN_LIMIT = 1e-100
"""A smaller limit is replaced by this one: its square would underflow, and the gradient would vanish."""


class LimitSlots(eqx.Module):
    """Which limits are set: the first `count` slots hold indices into the registry. A whole batch shares them.

    Both are unsigned: indexing by signed numbers compiles to more operations, as they may count from the end.
    """

    index: Any  # UInt32[" slots"] of NumPy or JAX
    count: Any  # UInt32[""]


class Task(eqx.Module):
    """One problem or a batch: limits by slots, the box of the variables, and the weight of the cost.

    With weight 0 the search minimises only the largest violation. All arrays are NumPy or JAX arrays.
    """

    problem: Problem
    limits: Any  # Float["*batch slots"]
    low: Any  # Float["*batch n"]
    high: Any  # Float["*batch n"]
    weight: Any  # Float["*batch"]


def over_slots(slots: LimitSlots, of_slot: Callable[[Int[Array, ""], Any], Any], start: Any) -> Any:
    """`of_slot(slot, carry)` for each slot in use, one after the other, from `start`."""
    count = jnp.asarray(slots.count)
    return jax.lax.fori_loop(jnp.zeros_like(count), count, of_slot, start)


def named_limits(limits: Limits, corridor: Any = None) -> dict[str, Any]:
    """The limits that are set, by name and in the order of their slots; a corridor comes last."""
    return limits.given() | ({} if corridor is None else {CORRIDOR.name: corridor})


def limit_names(limits: Limits, corridor: Any = None) -> tuple[str, ...]:
    """The names of `named_limits`."""
    return tuple(named_limits(limits, corridor))


def slot_count(names: Iterable[str]) -> int:
    """One slot for every possible limit and one for a corridor: one compiled search serves every set of limits.

    Limits that need a vehicle have slots, and formulas, only in problems that set one of them.
    """
    on_road = any(name != CORRIDOR.name and QUANTITIES[name].needs_vehicle for name in names)
    return len(QUANTITIES) + 1 - (0 if on_road else ON_ROAD)


def limit_slots(names: Sequence[str]) -> LimitSlots:
    """The slots of the limits with these names."""
    registry = [*QUANTITIES]
    places = [CORRIDOR_INDEX if name == CORRIDOR.name else registry.index(name) for name in names]
    index = np.zeros(slot_count(names), np.uint32)
    index[: len(places)] = places
    return LimitSlots(index, np.asarray(len(places), np.uint32))


def slot_limits(limits: Limits, corridor: Array | None, count: int) -> Array | np.ndarray:
    """The values of the limits that the search uses, for each of `count` problems: (count, slots).

    A NumPy array if the limits are concrete. The value of an unused slot is one.
    """
    user_limits = named_limits(limits, corridor)
    is_concrete = all(concrete(x) is not None for x in user_limits.values())
    xp: Any = np if is_concrete else jnp
    targets = [
        xp.maximum(TARGET_RATIO * (np.asarray(x) if is_concrete else x), MIN_LIMIT) for x in user_limits.values()
    ]
    columns = [xp.broadcast_to(xp.asarray(x, float), (count,)) for x in targets]
    return xp.stack([*columns, *[xp.ones(count)] * (slot_count(user_limits) - len(columns))], axis=1)
