"""The segments near one of a route whose states at the ends of the route deviate within a box.

A deviation at the start of the route adds a quintic to the first segment, one at the end to the last segment. The
quintic changes the position or the velocity at this end, and no other state up to the acceleration.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.proof.sources import PolynomialSource
from qtraj.design.robust.box import ROUTE_STATES, Box
from qtraj.design.robust.driven_route import AT_END, AT_START, findings_on
from qtraj.design.robust.family import Coefficients, Coordinates, Family
from qtraj.path.stops import Segments

LEAST_SLOPE = 1e-6
"""Smallest part of a velocity that is horizontal, so that it has a left side."""


def states_on(segments: Segments, row: int, box: Box) -> list[str]:
    """Return the names of the states in a box on which a segment depends."""
    ends = {"start": 0, "end": len(segments.starts) - 1}
    return [name for name in box.names if name in ROUTE_STATES and ends[name.split("_", 1)[0]] == row]


def family_of_segment(segments: Segments, row: int, box: Box) -> Family:
    """Return the segments near segment `row`; its times are measured from its start."""
    part = segments.part(np.array([row]))
    c, duration = part.coefficients[0], float(part.durations[0])
    names = states_on(segments, row, box)
    changes = [_changes(name, c, duration) for name in names]
    x, y, z = (np.ascontiguousarray(part.coefficients[:, :, axis].T) for axis in range(3))
    source = PolynomialSource(x, y, z, None, part.durations, origin=segments.origin)
    origin = 0.0 if segments.origin is None else float(segments.origin[2])

    def certified(
        deviations: Float[np.ndarray, "n p"], limits: Limits, vehicles: Float[np.ndarray, "n 2"] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        rows = _stacked(family.coefficients(deviations)[:3])
        found = findings_on(part.part(np.zeros(len(rows), int))._replace(coefficients=rows), limits, vehicles)
        return found.times, found.values

    own: Coefficients = [c[:, 0], c[:, 1], c[:, 2], None]
    family = Family(names, Coordinates(own, changes, origin=origin), source, box, certified)
    return family


def _stacked(each: Coefficients) -> Float[np.ndarray, "n terms 3"]:
    """Return the coefficients of x, y and z, which may have different lengths, in one array."""
    known = [np.asarray(c) for c in each]
    rows = np.zeros((len(known[0]), max(c.shape[1] for c in known), 3))
    for axis, c in enumerate(known):
        rows[:, : c.shape[1], axis] = c
    return rows


def _changes(name: str, c: Float[np.ndarray, "terms 3"], duration: float) -> Coefficients:
    """Return the changes of the coefficients of the coordinates per unit of a deviation."""
    end, kind = name.split("_", 1)
    powers = np.arange(1, len(c)) * duration ** np.arange(len(c) - 1)
    velocity = c[1] if end == "start" else powers @ c[1:]
    which = int(kind.endswith("speed"))  # of the rows of the quintics
    shape = (AT_START if end == "start" else AT_END)[which] * duration**which / duration ** np.arange(6)
    direction = _direction(name, kind.partition("_")[0], velocity)
    return [*(x * shape for x in direction), None]


def _direction(name: str, kind: str, velocity: Float[np.ndarray, 3]) -> Float[np.ndarray, 3]:
    """Return the direction of a deviation: along the velocity, to its left, or upwards."""
    if kind == "vertical":
        return np.array([0.0, 0.0, 1.0])
    speed, level = np.linalg.norm(velocity), np.hypot(velocity[0], velocity[1])
    if not speed > 0:
        raise ValueError(f"{name} needs a velocity that is not zero there: pass a window of the route without the stop")
    if kind == "speed":
        return velocity / speed
    if not level > LEAST_SLOPE * speed:
        raise ValueError(f"{name} needs a velocity that is not vertical: pass the vertical speed or position instead")
    return np.array([-velocity[1], velocity[0], 0.0]) / level
