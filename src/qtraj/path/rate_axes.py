"""Labels of rates and accelerations in body or in inertial axes.

ω_ξ = λ∘ω_x∘λ⁻¹ and ε_ξ = λ∘ε_x∘λ⁻¹ (paper C, section 1) are components of the same vectors as ω_x and ε_x. Since
ω × ω = 0, ε_ξ is the time derivative of ω_ξ, as ε_x is the time derivative of ω_x.
"""

import dataclasses

from qtraj.path.channel import Channel

BODY, INERTIAL = "body", "inertial"

TURNING = ("rate", "angular_acceleration", "force", "moment")
"""The outputs of a frame that have components in either axes; the forces of a vehicle follow the rates."""


def require_axes(axes: str) -> None:
    """Raise a ValueError for axes that are neither 'body' nor 'inertial'."""
    if axes not in (BODY, INERTIAL):
        raise ValueError(f"axes must be 'body' or 'inertial', but {axes!r} was given")


def in_axes(entry: Channel, axes: str) -> Channel:
    """An output with its labels for rates and accelerations in these axes."""
    if axes == BODY or entry.name not in TURNING:
        return entry
    return dataclasses.replace(entry, meaning=entry.meaning.replace("body axes", "inertial axes"), axes=("world",))
