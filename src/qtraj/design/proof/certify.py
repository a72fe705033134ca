"""Limits judged on the whole path: proved where they are polynomial inequalities, sampled where not."""

import math
from functools import partial
from typing import Any, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.design.limits import Limits
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.corridor import with_corridor
from qtraj.design.proof.inequalities import Parts, Vectors, parts
from qtraj.design.proof.judge import COUNT, LIMITS, Along, Findings, Scale, judge, present
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
from qtraj.path.values import turned, value

TOGETHER = 64
"""Paths of a batch that are judged at once, few enough to stay in the cache."""

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


class Known(eqx.Module):
    """What is to be known of paths with polynomials, a path in each row; two of one form share a program."""

    polynomials: MovingPolynomials
    duration: Float[Array, " paths"]
    orientation: Float[Array, "paths 4"]


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
    """What is known of `path` against `limits`, on the whole of it.

    Of a path with polynomials every limit is a polynomial inequality in t (paper S; see `inequalities`), whose sign is
    proved with all rounding accounted for: "proved" is a proof for the path and limit as given, without any tolerance,
    and "broken" names an instant. "undecided" is what no proof reached, mostly for a margin lost in rounding (relative,
    about 1e-11). Quantities that divide by the speed or the bend need a proof that these never vanish; where they
    cannot be told from zero they are "undefined". What refers to the vertical about an axis that is not vertical, and
    all of a `Curve`, is judged by refined sampling, and called "sampled".

    A batch of paths (stacked, as from `jax.vmap`) gives findings with the batch in front; limits are shared, or have
    the same batch. Under `jit` and `vmap` the certificate's arrays are known, its texts are not; `values` are
    differentiable in the path (envelope theorem). They are the largest values found: of a limit with a wide margin a
    needle between the samples may be missed, its proof is not.

    Of a route every segment is judged, from joint to joint, and a `RouteCertificate` says what holds on the whole, on
    each segment, and in which intervals a limit is broken. Of quantities at a joint both sides count. At a stop, rates
    of frames and accelerations along and across the path are judged against the direction of the velocity, which does
    not vanish there if the velocity does so at a joint; a velocity that is zero to rounding at a joint counts as zero.
    A segment that stands satisfies every limit.

    `corridor` [m] bounds the distance of a spiral-helix from `reference`, another one about the same axis, at equal
    fractions of their durations, counted along the arc: one more limit, the last of the certificate.

    **Raises:** ValueError in float32, whose rounding exceeds the margins that matter here, and for a batch in which not
    every array has the batch in front; for a corridor without a reference, or about another axis. RuntimeError with
    `throw` where a limit is broken, undecided or undefined.
    """
    if corridor is None and reference is not None:
        raise ValueError("a reference was given without a corridor, its largest distance: pass corridor= beside it")
    if isinstance(path, Route):
        if corridor is not None:
            raise ValueError("a corridor bounds the distance of a SpiralHelix, but a Route was given: leave it out")
        require_float64(path)
        judged = certify_route(path, limits)
        return judged.check() if throw else judged
    found = _certified(path, limits)
    if corridor is not None:
        found = with_corridor(found, path, reference, as_float(corridor))
    return found.check() if throw else found


def _certified(path: AbstractHodograph, limits: Limits) -> Certificate:
    require_float64(path)
    names, batch = tuple(limits.given()), path.duration.shape
    dtype = path.duration.dtype
    if not names:
        nothing = jnp.zeros((*batch, 0), dtype)
        return Certificate((), nothing, nothing, nothing, nothing)
    arrays, static = eqx.partition(path, eqx.is_array)
    if any(x.shape[: len(batch)] != batch for x in jax.tree.leaves(arrays)):
        raise ValueError(f"a batch of paths has {batch} in front of every array of it: stack the paths by jax.vmap")
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((arrays, limits)))
    numbers = jnp if traced else np
    bounds = [numbers.broadcast_to(numbers.asarray(limits.given()[x], dtype), batch) for x in names]
    table = [bounds[names.index(x.name)] if x.name in names else numbers.ones(batch, dtype) for x in LIMITS]
    source, columns = _source(path, len(batch)), numbers.stack(table, axis=-1)
    if traced:
        source, columns = jax.lax.stop_gradient((source, columns))
    found = _found(source, columns, *present(names), batch, _traced if traced else _on_cores)
    rows = np.array([k for k, x in enumerate(LIMITS) if x.name in names])
    codes, times, values = (x[..., rows] for x in found)
    if traced:
        values = _differentiable(names, static, arrays, times, values)
    return Certificate(names, codes, times, values, numbers.stack(bounds, axis=-1))


def _found(source: Any, limits: Any, index: Any, count: Any, batch: tuple[int, ...], work: Any) -> Any:
    """The findings on a batch of paths by a function of rows."""
    if math.prod(batch) == 0:
        nothing = np.zeros((*batch, COUNT), limits.dtype)
        return nothing.astype(np.int32), nothing, nothing
    rows = jax.tree.map(lambda x: x.reshape(-1, *x.shape[len(batch) :]), (source, limits))
    return jax.tree.map(lambda x: x.reshape(*batch, *x.shape[1:]), work(*rows, index, count))


def require_float64(path: AbstractHodograph) -> None:
    """Raise a ValueError for a path in lower precision than float64."""
    if path.duration.dtype != jnp.float64:
        raise ValueError(
            f"limits are judged in float64, but this path is in {path.duration.dtype}. Call "
            "jax.config.update('jax_enable_x64', True) before building it."
        )


def _source(path: AbstractHodograph, axes: int) -> Any:
    """What the findings depend on: polynomials where there are any, or the path itself."""
    polynomials = _over(lambda path: path.polynomials(), axes)
    known = polynomials(path)
    if known is None:
        return path
    placement, shape = known.placement, path.duration.shape
    if placement is None:
        orientation: Any = np.broadcast_to(UNTURNED, (*shape, 4))
    else:
        orientation = placement.orientation.astype(path.duration.dtype)
    return Known(MovingPolynomials(known.x, known.y, known.z, known.angle), path.duration, orientation)


def _over(function: Any, axes: int) -> Any:
    for _ in range(axes):
        function = eqx.filter_vmap(function)
    return function


def _on_cores(source: Any, limits: np.ndarray, index: Any, count: Any) -> Findings:
    """Findings on known paths, in blocks of few sizes: a program serves any number of paths."""
    arrays, static = eqx.partition((source, limits), eqx.is_array)
    leaves = jax.tree.leaves(arrays)
    devices = set().union(*(x.devices() for x in leaves if isinstance(x, jax.Array)))
    paths = limits.shape[0]
    if len(devices) > 1 or any(x.platform != "cpu" for x in devices):
        return _compiled(arrays, static, index, count)
    device = next(iter(devices), None)
    host, size = jax.tree.map(np.asarray, arrays), cores.size_for(paths)
    pieces = cores.split(np.arange(paths), size)
    calls = [(cores.take(host, piece, size), static, index, count) for piece in pieces]
    found: Any = None
    for piece, answers in zip(pieces, cores.each(_compiled, calls, device), strict=True):
        found = cores.room(paths, answers) if found is None else found
        cores.put(found, piece, answers)
    committed = any(x.committed for x in leaves if isinstance(x, jax.Array))
    return jax.device_put(found, device) if committed else found


@eqx.filter_jit
def _compiled(arrays: Any, static: Any, index: Array, count: Array) -> Findings:
    source, limits = eqx.combine(arrays, static)
    return _traced(source, limits, index, count)


def _traced(source: Any, limits: Array, index: Array, count: Array) -> Findings:
    """Findings on paths in the rows of all arrays; what `vmap` adds to them are more paths."""
    arrays, static = eqx.partition(source, eqx.is_array)

    @jax.custom_batching.custom_vmap
    def work(arrays: Any, limits: Array, index: Array, count: Array) -> Findings:
        return _in_blocks(lambda rows: _judged(eqx.combine(rows[0], static), rows[1], index, count), (arrays, limits))

    @work.def_vmap
    def batched(size: int, is_batched: Any, *given: Any) -> tuple[Findings, Findings]:
        *rows, index, count = jax.tree.map(
            lambda x, there: x if there else jnp.broadcast_to(x, (size, *jnp.shape(x))), given, tuple(is_batched)
        )
        flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), rows)
        found = work(*flat, index[0], count[0])
        return jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), found), jax.tree.map(lambda _: True, found)

    return work(arrays, limits, jnp.asarray(index), jnp.asarray(count))


def _in_blocks(work: Any, rows: Any) -> Findings:
    """Block after block where there are many rows."""
    count = jax.tree.leaves(rows)[0].shape[0]
    if count <= TOGETHER:
        return work(rows)
    blocks = -(-count // TOGETHER)
    order = np.minimum(np.arange(blocks * TOGETHER), count - 1).reshape(blocks, TOGETHER)
    found = jax.lax.map(work, jax.tree.map(lambda x: x[order], rows))
    return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:])[:count], found)


def _judged(source: Any, limits: Array, index: Array, count: Array) -> Findings:
    along, scale, upright, known = _of_known(source) if isinstance(source, Known) else _of_curves(source)
    found = judge(along, scale, limits.T, upright, known, index, count)
    return jax.tree.map(lambda x: x[:COUNT].T, found)


def _of_known(source: Known) -> tuple[Along, Scale, Array, Parts]:
    """What `judge` asks of paths with polynomials."""
    side = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), source.polynomials)
    known = parts(side, source.duration)
    w, x, y, z = source.orientation.T
    vertical = jax.vmap(lambda q: rotate(conjugate(q), jnp.asarray([0.0, 0.0, 1.0], q.dtype)))(source.orientation).T

    @jax.jit
    def up(s: Array) -> Vectors:
        t, angle = known.unit[None] * (s + 1), jnp.zeros_like(s)
        for c in side.angle[::-1]:
            angle = angle * t + c[None]
        return Vectors(*turned(vertical[:, None], angle))

    def along(s: Array, order: int, upright: bool) -> Invariants:
        derivatives = [None, *(Vectors(*r.at(s)) for r in known.derivatives[:order])]
        return Invariants(derivatives, up(s) if upright else None)

    upright = ((x == 0) & (y == 0)) | ((w == 0) & (z == 0))
    return along, Scale(known.length, known.unit), upright, known


def _of_curves(paths: AbstractHodograph) -> tuple[Along, Scale, Array, None]:
    """What `judge` asks of any paths."""
    unit = 0.5 * paths.duration
    arrays, static = eqx.partition(paths, eqx.is_array)

    def along(s: Array, order: int, upright: bool) -> Invariants:
        def of_path(arrays: Any, t: Array) -> Array:
            path = eqx.combine(arrays, static)
            return jax.vmap(lambda t: path.derivatives(t, order))(t)

        rows = jax.vmap(of_path, (0, 1), 2)(arrays, unit[None] * (s + 1))  # (instants, order + 1, path, 3)
        scaled = [rows[:, k] * (unit**k)[None, :, None] for k in range(order + 1)]
        return Invariants([Vectors(r[..., 0], r[..., 1], r[..., 2]) for r in scaled])

    return along, Scale(jnp.ones_like(unit), unit), jnp.ones(unit.shape, bool), None


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
def _differentiable(names: tuple[str, ...], static: Any, arrays: Any, times: Array, values: Array) -> Array:
    """The values as they are; their derivatives are those at the times found, which are held constant."""
    return values


@_differentiable.defjvp
def _derivative(names: tuple[str, ...], static: Any, primals: Any, tangents: Any) -> tuple[Array, Array]:
    (arrays, times, values), (changes, _, _) = primals, tangents

    def at_times(arrays: Any, times: Array) -> Array:
        path = eqx.combine(arrays, static)
        return jnp.stack([value(path, times[k], name) for k, name in enumerate(names)])

    def of_all(arrays: Any) -> Array:
        one = at_times
        for _ in range(times.ndim - 1):
            one = jax.vmap(one)
        return one(arrays, times)

    _, change = jax.jvp(of_all, (arrays,), (changes,))
    return values, change
