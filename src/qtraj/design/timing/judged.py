"""Combine the timings of all parts of a path to one timing, with its certificate, its usage and its code."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient

from qtraj.design.timing import findings
from qtraj.design.timing.constraints import all_names, listed, uses_vehicle
from qtraj.design.timing.differentiated import at_ends, joined
from qtraj.design.timing.part_timing import TimedPart
from qtraj.design.timing.result_code import result_code
from qtraj.design.timing.retimed_cells import Cells
from qtraj.design.timing.retimed_maxima import Limited, largest_in, values_in
from qtraj.design.timing.search import MARGIN
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.design.varying import in_cells, varies
from qtraj.foundation.arrays import is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters


def judged(
    path: AbstractHodograph,
    timed: list[TimedPart],
    bounds: dict[str, Any],
    speeds: tuple[Any, Any],
    vehicle: RoadParameters | RoadOnPath | None,
    cells: Cells,
    names: tuple[str, ...],
    rest: tuple[bool, bool],
) -> tuple[Any, ...]:
    """Combine the timings of all parts, and return the fields of `Retimed`."""
    xp: Any = jnp if is_traced(path, timed, bounds, speeds, vehicle) else np
    knots = joined([x.knots for x in timed])
    powers = xp.concatenate([x.powers for x in timed])
    timing = Timing(powers, knots, rest)
    own = np.array([all_names(names).index(name) for name in names])
    rows = listed(names, uses_vehicle(names))
    usage = xp.concatenate([x.usage for x in timed], axis=1)
    usage = usage[np.array([rows.index(name) for name in names])] * (1 - MARGIN)
    codes = xp.concatenate([xp.asarray(x.codes) for x in timed], axis=1)[own]
    codes = findings.with_straight(path, knots, codes, names)
    cell = findings.worst_cell(codes, usage)
    if varies(bounds):
        bounds = in_cells(bounds, knots[:-1][cells.columns], knots[1:][cells.columns])
    limited = Limited(RetimedPath(path, timing), cells, bounds, vehicle)
    times, place, largest = largest_in(stop_gradient(limited) if xp is jnp else limited, cell, names)
    largest = stop_gradient(largest) if xp is jnp else largest
    values, limits = values_in(limited, (cell, place), largest, names)
    certificate = findings.certificate(codes, times, values, limits, path.polynomials(), names)
    pace, wanted = speeds
    ends = at_ends(powers, pace, rest)
    moving = [x for x in timed if x.found is not None]
    searches: list[Any] = [x.found for x in moving]
    found = xp.all(xp.stack([x.error for x in searches]) < xp.stack([x.enough for x in moving]))
    time = timing.duration if xp is np else stop_gradient(timing.duration)
    time = time + sum(found.sensitivity for found in searches) if xp is jnp else time
    steps = sum((found.steps for found in searches), np.zeros((), np.int32))
    code = result_code(xp, certificate.code, (found, searches), (ends, wanted), (powers, time))
    gap = sum(x.excess for x in timed) / time
    return RetimedPath(path, timing), time, certificate, usage, ends, code, steps, gap
