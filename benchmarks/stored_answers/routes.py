"""Certificates of routes, tuned routes, and fits of recordings."""

from functools import partial
from typing import Any

import numpy as np

import qtraj as qt

from . import drives
from .certificates import MARGINS, PLAIN, ROAD
from .group import FLOOR, LOOSE, Fields, Group, random_vehicles

ON_ROUTES = tuple(name for name in PLAIN if name not in ("torsion", "angular_rate", "angular_acceleration"))
TUNED = ("curvature", "speed", "lateral_acceleration")

DRIVE = drives.DATA.parents[1] / "examples" / "drive_8km.csv.gz"
BENDS = (23.3, 31.9, 46.6, 587.7, 596.8, 605.9, 618.7, 1061.9, 1091.8)
"""Times [s] at which bends of the recorded drive start; each takes about `BEND` [s]."""

BEND, STRETCH = 6.0, 20.0
"""Lengths [s] of the windows for fits of turns and of routes."""


def certified(kind: str, count: int, names: tuple[str, ...], rng: np.random.Generator, **options: Any) -> Fields:
    """Return random routes, and limits that differ from the largest values by one of `MARGINS`."""
    given = getattr(drives, kind)(rng, count, **options)
    if set(names) & set(ROAD):
        given["vehicle"] = random_vehicles(rng, count, banked=True)
    loose = given | {"limits": np.full((count, len(names)), LOOSE)}
    values = np.stack([np.asarray(_certificate(names, loose, k).whole.values) for k in range(count)])
    limits = np.maximum(values * (1 + rng.choice(MARGINS, values.shape)), FLOOR)
    return given | {"limits": np.where(np.isfinite(limits), limits, 1.0)}


def certificates(names: tuple[str, ...], given: Fields) -> Fields:
    """Return the statuses of whole routes and of their segments, and the largest values."""
    found = [_certificate(names, given, k) for k in range(len(given["limits"]))]
    return {
        "statuses": np.array([np.asarray(x.whole.codes) for x in found], np.int8),
        "segment_statuses": np.array([np.asarray(x.segments.codes) for x in found], np.int8),
        "values": np.array([np.asarray(x.whole.values) for x in found]),
    }


def _certificate(names: tuple[str, ...], given: Fields, k: int) -> qt.RouteCertificate:
    return qt.certify(drives.route(given, k), drives.one(names, given, k))


def problems(count: int, rng: np.random.Generator) -> Fields:
    """Return random winding drives with limits that they violate but not at their ends, and half-widths of tubes."""
    given = drives.winding(rng, count, noise=0.0)
    routes = [drives.route(given, k) for k in range(count)]
    loose = qt.Limits(**dict.fromkeys(TUNED, LOOSE))
    largest = np.stack([np.asarray(qt.certify(x, loose).whole.values) for x in routes])
    ends = np.stack([_at_ends(x) for x in routes])
    limits = np.maximum(largest * rng.uniform(0.93, 0.99, largest.shape), 1.03 * ends)
    return given | {"limits": limits, "tube": rng.uniform(0.4, 0.8, count)}


def _at_ends(route: qt.Route) -> np.ndarray:
    """Return the larger value of each quantity in `TUNED` at the two ends of a route."""
    velocity, acceleration = np.moveaxis(np.asarray(route.joints())[[0, -1], 1:], 1, 0)
    speed = np.linalg.norm(velocity, axis=1)
    lateral = np.linalg.norm(np.cross(velocity, acceleration), axis=1) / speed
    return np.stack([lateral / speed**2, speed, lateral]).max(axis=1)


def tuned(objective: str, given: Fields) -> Fields:
    """Return result codes and objectives of tuned routes, and the changes of their durations."""
    found = [
        qt.tune_route(drives.route(given, k), drives.one(TUNED, given, k), float(given["tube"][k]), objective)
        for k in range(len(given["limits"]))
    ]
    return {
        "codes": np.array([int(x.code) for x in found], np.int8),
        "objectives": np.array([float(x.objective) for x in found]),
        "delays": np.array([float(x.delay) for x in found]),
        "statuses": np.array([np.asarray(x.certificate.whole.codes) for x in found], np.int8),
    }


def windows(length: float, count: int, rng: np.random.Generator) -> Fields:
    """Return random windows (start, end) [s] of the recorded drive; each starts close to the start of a bend."""
    begin = rng.choice(BENDS, count, replace=False) + rng.uniform(-0.3, 0.3, count)
    return {"windows": np.stack([begin, begin + length], axis=1)}


def turns(motion: str, given: Fields) -> Fields:
    """Return result codes, residuals, and coefficients of fitted turns."""
    track = qt.read_track(DRIVE)
    found = [qt.fit(track.window(*window), motion=motion) for window in given["windows"].tolist()]
    return {
        "codes": np.array([int(x.code) for x in found], np.int8),
        "residuals": np.array([float(x.residual.horizontal_rms) for x in found]),
        "fits": np.array([float(x.residual.velocity_rms) for x in found]),
        **{name: np.array([np.asarray(getattr(x.path, name)) for x in found]) for name in ("radius", "angle")},
    }


def fits(given: Fields) -> Fields:
    """Return result codes, residuals, prediction errors and smoothing of fitted routes."""
    track = qt.read_track(DRIVE)
    found = [qt.fit_route(track.window(*window)) for window in given["windows"].tolist()]
    return {
        "codes": np.array([int(x.code) for x in found], np.int8),
        "residuals": np.array([float(x.residual.distance_rms) for x in found]),
        "fits": np.array([[float(x.prediction_error), float(x.smoothing), x.path.segments] for x in found]),
    }


def _certified(kind: str, count: int, names: tuple[str, ...] = ON_ROUTES, **options: Any) -> Group:
    return Group(lambda rng: certified(kind, count, names, rng, **options), partial(certificates, names), names)


GROUPS = {
    "winding": _certified("winding", 12),
    "stopping": _certified("stopping", 8),
    "reversing": _certified("stopping", 6, reverses=True),
    "splines": _certified("splines", 6),
    "fitted": _certified("fitted", 6),
    "road": _certified("stopping", 8, ROAD),
    **{
        f"tuned_{x}": Group(partial(problems, 6), partial(tuned, x), TUNED) for x in ("nearest", "fastest", "smoothest")
    },
    **{f"turns_{x}": Group(partial(windows, BEND, 6), partial(turns, x)) for x in ("uniform", "hermite")},
    "fits": Group(partial(windows, STRETCH, 4), fits),
}
