"""Derivatives of the constraints in the variables and in the place u on the path."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.algebra.sparse import add
from qtraj.design.tuning import corridor, monomials, road
from qtraj.design.tuning.constraints import HORIZONTAL, MEMBER, Group, Places, Setting, limit_scale, switch_group
from qtraj.design.tuning.curves import CurveDerivatives, along_u, angle_at, second_along
from qtraj.design.tuning.world_axes import cross_axis, to_world, world_derivatives
from qtraj.foundation.types import Scalar
from qtraj.path.components import Triple, add_vectors, cross, dot


class Expansion(NamedTuple):
    """The constraint g at many places: its value and its derivatives in the variables and in u."""

    value: Places
    slope: Float[Array, "n places"]
    curvature: Float[Array, "n n places"]
    mixed: Float[Array, "n places"]  # ∂²g/∂z∂u
    rate: Places  # ∂g/∂u
    second_rate: Places  # ∂²g/∂u²


def slopes(
    setting: Setting, derivatives: CurveDerivatives, index: Int[Array, ""], limit: Scalar, u: Places
) -> tuple[Places, Float[Array, "n places"]]:
    """g at the places `u`, and its derivatives in the variables."""
    curves = setting.curves
    scale, per_log = limit_scale(setting, index, limit)

    def make_branch(group: Group) -> Callable[[], tuple[Places, Array]]:
        def branch() -> tuple[Places, Array]:
            r = along_u(curves.up_to(group.order), u, 0)[0]
            directions = along_u(derivatives.first.up_to(group.order), u, 0)[0]
            if group.upright:
                angle, first = (angle_at(x.angle, u, 0)[0] for x in (curves, derivatives.first))
                directions = to_world(setting.axes, angle, directions + first[:, None, None] * cross_axis(r)[None])
                r = to_world(setting.axes, angle, r)
            G, gradient, _ = _gradient(group, _vectors(r), index)
            along = [dot(_broadcast(b), v) for b, v in zip(gradient, _vectors(directions), strict=True)]
            return G, add(along)

        return branch

    places = curves.place, derivatives.first.place, setting.reference
    member = jnp.asarray(MEMBER)[index]
    others = _others(setting, lambda: corridor.slopes(*places, u), lambda: road.slopes(setting, derivatives, member, u))
    G, in_slopes = switch_group(index, lambda group: _with_log(setting, make_branch(group)), others)
    slope = _directions(setting, derivatives).T @ in_slopes + (per_log * derivatives.log_duration)[:, None] * G[None]
    return 0.5 * (scale * G - 1), 0.5 * scale * slope


def expansions(
    setting: Setting, derivatives: CurveDerivatives, index: Int[Array, ""], limit: Scalar, u: Places
) -> Expansion:
    """g at the places `u`, with first and second derivatives in the variables and in u."""
    scale, per_log = limit_scale(setting, index, limit)
    places = setting.curves.place, derivatives.first.place, setting.reference
    member = jnp.asarray(MEMBER)[index]
    others = _others(
        setting,
        lambda: corridor.second_order(*places, u),
        lambda: road.second_order(setting, derivatives, member, u),
    )
    make_branch = lambda group: _with_log(setting, lambda: _second_order(group, setting, derivatives, index, u))  # noqa: E731
    G = Expansion(*switch_group(index, make_branch, others))
    J, e = _directions(setting, derivatives), derivatives.log_duration[:, None]
    slope, mixed = J.T @ G.slope, J.T @ G.mixed
    curvature = jnp.einsum("in,ijp,jm->nmp", J, G.curvature, J)
    # The slopes are T times velocities, so they are linear in T as well as in the velocities.
    k = derivatives.slopes.shape[0]
    in_slopes = slope if setting.road is None else derivatives.slopes.T @ G.slope[:k]
    log_terms = e[:, None] * in_slopes[None]
    both = e[:, None] * e[None] * jnp.sum(e * in_slopes, axis=0)[None, None]
    curvature = curvature + log_terms + jnp.swapaxes(log_terms, 0, 1) - both
    # κ = exp(−2p ln T)/limit².
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
    """The derivatives of the slopes in the variables and, with a vehicle, those of ln T."""
    if setting.road is None:
        return derivatives.slopes
    return jnp.concatenate([derivatives.slopes, derivatives.log_duration[None]])


def _others(setting: Setting, corridor_branch: Any, road_branch: Any) -> list[Any]:
    """The branches beside those of the groups, with a zero derivative of the corridor in ln T."""
    return [_with_log(setting, corridor_branch), *([] if setting.road is None else [road_branch])]


def _with_log(setting: Setting, branch: Callable[[], Any]) -> Callable[[], Any]:
    """The branch with the direction of ln T, in which its quantity does not change, in a problem with a vehicle."""

    def padded() -> Any:
        G, slope, *rest = branch()
        slope = jnp.pad(slope, ((0, 1), (0, 0)))
        if not rest:
            return G, slope
        curvature, mixed, *in_u = rest
        return G, slope, jnp.pad(curvature, ((0, 1), (0, 1), (0, 0))), jnp.pad(mixed, ((0, 1), (0, 0))), *in_u

    return branch if setting.road is None else padded


def _second_order(
    group: Group, setting: Setting, derivatives: CurveDerivatives, index: Int[Array, ""], u: Places
) -> tuple[Array, ...]:
    """G, with first and second derivatives in the slopes at the ends, mixed ones, and those in u.

    In the directions w of the slopes and of u, with invariants s and blocks Y,
    G_ww = Σ G_ss s_w s_w + Σ W Y_w Y_w + Σ Ȳ·Y_ww, where W are the weights of the blocks' products and Ȳ = G_Y.
    """
    curves = setting.curves
    r, in_u, in_u_twice = along_u(curves.up_to(group.order), u, 2)
    moved, moved_in_u = along_u(derivatives.first.up_to(group.order), u, 1)
    w = jnp.concatenate([moved, in_u[None]])
    map_back: Any = lambda gradient: (gradient, 0.0)  # noqa: E731
    if group.upright:
        r, w, map_back = world_derivatives(setting.axes, setting.curves.angle, derivatives.first.angle, r, w, u)
    directions = _vectors(w)
    vectors = _vectors(r)
    G, gradient, (Y, block_gradient, in_invariants, hessian) = _gradient(group, vectors, index)
    in_w = {f"r{k + 1}": v for k, v in enumerate(directions)}
    for name, k in group.cross_products.items():
        in_w[name] = add_vectors(
            cross(directions[0], _broadcast(vectors[k])), cross(_broadcast(vectors[0]), directions[k])
        )
    s_w, weighted = [], dict.fromkeys(in_w, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            s_w.append(in_w[a][2])
            continue
        axes = 2 if name in HORIZONTAL else 3
        s_w.append(add([dot(in_w[a][:axes], _broadcast(Y[b])[:axes]), dot(in_w[b][:axes], _broadcast(Y[a])[:axes])]))
        weight = in_invariants[i][None]
        weighted[a] = add_vectors(weighted[a], _scaled(in_w[b], weight, axes))
        weighted[b] = add_vectors(weighted[b], _scaled(in_w[a], weight, axes))
    projected = jnp.einsum("ijp,jmp->imp", hessian, jnp.stack(s_w))
    hessian_w = [_outer(projected[i], x) for i, x in enumerate(s_w)]
    hessian_w += [_outer(x, y) for name in in_w for x, y in zip(in_w[name], weighted[name], strict=True)]
    for name, k in group.cross_products.items():
        product = add(
            [
                _outer(x, y)
                for x, y in zip(cross(_broadcast(block_gradient[name]), directions[0]), directions[k], strict=True)
            ]
        )
        hessian_w += [product, jnp.swapaxes(product, 0, 1)]
    hessian_w = add(hessian_w)
    local, rotation_terms = map_back(jnp.stack([jnp.stack(b) for b in gradient]))
    hessian_w = hessian_w + rotation_terms
    if derivatives.second is not None:
        hessian_w = hessian_w + jnp.pad(second_along(derivatives, local, group.order, u), ((0, 1), (0, 1), (0, 0)))
    n = moved.shape[0]
    first_order = add([dot(_broadcast(b), v) for b, v in zip(gradient, directions, strict=True)])
    local = _vectors(local)
    mixed = add([dot(_broadcast(b), v) for b, v in zip(local, _vectors(moved_in_u), strict=True)])
    second_rate = add([dot(b, v) for b, v in zip(local, _vectors(in_u_twice), strict=True)])
    return (
        G,
        first_order[:n],
        hessian_w[:n, :n],
        hessian_w[:n, n] + mixed,
        first_order[n],
        hessian_w[n, n] + 2 * second_rate,
    )


def _gradient(group: Group, r: list[Triple], index: Int[Array, ""]) -> tuple[Places, list[Triple], tuple[Any, ...]]:
    """G and its gradients in r', r'', …; then the blocks, and the derivatives in them and in the invariants."""
    Y = {f"r{k + 1}": v for k, v in enumerate(r)}
    Y |= {name: cross(r[0], r[k]) for name, k in group.cross_products.items()}
    s = []
    for name, (a, b) in group.products.items():
        axes = 2 if name in HORIZONTAL else 3
        s.append(Y[a][2] if b == "up" else dot(Y[a][:axes], Y[b][:axes]))
    member = jnp.asarray(MEMBER)[index]
    coefficients, exponents = (jnp.asarray(x, s[0].dtype)[member] for x in group.table)
    G, in_invariants, hessian = monomials.expand(coefficients, exponents, jnp.stack(s))
    gradient: dict[str, Any] = dict.fromkeys(Y, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            gradient[a] = add_vectors(gradient[a], (0, 0, in_invariants[i]))
            continue
        axes = 2 if name in HORIZONTAL else 3
        gradient[a] = add_vectors(gradient[a], _scaled(Y[b], in_invariants[i], axes))
        gradient[b] = add_vectors(gradient[b], _scaled(Y[a], in_invariants[i], axes))
    gradient = {name: tuple(_as_array(x, G) for x in v) for name, v in gradient.items()}
    local = [gradient[f"r{k + 1}"] for k in range(group.order)]
    for name, k in group.cross_products.items():
        local[0], local[k] = (
            add_vectors(local[0], cross(r[k], gradient[name])),
            add_vectors(local[k], cross(gradient[name], r[0])),
        )
    return G, local, (Y, gradient, in_invariants, hessian)


def _vectors(r: Array) -> list[Triple]:
    """Vectors (*rest, orders, 3, places) as triples of arrays (*rest, places), one triple for each order."""
    return [(r[..., k, 0, :], r[..., k, 1, :], r[..., k, 2, :]) for k in range(r.shape[-3])]


def _broadcast(v: Triple) -> Triple:
    """The vector with a new first axis, for the directions."""
    return (v[0][None], v[1][None], v[2][None])


def _scaled(v: Triple, weight: Array, axes: int) -> Triple:
    """weight·v, without the vertical component if `axes` is 2."""
    return (weight * v[0], weight * v[1], weight * v[2] if axes == 3 else 0)


def _outer(a: Any, b: Any) -> Any:
    """The products of all pairs of directions."""
    return 0 if isinstance(a, int) or isinstance(b, int) else a[:, None] * b[None]


def _as_array(x: Any, like: Array) -> Array:
    return jnp.zeros_like(like) if isinstance(x, int) else x
