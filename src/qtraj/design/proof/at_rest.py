"""Findings on segments of a route without motion, such as those of a parked vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, UNDEFINED
from qtraj.design.proof.findings import Limit
from qtraj.design.proof.standing import ZERO
from qtraj.path.frenet import Invariants
from qtraj.path.own_facts import OwnFacts
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.standstill import ORDER, driven_invariants
from qtraj.path.stops import Segments


def at_rest(
    segments: Segments, limits: Sequence[Limit], road: RoadParameters | None, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the status codes and values of the segments `rows`: only gravity acts, on a road without slope."""
    if not rows.size:
        return np.zeros((0, len(limits)), int), np.zeros((0, len(limits)))
    count, entries = len(segments.durations), [x.entry for x in limits]
    values = np.stack([_values(entry, segments, road, rows) for entry in entries], axis=1)
    bounds = np.stack([np.broadcast_to(x.bounds, count)[rows] for x in limits], axis=1)
    side = np.array([x.side for x in entries])
    margin = side * (bounds - values)
    proved, broken = margin > ZERO * np.abs(values), margin < -ZERO * np.abs(values)
    proved |= (values == 0) & (bounds == 0)
    of_formula = np.array([x.own is None or x.own.formula is not None for x in entries])
    met = np.where(of_formula, PROVED, SAMPLED)
    codes = np.where(proved, met, np.where(broken, BROKEN, UNDECIDED))
    for j in [j for j, entry in enumerate(entries) if entry.position and entry.own is None]:
        open_ = np.flatnonzero(codes[:, j] == UNDECIDED)
        codes[open_, j] = _height_codes(entries[j], segments, rows[open_], bounds[open_, j])
    return np.where(np.isnan(values), np.where(of_formula, UNDEFINED, UNDECIDED), codes), values


def _height_codes(entry: PathQuantity, segments: Segments, rows: np.ndarray, bounds: np.ndarray) -> list[int]:
    """Return the status codes of heights that lie so close to their bounds that only exact numbers tell the sides."""
    start = Fraction(0) if segments.origin is None else Fraction(float(segments.origin[2]))
    heights = [start + Fraction(float(z)) for z in segments.coefficients[rows, 0, 2]]
    heights = [abs(z) for z in heights] if entry.signed is None else heights
    margins = [entry.side * (Fraction(float(bound)) - z) for bound, z in zip(bounds, heights, strict=True)]
    return [PROVED if margin >= 0 else BROKEN for margin in margins]


def _values(entry: PathQuantity, segments: Segments, road: RoadParameters | None, rows: np.ndarray) -> np.ndarray:
    zero: Any = np.zeros(())
    if road is not None and entry.gravity:
        one: Any = np.ones(())
        own_road = road.each(lambda x: np.broadcast_to(np.asarray(x), len(segments.durations))[rows])
        forces = driven_invariants([(zero, zero, zero)] * (ORDER + 1), None, own_road, zero, one, one)
        return np.zeros(rows.size) + np.asarray(entry.value(forces))
    own = entry.own
    if own is not None and _undefined(entry, own):
        return np.full(rows.size, np.nan)
    if not _has_constant(entry):
        return np.zeros(rows.size)
    zeros = np.zeros(rows.size)
    origin = np.zeros(3) if segments.origin is None else segments.origin
    position: Any = tuple((segments.coefficients[rows, 0] + origin).T)
    with np.errstate(all="ignore"):
        found = entry.value(Invariants([position, *[(zeros, zeros, zeros)] * ORDER], None, road, np.sqrt))
    return np.asarray(found) + zeros


def _undefined(entry: PathQuantity, own: OwnFacts) -> bool:
    """Return whether a quantity of one's own is undefined at rest.

    Quantities that are defined next to a stop although they divide by the speed, such as the lateral acceleration, are
    zero at rest, as those of the registry.
    """
    if any(guard.divisor for guard in own.guards) or (entry.divisor is not None and own.stop == "path"):
        return True
    singular = entry.divisor is not None or bool(own.guards)
    return singular and _has_constant(entry)


def _has_constant(entry: PathQuantity) -> bool:
    """Return whether a quantity may differ from zero at rest although only gravity acts."""
    own = entry.own
    if own is None:
        return entry.position
    return not own.zero_at_rest and bool(own.in_si or entry.position or entry.needs)
