"""Find the peaks of a constraint in a zone of the distance travelled, and its values at the ends of the zone."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.tuning.constraints import ABSENT
from qtraj.design.tuning.maxima import (
    GRID,
    NODES,
    OFFSETS,
    RELEVANT,
    Candidates,
    highest,
    instants,
    parabola,
    refined,
)
from qtraj.design.tuning.searches import Curves
from qtraj.design.tuning.travelled import Travelled
from qtraj.design.tuning.zones import AnyZone, SpeedZone
from qtraj.path.quantity import quantity

INNER = slice(8, NODES - 8, 8)
"""The nodes of a zone at which a constraint at a fixed distance predicts new peaks after a step."""

BELOW = 0.3
"""Constraints at fixed distances are used if their values are at most this much below the largest one, or below 0."""

NEXT = 1e-6
"""A peak that is closer to an end of its zone than this fraction of the duration is the end."""

ROUNDS = 6
"""Number of parabolas by which the peak of a limit that changes linearly or with the speed is refined."""


class ZonePeaks(NamedTuple):
    """Peaks in a zone, as in `Peaks`."""

    owner: np.ndarray
    time: np.ndarray
    value: np.ndarray
    fixed: bool
    edge: bool


def zone_peaks(
    zone: AnyZone, curves: Curves, travelled: Travelled
) -> tuple[Float[np.ndarray, " batch"], list[ZonePeaks]]:
    """Return the largest constraint value of each search in a zone, and the peaks, the ends and further instants."""
    order, inside = quantity(zone.name).order, zone.low < travelled.length
    low, high = travelled.times(zone.low), travelled.times(zone.high)
    u = low + (high - low) * GRID[:, None]
    limit = zone.limit(travelled.at(u)) if zone.is_linear else zone.values[0]
    g = np.broadcast_to(curves.within({zone.name: limit}).values([zone.name], u, order)[0], u.shape)
    g = np.where(inside, g, ABSENT)
    largest = g.max(axis=0)
    owner, time, value = _tops(zone, curves, highest(g, u))
    apart = (time - low[owner] > NEXT) & (high[owner] - time > NEXT)
    found = [ZonePeaks(owner[apart], time[apart], value[apart], False, False)]
    np.maximum.at(largest, owner, value)
    for row, end, moves in ((0, low, zone.low > 0), (-1, high, zone.high < travelled.length)):
        for edge in (False, True):
            own = np.flatnonzero(inside & (moves == edge) & (g[row] > np.maximum(RELEVANT, largest - 2 * BELOW)))
            found.append(ZonePeaks(own, end[own], g[row, own], False, edge))
    node, owner = np.nonzero(g[INNER] > np.maximum(largest, 0.0) - BELOW)
    found.append(ZonePeaks(owner, u[INNER][node, owner], g[INNER][node, owner], True, False))
    return largest, found


def _tops(zone: AnyZone, curves: Curves, at: Candidates) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the searches, the times and the values of the refined maxima."""
    name, owner = zone.name, at.owner
    if not owner.size:
        return owner, np.zeros(0), np.zeros(0)
    if not zone.is_linear:
        rounds = ROUNDS if isinstance(zone, SpeedZone) else 1
        return owner, *refined(name, curves.within({name: zone.values[0]}).at(owner), at, OFFSETS, rounds)
    own, here = zone.take(owner), curves.at(owner)
    travelled, order = Travelled(here, owner.size), quantity(name).order

    def values(u: np.ndarray) -> np.ndarray:
        g = here.within({name: own.limit(travelled.at(u))}).values([name], u, order)[0]
        return np.broadcast_to(g, u.shape)

    low, middle, high = at.low, at.middle, at.high
    for _ in range(ROUNDS):
        u = instants(low, middle, high, OFFSETS)
        g = values(u)
        low, middle, high = parabola(u, g, g.argmax(axis=0))
    return owner, middle, values(middle[None])[0]
