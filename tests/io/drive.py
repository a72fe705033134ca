"""A drive by formulas, in the forms in which recordings contain it."""

import numpy as np
from scipy.spatial.transform import Rotation

COUNT = 40
SECONDS = 0.5 * np.arange(COUNT)
POSITIONS = np.stack([8 * SECONDS, 30 * np.sin(SECONDS / 9), 0.05 * SECONDS], axis=1)
VELOCITIES = np.stack([8 + 0 * SECONDS, 30 / 9 * np.cos(SECONDS / 9), 0.05 + 0 * SECONDS], axis=1)
HEADING = np.arctan2(VELOCITIES[:, 1], VELOCITIES[:, 0])
ROTATIONS = Rotation.from_euler("ZYX", np.stack([HEADING, 0.01 + 0 * HEADING, 0.02 + 0 * HEADING], axis=1))
NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])
CAMERA = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
CAMERA_BODY = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0.0]])

LATITUDE, LONGITUDE, HEIGHT = 48.1, 11.5, 520.0


def ned(vectors):
    return vectors @ NED


def geodetic(positions):
    """Latitude, longitude and height of positions near the origin, by the radii of curvature there; exact to 1 mm."""
    a, e2, latitude = 6378137.0, 0.00669437999014, np.radians(LATITUDE)
    w = np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    north, east = (
        positions[:, 1] / (a * (1 - e2) / w**3 + HEIGHT),
        positions[:, 0] / ((a / w + HEIGHT) * np.cos(latitude)),
    )
    return np.stack([LATITUDE + np.degrees(north), LONGITUDE + np.degrees(east), HEIGHT + positions[:, 2]], axis=1)


def clock(seconds, form):
    """A time of the day from 09:00:00 on, as a text."""
    whole, part = divmod(round(float(seconds) * 1000), 1000)
    hours, rest = divmod(whole, 3600)
    minutes, rest = divmod(rest, 60)
    if form == "am":
        hours += 9
        return f"{(hours - 1) % 12 + 1}:{minutes:02d}:{rest:02d}.{part:03d} {'PM' if hours >= 12 else 'AM'}"
    return f"{9 + hours:02d}:{minutes:02d}:{rest:02d}.{part:03d}"
