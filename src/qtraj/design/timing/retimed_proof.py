"""Certify limits on a retimed path, with the proof of `retime` and with the proof for the original path."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.lax import stop_gradient
from jaxtyping import Array, Float, Int

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import BROKEN, PROVED, SAMPLED, UNDECIDED, Certificate
from qtraj.design.proof.envelope import differentiable
from qtraj.design.proof.route import certify_route
from qtraj.design.timing import findings
from qtraj.design.timing.constraints import NAMES, listed, parts, ratios, used
from qtraj.design.timing.grid import Grid, Shape, derivatives, uniform
from qtraj.design.timing.parts import known_segments, standing_ends
from qtraj.design.timing.proof import Source, prove
from qtraj.design.timing.road import ROAD
from qtraj.design.timing.sources import source
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.types import Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import QUANTITIES
from qtraj.path.route import Route
from qtraj.path.vehicle import RoadParameters

SHAPE = tuple(name for name, entry in QUANTITIES.items() if entry.per_time == 0 and not entry.needs)
"""Quantities that depend only on the shape of a path, not on its timing."""

ROUNDINGS = 64
"""Largest distance between a knot and the end of a dyadic cell, in rounding errors of the duration of the path."""

PLACES, ZOOMS = 17, 3
"""Number of equally spaced points in a cell, and in each of the smaller and smaller intervals around the largest."""

INSIDE = 1e-9
"""Smallest distance of a reported maximum from the ends of its cell, relative to the cell."""

RANKS = {"friction": 1, "inertia": 2}
"""Number of axes of the fields of a vehicle that are not scalars."""


Certify = Callable[[AbstractHodograph, Limits], Certificate]


def certify_retimed(path: RetimedPath, limits: Limits, certify: Certify) -> Certificate:
    """Return the certificate of a retimed path or a batch; `certify` is the function for all other paths but routes.

    Limits that the proof of `retime` supports are proved with it, and limits on the shape on the original path. All
    other limits are sampled. If the cells of the timing are not parts of a polynomial path, all limits are sampled.
    """
    batch, given = path.duration.shape, tuple(limits.given())
    limits.require_batch(batch, "the paths" if batch else "the path")
    cells = None if path.timing.coefficients.ndim != len(batch) + 2 else _provable(path)
    of_timing = [name for name in given if cells is not None and name in NAMES]
    known = not isinstance(path.path, Route) or not _is_traced(limits)
    of_shape = [name for name in given if cells is not None and known and name in SHAPE]
    found: list[Certificate] = []
    if of_timing and cells is not None:
        chosen = _only(limits, of_timing)
        axes = jax.tree_util.tree_map_with_path(partial(_batch_axis, len(batch)), chosen)
        found.append(_batched(lambda x, y: certify_timing(x, y, cells), (0, axes), len(batch))(path, chosen))
    if of_shape:
        chosen = _only(limits, of_shape)
        whole = certify_route(path.path, chosen).whole if isinstance(path.path, Route) else certify(path.path, chosen)
        found.append(_batched(at_new_times, (0, 0), len(batch))(path, whole))
    if others := [name for name in given if name not in (*of_timing, *of_shape)]:
        found.append(certify(path, _only(limits, others)))
    if len(found) < 2:
        return found[0] if found else certify(path, limits)
    order = np.argsort([given.index(name) for one in found for name in one.names])
    arrays = [
        jnp.concatenate([jnp.asarray(getattr(one, field)) for one in found], axis=-1)[..., order]
        for field in ("codes", "times", "values", "limits")
    ]
    return Certificate(given, *arrays)


def _only(limits: Limits, names: list[str]) -> Limits:
    """Return the limits with these names; the vehicle stays."""
    dropped = [name for name in limits.given() if name not in names]
    return eqx.tree_at(lambda x: [getattr(x, name) for name in dropped], limits, [None] * len(dropped))


def _batched(function: Any, axes: Any, count: int) -> Any:
    for _ in range(count):
        function = eqx.filter_vmap(function, in_axes=axes)
    return function


class Cells(NamedTuple):
    """The cells of a timing in which the vehicle moves.

    `grid` contains the cells as dyadic parts of segments, `columns` are their indices among all cells of the timing,
    and `stops` (2, cells) indicates whether the velocity of the path is zero at the start and at the end of a cell.
    """

    grid: Grid
    columns: Int[np.ndarray, " cells"]
    stops: Any


def cells_of(path: RetimedPath) -> Cells | None:
    """Return the cells of the timing, or None if they are not dyadic parts of the segments of the original path.

    For a path with one segment and traced knots, the cells are known only if they are of equal length. See `_match`.
    """
    knots, count = path.timing.knots, path.timing.coefficients.shape[-2]
    if not isinstance(path.path, Route):
        if count & (count - 1):
            return None
        found = Cells(uniform(count), np.arange(count), np.zeros((2, count), bool))
        return found if isinstance(knots, Tracer) or bool(np.all(_match(path, found))) else None
    if path.duration.ndim or _is_traced((path.path, knots)):
        return None
    segments, at = known_segments(path.path), np.asarray(knots)
    starts, spans = segments.starts, segments.durations
    own = np.clip(np.searchsorted(starts, 0.5 * (at[1:] + at[:-1]), side="right") - 1, 0, starts.size - 1)
    half = np.exp2(np.round(np.log2(np.maximum(np.diff(at), 1e-300) / spans[own])))
    middle = (2 * np.round(((at[1:] + at[:-1] - 2 * starts[own]) / spans[own] / half - 1) / 2) + 1) * half - 1
    ends = starts[own] + 0.5 * spans[own] * (1 + middle + np.array([[-1.0], [1.0]]) * half)
    error = max(np.abs(ends - np.stack([at[:-1], at[1:]])).max(), abs(at[0]), abs(at[-1] - starts[-1] - spans[-1]))
    if error > ROUNDINGS * np.finfo(float).eps * (starts[-1] + spans[-1]):
        return None
    columns = np.flatnonzero(segments.coefficients[own, 1:].any(axis=(1, 2)))
    grid = Grid(np.arange(columns.size + 1.0), own[columns], middle[columns], half[columns])
    sides = np.stack([grid.middle - grid.half == -1, grid.middle + grid.half == 1])
    return Cells(grid, columns, sides & standing_ends(segments)[grid.segment].T) if columns.size else None


def _match(path: RetimedPath, cells: Cells) -> Array:
    """Return whether the knots divide the whole path into cells of equal length, for each path of a batch."""
    duration, knots = jnp.asarray(path.path.duration)[..., None], path.timing.knots
    equal = (cells.grid.knots / cells.grid.cells).reshape(*[1] * (knots.ndim - 1), -1)
    error = jnp.abs(knots - duration * equal)
    return jnp.max(error / duration, axis=-1) <= ROUNDINGS * float(jnp.finfo(knots.dtype).eps)


def _provable(path: RetimedPath) -> Cells | None:
    """Return the cells of a retimed path whose original path and cells the proof supports, otherwise None."""
    cells = cells_of(path)
    if cells is None or isinstance(path.path, Route):
        return cells
    polynomials = _batched(lambda x: x.polynomials(), 0, path.duration.ndim)(path.path)
    return None if polynomials is None else cells


def _batch_axis(batched: int, place: Any, x: Any) -> int | None:
    """Return the batch axis of a field of limits or of their vehicle, or None without a batch."""
    own = RANKS.get(place[-1].name, 0)
    return 0 if batched and jnp.ndim(x) - own >= batched else None


def certify_timing(path: RetimedPath, limits: Limits, cells: Cells) -> Certificate:
    """Return the certificate of one path for limits that are in `NAMES`.

    At the time of the largest value, the value is that of the path, so it confirms a violation.
    """
    names, dtype = tuple(limits.given()), path.duration.dtype
    bounds = {name: jnp.asarray(value, dtype) for name, value in limits.given().items()}
    vehicle = None
    if set(names) & set(ROAD):
        vehicle = RoadParameters(*(jnp.asarray(x, dtype) for x in limits.road(dtype)))
    (arrays, static), traced = eqx.partition(path, eqx.is_array), _is_traced((path, limits))
    polynomials: Any = source(path.path)  # before `stop_gradient`, which makes the numbers of a route unknown
    of_vehicle = vehicle
    path, polynomials, bounds, vehicle = stop_gradient((path, polynomials, bounds, vehicle))
    rest = np.array(path.timing.rest)
    codes = prove(
        polynomials,
        cells.grid,
        (path.timing.coefficients[cells.columns], rest),
        bounds,
        vehicle,
    ).codes
    found = _certificate(path, polynomials, cells, codes, bounds, vehicle, names)
    if not traced:
        return found
    road = jnp.zeros(0, dtype) if of_vehicle is None else jnp.stack(list(of_vehicle))
    values = differentiable(names, static, (arrays, road), found.times, found.values)
    return Certificate(names, found.codes, found.times, values, jnp.stack([*limits.given().values()]))


def _is_traced(tree: Any) -> bool:
    return any(isinstance(x, Tracer) for x in jax.tree.leaves(tree))


@eqx.filter_jit
def _certificate(
    path: RetimedPath,
    polynomials: Source,
    cells: Cells,
    codes: Int[Array, "limits moving"],
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None,
    names: tuple[str, ...],
) -> Certificate:
    timing, columns, own = path.timing, cells.columns, np.array([NAMES.index(name) for name in names])
    if not isinstance(path.path, Route):
        codes = jnp.where(_match(path, cells), codes, SAMPLED)
    count, moving = timing.coefficients.shape[0], columns.size
    place = jnp.broadcast_to(jnp.linspace(0.0, 1.0, PLACES), (moving, PLACES))
    of = _usage(path, cells, jnp.repeat(jnp.arange(moving), PLACES), place.ravel(), bounds, vehicle, names)
    of = jnp.where(jnp.isnan(of), 0.0, of).reshape(own.size, moving, PLACES)
    all_codes = jnp.full((own.size, count), PROVED, jnp.int32).at[:, columns].set(codes[own])
    all_codes = findings.with_straight(path.path, timing.knots, all_codes, names)
    usage = jnp.full((own.size, count), -1.0, of.dtype).at[:, columns].set(jnp.max(of, axis=-1))
    cell = findings.worst_cell(all_codes, usage)
    k = jnp.searchsorted(jnp.asarray(columns), cell)  # a cell without motion is never the worst one
    best = jnp.argmax(jnp.take_along_axis(of, k[:, None, None], axis=1)[:, 0], axis=-1) / (PLACES - 1)
    found, values = _zoomed(path, cells, k, best, bounds, vehicle, names)
    knots = timing.knots[cell], timing.knots[cell + 1]
    times = jax.vmap(timing.time)(knots[0] + found * (knots[1] - knots[0]))
    limits = jnp.stack([bounds[name] for name in names])
    return findings.certificate(all_codes, times, values * limits, limits, path.path.polynomials(), names)


def _zoomed(
    path: RetimedPath,
    cells: Cells,
    cell: Int[Array, " limits"],
    best: Float[Array, " limits"],
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None,
    names: tuple[str, ...],
) -> tuple[Float[Array, " limits"], Float[Array, " limits"]]:
    """Return the place of the maximum in a cell near `best`, and the ratio to the limit there.

    Rounding errors dominate the direction of motion close to a stop, so that the search keeps away from it.
    """
    width = 1 / (PLACES - 1)
    before, after = (jnp.asarray(stops)[cell] for stops in cells.stops)
    lowest = jnp.where(before, jnp.minimum(best, width), INSIDE)
    highest = jnp.where(after, jnp.maximum(best, 1 - width), 1 - INSIDE)
    count = len(names)
    rows, around = jnp.arange(count), jnp.linspace(-1.0, 1.0, PLACES)[None]

    def zoom(k: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        reach = width * (2.0 * width) ** k
        near = jnp.clip(found[0][:, None] + reach * around, lowest[:, None], highest[:, None])
        usage = _usage(path, cells, jnp.repeat(cell, PLACES), near.ravel(), bounds, vehicle, names)
        usage = usage.reshape(count, count, PLACES)[rows, rows]
        at = jnp.argmax(jnp.where(jnp.isnan(usage), -jnp.inf, usage), axis=1)
        return near[rows, at], usage[rows, at]

    return jax.lax.fori_loop(0, ZOOMS, zoom, (best, jnp.zeros_like(best)))


def _usage(
    path: RetimedPath,
    cells: Cells,
    cell: Int[Array, " m"],
    place: Float[Array, " m"],
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None,
    names: tuple[str, ...],
) -> Float[Array, "limits m"]:
    """Return the ratio of each quantity in `names` to its limit at the fraction `place` of each moving `cell`."""
    timing, dtype = path.timing, path.duration.dtype
    at = jnp.asarray(cells.columns)[cell]
    grid = cells.grid if isinstance(path.path, Route) else cells.grid._replace(knots=timing.knots)
    one, length = jnp.ones((), dtype), timing.knots[at + 1] - timing.knots[at]
    r = derivatives(Shape(path.path, 0 * one, one), grid, cell, place)
    c = jnp.moveaxis(timing.coefficients[at], -1, 0)
    a = c[0] + place * (c[1] + place * (c[2] + place * c[3]))
    slope, second = c[1] + place * (2 * c[2] + 3 * place * c[3]), 2 * c[2] + 6 * place * c[3]
    found = used(parts(r, one, bounds, vehicle), jnp.stack([a, slope / length, second / length**2]))
    rows = listed(bounds, vehicle is not None)
    return ratios(found, rows)[np.array([rows.index(name) for name in names])]


def at_new_times(path: RetimedPath, shape: Certificate) -> Certificate:
    """Return a certificate of the original path with the times at which the retimed path is at the same places.

    If the timing does not cover exactly the whole path, a limit is not proved or violated on the retimed path.
    """
    timing, duration = path.timing, jnp.asarray(path.path.duration)
    error = jnp.maximum(jnp.abs(timing.knots[0]), jnp.abs(timing.knots[-1] - duration))
    whole = error <= ROUNDINGS * float(jnp.finfo(timing.knots.dtype).eps) * duration
    codes = jnp.where(whole | ((shape.codes != PROVED) & (shape.codes != BROKEN)), shape.codes, UNDECIDED)
    times = jax.vmap(timing.time)(jnp.asarray(shape.times, timing.knots.dtype))
    return Certificate(shape.names, codes, times, shape.values, shape.limits)
