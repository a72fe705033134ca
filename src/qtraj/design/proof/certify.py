"""Checks limits on whole paths: by proof for polynomial paths, by refined sampling for all others."""

from __future__ import annotations  # so that `help` shows short names

import math
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate, require_float64
from qtraj.design.proof.corridor import add_corridor
from qtraj.design.proof.envelope import differentiable
from qtraj.design.proof.inequalities import PathDerivatives, Vectors, path_derivatives
from qtraj.design.proof.judge import LIMIT_COUNT, LIMITS, Evaluate, Findings, Scale, indices, judge
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.foundation import cores
from qtraj.foundation.arrays import as_float
from qtraj.foundation.types import ArrayInput
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.route import Route
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.values import to_turned_basis
from qtraj.path.vehicle import RoadParameters

BLOCK_SIZE = 64
"""Number of paths that are processed together, small enough for the processor's cache."""

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class PolynomialPaths(eqx.Module):
    """The data of polynomial paths, with a leading batch axis; paths of equal structure share an executable."""

    polynomials: MovingPolynomials
    duration: Float[Array, "*paths"]
    orientation: Float[Array | np.ndarray, "*paths 4"]


@overload
def certify(  # pyright: ignore[reportOverlappingOverload]
    path: Route,
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
def certify(
    path: AbstractHodograph,
    limits: Limits,
    *,
    corridor: ArrayInput | None = None,
    reference: SpiralHelix | None = None,
    throw: bool = False,
) -> Certificate | RouteCertificate:
    """Check `limits` on the whole of `path`.

    For a polynomial path every limit is a polynomial inequality in t (paper S; see `inequalities`). Its sign is proved
    with all rounding errors bounded. The status of a limit is

    - "proved": the limit is satisfied everywhere, for exactly this path and limit, without any tolerance.
    - "broken": it is violated at the reported instant.
    - "undecided": no proof was found, usually because the margin is below the rounding error (relative, about 1e-11).
    - "undefined": the quantity divides by the speed or by |ṙ×r̈|, which cannot be distinguished from zero somewhere.
    - "sampled": satisfied according to refined sampling. This is the best status for a `Curve`, and for quantities that
      depend on the vertical if the axis of the path is not vertical.

    A batch of paths gives a batch of findings; limits are shared or have the same batch dimension. Under `jit` and
    `vmap` the arrays of the certificate are available, but not its texts. The `values` are differentiable with respect
    to the path (envelope theorem). They may miss a narrow peak well below the limit, but the proof does not.

    For a route every segment is checked separately. The `RouteCertificate` gives the status on the whole route and on
    each segment, and the intervals in which a limit is violated. At a joint both sides are checked. If the velocity is
    zero there, rates of frames and tangential and normal acceleration are computed from its limiting direction. A
    segment without motion satisfies every limit.

    `corridor` [m] bounds the distance of a spiral-helix from another one about the same axis, `reference`, at equal
    fractions of their durations; it is the last limit of the certificate. The angle counts by its arc length.

    **Raises:** ValueError in float32, whose rounding error is too large for these proofs; for a batch in which an array
    lacks the batch dimension; for a corridor without a reference, or about another axis. RuntimeError with `throw` if a
    limit is violated, undecided or undefined.
    """
    if corridor is None and reference is not None:
        raise ValueError("a reference was given without a corridor: also pass corridor=, the largest distance")
    require_float64(path)
    if isinstance(path, Route):
        if corridor is not None:
            raise ValueError("a corridor is supported only for a SpiralHelix, but a Route was given: omit corridor=")
        found = certify_route(path, limits)
        return found.check() if throw else found
    certificate = _certify(path, limits)
    if corridor is not None:
        certificate = add_corridor(certificate, path, reference, as_float(corridor))
    return certificate.check() if throw else certificate


def _certify(path: AbstractHodograph, limits: Limits) -> Certificate:
    names, batch, dtype = tuple(limits.given()), path.duration.shape, path.duration.dtype
    if not names:
        return Certificate((), *[jnp.zeros((*batch, 0), dtype)] * 4)
    arrays, static = eqx.partition(path, eqx.is_array)
    if any(x.shape[: len(batch)] != batch for x in jax.tree.leaves(arrays)):
        advice = "build the batch in jax.vmap, or by jax.tree.map(lambda *x: jnp.stack(x), *paths)"
        raise ValueError(f"every array of a batch of paths must have the leading shape {batch}: {advice}")
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((arrays, limits)))
    xp = jnp if traced else np
    bounds = [xp.broadcast_to(xp.asarray(limits.given()[x], dtype), batch) for x in names]
    table = [bounds[names.index(x.name)] if x.name in names else xp.ones(batch, dtype) for x in LIMITS]
    # The numbers of the vehicle follow those of the limits. Without it, the formulas that need it are not compiled.
    numbers = limits.road(dtype) if limits.needs_vehicle else ()
    road = [xp.broadcast_to(xp.asarray(x, dtype), batch) for x in numbers]
    source, limits_array = _source(path, len(batch)), xp.stack([*table, *road], axis=-1)
    road_numbers = limits_array[..., LIMIT_COUNT:]
    if traced:
        source, limits_array = jax.lax.stop_gradient((source, limits_array))
    findings = _judge_batch(source, limits_array, *indices(names), batch, _traced if traced else _on_cores)
    places = np.array([k for k, x in enumerate(LIMITS) if x.name in names])
    codes, times, values = (x[..., places] for x in findings)
    if traced:
        values = differentiable(names, static, (arrays, road_numbers), times, values)
    return Certificate(names, codes, times, values, xp.stack(bounds, axis=-1))


def _judge_batch(source: Any, limits: Any, index: Any, count: Any, batch: tuple[int, ...], function: Any) -> Any:
    """The findings on a batch of paths, by a function of paths along one axis."""
    if math.prod(batch) == 0:
        empty = np.zeros((*batch, LIMIT_COUNT), limits.dtype)
        return empty.astype(np.int32), empty, empty
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(batch) :]), (source, limits))
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), function(*flat, index, count))


def _source(path: AbstractHodograph, axes: int) -> Any:
    """The data on which the findings depend: the polynomials of the paths if they have any, else the paths."""
    polynomials = _vmap_times(lambda path: path.polynomials(), axes)(path)
    if polynomials is None:
        return path
    placement, shape = polynomials.placement, path.duration.shape
    if placement is None:
        orientation: Any = np.broadcast_to(IDENTITY, (*shape, 4))
    else:
        orientation = placement.orientation.astype(path.duration.dtype)
    return PolynomialPaths(
        MovingPolynomials(polynomials.x, polynomials.y, polynomials.z, polynomials.angle), path.duration, orientation
    )


def _vmap_times(function: Any, axes: int) -> Any:
    for _ in range(axes):
        function = eqx.filter_vmap(function)
    return function


def _on_cores(source: Any, limits: np.ndarray, index: Any, count: Any) -> Findings:
    """Findings on concrete paths, in blocks of few sizes, so that few executables serve any number of paths."""
    arrays, static = eqx.partition((source, limits), eqx.is_array)
    leaves = jax.tree.leaves(arrays)
    devices = set().union(*(x.devices() for x in leaves if isinstance(x, jax.Array)))
    paths = limits.shape[0]
    if len(devices) > 1 or any(x.platform != "cpu" for x in devices):
        return _compiled(arrays, static, index, count)
    device = next(iter(devices), None)
    arrays_on_host, size = jax.tree.map(np.asarray, arrays), cores.block_size(paths)
    pieces = cores.split(np.arange(paths), size)
    calls = [(cores.take(arrays_on_host, piece, size), static, index, count) for piece in pieces]
    findings: Any = None
    for piece, block_findings in zip(pieces, cores.map_blocks(_compiled, calls, device), strict=True):
        findings = cores.allocate(paths, block_findings) if findings is None else findings
        cores.put(findings, piece, block_findings)
    committed = any(x.committed for x in leaves if isinstance(x, jax.Array))
    return jax.device_put(findings, device) if committed else findings


@eqx.filter_jit
def _compiled(arrays: Any, static: Any, index: Array, count: Array) -> Findings:
    source, limits = eqx.combine(arrays, static)
    return _traced(source, limits, index, count)


def _traced(source: Any, limits: Array, index: Array, count: Array) -> Findings:
    """Findings on paths along the first axis of all arrays; `vmap` adds more paths to that axis."""
    arrays, static = eqx.partition(source, eqx.is_array)

    @jax.custom_batching.custom_vmap
    def function(arrays: Any, limits: Array, index: Array, count: Array) -> Findings:
        return _in_blocks(
            lambda data: _judge_block(eqx.combine(data[0], static), data[1], index, count), (arrays, limits)
        )

    @function.def_vmap
    def batched(size: int, is_batched: Any, *arguments: Any) -> tuple[Findings, Findings]:
        *data, index, count = jax.tree.map(
            lambda x, is_batched_leaf: x if is_batched_leaf else jnp.broadcast_to(x, (size, *jnp.shape(x))),
            arguments,
            tuple(is_batched),
        )
        flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), data)
        findings = function(*flat, index[0], count[0])
        batched_findings = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), findings)
        return batched_findings, jax.tree.map(lambda _: True, findings)

    return function(arrays, limits, jnp.asarray(index), jnp.asarray(count))


def _in_blocks(function: Any, data: Any) -> Findings:
    """Apply a function to blocks of paths, one after the other."""
    count = jax.tree.leaves(data)[0].shape[0]
    if count <= BLOCK_SIZE:
        return function(data)
    n_blocks = -(-count // BLOCK_SIZE)
    order = np.minimum(np.arange(n_blocks * BLOCK_SIZE), count - 1).reshape(n_blocks, BLOCK_SIZE)
    findings = jax.lax.map(function, jax.tree.map(lambda x: x[order], data))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], findings)


def _judge_block(source: Any, limits: Array, index: Array, count: Array) -> Findings:
    evaluate, scale, is_vertical, polynomials = (
        _from_polynomials(source) if isinstance(source, PolynomialPaths) else _from_curves(source)
    )
    vehicle = RoadParameters(*limits.T[LIMIT_COUNT:]) if limits.shape[1] > LIMIT_COUNT else None
    findings = judge(evaluate, scale, limits.T[:LIMIT_COUNT], is_vertical, polynomials, index, count, vehicle)
    return jax.tree.map(lambda x: x[:LIMIT_COUNT].T, findings)


def _from_polynomials(source: PolynomialPaths) -> tuple[Evaluate, Scale, Array, PathDerivatives]:
    """The arguments of `judge` for polynomial paths."""
    coefficients = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), source.polynomials)
    polynomials = path_derivatives(coefficients, source.duration)
    w, x, y, z = source.orientation.T
    vertical = jax.vmap(lambda q: rotate(conjugate(q), jnp.asarray([0.0, 0.0, 1.0], q.dtype)))(source.orientation).T

    @jax.jit
    def up(s: Array) -> Vectors:
        t, angle = polynomials.unit[None] * (s + 1), jnp.zeros_like(s)
        for c in coefficients.angle[::-1]:
            angle = angle * t + c[None]
        return Vectors(*to_turned_basis(vertical[:, None], angle))

    def evaluate(s: Array, order: int, with_vertical: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in polynomials.derivatives[:order])]
        return Invariants(derivatives, up(s) if with_vertical else None)

    is_vertical = ((x == 0) & (y == 0)) | ((w == 0) & (z == 0))
    return evaluate, Scale(polynomials.length, polynomials.unit), is_vertical, polynomials


def _from_curves(paths: AbstractHodograph) -> tuple[Evaluate, Scale, Array, None]:
    """The arguments of `judge` for any other paths."""
    unit = 0.5 * paths.duration
    arrays, static = eqx.partition(paths, eqx.is_array)

    def evaluate(s: Array, order: int, with_vertical: bool) -> Invariants:
        def of_path(arrays: Any, t: Array) -> Array:
            path = eqx.combine(arrays, static)
            return jax.vmap(lambda t: path.derivatives(t, order))(t)

        derivatives = jax.vmap(of_path, (0, 1), 2)(arrays, unit[None] * (s + 1))  # (instants, order + 1, path, 3)
        scaled = [derivatives[:, k] * (unit**k)[None, :, None] for k in range(order + 1)]
        return Invariants([Vectors(r[..., 0], r[..., 1], r[..., 2]) for r in scaled])

    return evaluate, Scale(jnp.ones_like(unit), unit), jnp.ones(unit.shape, bool), None
