"""Convert the columns of a recording to the quantities of a track."""

from pathlib import Path
from typing import Any

import numpy as np

from qtraj.algebra import hamilton, rotation
from qtraj.io.recorded_axes import vectors_up
from qtraj.io.tangent_plane import TangentPlane
from qtraj.io.track_facts import Columns


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
        if part == "position" and len(names) == 2:
            values = np.column_stack([values, np.zeros(len(values))])
        if part in ("position", "velocity"):
            values = vectors_up(values, columns.axes[part])
        parts[part] = values
    return parts


def projected(
    path: Path, plane: TangentPlane, geodetic: np.ndarray, velocity: np.ndarray | None, attitude: np.ndarray | None
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
