"""The limits as constraints on a path: values at many places of many searches.

A constraint is g(z, u) = ½((value/limit)² − 1) ≤ 0 at the fraction u of the duration. In unit time the duration T only
scales the limit: (value/limit)² = κ·G with κ = T^−2p/limit², p being the power of 1/s in the quantity's unit. G is a
function of a few invariants, and these are scalar products of r', r'', …, c = r'×r'' and c' = r'×r''', called blocks.

Which limit is meant is a number that all searches of a batch share, so that each limit's formula is compiled once, and
only the limits that are present are worked out.
"""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import corridor, monomials
from qtraj.design.tuning.curves import Curves, along_u
from qtraj.design.tuning.monomials import Table
from qtraj.design.tuning.world_axes import upright
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import QUANTITIES, PathQuantity

Places = Float[Array, " places"]


class Setting(NamedTuple):
    """A path in unit time, ln T, the rotation from the axes of its placement to the world's, and the given path."""

    curves: Curves
    log_duration: Scalar
    axes: Float[Array, "3 3"]
    given: Float[Array, "terms 3"]


class Group(NamedTuple):
    """Quantities that are formed from the same invariants.

    `products` gives each invariant as a scalar product of two blocks, by their names, or of one block and the vertical.
    """

    order: int
    members: tuple[Callable[[Any], Any], ...]
    products: dict[str, tuple[str, str]]
    table: Table
    upright: bool = False

    @property
    def crossed(self) -> dict[str, int]:
        """The blocks that are cross products of r' with another derivative, and the place of that one."""
        used = {name for pair in self.products.values() for name in pair}
        return {name: k for name, k in (("c", 1), ("c1", 2)) if name in used}


LEVEL = ("H", "G")
"""Invariants of the horizontal parts."""


HINTS = ("S", "N")
"""Where these invariants are least, quantities that divide by them may rise to a needle between the nodes."""


def _group(order: int, products: dict[str, tuple[str, str]], entries: Sequence[PathQuantity], *more: str) -> Group:
    tables = [monomials.table(entry, tuple(products)) for entry in entries]
    table = monomials.stacked(
        [*tables, *(Table(-np.ones(1), np.eye(len(products))[[tuple(products).index(x)]]) for x in more)]
    )
    members = (*(entry.squared for entry in entries), *(lambda i, x=x: -1 * getattr(i, x) for x in more))
    return Group(order, members, products, table, any(entry.upright for entry in entries))


def _place(entry: PathQuantity) -> int:
    return int(entry.order > 2 or entry.upright)


_ENTRIES = [[entry for entry in QUANTITIES.values() if _place(entry) == k] for k in range(2)]
_BOTH = {"S": ("r1", "r1"), "B": ("r1", "r2"), "N": ("c", "c")}
_FURTHER = {
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
    _group(2, {**_BOTH, "A": ("r2", "r2")}, _ENTRIES[0], *HINTS),
    _group(4, {**_BOTH, **_FURTHER}, _ENTRIES[1]),
)
"""What most roads are limited by, and everything else."""

FIRST_HINT = len(QUANTITIES)
"""The places after the last limit: minus the invariants of `HINTS`, whose peaks are where these are least."""

HINT = np.asarray(
    [*(int(entry.divisor == "cross_norm") for entry in QUANTITIES.values()), *[0] * (len(HINTS) + 1)], np.int32
)
"""Of each place the hint that concerns it."""

CORRIDOR_AT = FIRST_HINT + len(HINTS)
"""The place of the corridor, which is a group of its own."""

_PLACES = [_place(entry) for entry in QUANTITIES.values()]
_BEHIND = range(len(_ENTRIES[0]), len(_ENTRIES[0]) + len(HINTS))
GROUP = np.asarray([*_PLACES, *[0] * len(HINTS), len(GROUPS)], np.int32)
MEMBER = np.asarray([*(_PLACES[:k].count(g) for k, g in enumerate(_PLACES)), *_BEHIND, 0], np.int32)
PER_TIME = np.asarray([*(entry.per_time for entry in QUANTITIES.values()), *[0] * (len(HINTS) + 1)], np.int32)


def values(setting: Setting, index: Int[Array, ""], limit: Scalar, u: Places) -> Places:
    """g at the places `u`."""
    curves = setting.curves
    scale, _ = scaling(setting, index, limit)

    def of(group: Group) -> Callable[[], Places]:
        def branch() -> Places:
            r = along_u(curves.up_to(group.order), u, 0)[0]
            r = upright(setting.axes, setting.curves.angle, r, u) if group.upright else r
            found = Invariants([None, *((x[0], x[1], x[2]) for x in r)])
            known = SimpleNamespace(**{name: getattr(found, name) for name in group.products})
            squares = [lambda square=square: square(known) for square in group.members]
            return jax.lax.switch(jnp.asarray(MEMBER)[index], squares)

        return branch

    return 0.5 * (scale * by_group(index, of, lambda: corridor.value(curves.place, setting.given, u)) - 1)


def scaling(setting: Setting, index: Int[Array, ""], limit: Scalar) -> tuple[Array, Array]:
    """κ, and d ln κ / d ln T."""
    per_log = jnp.asarray(-2.0 * PER_TIME)[index].astype(limit.dtype)
    return jnp.exp(per_log * setting.log_duration) / limit**2, per_log


def by_group(index: Int[Array, ""], of: Callable[[Group], Callable[[], Any]], of_corridor: Callable[[], Any]) -> Any:
    return jax.lax.switch(jnp.asarray(GROUP)[index], [*(of(group) for group in GROUPS), of_corridor])
