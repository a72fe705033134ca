"""Bound the slacks of limits on friction and power on subcells of a retimed path, for the proof.

Let a = u̇², where u is the path parameter. The formulas of `contact` apply to a vector q in the direction of motion,
r' = w·q, and to the acceleration a r'' + ½ a' r'. With S = q·q, the formulas contain the squared speed w² a S only in
the drag, and the speed w√(a S) only as a factor of the power. Let the drive power be w√a·P. Then the limit on the power
is satisfied if P ≤ 0 or w² a P² ≤ limit². The acceleration, gravity and drag are doubled to avoid the factor ½.
"""

from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra.cells import Enclosure, enclose_minimum, semi_axes
from qtraj.algebra.chebyshev_model import ChebyshevModel, interpolated
from qtraj.algebra.rooted import RootSum
from qtraj.design.proof.inequalities import bounds as in_units
from qtraj.design.proof.road import Parameter, RoadInvariants
from qtraj.design.timing.road import ROAD
from qtraj.path.contact import power_numerator
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters


class _Drag:
    """The coefficient of drag times the squared ratio of the velocity to the vector q (see the module)."""

    def __init__(self, coefficient: Parameter, square: RootSum):
        self.coefficient, self.square = coefficient, square

    def __mul__(self, other: RootSum) -> RootSum:
        return self.coefficient * (other * self.square)


def road_bounds(
    limits: dict[str, Array],
    units: dict[str, Array],
    vehicle: RoadParameters,
    ahead: ChebyshevModel,
    doubled: ChebyshevModel,
    pace: ChebyshevModel,
    half: Float[Array, "1 subcells"],
) -> tuple[Float[Array, "limits subcells"], Float[Array, "limits subcells"]]:
    """Return lower and upper bounds on the smallest slack of each of `limits` in each subcell, in the order of `ROAD`.

    A negative upper bound indicates a violation. With r' = w·q and a = u̇², `ahead` is q, `doubled` is twice the
    acceleration, and `pace` is w² a, in the units of length and time of the parameters of `vehicle`. `units` convert
    the limits from SI units.
    """
    twice = vehicle._replace(gravity=2 * vehicle.gravity, drag=2 * vehicle.drag)
    i: Any = RoadInvariants(Invariants([None, ahead, doubled], vehicle=twice))
    square = RootSum((pace, 0, 0, 0), i.squares)
    i.vehicle = i.vehicle._replace(drag=_Drag(i.vehicle.drag, square))

    def enclosed(number: RootSum | ChebyshevModel) -> Enclosure:
        model = number.model(half) if isinstance(number, RootSum) else number
        return enclose_minimum(*interpolated(model, semi_axes(half)))

    lows, highs = [], []
    for name in ROAD:
        if name not in limits:
            continue
        entry: Any = QUANTITIES[name]
        if name == "friction":
            bound = in_units(limits[name], units[name])
            slack = entry.denominator(i).scaled(*bound.square) - entry.numerator(i)
            both = [enclosed(x) for x in (slack, i.contact.onto)]
            low, high = (jnp.minimum(*pair) for pair in zip(*((x.low, x.high) for x in both), strict=True))
        else:
            bound = in_units(2 * limits[name], units[name])
            power = power_numerator(i)
            own = power.model(half)
            slack = i.H.scaled(*bound.square) - power * power * square
            driving, braking, within = enclosed(own), enclosed(-1 * own), enclosed(slack)
            low = jnp.maximum(braking.low, within.low)
            high = jnp.where(driving.low > 0, within.high, jnp.inf)
        lows.append(low[0])
        highs.append(high[0])
    return jnp.stack(lows), jnp.stack(highs)
