"""Define quantities of the motion that are signed: rates of the acceleration and of the curvature, height, climb.

With the invariants of `frenet`, the longitudinal acceleration is B/√S and the horizontal curvature P/√H³. The others
are their derivatives with respect to time or, for the sharpness, to the horizontal distance travelled. So S' = 2B,
H' = 2G, P' is `P1`, and B' = A + C.
"""

from typing import Any

from qtraj.algebra.cpu import inverse_root
from qtraj.path.path_quantity import Component, Formula, PathQuantity, cubed, squared


def _longitudinal_jerk(i: Any) -> Any:
    """Return √S³ times the derivative of B/√S."""
    return (i.A + i.C) * i.S - squared(i.B)


def _lateral_jerk(i: Any) -> Any:
    """Return √H³ times the derivative of P/√H."""
    return i.P1 * i.H - i.P * i.G


def curvature_growth(i: Any) -> Any:
    """Return √H⁵ times the derivative of P/√H³."""
    return i.P1 * i.H - 3 * (i.P * i.G)


def _signed(
    name: str,
    symbol: str,
    unit: str,
    order: int,
    meaning: str,
    signs: str,
    ratio: tuple[Formula, Formula | None, Formula],
    square: Formula | None,
    divisor: str | None,
    upright: bool = True,
    position: bool = False,
) -> PathQuantity:
    """Return the entry of a quantity whose magnitude is limited by a number.

    `ratio` consists of numerator, denominator and value; `square` is the square of the denominator.
    """
    numerator, denominator, value = ratio
    return PathQuantity(
        name,
        f"|{symbol}|",
        unit,
        order,
        f"magnitude of the {meaning}",
        numerator=lambda i: squared(numerator(i)),
        denominator=square,
        square=lambda i: squared(value(i)),
        divisor=divisor,
        upright=upright,
        output=f"{name}_magnitude",
        position=position,
        component=Component(f"{meaning}; {signs}", numerator, denominator, value),
    )


MOTION_QUANTITIES = (
    _signed(
        "longitudinal_jerk",
        "ȧ_τ",
        "m s-3",
        3,
        "rate of the tangential acceleration",
        "positive where the braking decreases or the acceleration increases",
        (_longitudinal_jerk, lambda i: i.S * i.v, lambda i: _longitudinal_jerk(i) * inverse_root(i.S) ** 3),
        lambda i: cubed(i.S),
        "speed",
        upright=False,
    ),
    _signed(
        "lateral_jerk",
        "ȧ_y",
        "m s-3",
        3,
        "rate of the horizontal lateral acceleration",
        "positive to the left",
        (_lateral_jerk, lambda i: i.H * i.h, lambda i: _lateral_jerk(i) * inverse_root(i.H) ** 3),
        lambda i: cubed(i.H),
        "level",
    ),
    _signed(
        "horizontal_curvature",
        "κ_h",
        "m-1",
        2,
        "curvature of the horizontal projection of the path",
        "positive in left turns",
        (lambda i: i.P, lambda i: i.H * i.h, lambda i: i.P * inverse_root(i.H) ** 3),
        lambda i: cubed(i.H),
        "level",
    ),
    _signed(
        "curvature_rate",
        "κ̇_h",
        "m-1 s-1",
        3,
        "rate of the horizontal curvature",
        "positive to the left",
        (curvature_growth, lambda i: squared(i.H) * i.h, lambda i: curvature_growth(i) * inverse_root(i.H) ** 5),
        lambda i: squared(i.H) * cubed(i.H),
        "level",
    ),
    _signed(
        "sharpness",
        "σ",
        "m-2",
        3,
        "change of the horizontal curvature per horizontal distance",
        "positive to the left",
        (curvature_growth, lambda i: cubed(i.H), lambda i: curvature_growth(i) * inverse_root(i.H) ** 6),
        lambda i: squared(cubed(i.H)),
        "level",
    ),
    _signed(
        "height",
        "z",
        "m",
        0,
        "height, the vertical component of the position",
        "positive above the origin",
        (lambda i: i.Z, None, lambda i: i.Z),
        None,
        None,
        position=True,
    ),
    _signed(
        "vertical_speed",
        "v_z",
        "m s-1",
        1,
        "vertical component of the velocity",
        "positive upwards",
        (lambda i: i.V, None, lambda i: i.V),
        None,
        None,
    ),
    _signed(
        "vertical_acceleration",
        "a_z",
        "m s-2",
        2,
        "vertical component of the acceleration",
        "positive upwards",
        (lambda i: i.W, None, lambda i: i.W),
        None,
        None,
    ),
)
"""The signed quantities of the motion, in the order in which they are displayed."""
