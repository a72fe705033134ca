"""Label rates and accelerations in body or inertial axes.

Let λ be the attitude quaternion, body to inertial, and ω_X and ε_X the angular rate and acceleration in body axes. Then
ω_ξ = λ∘ω_X∘λ⁻¹ and ε_ξ = λ∘ε_X∘λ⁻¹ are their inertial components (paper C, section 1). Since ω × ω = 0, ε_ξ is the time
derivative of ω_ξ, just as ε_X is the time derivative of ω_X.
"""

import dataclasses

from qtraj.path.channel import Channel

BODY, INERTIAL = "body", "inertial"

TURNING = ("rate", "angular_acceleration", "force", "moment")
"""Outputs whose components are in body or inertial axes, depending on the argument `axes`."""


def require_axes(axes: str) -> None:
    """Raise a ValueError if `axes` is neither 'body' nor 'inertial'."""
    if axes not in (BODY, INERTIAL):
        raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")


def in_axes(entry: Channel, axes: str) -> Channel:
    """Return the output `entry` with the labels for components in these `axes`."""
    if axes == BODY or entry.name not in TURNING:
        return entry
    return dataclasses.replace(entry, meaning=entry.meaning.replace("body axes", "inertial axes"), axes=("world",))
