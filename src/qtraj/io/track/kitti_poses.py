"""Recognise and read poses as KITTI writes them: twelve numbers on a line, the rows of a matrix (3, 4)."""

from pathlib import Path
from typing import Any

import numpy as np

from qtraj.algebra import rotation
from qtraj.io.track.delimited import Content, is_number
from qtraj.io.track.given_times import NO_TIMES

COLUMNS = [name for k in (1, 2, 3) for name in (f"r{k}1", f"r{k}2", f"r{k}3", f"t{k}")]
"""Names of the columns: a row of the rotation matrix and a coordinate, three times."""

POSITION = ("t1", "t2", "t3")
ROTATION = tuple(name for name in COLUMNS if name not in POSITION)
TOLERANCE = 1e-2
"""Maximum deviation of R Rᵀ from the identity: matrices are printed with few digits."""


def is_kitti(found: Content) -> bool:
    """Return whether the first line consists of twelve numbers between spaces, of which nine are a rotation matrix."""
    cells = found.lines[0][1].split()
    if len(cells) != len(COLUMNS) or not all(map(is_number, cells)):
        return False
    matrix = np.array(cells, float).reshape(3, 4)[:, :3]
    return bool(np.abs(matrix @ matrix.T - np.eye(3)).max() < TOLERANCE and np.linalg.det(matrix) > 0)


def require_times(path: Path | str, timed: bool) -> None:
    """Raise a ValueError if no times are given."""
    if not timed:
        raise ValueError(f"{path}: the file contains poses of twelve numbers (KITTI), and no times.{NO_TIMES}")


def pose_axes(path: Path | str, positions: np.ndarray, axes: str | None) -> str:
    """Return `axes`, or "camera" if the positions (n, 3) change least along y, as a camera moves over the ground.

    **Raises:** ValueError without `axes` if the positions change least along another axis.
    """
    if axes is not None:
        return axes
    extents = np.ptp(positions, axis=0)
    if extents[1] < min(extents[0], extents[2]):
        return "camera"
    raise ValueError(
        f"{path}: the axes of the poses are not known: the positions extend over {extents[0]:.4g}, {extents[1]:.4g} "
        f"and {extents[2]:.4g} m. Pass axes='camera' (right, down, forward), axes='ned' or axes='enu' (z up)"
    )


def attitudes(path: Path | str, matrices: np.ndarray) -> np.ndarray:
    """Return the quaternions (n, 4), scalar first, nearest to the `matrices` (n, 9).

    **Raises:** ValueError for a matrix that is not a rotation, with its number.
    """
    square: Any = matrices.reshape(-1, 3, 3)
    deviation = np.abs(square @ np.swapaxes(square, 1, 2) - np.eye(3)).max(axis=(1, 2))
    if (bad := np.flatnonzero((deviation > TOLERANCE) | (np.linalg.det(square) < 0))).size:
        raise ValueError(f"{path}: the pose of row {bad[0] + 1} does not contain a rotation matrix")
    return np.asarray(rotation.from_dcm(rotation.nearest_dcm(square.swapaxes(1, 2))))
