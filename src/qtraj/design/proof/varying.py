"""Certify limits that change along the way or with the speed, on one path that is not a route."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from qtraj.design.along import Along
from qtraj.design.divisors import factors as factors_of
from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits, limits_of
from qtraj.design.margins import at_speed
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.findings import Findings, Limit, Window
from qtraj.design.proof.judge import judge
from qtraj.design.proof.on_road import OnRoad
from qtraj.design.proof.paths import curve_source, polynomial_arrays, source_of, world_source
from qtraj.design.proof.varying_parts import Divided, judged_parts
from qtraj.design.regions import Regions
from qtraj.design.timing.findings import joined
from qtraj.foundation.arrays import is_traced
from qtraj.path.distances import distances
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import quantity
from qtraj.path.road_on_path import RoadOnPath
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import fixed_parameters
from qtraj.path.vehicle_data import batch_of


def certify_varying(
    path: AbstractHodograph, limits: Limits, certify: Callable[[AbstractHodograph, Limits], Certificate]
) -> Certificate:
    """Return the certificate of a path or of a batch of paths for limits of which some change along the way.

    `certify` returns the certificate for the other limits.

    **Raises:** ValueError for traced values.
    """
    require_known(path, limits)
    if batch := path.duration.shape:
        limits.require_batch(batch, "the paths")
        each = [certify_varying(*_element(path, limits, k), certify) for k in np.ndindex(batch)]
        fields = ([getattr(x, field) for x in each] for field in ("codes", "times", "values", "limits"))
        names = tuple(limits.given())
        return Certificate(names, *(np.reshape(x, (*batch, len(names))) for x in fields))
    limits = limits.on(path)
    given, on_road = limits.given(), limits.along_road
    whole, rest = _divided(path, limits), [name for name in limits.constant() if name not in on_road]
    factors = dict(zip(given, (float(np.asarray(x)) for x in factors_of(limits, float)), strict=True))
    found = [certify(path, limits.only(rest))] if rest else []
    for name in dict.fromkeys([*limits.varying, *on_road]):
        along: Any = given[name]
        if isinstance(along, OfSpeed):
            found.append(_by_speed(path, name, along))
            continue
        if not isinstance(along, Along):
            found.append(_on_road(whole, name, float(np.asarray(along)), factors[name]))
            continue
        parts = judged_parts(whole, quantity(name), along, factors[name])
        row = parts.worst(quantity(name), 1)
        columns = (parts.codes, parts.times, parts.values, parts.bounds)
        found.append(Certificate((name,), *(x[row] for x in columns)))
    return joined(found, tuple(given))


def _on_road(whole: Divided, name: str, bound: float, factor: float) -> Certificate:
    """Return the certificate of a constant limit on a road that changes along the way."""
    limit = Limit(quantity(name), np.full(1, bound), np.full(1, factor))
    found = whole.findings(np.zeros(1, int), limit, Window(np.zeros(1), np.ones(1)))
    codes, times, values = (x[0] for x in found)
    return Certificate((name,), codes, times, values, np.full(1, bound))


def _by_speed(path: AbstractHodograph, name: str, bound: OfSpeed) -> Certificate:
    """Return the certificate of a limit that depends on the speed."""
    arrays = polynomial_arrays(path)
    one: Any = jax.tree.map(lambda x: x[None] if eqx.is_array(x) else x, path) if arrays is None else None
    source = curve_source(one) if arrays is None else source_of([np.asarray(x)[None] for x in arrays])
    codes, times, values = (x[0] for x in judge(source, [limit_by_speed(name, bound)]))
    speed = np.linalg.norm(np.asarray(path.derivatives(float(times[0]), 1)[1], float))
    bounds = at_speed(bound, speed)
    return Certificate((name,), codes, times, values, np.atleast_1d(bounds))


def limit_by_speed(name: str, bound: OfSpeed) -> Limit:
    """Return a limit that depends on the speed; its number is the limit at rest."""
    at_rest = np.atleast_1d(np.asarray(at_speed(bound, np.zeros(())), float))
    return Limit(quantity(name), at_rest, np.ones(1), None, bound)


def require_known(path: AbstractHodograph, limits: Limits) -> None:
    """Raise a ValueError for traced values with limits that are not constant."""
    if is_traced(path, limits):
        name = [*limits.varying, *limits.along_road][0]
        raise ValueError(
            f"the limit {name}, or the road, is not constant, which certify supports for paths with concrete values: "
            "call it outside jit, grad and vmap"
        )


def _element(path: AbstractHodograph, limits: Limits, index: tuple[int, ...]) -> tuple[AbstractHodograph, Limits]:
    """Return one path of a batch, and its limits."""

    def at(tree: Any) -> Any:
        return jax.tree.map(lambda x: np.asarray(x)[index] if eqx.is_array(x) else x, tree)

    def has_batch(bound: Any) -> bool:
        if isinstance(bound, Regions | OfSpeed):
            return False
        return bound.distance.ndim > 1 if isinstance(bound, Along) else np.ndim(bound) > 0

    bounds = {name: at(x) if has_batch(x) else x for name, x in limits.given().items()}
    vehicle = limits.vehicle
    return at(path), limits_of(bounds, at(vehicle) if batch_of(vehicle) else vehicle)


def _divided(path: AbstractHodograph, limits: Limits) -> Divided:
    """Return the path as one segment."""
    arrays = polynomial_arrays(path)
    road = fixed_parameters(limits.vehicle, float) if limits.uses_vehicle else None

    def judged(segment: np.ndarray, limit: Limit, window: Window, start: Any, end: Any = None) -> Findings:
        count = len(segment)
        in_world = limit.entry.uses_axes(start)
        if arrays is None or in_world:  # the derivatives may be compiled, for one path
            source = curve_source if arrays is None else world_source
            each = [_on_curve(path, source, limit, (start, end), window, k) for k in range(count)]
            return Findings(*(np.concatenate(x) for x in zip(*each, strict=True)))
        source = source_of([np.repeat(np.asarray(x)[None], count, axis=0) for x in arrays])
        factors = np.broadcast_to(limit.factors, count)
        return judge(source, [limit._replace(factors=factors)], _each(start, count), window, _each(end, count))

    on, length = distances(path), np.full(1, float(path.duration))
    vehicle: Any = limits.vehicle
    on_road = OnRoad(RoadOnPath(vehicle, on), np.zeros(1), length, judged) if limits.along_road else None

    def findings(segment: np.ndarray, limit: Limit, window: Window) -> Findings:
        if on_road is not None and on_road.supports(limit.entry):
            return on_road.findings(segment, limit, window)
        return judged(segment, limit, window, road)

    return Divided(np.zeros(1), length, on, findings)


def _on_curve(path: Any, source: Any, limit: Limit, road: tuple[Any, Any], window: Window, k: int) -> Findings:
    """Return the findings on one part of a path that is not polynomial."""
    one: Any = jax.tree.map(lambda x: x[None] if eqx.is_array(x) else x, path)
    factors, curve = np.broadcast_to(limit.factors, len(limit.bounds)), limit.curve
    own = Limit(limit.entry, limit.bounds[[k]], factors[[k]], None if curve is None else curve[[k]])
    start, end = (_row(x, k) for x in road)
    return judge(source(one), [own], start, Window(*(x[[k]] for x in window)), end)


def _row(road: RoadParameters | None, k: int) -> RoadParameters | None:
    return None if road is None else road.each(lambda x: np.atleast_1d(x)[[k if np.ndim(x) else 0]])


def _each(road: RoadParameters | None, count: int) -> RoadParameters | None:
    """Return the parameters of the vehicle for `count` parts of a path."""
    return None if road is None else road.each(lambda x: np.broadcast_to(np.asarray(x, float), count))
