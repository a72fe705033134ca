"""Check limits on whole paths, by proof for polynomial paths and by refined sampling for all others."""

from __future__ import annotations  # so that `help` shows short names

import math
from collections.abc import Iterable
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import SAMPLED, UNDECIDED, Certificate, contradicted, require_float64
from qtraj.design.proof.corridor import add_corridor
from qtraj.design.proof.envelope import differentiable
from qtraj.design.proof.judge import LIMIT_COUNT, LIMITS, Findings, indices, judge
from qtraj.design.proof.paths import PolynomialPaths, from_curves, from_polynomials, prepared
from qtraj.design.proof.route import certify_route
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.timing.retimed_proof import certify_retimed
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation import cores
from qtraj.foundation.arrays import as_float, constants, is_traced
from qtraj.foundation.types import ArrayInput
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle import RoadParameters

BLOCK_SIZE = 64
"""Number of paths that are processed together; their data fits into the processor's cache."""


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
    """Check whether a path satisfies `limits` everywhere, with a proof if the path is polynomial.

    For a polynomial path every limit is an inequality between polynomials in t (paper S; see `inequalities`). Some
    limits on a vehicle also contain square roots of polynomials, such as the speed. The proof bounds all rounding
    errors. The certificate contains one of these statuses for each limit:

    - "proved": the limit is satisfied everywhere, for exactly this path and limit, without any tolerance.
    - "broken": the limit is violated at the reported instant.
    - "undecided": no proof was found, usually because the relative margin is below the rounding error (about 1e-11).
    - "undefined": a denominator of the quantity (the speed, its horizontal component, |ṙ×r̈| or the normal load) cannot
      be distinguished from zero at the reported instant.
    - "sampled": the limit is satisfied according to refined sampling. This is the best possible status for a `Curve`,
      and for quantities that depend on the vertical if the axis of the path is not vertical.

    For the path of `retime`, limits that depend on the timing are proved as in `retime`, and limits on the curvature,
    torsion and slope are proved on its original path. All other limits (on the longitudinal and lateral
    force, normal load, moments and angular acceleration) are sampled.

    For a batch of paths, each limit is a scalar or has the batch shape, and the certificate has this batch shape, too.
    Under `jit` and `vmap` the arrays of the certificate are available, but not its texts. The `values` are
    differentiable with respect to the path (envelope theorem). The search for these values may miss a narrow peak that
    is well below the limit, but the proof does not depend on this search.

    For a route every segment is checked separately. The `RouteCertificate` contains the status for the whole route and
    for each segment, and the intervals of violation. At a joint both sides are checked. If the velocity is zero at a
    joint, the rates of frames and the longitudinal and lateral acceleration are computed from the direction that the
    velocity approaches there. A segment without motion satisfies every limit that does not depend on the road. The
    forces on a parked vehicle are computed for a road without slope in the direction of travel.

    `corridor` [m] is the maximum distance between two spiral-helices about the same axis, `path` and `reference`, at
    equal fractions of their durations. It is the last limit of the certificate. The difference of the azimuths
    contributes to the distance as an arc length.

    **Raises:** ValueError for a path in float32, which is too inaccurate for the proofs; for a batch of paths with
    an array that lacks the batch dimension; for a corridor without a reference, or with a reference about a different
    axis. RuntimeError with `throw` if a limit is violated, undecided or undefined.
    """
    if corridor is None and reference is not None:
        raise ValueError("a reference was given without a corridor: also pass corridor=, the maximum distance [m]")
    require_float64(path)
    if isinstance(path, Route):
        if corridor is not None:
            raise ValueError("a corridor is supported only for a SpiralHelix, but a Route was given: omit corridor=")
        found = certify_route(path, limits)
        return found.check() if throw else found
    retimed = isinstance(path, RetimedPath)
    certificate = certify_retimed(path, limits, _certify) if retimed else _certify(path, limits)
    if corridor is not None:
        certificate = add_corridor(certificate, path, reference, as_float(corridor))
    return certificate.check() if throw else certificate


def _certify(path: AbstractHodograph, limits: Limits) -> Certificate:
    names, batch, dtype = tuple(limits.given()), path.duration.shape, path.duration.dtype
    if not names:
        return Certificate((), *[jnp.zeros((*batch, 0), dtype)] * 4)
    arrays, static = eqx.partition(path, eqx.is_array)
    if any(x.shape[: len(batch)] != batch for x in jax.tree.leaves(arrays)):
        advice = "build the batch with jax.vmap, or with jax.tree.map(lambda *x: jnp.stack(x), *paths)"
        raise ValueError(f"every array of a batch of paths must have the leading shape {batch}: {advice}")
    limits.require_batch(batch, "the paths" if batch else "the path")
    traced = is_traced(arrays, limits)
    bounds = _in_batch(limits.given().values(), batch, dtype)
    # Outside jit and vmap, the values of differentiated arrays are known, so the search is not traced.
    constant, fixed = constants((arrays, limits))
    codes, times, values = _find(eqx.combine(constant, static), fixed, names, batch)
    if traced:
        road = _in_batch(limits.road(dtype) if limits.needs_vehicle else (), batch, dtype)
        values = differentiable(names, static, (arrays, road), times, values)
    return Certificate(names, codes, times, values, bounds)


def _in_batch(numbers: Iterable[Any], batch: tuple[int, ...], dtype: Any) -> Any:
    """Return an array (*batch, n) of `numbers`, each of which is a scalar or has the batch shape."""
    each = list(numbers)
    xp: Any = jnp if is_traced(each) else np
    columns = [xp.broadcast_to(xp.asarray(x, dtype), batch) for x in each]
    return xp.stack(columns, axis=-1) if columns else xp.zeros((*batch, 0), dtype)


def _find(path: AbstractHodograph, limits: Limits, names: tuple[str, ...], batch: tuple[int, ...]) -> Any:
    """Return the codes, times and values of the findings on `names`."""
    dtype, source = path.duration.dtype, prepared(path, len(batch))
    reduced = limits.reduced(dtype)
    # In the array, the vehicle's parameters come after the limits. They are omitted if no limit depends on the road.
    numbers = [*(reduced.get(x.name, 1.0) for x in LIMITS), *(limits.road(dtype) if limits.on_road else ())]
    limits_array, traced = _in_batch(numbers, batch, dtype), is_traced(source, limits)
    findings = _judge_batch(source, limits_array, *indices(names), batch, _traced if traced else _on_cores)
    places = np.array([k for k, x in enumerate(LIMITS) if x.name in names])
    codes, times, values = (x[..., places] for x in findings)
    values = values * _in_batch(limits.factors(dtype), batch, dtype)
    undecided = UNDECIDED if isinstance(source, PolynomialPaths) else SAMPLED
    given = _in_batch(limits.given().values(), batch, dtype)
    xp: Any = jnp if traced else np
    return xp.where(contradicted(names, codes, values, given), undecided, codes), times, values


def _judge_batch(source: Any, limits: Any, index: Any, count: Any, batch: tuple[int, ...], function: Any) -> Any:
    """Return the findings on a batch of paths; `function` computes them for a single batch axis."""
    if math.prod(batch) == 0:
        empty = np.zeros((*batch, LIMIT_COUNT), limits.dtype)
        return empty.astype(np.int32), empty, empty
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(batch) :]), (source, limits))
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), function(*flat, index, count))


def _on_cores(source: Any, limits: np.ndarray, index: Any, count: Any) -> Findings:
    """Return the findings on concrete paths.

    The paths are divided into blocks of a few fixed sizes, so that only a few executables are compiled.
    """
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
    """Return the findings on paths along the first axis of all arrays; `vmap` merges its batch axis into this axis."""
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
    """Apply `function` to one block of paths after another."""
    count = jax.tree.leaves(data)[0].shape[0]
    if count <= BLOCK_SIZE:
        return function(data)
    n_blocks = -(-count // BLOCK_SIZE)
    order = np.minimum(np.arange(n_blocks * BLOCK_SIZE), count - 1).reshape(n_blocks, BLOCK_SIZE)
    findings = jax.lax.map(function, jax.tree.map(lambda x: x[order], data))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], findings)


def _judge_block(source: Any, limits: Array, index: Array, count: Array) -> Findings:
    evaluate, scale, is_vertical, polynomials = (
        from_polynomials(source) if isinstance(source, PolynomialPaths) else from_curves(source)
    )
    vehicle = RoadParameters(*limits.T[LIMIT_COUNT:]) if limits.shape[1] > LIMIT_COUNT else None
    findings = judge(evaluate, scale, limits.T[:LIMIT_COUNT], is_vertical, polynomials, index, count, vehicle)
    return jax.tree.map(lambda x: x[:LIMIT_COUNT].T, findings)
