"""What can be said of a path and its trihedral at an instant: names, components, units and meanings."""

from qtraj.foundation import record

AXES: dict[str, tuple[str, ...]] = {
    "position": ("world",),
    "velocity": ("world",),
    "acceleration": ("world",),
    "jerk": ("world",),
    "dcm": ("body", "world"),
    "quaternion": ("quaternion_component",),
    "gibbs": ("body",),
    "speed": (),
    "curvature": (),
    "torsion": (),
    "rate": ("body",),
    "angular_acceleration": ("body",),
    "defined": (),
}
"""The component axes of every output, by the labels of their coordinates."""

LABELS = {
    "world": record.LABELS["world"],
    "body": ["tangent", "normal", "binormal"],
    "quaternion_component": record.LABELS["component"],
}

DESCRIPTIONS: dict[str, tuple[str, str]] = {
    "position": ("m", "position, world axes"),
    "velocity": ("m s-1", "velocity, world axes"),
    "acceleration": ("m s-2", "acceleration, world axes"),
    "jerk": ("m s-3", "jerk, world axes"),
    "dcm": ("1", "direction cosines: rows are the body axes in world components; maps world to body"),
    "quaternion": ("1", "unit quaternion, scalar first, Hamilton, body to world"),
    "gibbs": ("1", "Gibbs vector e tan(angle/2)"),
    "speed": ("m s-1", "speed"),
    "curvature": ("m-1", "curvature of the path"),
    "torsion": ("m-1", "torsion of the path"),
    "rate": ("rad s-1", "angular rate of the frame, body axes"),
    "angular_acceleration": ("rad s-2", "angular acceleration of the frame, body axes"),
    "defined": ("1", "whether the frame exists; where it does not, its numbers are finite fillers"),
}
"""Unit and meaning of every output."""

INTEGRATED = {
    "1": "s",
    "m": "m s",
    "m s-1": "m",
    "m s-2": "m s-1",
    "m s-3": "m s-2",
    "m-1": "m-1 s",
    "rad s-1": "rad",
    "rad s-2": "rad s-1",
}
"""The units of the integrals over time of quantities in these units."""


def framed(frame: str) -> dict[str, str]:
    """The attributes of a dataset whose rates and attitudes are those of a `frame` along a path."""
    return {
        "frame": frame,
        "frame_convention": "right-handed; body axes x = tangent (forward), y = normal, z = binormal",
        "quaternion_convention": f"{record.CONVENTIONS['quaternion_convention']}, unit norm",
    }
