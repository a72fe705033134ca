"""Certify limits on a retimed path: limits on the timing as in `retime`, limits on the shape on the original path."""

from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Int

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, Certificate
from qtraj.design.proof.envelope import differentiable
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.varying import require_known
from qtraj.design.timing import findings
from qtraj.design.timing.constraints import NAMES, all_names, uses_vehicle
from qtraj.design.timing.joints import jumps
from qtraj.design.timing.own_requirements import own_of_timing
from qtraj.design.timing.pieces import proved_in_pieces
from qtraj.design.timing.proof import prove
from qtraj.design.timing.retimed_cells import ROUNDINGS, Cells, cells_of, divides_equally
from qtraj.design.timing.retimed_maxima import Limited, largest_in, largest_per_cell, values_in
from qtraj.design.timing.road_cells import road_of
from qtraj.design.timing.sources import source
from qtraj.design.timing.timing import RetimedPath
from qtraj.design.varying import Varying, on_path, varies
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.route import Route
from qtraj.path.vehicle_data import axes_of

Certify = Callable[[AbstractHodograph, Limits], Certificate]


def certify_retimed(path: RetimedPath, limits: Limits, certify: Certify) -> Certificate:
    """Return the certificate of a retimed path or a batch; `certify` certifies paths other than routes.

    Limits on the timing, and those on own quantities, are proved as in `retime`, and limits on the shape are
    proved on the original path. All other limits are sampled. If the cells of the timing are not parts of a polynomial
    path, all limits are sampled.
    """
    batch, given = path.duration.shape, tuple(limits.given())
    limits.require_batch(batch, "the paths" if batch else "the path")
    if batch:
        limits.require_constant("certify of a batch of retimed paths", "check the paths one by one")
    if limits.varying and not (batch or is_traced(path, limits)):
        limits = limits.on(path.path)
    elif limits.varying or (limits.along_road and is_traced(path, limits)):
        require_known(path, limits)
    cells = None if path.timing.coefficients.ndim != len(batch) + 2 else _provable(path)
    if cells is None or not given:
        return certify(path, limits)
    of_timing, of_shape = limits.only(NAMES), limits.on_shape()
    own = limits.only(() if batch or is_traced(path, limits) else own_of_timing(path.path, limits))
    if isinstance(path.path, Route) and is_traced(limits):
        of_shape = limits.only(())
    found: list[Certificate] = []
    if of_timing.given():
        axes = jax.tree_util.tree_map_with_path(partial(_batch_axis, len(batch)), of_timing)
        found.append(_batched(lambda x, y: _of_timing(x, y, cells), (0, axes), len(batch))(path, of_timing))
    if own.given():
        found.append(_of_timing(path, own, cells))
    if of_shape.given():
        shape = path.path
        whole = certify_route(shape, of_shape).whole if isinstance(shape, Route) else certify(shape, of_shape)
        found.append(_batched(_at_new_times, (0, 0), len(batch))(path, whole))
    proved = {*of_timing.given(), *own.given(), *of_shape.given()}
    if len(proved) < len(given):
        found.append(certify(path, limits.only([name for name in given if name not in proved])))
    return findings.joined(found, given)


def _batched(function: Any, axes: Any, count: int) -> Any:
    for _ in range(count):
        function = eqx.filter_vmap(function, in_axes=axes)
    return function


def _provable(path: RetimedPath) -> Cells | None:
    """Return the cells of a retimed path if the proof supports them and the original path, otherwise None."""
    cells = cells_of(path)
    if cells is None or isinstance(path.path, Route):
        return cells
    polynomials = _batched(lambda x: x.polynomials(), 0, path.duration.ndim)(path.path)
    return None if polynomials is None else cells


def _batch_axis(batched: int, place: Any, x: Any) -> int | None:
    """Return the batch axis of a limit, or of a parameter of the vehicle; None without a batch."""
    own = axes_of(place[-1].name) if place[0].name == "vehicle" else 0
    return 0 if batched and jnp.ndim(x) - own >= batched else None


def _of_timing(path: RetimedPath, limits: Limits, cells: Cells) -> Certificate:
    """Return the certificate of one path for limits that are in `NAMES`.

    Each largest value is evaluated at a point of the path, so a value above the limit confirms a violation.
    """
    names, dtype = tuple(limits.given()), path.duration.dtype
    (arrays, static), traced = eqx.partition(path, eqx.is_array), is_traced(path, limits)
    xp: Any = jnp if traced else np
    bounds = {
        name: x if isinstance(x, OfSpeed | Varying) else xp.asarray(x, dtype)
        for name, x in on_path(limits.given(), path.path).items()
    }
    vehicle: Any = None
    if uses_vehicle(names):
        vehicle = road_of(limits, path.path, False)
        if isinstance(vehicle, RoadParameters):
            vehicle = vehicle.each(lambda x: xp.asarray(x, dtype))
    polynomials: Any = constants(source(path.path))
    limited = constants(Limited(path, cells, bounds, vehicle))
    known = not is_traced(limited)
    if known:
        limited = limited._replace(
            bounds={
                name: x if isinstance(x, OfSpeed | Varying) else np.asarray(x) for name, x in limited.bounds.items()
            }
        )
    limited, codes = (proved_in_pieces if varies(bounds) or limits.along_road else _proved)(limited, polynomials)
    # Cells without motion are proved, and their usage is negative.
    columns = limited.cells.columns
    place = np.full(limited.path.timing.coefficients.shape[0], columns.size)
    place[columns] = np.arange(columns.size)
    found = (_certificate if known else eqx.filter_jit(_certificate))(limited, codes, names, place)
    if not traced:
        return found
    road = jnp.zeros(0, dtype) if vehicle is None else jnp.stack(list(vehicle.numbers))
    values = differentiable(names, static, (arrays, road), found.times, found.values)
    return Certificate(names, found.codes, found.times, values, jnp.stack([*limits.constant().values()]))


def _proved(limited: Limited, polynomials: Any) -> tuple[Limited, Int[Any, "limits moving"]]:
    """Return the path with its cells, and the status of each limit of `NAMES` on each cell that moves."""
    timing, cells = limited.path.timing, limited.cells
    coefficients = timing.coefficients if is_traced(limited) else np.asarray(timing.coefficients)
    powers = coefficients[cells.columns], np.array(timing.rest)
    vehicle: Any = limited.vehicle
    return limited, prove(polynomials, cells.grid, powers, limited.bounds, vehicle).codes


def _certificate(
    limited: Limited, codes: Int[Any, "limits moving"], names: tuple[str, ...], place: Int[Any, " cells"]
) -> Certificate:
    """Return the certificate; `place` is the index of each cell among those with motion, or their number."""
    (path, cells, *_), xp = limited, limited.library
    knots = xp.asarray(path.timing.knots)
    own = codes[np.array([all_names(names).index(name) for name in names])]
    own = xp.where((own == PROVED) & jumps(path, cells, names), UNDECIDED, own)
    if is_traced(path) and not isinstance(path.path, Route):
        own = xp.where(divides_equally(path, cells), own, SAMPLED)
    still = np.ones((len(names), 1))
    all_codes = xp.concatenate([own, (PROVED * still).astype(own.dtype)], axis=1)[:, place]
    all_codes = findings.with_straight(path.path, knots, all_codes, names)
    usage = xp.concatenate([largest_per_cell(limited, names), -still], axis=1)[:, place]
    cell = findings.worst_cell(all_codes, usage)
    times, place, largest = largest_in(limited, cell, names)
    other = cell if xp is jnp else findings.undecided_cell(all_codes, usage, cell)
    if xp is np and (other != cell).any():
        again = largest_in(limited, other, names)
        larger = again[2] > largest
        cell = np.where(larger, other, cell)
        times, place, largest = (np.where(larger, *x) for x in zip(again, (times, place, largest), strict=True))
    values, limits = values_in(limited, (cell, place), largest, names)
    return findings.certificate(all_codes, times, values, limits, path.path.polynomials(), names)


def _at_new_times(path: RetimedPath, shape: Certificate) -> Certificate:
    """Convert the times of a certificate of the original path to times of the retimed path.

    If the timing does not cover exactly the whole path, UNDECIDED replaces PROVED and BROKEN.
    """
    xp: Any = jnp if is_traced(path, shape) else np
    timing = path.timing
    duration, knots, codes = (xp.asarray(x) for x in (path.path.duration, timing.knots, shape.codes))
    error = xp.maximum(xp.abs(knots[0]), xp.abs(knots[-1] - duration))
    whole = error <= ROUNDINGS * float(np.finfo(knots.dtype).eps) * duration
    codes = xp.where(whole | ((codes != PROVED) & (codes != BROKEN)), codes, UNDECIDED)
    times = timing.times_of(xp.asarray(shape.times, knots.dtype))
    return Certificate(shape.names, codes, times, shape.values, shape.limits)
