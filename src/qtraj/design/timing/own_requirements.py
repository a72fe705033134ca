"""Which limits on quantities of the user's own `retime` and the proofs of timings support."""

from typing import Any

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.own_limits import require_reduced
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.formula_limits import is_formula
from qtraj.foundation.arrays import is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.own_facts import POSITION, vectors_of
from qtraj.path.own_name import OwnName
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.route import Route
from qtraj.path.shape import Shape

HIGHEST = 3
"""Order of the highest derivative of the motion that is a continuous function of a timing."""


def require_formulas(limits: Limits, path: AbstractHodograph, speeds: Any) -> None:
    """Raise an error for limits on own quantities, or on sides of the power, that `retime` cannot impose."""
    names = [name for name in limits.given() if is_formula(name)]
    own = [name for name in names if isinstance(name, OwnName) and not quantity(name).of_shape]
    require_reduced(own, "retime", has_world_axes(path), HIGHEST)
    for name in own:
        if _contains_position(quantity(name)):
            raise ValueError(
                f"retime does not support the limit on {_base(name)}, because its function contains the position and "
                "depends on the timing: remove the limit, and check the result with qtraj.certify"
            )
    changing = [name for name in own if quantity(name).uses_vehicle]
    if changing and limits.vehicle is not None and limits.vehicle.on_changing_road:
        raise ValueError(
            f"retime does not support the limit on {_base(changing[0])} on a road that changes along the way, because "
            "its function contains parameters of the vehicle: pass a constant road, or remove the limit"
        )
    if names and is_traced(path, limits, speeds):
        raise ValueError(
            f"retime supports the limit on {_base(names[0])} only for a path, limits and speeds with concrete values: "
            "call it outside jit, grad and vmap"
        )


def provable(name: str, path: AbstractHodograph) -> bool:
    """Return whether the proofs of timings support a limit on an own quantity that depends on the timing."""
    entry = quantity(name)
    if entry.own is None or entry.of_shape or entry.own.formula is None or entry.own.in_si:
        return False
    world = entry.own.world and not has_world_axes(path)
    return not world and entry.order <= HIGHEST and not _contains_position(entry)


def own_of_timing(path: AbstractHodograph, limits: Limits) -> list[str]:
    """Return the names of the limits on own quantities that depend on the timing, as far as proofs support them."""
    changes = limits.vehicle is not None and limits.vehicle.on_changing_road
    return [
        name
        for name, bound in limits.given().items()
        if provable(name, path) and not isinstance(bound, OfSpeed) and not (changes and quantity(name).uses_vehicle)
    ]


def imposable(path: AbstractHodograph | Shape, limits: Limits) -> Limits:
    """Return the limits that `retime` can impose on a path, without those that no timing changes."""
    return limits.only([*NAMES, *own_of_timing(path.route if isinstance(path, Shape) else path, limits)])


def has_world_axes(path: AbstractHodograph) -> bool:
    """Return whether the derivatives of a path are known in world axes, and not in a basis that rotates with it."""
    return isinstance(path, Route) or path.polynomials() is None


def _contains_position(entry: PathQuantity) -> bool:
    return POSITION in vectors_of(entry.own.formula)


def _base(name: str) -> str:
    return quantity(name).base or name
