"""Convert the columns of a recording to the quantities of a track."""

from pathlib import Path
from typing import Any

import numpy as np

from qtraj.algebra import hamilton, rotation
from qtraj.io.track.attitude_angles import AttitudeAngles
from qtraj.io.track.kitti_poses import attitudes
from qtraj.io.track.recorded_axes import attitudes_up, rates_up, vectors_up
from qtraj.io.track.tangent_plane import TangentPlane
from qtraj.io.track.track_facts import Columns


def quantities(
    path: Path | str, columns: Columns, numbers: np.ndarray, plane: TangentPlane | None, angles: AttitudeAngles | None
) -> dict[str, np.ndarray]:
    """Return the quantities of a track from the columns `numbers` (rows, columns) of all quantities except the time."""
    parts = parts_of(columns, numbers)
    attitude = parts.get("attitude")
    if attitude is not None and attitude.shape[1] == 9:
        attitude = attitudes(path, attitude)
    if attitude is not None:
        converted = angles is not None
        parts["attitude"] = (
            angles.quaternions(attitude) if converted else attitudes_up(attitude, columns.axes["attitude"])
        )
    if plane is not None:
        parts |= projected(path, plane, parts["position"], parts.get("velocity"), parts.get("attitude"))
    if "rate" in parts:
        parts["rate"] = rates_up(parts["rate"], columns.axes["rate"])
    return parts


def parts_of(columns: Columns, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """Return the columns of each quantity except the time, in the units of a track; vectors with z up."""
    parts: dict[str, np.ndarray] = {}
    start = 0
    for part, names in columns.chosen.items():
        if part == "time":
            continue
        values = numbers[:, start : start + len(names)]
        start += len(names)
        if part != "attitude":
            values = values * [1.0 if unit is None else float(unit.factor) for unit in columns.units[part]]
        if part in ("position", "velocity") and len(names) == 2:
            values = np.column_stack([values, np.zeros(len(values))])
        if part in ("position", "velocity"):
            values = vectors_up(values, columns.axes[part])
        parts[part] = values
    return parts


def projected(
    path: Path | str,
    plane: TangentPlane,
    geodetic: np.ndarray,
    velocity: np.ndarray | None,
    attitude: np.ndarray | None,
) -> dict[str, np.ndarray]:
    """Return positions in the tangent plane, and velocities and attitudes rotated to its axes.

    The recorded velocities and attitudes refer to the local axes of each sample.
    """
    try:
        position, rotations = plane.project(geodetic)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    parts = {"position": position}
    if velocity is not None:
        parts["velocity"] = np.einsum("nij,nj->ni", rotations, velocity)
    if attitude is not None:
        world_to_local: Any = np.swapaxes(rotations, -1, -2)
        local = np.asarray(rotation.from_dcm(world_to_local))
        parts["attitude"] = np.stack(hamilton.product(tuple(local.T), tuple(attitude.T)), axis=1)  # pyright: ignore[reportArgumentType]
    return parts
