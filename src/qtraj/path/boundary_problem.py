"""Compute the polynomials of a spiral-helix from boundary states: paper S's problem and its Hermite extension."""

from __future__ import annotations  # so that `help` shows short names

import operator

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import concrete
from qtraj.foundation.namespace import in_numpy, with_component, xp
from qtraj.foundation.types import Scalar
from qtraj.path.boundary import BoundaryState, Cylindrical, azimuth_difference, cylindrical, require_states
from qtraj.path.placement import Placement

RATE_TOLERANCE = 1e-9
"""Maximum relative difference between the angular rates V_φ/ρ at both ends of a path with a constant rate.

V_φ is the azimuthal velocity, and ρ is the radius. In float32, the maximum is 16 machine epsilons.
"""

AZIMUTH_TOLERANCE = 32
"""The difference of two azimuths counts as zero if it is at most this multiple of the sum of their rounding errors."""

PARALLEL_TOLERANCE = 1e-9
"""Two horizontal velocities count as parallel if the sine of the angle between them is below this value."""

MAX_TURNS = 1_000_000_000
"""The largest number of whole turns, of paths and of slews; its angle has a rounding error of 1e-6 rad."""

Coefficients = Float[Array, "_"]


@in_numpy
def uniform(
    start: BoundaryState, end: BoundaryState, turns: int, placement: Placement | None, eps: float
) -> tuple[Coefficients, Coefficients, Coefficients, Scalar, Placement | None, Scalar]:
    """Return the spiral-helix with a constant angular rate V_φ/ρ, as the arguments of `SpiralHelix`.

    V_φ is the azimuthal velocity. The arguments are the ascending coefficients of the radius ρ, the azimuth φ and the
    height h, the duration, the placement, and the mismatch. The mismatch is the relative difference of V_φ/ρ between
    the two ends; it is infinite if there is no solution. The coefficients satisfy the boundary conditions of paper S.
    `eps` is the machine epsilon of the states.
    """
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError(
            "a path with a constant rate about its axis cannot satisfy prescribed boundary accelerations. Omit them, "
            "or use SpiralHelix.hermite."
        )
    a, b = cylindrical(start, placement, eps), cylindrical(end, placement, eps)
    _require_off_axis(a, b)
    mismatch = _rate_mismatch(a, b)
    turn = directed_turn(a, b, turns)
    _require_solvable(a, b, turn, mismatch, max(RATE_TOLERANCE, 16 * eps))
    solvable = (abs(turn) > 0) & (a.rate != 0)
    duration = xp.where(solvable, turn / xp.where(solvable, a.rate, 1.0), xp.inf)
    radius, angle, height = polynomials(a, b, turn, duration, uniform=True)
    return radius, angle, height, duration, placement, xp.where(solvable, mismatch, xp.inf)


def directed_turn(a: Cylindrical, b: Cylindrical, turns: int) -> Scalar:
    """Return the signed turn [rad] from `a` to `b`; its sign is the sign of V_φ at `a`, or + if V_φ is zero.

    V_φ is the azimuthal velocity. The magnitude of the turn is `turns` whole turns plus an angle in [0, 2π).

    **Raises:** ValueError if `turns` is negative or not an integer.
    """
    if whole_turns(turns) < 0:
        raise ValueError(
            "turns is the number of additional whole turns in the direction of V_phi and must be 0 or more, but "
            f"{turns} was given"
        )
    sense = xp.where(a.velocity[1] < 0, -1.0, 1.0).astype(a.radius.dtype)
    ahead = sense * azimuth_difference(a, b)
    equal = abs(ahead) <= AZIMUTH_TOLERANCE * (a.rounding + b.rounding)
    ahead = xp.where(equal, 0.0 * ahead, xp.where(ahead < 0, ahead + 2 * xp.pi, ahead))
    return sense * (ahead + 2 * xp.pi * turns)


def whole_turns(turns: int) -> int:
    """Convert `turns` to an integer.

    **Raises:** ValueError if `turns` is not an integer.
    """
    try:
        count = operator.index(turns)
    except TypeError:
        count = None
    if count is None or isinstance(turns, bool) or abs(count) > MAX_TURNS:
        raise ValueError(
            f"turns must be an integer, the number of whole turns, of at most {MAX_TURNS:,}, but {described(turns)} "
            "was given"
        )
    return count


@in_numpy
def hermite(
    start: BoundaryState, end: BoundaryState, duration: Scalar, turns: int, placement: Placement | None
) -> tuple[Coefficients, Coefficients, Coefficients]:
    """Return the ascending coefficients of the radius ρ, the azimuth φ and the height h from all boundary values.

    The polynomials are cubics, or quintics if the states have accelerations. `duration` is in s, and `turns` is the
    signed number of whole turns in addition to an azimuth difference in (−π, π].
    """
    if (start.acceleration is None) != (end.acceleration is None):
        raise ValueError("only one boundary state has an acceleration: pass accelerations for both ends or for neither")
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    _require_off_axis(a, b)
    turn = azimuth_difference(a, b) + 2 * xp.pi * whole_turns(turns)
    return polynomials(a, b, turn, duration, uniform=False)


def polynomials(
    a: Cylindrical, b: Cylindrical, turn: Scalar, duration: Scalar, uniform: bool
) -> tuple[Coefficients, Coefficients, Coefficients]:
    """Return the ascending coefficients of the radius ρ, the azimuth φ and the height h between two states.

    `turn` is the azimuth of `b` minus the azimuth of `a`, including whole turns [rad]; `duration` is in s. If `uniform`
    is true, φ is linear in time, and the angular rates of the states are not used.
    """
    ends = [_boundary_values(a), _boundary_values(b)]
    radius, height = (polynomial.hermite(ends[0][k], ends[1][k], duration) for k in (0, 2))
    if uniform:
        return radius, xp.stack([a.azimuth, turn / duration]), height
    angle = polynomial.hermite(ends[0][1], with_component(ends[1][1], 0, a.azimuth + turn), duration)
    return radius, angle, height


def _boundary_values(state: Cylindrical) -> tuple[Coefficients, Coefficients, Coefficients]:
    """Return the value and the time derivatives of radius, azimuth and height at one end, as one array for each.

    The arrays have two elements, or three if the state has an acceleration.
    """
    rows = [(state.radius, state.azimuth, state.height), (state.velocity[0], state.rate, state.velocity[2])]
    if state.acceleration is not None:
        rows.append((state.radial_acceleration, state.angular_acceleration, state.acceleration[2]))
    radius, angle, height = zip(*rows, strict=True)
    return xp.stack(radius), xp.stack(angle), xp.stack(height)


@in_numpy
def axis_between(start: BoundaryState, end: BoundaryState) -> Placement:
    """Return a placement with a vertical axis about which the radial velocities at both ends are zero.

    Each state has a horizontal normal, a line through the position that is perpendicular to the velocity. Seen from
    above, the axis is at the intersection of the two normals.

    **Raises:** ValueError if the horizontal velocities are parallel or zero, because then no such axis exists.
    """
    require_states(start, end)
    middle = (start.position + end.position)[:2] / 2
    va, vb = start.velocity[:2], end.velocity[:2]
    # The point p satisfies (p − p_A)·v_A = 0 and (p − p_B)·v_B = 0, with the horizontal positions p_A, p_B and
    # velocities v_A, v_B at both ends. The equations are solved relative to the midpoint, so that large coordinates
    # lose no digits.
    a, b = va @ (start.position[:2] - middle), vb @ (end.position[:2] - middle)
    determinant = va[0] * vb[1] - va[1] * vb[0]
    _require_crossing(va, vb)
    point = middle + xp.stack([a * vb[1] - b * va[1], b * va[0] - a * vb[0]]) / determinant
    return Placement(xp.concatenate([point, xp.zeros_like(point[:1])]))


def _rate_mismatch(a: Cylindrical, b: Cylindrical) -> Scalar:
    largest = xp.maximum(abs(a.rate), abs(b.rate))
    safe = xp.where(largest > 0, largest, 1.0)
    return xp.where(largest > 0, abs(a.rate - b.rate) / safe, xp.inf)


def _require_off_axis(a: Cylindrical, b: Cylindrical) -> None:
    for state, name in ((a, "start"), (b, "end")):
        radius = concrete(state.radius)
        if radius is not None and not radius > 0:
            raise ValueError(
                f"the {name} lies on the axis of the spiral-helix (radius 0), where the azimuth is undefined. "
                "Pass a placement whose axis does not contain the boundary positions."
            )


def _require_solvable(a: Cylindrical, b: Cylindrical, turn: Scalar, mismatch: Scalar, tolerance: float) -> None:
    mismatch_value, turn_value = concrete(mismatch), concrete(turn)
    if mismatch_value is None or turn_value is None:
        return
    if not np.isfinite(mismatch_value):
        raise ValueError(
            "the boundary velocities have no component about the axis (V_phi is 0 at both ends), so there is no "
            "path with a constant rate about the axis. Pass another placement, or use SpiralHelix.hermite with a "
            "duration."
        )
    if mismatch_value > tolerance:
        raise ValueError(
            f"the boundary rates disagree: V_phi/rho is {float(a.rate):.6g} rad/s at the start and {float(b.rate):.6g} "
            "at the end, but a path with a constant rate has the same rate at both ends. Use SpiralHelix.hermite, "
            "whose angle is a polynomial that satisfies both rates, or change a velocity."
        )
    if turn_value == 0:
        raise ValueError(
            "the start and the end have the same azimuth, so with turns=0 the path has no turn. "
            "Pass turns=1 for one whole turn, or use SpiralHelix.hermite."
        )


def _require_crossing(va: Array, vb: Array) -> None:
    a, b = concrete(va), concrete(vb)
    if a is None or b is None:
        return
    if abs(a[0] * b[1] - a[1] * b[0]) <= PARALLEL_TOLERANCE * np.hypot(*a) * np.hypot(*b):
        raise ValueError(
            f"the horizontal velocities {a.tolist()} and {b.tolist()} are parallel, or one of them is zero, so they do "
            "not determine the axis of the helix. Pass a placement to SpiralHelix.hermite instead."
        )
