"""Derivatives of the constraints with respect to the variables z and to the time u (a fraction of the duration)."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.algebra.sparse import add
from qtraj.design.tuning import corridor, monomials, road
from qtraj.design.tuning.constraints import HORIZONTAL, MEMBER, Group, Places, Setting, limit_scale, switch_group
from qtraj.design.tuning.curves import CurveDerivatives, along_u, second_along
from qtraj.design.tuning.directions import (
    add_scaled,
    along,
    as_array,
    broadcast,
    change,
    compiled_cross,
    compiled_dot,
    cross_change,
    outer_sum,
    vectors,
)
from qtraj.design.tuning.world_axes import from_world, world_derivatives
from qtraj.foundation.indexing import element
from qtraj.foundation.types import Scalar
from qtraj.path.components import Triple, add_vectors


class Expansion(NamedTuple):
    """The constraint g = ½((value/limit)² − 1) at several instants, and its derivatives.

    The derivatives are with respect to the variables z and to u, a fraction of the duration.
    """

    value: Float[Array, "*batch places"]
    slope: Float[Array, "*batch n places"]
    curvature: Float[Array, "*batch n n places"]
    mixed: Float[Array, "*batch n places"]  # ∂²g/∂z∂u
    rate: Float[Array, "*batch places"]  # ∂g/∂u
    second_rate: Float[Array, "*batch places"]  # ∂²g/∂u²


def slopes(
    settings: Setting, derivatives: CurveDerivatives, index: Int[Array, ""], limits: Float[Array, " batch"], u: Places
) -> tuple[Places, Float[Array, "batch n places"]]:
    """Return the constraint values of a batch of paths, and their derivatives with respect to the variables.

    Each path has its own instants `u`.
    """
    scale, per_log = limit_scale(settings, index, limits)
    moving, places = (settings, derivatives, u), (settings.curves.place, derivatives.first.place, settings.reference)
    G, in_slopes = switch_group(
        index,
        lambda each: _with_log(settings, lambda: jax.vmap(partial(_first_order, each, index))(*moving)),
        _others(
            settings,
            lambda: jax.vmap(corridor.slopes)(*places, u),
            lambda: jax.vmap(partial(road.slopes, element(MEMBER, index)))(*moving),
        ),
    )

    def combined(
        G: Array, in_slopes: Array, setting: Setting, derivatives: CurveDerivatives, scale: Scalar
    ) -> tuple[Array, Array]:
        in_duration = (per_log * derivatives.log_duration)[:, None] * G[None]
        slope = _directions(setting, derivatives).T @ in_slopes + in_duration
        return 0.5 * (scale * G - 1), 0.5 * scale * slope

    return jax.vmap(combined)(G, in_slopes, settings, derivatives, scale)


def _first_order(
    group: Group, index: Int[Array, ""], setting: Setting, derivatives: CurveDerivatives, u: Float[Array, " places"]
) -> tuple[Array, Array]:
    """Return G (see `constraints`) of one path and its derivatives with respect to the slopes at both ends."""
    at = _local(group, index, setting, derivatives, u)
    return at.G, at.first_order[:-1]


def expansions(
    settings: Setting,
    derivatives: CurveDerivatives,
    index: Int[Array, ""],
    limits: Float[Array, " batch"],
    u: Places,
    group: int | None = None,
) -> Expansion:
    """Return the constraint values of a batch of paths, each at its own instants `u`, with their derivatives.

    `group` is the number of the quantity's group, if it is known.
    """
    scale, per_log = limit_scale(settings, index, limits)
    moving, places = (settings, derivatives, u), (settings.curves.place, derivatives.first.place, settings.reference)
    arrays = switch_group(
        index,
        lambda each: _with_log(settings, lambda: jax.vmap(partial(_second_order, each, index))(*moving)),
        _others(
            settings,
            lambda: jax.vmap(corridor.second_order)(*places, u),
            lambda: jax.vmap(partial(road.second_order, element(MEMBER, index)))(*moving),
        ),
        group,
    )
    return jax.vmap(_in_variables, (0, 0, 0, 0, None))(Expansion(*arrays), settings, derivatives, scale, per_log)


def _in_variables(
    G: Expansion, setting: Setting, derivatives: CurveDerivatives, scale: Scalar, per_log: Scalar
) -> Expansion:
    """Convert G (see `constraints`) and its derivatives to the constraint g and its derivatives.

    The derivatives of G are with respect to the slopes at both ends, and those of g with respect to the variables z.
    """
    J, e = _directions(setting, derivatives), derivatives.log_duration[:, None]
    slope, mixed = J.T @ G.slope, J.T @ G.mixed
    curvature = jnp.einsum("in,ijp,jm->nmp", J, G.curvature, J)
    # A slope is T times a velocity, so its second derivatives that involve ln T are not zero.
    k = derivatives.slopes.shape[0]
    in_slopes = slope if setting.road is None else derivatives.slopes.T @ G.slope[:k]
    log_terms = e[:, None] * in_slopes[None]
    both = e[:, None] * e[None] * jnp.sum(e * in_slopes, axis=0)[None, None]
    curvature = curvature + log_terms + jnp.swapaxes(log_terms, 0, 1) - both
    # Add the derivatives of κ = exp(−2p ln T)/limit², where p is the power of 1/s in the unit of the quantity.
    first = per_log * e
    cross = first[:, None] * slope[None]
    second = first[:, None] * first[None] * G.value[None, None]
    return Expansion(
        0.5 * (scale * G.value - 1),
        0.5 * scale * (slope + first * G.value[None]),
        0.5 * scale * (curvature + second + cross + jnp.swapaxes(cross, 0, 1)),
        0.5 * scale * (mixed + first * G.rate[None]),
        0.5 * scale * G.rate,
        0.5 * scale * G.second_rate,
    )


def _directions(setting: Setting, derivatives: CurveDerivatives) -> Float[Array, "m n"]:
    """Return the derivatives of the slopes (and, with a vehicle, of ln(duration)) with respect to the variables."""
    if setting.road is None:
        return derivatives.slopes
    return jnp.concatenate([derivatives.slopes, derivatives.log_duration[None]])


def _others(setting: Setting, corridor_branch: Any, road_branch: Any) -> list[Any]:
    """Return the functions of the corridor and, with a vehicle, of `ROAD_GROUP`."""
    return [_with_log(setting, corridor_branch), *([] if setting.road is None else [road_branch])]


def _with_log(setting: Setting, branch: Callable[[], Any]) -> Callable[[], Any]:
    """In a problem with a vehicle, add zero derivatives with respect to ln(duration) to the result of a function."""

    def padded() -> Any:
        G, slope, *rest = branch()
        slope = jnp.pad(slope, ((0, 0), (0, 1), (0, 0)))
        if not rest:
            return G, slope
        curvature, mixed, *in_u = rest
        curvature = jnp.pad(curvature, ((0, 0), (0, 1), (0, 1), (0, 0)))
        return G, slope, curvature, jnp.pad(mixed, ((0, 0), (0, 1), (0, 0))), *in_u

    return branch if setting.road is None else padded


def _second_order(
    group: Group, index: Int[Array, ""], setting: Setting, derivatives: CurveDerivatives, u: Float[Array, " places"]
) -> tuple[Array, ...]:
    """Return G (see `constraints`) of one path with its first and second derivatives.

    The derivatives are with respect to the slopes at both ends and to u. Subscripts denote derivatives. With directions
    w (the slopes and u), invariants s and blocks Y, G_ww = Σ G_ss s_w s_w + Σ W Y_w Y_w + Σ Ȳ·Y_ww, where W are the
    weights of the products of blocks and Ȳ = G_Y.
    """
    at = _local(group, index, setting, derivatives, u)
    Y, in_invariants, directions = at.blocks, at.in_invariants, vectors(at.w)
    own = [Y[f"r{k + 1}"] for k in range(group.order)]
    in_w = {f"r{k + 1}": v for k, v in enumerate(directions)}
    for name, k in group.cross_products.items():
        in_w[name] = cross_change(directions[0], own[0], directions[k], own[k])
    s_w, weighted = [], dict.fromkeys(in_w, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            s_w.append(in_w[a][2])
            continue
        axes = 2 if name in HORIZONTAL else 3
        s_w.append(change(in_w[a][:axes], Y[a][:axes], in_w[b][:axes], Y[b][:axes]))
        weighted[a] = add_scaled(weighted[a], in_w[b], in_invariants[i], axes)
        weighted[b] = add_scaled(weighted[b], in_w[a], in_invariants[i], axes)
    projected = jnp.einsum("ijp,jmp->imp", at.hessian, jnp.stack(s_w))
    hessian_w = [outer_sum((projected[i],), (x,)) for i, x in enumerate(s_w)]
    hessian_w += [outer_sum(in_w[name], tuple(as_array(x, s_w[0]) for x in weighted[name])) for name in in_w]
    for name, k in group.cross_products.items():
        product = outer_sum(compiled_cross(broadcast(at.in_blocks[name]), directions[0]), directions[k])
        hessian_w += [product, jnp.swapaxes(product, 0, 1)]
    hessian_w = add(hessian_w)
    local = jnp.stack([jnp.stack(b) for b in at.gradient])
    if group.upright:
        local, rotation_terms = from_world(
            setting.axes, setting.curves.angle, derivatives.first.angle, at.r, at.moving_w, local, u
        )
        hessian_w = hessian_w + rotation_terms
    if derivatives.second is not None:
        hessian_w = hessian_w + jnp.pad(second_along(derivatives, local, group.order, u), ((0, 1), (0, 1), (0, 0)))
    local = vectors(local)
    mixed = add([along(b, v) for b, v in zip(local, vectors(at.moved_in_u), strict=True)])
    second_rate = add([compiled_dot(b, v) for b, v in zip(local, vectors(at.in_u_twice), strict=True)])
    return (
        at.G,
        at.first_order[:-1],
        hessian_w[:-1, :-1],
        hessian_w[:-1, -1] + mixed,
        at.first_order[-1],
        hessian_w[-1, -1] + 2 * second_rate,
    )


class _Local(NamedTuple):
    """G (see `constraints`) of one path, its first derivatives, and intermediate values for its second derivatives.

    `r` contains the derivatives of the position in the moving basis. `moving_w` and `w` are the derivatives of `r` in
    the directions of the slopes and of u, in the moving basis and in the basis of the invariants.
    """

    G: Float[Array, " places"]
    first_order: Float[Array, "k places"]
    r: Float[Array, "orders 3 places"]
    w: Float[Array, "k orders 3 places"]
    moving_w: Float[Array, "k orders 3 places"]
    moved_in_u: Float[Array, "n orders 3 places"]
    in_u_twice: Float[Array, "orders 3 places"]
    blocks: dict[str, Triple]
    gradient: list[Triple]  # with respect to the derivatives of the position
    in_blocks: dict[str, Triple]
    in_invariants: Float[Array, "i places"]
    hessian: Float[Array, "i i places"]  # with respect to the invariants


@partial(jax.jit, static_argnums=0)  # traced once: the arrays of peaks and of fixed times have one shape
def _local(
    group: Group, index: Int[Array, ""], setting: Setting, derivatives: CurveDerivatives, u: Float[Array, " places"]
) -> _Local:
    r, in_u, in_u_twice = along_u(setting.curves.up_to(group.order), u, 2)
    moved, moved_in_u = along_u(derivatives.first.up_to(group.order), u, 1)
    moving_w = jnp.concatenate([moved, in_u[None]])
    used_r, w = r, moving_w
    if group.upright:
        used_r, w = world_derivatives(setting.axes, setting.curves.angle, derivatives.first.angle, r, moving_w, u)
    G, gradient, (blocks, in_blocks, in_invariants, hessian) = _gradient(group, vectors(used_r), index)
    first_order = add([along(b, v) for b, v in zip(gradient, vectors(w), strict=True)])
    return _Local(
        G,
        first_order,
        r,
        w,
        moving_w,
        moved_in_u,
        in_u_twice,
        blocks,
        gradient,
        in_blocks,
        in_invariants,
        hessian,
    )


def _gradient(group: Group, r: list[Triple], index: Int[Array, ""]) -> tuple[Array, list[Triple], tuple[Any, ...]]:
    """Return G (see `constraints`), its gradients with respect to the derivatives `r`, and intermediate values.

    The intermediate values are the blocks, the gradients with respect to the blocks and to the invariants, and the
    Hessian with respect to the invariants.
    """
    Y = {f"r{k + 1}": v for k, v in enumerate(r)}
    Y |= {name: compiled_cross(r[0], r[k]) for name, k in group.cross_products.items()}
    s = []
    for name, (a, b) in group.products.items():
        axes = 2 if name in HORIZONTAL else 3
        s.append(Y[a][2] if b == "up" else compiled_dot(Y[a][:axes], Y[b][:axes]))
    tables = group.table.coefficients, group.table.exponents, group.table.odd
    coefficients, exponents, odd = element(tables, element(MEMBER, index))
    G, in_invariants, hessian = monomials.expand(coefficients, exponents, odd, jnp.stack(s))
    gradient: dict[str, Any] = dict.fromkeys(Y, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            gradient[a] = add_vectors(gradient[a], (0, 0, in_invariants[i]))
            continue
        axes = 2 if name in HORIZONTAL else 3
        gradient[a] = add_scaled(gradient[a], Y[b], in_invariants[i], axes)
        gradient[b] = add_scaled(gradient[b], Y[a], in_invariants[i], axes)
    gradient = {name: tuple(as_array(x, G) for x in v) for name, v in gradient.items()}
    local = [gradient[f"r{k + 1}"] for k in range(group.order)]
    for name, k in group.cross_products.items():
        local[0], local[k] = (
            add_vectors(local[0], compiled_cross(r[k], gradient[name])),
            add_vectors(local[k], compiled_cross(gradient[name], r[0])),
        )
    return G, local, (Y, gradient, in_invariants, hessian)
