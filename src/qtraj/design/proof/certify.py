"""Check limits on whole paths, by proof for polynomial paths and by refined sampling for all others."""

from __future__ import annotations  # so that `help` shows short names

import math
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.divisors import factors as factors_of
from qtraj.design.limit_checks import require_known_road
from qtraj.design.limits import Limits, require_limits
from qtraj.design.obstacles.certificate import with_obstacles
from qtraj.design.on_host import host_callback
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.corridor import add_corridor
from qtraj.design.proof.envelope import differentiable
from qtraj.design.proof.findings import Findings, Limit
from qtraj.design.proof.judge import judge
from qtraj.design.proof.paths import curve_source, polynomial_arrays, source_of, world_source
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.shape import certify_shape
from qtraj.design.proof.sources import Source
from qtraj.design.proof.varying import certify_varying
from qtraj.design.timing.retimed_proof import certify_retimed
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import as_float, constants, is_traced
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.types import ArrayInput
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.route import Route
from qtraj.path.shape import Shape
from qtraj.path.spiral_helix import SpiralHelix

BLOCK_SIZE = 512
"""Number of paths that are judged together; their data fits into the processor's cache."""


@overload
def certify(  # pyright: ignore[reportOverlappingOverload]
    path: Route | Shape,
    limits: Limits,
    *,
    corridor: ArrayInput | None = None,
    reference: SpiralHelix | None = None,
    throw: bool = False,
) -> RouteCertificate: ...
@overload
def certify(
    path: AbstractHodograph,
    limits: Limits,
    *,
    corridor: ArrayInput | None = None,
    reference: SpiralHelix | None = None,
    throw: bool = False,
) -> Certificate: ...
@of_one_device
def certify(
    path: AbstractHodograph | Shape,
    limits: Limits,
    *,
    corridor: ArrayInput | None = None,
    reference: SpiralHelix | None = None,
    throw: bool = False,
) -> Certificate | RouteCertificate:
    """Check whether a path satisfies `limits` everywhere, with a proof if the path is polynomial.

    For a polynomial path every limit is an inequality between polynomials in t (paper S). Their coefficients are
    floats, so rational numbers, and the inequality is decided in exact integers (docs/concepts/proofs.md). Limits on a
    vehicle also contain the roots of polynomials, such as the speed; they are decided by signs and squares. The status
    is the same on every machine. The certificate contains one of these statuses for each limit:

    - "proved": the limit is satisfied everywhere, for exactly this path and limit, without any tolerance.
    - "broken": the limit is violated; the reported instant is near the largest violation.
    - "undecided": the quantity touches its limit to within 2^-60 of the duration, or the numbers span so many orders of
      magnitude that a decision would take longer than about a second.
    - "undefined": a denominator of the quantity (the speed, its horizontal component, |ṙ×r̈| or the normal load) cannot
      be distinguished from zero at the reported instant.
    - "sampled": the limit is satisfied according to refined sampling. This is the best possible status for a `Curve`,
      and for quantities that depend on the vertical if the axis of the path is not vertical.

    For the path of `retime`, limits that depend on the timing are proved as in `retime`, and limits on quantities of
    the shape, such as the curvature, are proved on its original path. Constant limits on own quantities are proved as
    in `retime`, too. All other limits, such as those on lateral forces, moments and the rates of accelerations, are
    sampled.

    For a batch of paths, each limit is a scalar or has the batch shape, and the certificate has this batch shape, too.
    Under `jit` and `vmap` the arrays of the certificate are available, but not its texts; the proof runs on the host.
    The number of segments of a route is then unknown: `segments` has one row for each row of `route.coefficients`, of
    which those of padding count as proved, with the value NaN, and there are no intervals of violation.
    The `times` and `values` come from a search in floats, which may miss a narrow peak that is well below the limit;
    no status of a polynomial path depends on this search. The `values` are differentiable with respect to the path
    (envelope theorem). A path in float32 is proved as the rational numbers that its coefficients are.

    For a route every segment is checked separately. The `RouteCertificate` contains the status for the whole route and
    for each segment, and the intervals of violation. At a joint both sides are checked. If the velocity is zero at a
    joint, the rates of frames and the longitudinal and lateral acceleration are computed from the direction that the
    velocity approaches there. A segment without motion satisfies every limit that does not depend on the road. The
    forces on a parked vehicle are computed for a road without slope in the direction of travel.

    A limit that changes along the way (`Along`) is checked on the parts of the path in which it is constant or linear;
    this is supported for paths with concrete values, and for a batch unless it is retimed. An interval in which a limit
    is linear is divided until straight lines in the parameter of the path, which are nowhere less strict, differ from
    the limit by about 1e-7 of its value. On the path of `retime`, the cells of the timing are divided in the same way.

    A `Shape` is checked like a route, with limits on quantities of the shape only: curvature, horizontal curvature,
    steering angle, sharpness, torsion and slope.

    Obstacles in `limits.keep_out` are proved to be avoided by the whole `body`, on routes, shapes, spiral-helices and
    their timings. The names in the certificate are "keep_out[0]", "keep_out[1]" and so on. The value is the smallest
    clearance [m], and its limit is 0. With an offset, the body has a direction; the proof is about all instants at
    which the path has one. Obstacles that move are sampled on the path of `retime`. The obstacles must have concrete
    values, and so must the path; only `SpiralHelix` may be traced or a batch.

    `corridor` [m] is the maximum distance between two spiral-helices about the same axis, `path` and `reference`, at
    equal fractions of their durations. It is the last limit of the certificate. The difference of the azimuths
    contributes to the distance as an arc length.

    **Raises:** ValueError for a batch of paths with an array that lacks the batch dimension; for a corridor without a
    reference, or with a reference about a different axis; for a shape and a limit that depends on times; and for an own
    quantity that depends on the bank or the friction of a road that changes linearly along the way.
    RuntimeError with `throw` if a limit is violated, undecided or undefined.
    """
    if not isinstance(path, Shape):
        require_path(path)
    require_limits(limits)
    if corridor is None and reference is not None:
        raise ValueError("a reference was given without a corridor: also pass corridor=, the maximum distance [m]")
    require_known_road(limits.vehicle, limits.given())
    if isinstance(path, Route | Shape):
        if corridor is not None:
            kind = type(path).__name__
            raise ValueError(f"a corridor is supported only for a SpiralHelix, but a {kind} was given: omit corridor=")
        found = certify_shape(path, limits) if isinstance(path, Shape) else certify_route(path, limits)
        found = with_obstacles(found, path, limits)
        return found.check() if throw else found
    retimed = isinstance(path, RetimedPath)
    certificate = certify_retimed(path, limits, _certify) if retimed else _certify(path, limits)
    certificate = with_obstacles(certificate, path, limits)
    if corridor is not None:
        certificate = add_corridor(certificate, path, reference, as_float(corridor))
    return certificate.check() if throw else certificate


def _certify(path: AbstractHodograph, limits: Limits) -> Certificate:
    if limits.varying or limits.along_road:
        return certify_varying(path, limits, _certify)
    names, batch, dtype = tuple(limits.given()), path.duration.shape, path.duration.dtype
    if not names:
        return Certificate((), *[np.zeros((*batch, 0), dtype)] * 4)
    arrays, static = eqx.partition(path, eqx.is_array)
    if any(x.shape[: len(batch)] != batch for x in jax.tree.leaves(arrays)):
        advice = "build the batch with jax.vmap, or with jax.tree.map(lambda *x: jnp.stack(x), *paths)"
        raise ValueError(f"every array of a batch of paths must have the leading shape {batch}: {advice}")
    limits.require_batch(batch, "the paths" if batch else "the path")
    bounds = _in_batch(limits.constant().values(), batch)
    road = _in_batch(limits.road(float).numbers if limits.uses_vehicle else (), batch)
    factors = _in_batch(factors_of(limits, float), batch)
    # Outside jit and vmap, the values of differentiated arrays are known, so the proof is not traced.
    constant, *numbers = constants((arrays, bounds, factors, road))
    codes, times, values = _findings(eqx.combine(constant, static), names, numbers, batch)
    if is_traced(arrays, limits):
        values = differentiable(names, static, (arrays, road), times, values)
    return Certificate(names, codes, times, values, bounds)


def _in_batch(numbers: Any, batch: tuple[int, ...]) -> Any:
    """Return an array (*batch, n) of `numbers`, each of which is a scalar or has the batch shape."""
    each = list(numbers)
    xp: Any = jnp if is_traced(each) else np
    columns = [xp.broadcast_to(xp.asarray(x, float), batch) for x in each]
    return xp.stack(columns, axis=-1) if columns else xp.zeros((*batch, 0))


def _findings(path: AbstractHodograph, names: tuple[str, ...], numbers: list[Any], batch: tuple[int, ...]) -> Findings:
    """Return the findings on a batch of paths; `numbers` are the limits, factors and parameters (*batch, k)."""
    arrays = polynomial_arrays(path)
    if arrays is None:
        return _of_source(curve_source(path), names, numbers, batch)
    road = _road(numbers[2])
    in_world = np.array([quantity(name).uses_axes(road) for name in names])
    if in_world.any():  # components along x and y are not polynomials in the moving basis
        return _with_world(path, names, numbers, batch, in_world)
    if not is_traced(arrays, numbers):
        return _on_host(names, *arrays, *numbers)
    dtype, shape = jnp.result_type(float), (*batch, len(names))
    likes: list[Any] = [jax.ShapeDtypeStruct(shape, x) for x in (np.int32, dtype, dtype)]
    result = Findings(*likes)

    def on_host(*arrays: Any) -> Findings:
        return Findings(*(x.astype(y.dtype) for x, y in zip(_on_host(names, *arrays), result, strict=True)))

    return host_callback(on_host, result, *arrays, *numbers)


def _of_source(source: Source, names: tuple[str, ...], numbers: list[Any], batch: tuple[int, ...]) -> Findings:
    flat = [x.reshape(math.prod(batch), x.shape[-1]) for x in numbers]
    return Findings(*(x.reshape(*batch, len(names)) for x in _judged(source, names, *flat)))


def _with_world(
    path: AbstractHodograph, names: tuple[str, ...], numbers: list[Any], batch: tuple[int, ...], in_world: np.ndarray
) -> Findings:
    """Return the findings on a polynomial path; those on quantities in world axes (`in_world`) are sampled."""
    bounds, factors, road = numbers
    xp: Any = jnp if is_traced(path, numbers) else np
    parts = []
    for chosen in (in_world, ~in_world):
        own = tuple(name for name, x in zip(names, chosen, strict=True) if x)
        part = [bounds[..., chosen], factors[..., chosen], road]
        if own:
            sampled = chosen is in_world
            parts.append(
                _of_source(world_source(path), own, part, batch) if sampled else _findings(path, own, part, batch)
            )
    order = np.argsort(np.concatenate([np.flatnonzero(in_world), np.flatnonzero(~in_world)]))
    return Findings(*(xp.concatenate(x, axis=-1)[..., order] for x in zip(*parts, strict=True)))


def _on_host(names: tuple[str, ...], *arrays: Any) -> Findings:
    """Return the findings on a batch of polynomial paths; the last three arrays are the `numbers` of `_findings`."""
    batch = np.shape(arrays[-1])[:-1]
    if math.prod(batch) == 0:
        return Findings(*(np.zeros((*batch, len(names)), dtype) for dtype in (np.int32, float, float)))
    flat = [np.asarray(x, float).reshape(math.prod(batch), *np.shape(x)[len(batch) :]) for x in arrays]
    blocks = []
    for start in range(0, len(flat[-1]), BLOCK_SIZE):
        *polynomials, bounds, factors, road = (x[start : start + BLOCK_SIZE] for x in flat)
        blocks.append(_judged(source_of(polynomials), names, bounds, factors, road))
    return Findings(*(np.concatenate(x).reshape(*batch, len(names)) for x in zip(*blocks, strict=True)))


def _judged(source: Source, names: tuple[str, ...], bounds: Any, factors: Any, road: Any) -> Findings:
    limits = [Limit(quantity(name), bounds[:, k], factors[:, k]) for k, name in enumerate(names)]
    return judge(source, limits, _road(road))


def _road(numbers: Any) -> RoadParameters | None:
    """Return the parameters of a vehicle whose numbers are along the last axis, or None if there are none."""
    count = numbers.shape[-1]
    return RoadParameters(*(numbers[..., k] for k in range(count))) if count else None
