"""Evaluate the limits as constraints at many instants of a path.

A constraint is g(z, u) = ½((value/limit)² − 1) ≤ 0, where z are the variables and u is the time divided by the duration
T. With u as the time, T only scales the limit: (value/limit)² = κ·G with κ = T^−2p/limit², where p is the power of 1/s
in the unit of the quantity. G is a function of a few invariants. These are scalar products of vectors with each other
and with the vertical. The vectors are the first four derivatives of the position r with respect to u, c = r'×r'' and
c' = r'×r'''. The code calls these vectors blocks.

An index selects the limit. All searches of a batch share the index, so the formula of each limit is compiled once, and
only the limits that are set are evaluated. The functions in this module operate on a batch of paths without `jax.vmap`,
because `jax.vmap` would trace branches and loops several times.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import corridor, monomials, road
from qtraj.design.tuning.curves import Curves, along_u
from qtraj.design.tuning.monomials import Table
from qtraj.design.tuning.world_axes import upright_derivatives
from qtraj.foundation.indexing import element
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import Invariants
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters

Places = Float[Array, "batch places"]


class Setting(NamedTuple):
    """The data of a path for the evaluation of constraints.

    `curves` is the path as a function of u = t/T, where T is the duration, and `log_duration` is ln T. `axes` rotates
    from the axes of the placement to world axes. `reference` (terms, 3) contains the coefficients of ρ, φ and h of the
    initial path. `road` contains the parameters of the vehicle, or is None. For a batch of paths every array has a
    leading axis.
    """

    curves: Curves
    log_duration: Float[Array, "*batch"]
    axes: Float[Array, "*batch 3 3"]
    reference: Float[Array, "*batch terms 3"]
    road: RoadParameters | None


@dataclass(frozen=True, eq=False)  # compared by identity, so that groups can be static arguments of compiled functions
class Group:
    """Quantities that are functions of the same invariants.

    `order` is the highest order of the derivatives of the path in the quantities. `members` are the functions that
    compute the squares of the quantities from the invariants, and `table` contains the same squares as monomials.
    `products` maps each invariant to the names of its two factors, which are two blocks, or a block and the vertical.
    `upright` is true if a quantity depends on the vertical.
    """

    order: int
    members: tuple[Callable[[Any], Any], ...]
    products: dict[str, tuple[str, str]]
    table: Table
    upright: bool = False

    @property
    def cross_products(self) -> dict[str, int]:
        """The blocks that are cross products of r' with another derivative of r, and the index of that derivative."""
        used = {name for pair in self.products.values() for name in pair}
        return {name: k for name, k in (("c", 1), ("c1", 2)) if name in used}


HORIZONTAL = ("H", "G")
"""Invariants that contain only the horizontal components of the blocks."""


HINTS = ("S", "N")
"""Invariants that are divisors; where a divisor is small, a quantity may have a narrow peak between grid nodes."""


def _group(order: int, products: dict[str, tuple[str, str]], entries: Sequence[PathQuantity], *more: str) -> Group:
    tables = [monomials.table(entry, tuple(products)) for entry in entries]
    table = monomials.stacked(
        [*tables, *(Table(-np.ones(1), np.eye(len(products))[[tuple(products).index(x)]]) for x in more)]
    )
    members = (*(entry.squared for entry in entries), *(lambda i, x=x: -1 * getattr(i, x) for x in more))
    return Group(order, members, products, table, any(entry.upright for entry in entries))


def _group_index(entry: PathQuantity) -> int:
    return int(entry.order > 2 or entry.upright)


_ENTRIES = [
    [entry for entry in QUANTITIES.values() if _group_index(entry) == k and not entry.on_road] for k in range(2)
]
_COMMON = {"S": ("r1", "r1"), "B": ("r1", "r2"), "N": ("c", "c")}
_HIGHER = {
    "T": ("c", "r3"),
    "J": ("r3", "r3"),
    "E": ("c", "c1"),
    "D": ("c", "r4"),
    "V": ("r1", "up"),
    "H": ("r1", "r1"),
    "G": ("r1", "r2"),
    "P": ("c", "up"),
    "P1": ("c1", "up"),
}
GROUPS = (
    _group(2, {**_COMMON, "A": ("r2", "r2")}, _ENTRIES[0], *HINTS),
    _group(4, {**_COMMON, **_HIGHER}, _ENTRIES[1]),
)
"""Two groups: the quantities of low order, which most problems limit, and all others except those in `ROAD_GROUP`."""

FIRST_HINT = len(QUANTITIES)
"""The index of the first hint; hints are the negatives of `HINTS`, so that their peaks are minima of the divisors."""

HINT_OF = np.asarray(
    [*(int(entry.divisor == "cross_norm") for entry in QUANTITIES.values()), *[0] * (len(HINTS) + 1)], np.uint32
)
"""The index of the hint for each quantity."""

CORRIDOR_INDEX = FIRST_HINT + len(HINTS)
"""The index of the corridor, which is a separate group."""

ROAD_GROUP = len(GROUPS) + 1
"""The group of forces on the road, friction and power; it exists only in problems that limit one of them."""

_GROUP_INDICES = [ROAD_GROUP if entry.on_road else _group_index(entry) for entry in QUANTITIES.values()]
_HINT_MEMBERS = range(len(_ENTRIES[0]), len(_ENTRIES[0]) + len(HINTS))
GROUP = np.asarray([*_GROUP_INDICES, *[0] * len(HINTS), len(GROUPS)], np.uint32)
MEMBER = np.asarray(
    [*(_GROUP_INDICES[:k].count(g) for k, g in enumerate(_GROUP_INDICES)), *_HINT_MEMBERS, 0], np.uint32
)
PER_TIME = np.asarray([*(entry.per_time for entry in QUANTITIES.values()), *[0] * (len(HINTS) + 1)], np.int32)


def values(settings: Setting, index: Int[Array, ""], limits: Float[Array, " batch"], u: Places) -> Places:
    """Return the constraint values g = ½((value/limit)² − 1) for a batch of paths.

    Each path has its own instants `u` (fractions of the duration).
    """
    scale, _ = limit_scale(settings, index, limits)

    def in_world(order: int, upright: bool) -> Array:
        r = jax.vmap(lambda curves, u: along_u(curves.up_to(order), u, 0)[0])(settings.curves, u)
        return upright_derivatives(settings.axes, settings.curves.angle, r, u) if upright else r

    def make_branch(group: Group) -> Callable[[], Places]:
        def branch() -> Places:
            r = in_world(group.order, group.upright)
            invariants = Invariants([None, *((x[:, 0], x[:, 1], x[:, 2]) for x in jnp.moveaxis(r, 1, 0))])
            used = SimpleNamespace(**{name: getattr(invariants, name) for name in group.products})
            squares = [lambda square=square: square(used) for square in group.members]
            return jax.lax.switch(element(MEMBER, index), squares)

        return branch

    def corridor_branch() -> Places:
        return jax.vmap(corridor.value)(settings.curves.place, settings.reference, u)

    def road_branch() -> Places:
        member = element(MEMBER, index)
        return jax.vmap(lambda setting, r: road.value(setting, r, member))(settings, in_world(road.ORDER, True))

    others = [corridor_branch, *([] if settings.road is None else [road_branch])]
    return 0.5 * (scale[:, None] * switch_group(index, make_branch, others) - 1)


def of_one_path(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a version of `values` (or a similar function) for one path, without the batch axis."""

    def of_one(setting: Setting, *arguments: Any) -> Any:
        *derivatives, index, limit, u = arguments
        settings, batched, limits, places = jax.tree.map(lambda x: x[None], (setting, derivatives, limit, u))
        return jax.tree.map(lambda x: x[0], function(settings, *batched, index, limits, places))

    return of_one


def limit_scale(
    settings: Setting, index: Int[Array, ""], limits: Float[Array, " batch"]
) -> tuple[Float[Array, " batch"], Scalar]:
    """Return κ = T^−2p/limit² and its derivative d ln κ/d ln T.

    T is the duration, and p is the power of 1/s in the unit of the quantity.
    """
    per_log = element(-2.0 * PER_TIME, index).astype(limits.dtype)
    return jnp.exp(per_log * settings.log_duration) / limits**2, per_log


def switch_group(
    index: Int[Array, ""],
    make_branch: Callable[[Group], Callable[[], Any]],
    others: Sequence[Callable[[], Any]],
    group: int | None = None,
) -> Any:
    """Call the function of the group that contains the quantity with this index.

    `make_branch` returns the functions of `GROUPS`. `others` are the functions of the corridor and, in a problem with a
    vehicle, of `ROAD_GROUP`. With the number of the `group`, only its function is compiled.
    """
    branches = [*map(make_branch, GROUPS), *others]
    return jax.lax.switch(element(GROUP, index), branches) if group is None else branches[group]()
