"""Recognise map coordinates by their size."""

import numpy as np

from qtraj.path.track import Track

EASTING, NORTHING = (1e5, 9e5), (1e5, 1e7)
"""Ranges of eastings and northings [m] of UTM; a northing may be measured from the equator or from 10 000 km south."""

MAX_EXTENT = 1e6
"""Largest extent [m] of a recording in one zone."""


def look_like_utm(track: Track) -> bool:
    """Return whether all positions are in the range of UTM coordinates."""
    horizontal = np.asarray(track.positions)[:, :2]
    low, high = horizontal.min(axis=0), horizontal.max(axis=0)
    inside = EASTING[0] < low[0] and high[0] < EASTING[1] and NORTHING[0] < low[1] and high[1] < NORTHING[1]
    return bool(inside and (high - low).max() < MAX_EXTENT)
