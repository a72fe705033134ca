"""Certificates of traced routes: the proof is one operation of JAX, and the largest values have derivatives.

The values have the derivatives of the quantities at the same fraction of the same segment (envelope theorem). Inside
`jit` and `vmap` the number of segments is unknown, so the certificate has one row for each row of the route. Padding
counts as proved, and its values are NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits, limits_of
from qtraj.design.on_host import on_host
from qtraj.design.proof.certificate import PROVED, UNDEFINED, Certificate
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path import pieces
from qtraj.path.route import Route, from_segments
from qtraj.path.route_parts import unpadded
from qtraj.path.values import value
from qtraj.path.vehicle import RoadParameters

Certify = Callable[[Route, Limits], RouteCertificate]


def certify_traced(route: Route, limits: Limits, certify: Certify) -> RouteCertificate:
    """Return the certificate of a traced route, or of traced limits; `certify` is the proof for concrete arguments.

    **Raises:** ValueError for limits that change along the way or depend on the speed, for obstacles, and for a traced
    vehicle.
    """
    given = limits.given()
    if limits.varying or limits.along_road or any(isinstance(x, OfSpeed) for x in given.values()):
        raise ValueError(
            "inside jit, grad and vmap, certify needs limits of a route that are constant numbers, but one of them, or "
            "the road, changes along the way or with the speed: call it outside"
        )
    if limits.keep_out is not None:
        raise ValueError("certify needs a route with concrete values for obstacles: call it outside jit, grad and vmap")
    if is_traced(limits.vehicle):
        raise ValueError("inside jit, grad and vmap, certify needs a vehicle with concrete values for a route")
    names, vehicle = tuple(given), limits.vehicle
    bounds = jnp.stack([jnp.asarray(given[name], float) for name in names]) if names else jnp.zeros(0)
    road = limits.road(float).each(jnp.asarray) if limits.uses_vehicle else None

    def proved(route: Route, bounds: Any) -> RouteCertificate:
        return certify(route, limits_of(dict(zip(names, np.asarray(bounds).tolist(), strict=True)), vehicle))

    known = constants((route, bounds))
    if not is_traced(known):
        found = proved(*known)
        more = found.starts, found.broken, found.broken_limits
        own = _arrays(found, names)
    else:
        own, more = _on_host(known[0], known[1], names, proved), (known[0].starts, None, None)
    codes, times, values, row = own
    values = _values(route, road, names, times, values)
    column = np.arange(len(names))
    limits_of_rows = jnp.broadcast_to(bounds, codes.shape)
    parts = codes, times, values, limits_of_rows
    whole: Any = (jnp.asarray(x)[row, column] for x in parts)
    return RouteCertificate(Certificate(names, *whole), Certificate(names, *parts), *more)


def _arrays(found: RouteCertificate, names: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """Return the codes, times and values (segments, limits), and the segment of the worst value of each limit."""
    order = [found.names.index(name) for name in names]
    parts, whole = found.segments, found.whole
    codes, times, values = (np.asarray(x)[:, order] for x in (parts.codes, parts.times, parts.values))
    same = (codes == np.asarray(whole.codes)[order]) & (times == np.asarray(whole.times)[order])
    return codes, times, values, np.argmax(same, axis=0).astype(np.int32)


def _on_host(route: Route, bounds: Any, names: tuple[str, ...], proved: Callable[..., Any]) -> Any:
    """Return the arrays of a certificate with one row for each row of the route; invalid data are undefined."""
    rows, limits = route.starts.shape[-1], len(names)
    shapes = [jax.ShapeDtypeStruct((rows, limits), np.dtype(kind)) for kind in (np.int32, float, float)]
    shapes.append(jax.ShapeDtypeStruct((limits,), np.dtype(np.int32)))

    def of_one(starts: Any, c: Any, duration: Any, origin: Any, own: Any, bounds: Any) -> Any:
        count = int(np.isfinite(starts).sum())
        try:
            route = from_segments(*unpadded(starts, c, duration, origin, own))
            found = _arrays(proved(route, bounds), names)
        except ValueError:  # an error inside a compiled function would have no clear message
            missing = np.full((rows, limits), np.nan)
            return np.full((rows, limits), UNDEFINED), missing, missing, np.zeros(limits, np.int32)
        fills = PROVED, duration, np.nan
        padded = [
            np.pad(x, [(0, rows - count), (0, 0)], constant_values=fill)
            for x, fill in zip(found[:3], fills, strict=True)
        ]
        return *padded, found[3]

    def of_batch(*given: Any) -> Any:
        found = [of_one(*jax.tree.map(lambda x: x[k], given)) for k in range(len(given[0]))]  # noqa: B023
        return [np.stack(x) for x in zip(*found, strict=True)]

    return on_host(
        of_batch, shapes, route.starts, route.coefficients, route.duration, route.origin, route.progress, bounds
    )


@eqx.filter_custom_jvp
def _values(
    route: Route, road: RoadParameters | None, names: tuple[str, ...], times: Any, values: Any
) -> Float[Array, "rows limits"]:
    """Return `values` as a differentiable function of the route; `times` (rows, limits) [s] are in its segments."""
    return jnp.asarray(values)


@_values.def_jvp
def _values_jvp(primals: Any, tangents: Any) -> tuple[Array, Array]:
    values = jnp.asarray(primals[-1])
    if tangents[0] is None or not jax.tree.leaves(tangents[0]):
        return values, jnp.zeros_like(values)
    return values, _change(primals, tangents[0])


@eqx.filter_jit
def _change(primals: Any, change: Route) -> Float[Array, "rows limits"]:
    route, road, names, times, values = primals
    undefined = ~jnp.isfinite(jnp.asarray(values))
    count = undefined.shape[0]

    def of_row(c: Any, start: Any, h: Any, own: Any, times: Any, line: Any) -> Array:
        c = jnp.where(line, jnp.zeros_like(c).at[1, 0].set(1.0), c)  # finite derivatives where there is no value
        own = None if own is None else jnp.where(line, jnp.array([0.0, 1.0, 0.0, 0.0]), own)
        one = from_segments(jnp.zeros(1), c[None], h, jnp.zeros(3), None if own is None else own[None])
        local = (times - jax.lax.stop_gradient(start)) * (h / jax.lax.stop_gradient(h))
        return jnp.stack([value(one, local[k], name, road) for k, name in enumerate(names)])

    def at_times(route: Route) -> Array:
        starts = jnp.where(jnp.isfinite(route.starts), route.starts, route.duration)
        h = pieces.durations(route.starts, route.duration)
        h = jnp.where(h > 0, h, 1.0)
        own = None if route.progress is None else route.progress[:count]
        given = route.coefficients[:count], starts[:count], h[:count], own, jnp.asarray(times), undefined.any(axis=1)
        return jax.vmap(of_row)(*given)

    slope = eqx.filter_jvp(at_times, (route,), (change,))[1]
    return jnp.where(undefined, 0.0, slope)
