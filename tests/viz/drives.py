"""Drives of straight lines and arcs at a constant speed, in closed form, as datasets of paths."""

import numpy as np
import xarray

COUNT = 120
"""Number of intervals of each line and each arc."""


def drive(parts, speed):
    """Time, position, velocity and curvature along lines (length, 0) and arcs (length [m], angle [rad], left > 0)."""
    lengths, angles = np.array(parts, float).T
    steps, turns = np.repeat(lengths / COUNT, COUNT), np.repeat(angles / COUNT, COUNT)
    heading = np.concatenate([[0.0], np.cumsum(turns)])
    chords = steps * np.sinc(turns / 2 / np.pi)  # exact for arcs
    moves = chords[:, None] * along(heading[:-1] + turns / 2)
    position = np.concatenate([np.zeros((1, 3)), np.cumsum(moves, axis=0)])
    curvature = np.abs(np.append(turns / steps, turns[-1] / steps[-1]))
    time = np.concatenate([[0.0], np.cumsum(steps)]) / speed
    return time, position, speed * along(heading), curvature


def along(heading):
    """Horizontal unit vectors in directions [rad]."""
    return np.stack([np.cos(heading), np.sin(heading), np.zeros(np.shape(heading))], axis=-1)


def dataset_of(drives, **attributes):
    """Drives by name in the form of `path_dataset`, with an upright frame."""
    times, positions, velocities, curvatures = (np.stack(x) for x in zip(*drives.values(), strict=True))
    speed = np.linalg.norm(velocities, axis=2)
    tangent, up = velocities / speed[..., None], np.broadcast_to([0.0, 0.0, 1.0], velocities.shape)
    three = ("path", "sample", "world")
    variables = {
        "position": (three, positions, {"units": "m"}),
        "velocity": (three, velocities, {"units": "m s-1"}),
        "dcm": (("path", "sample", "body", "world"), np.stack([tangent, np.cross(up, tangent), up], axis=2)),
        "defined": (("path", "sample"), np.ones(speed.shape, bool)),
        "speed": (("path", "sample"), speed, {"units": "m s-1"}),
        "curvature": (("path", "sample"), curvatures, {"units": "m-1"}),
        "lateral_acceleration": (("path", "sample"), curvatures * speed**2, {"units": "m s-2", "limit": 3.0}),
    }
    coordinates = {"path": list(drives), "time": (("path", "sample"), times, {"units": "s"}), "world": list("xyz")}
    return xarray.Dataset(variables, coordinates, {"title": "Corners", "frame": "upright", **attributes})


def corners(radius, speed):
    """60 m, 90° to the right with a radius, 80 m, 60° to the left at 30 m, and 60 m."""
    return drive([(60, 0), (radius * np.pi / 2, -np.pi / 2), (80, 0), (30 * np.pi / 3, np.pi / 3), (60, 0)], speed)


def before_and_after(**attributes):
    """A drive with a corner of 12 m at 8 m/s, and the same with a corner of 15 m at 6 m/s."""
    return dataset_of({"before": corners(12.0, 8.0), "after": corners(15.0, 6.0)}, **attributes)
