"""Derivatives of the constraints in the variables of tuning and in the place on the path."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning import corridor, monomials
from qtraj.design.tuning.constraints import LEVEL, MEMBER, Group, Places, Setting, by_group, scaling
from qtraj.design.tuning.curves import Changes, along_u, angle_at, unpacked
from qtraj.design.tuning.world_axes import in_world, spun, turned
from qtraj.foundation.types import Scalar
from qtraj.path.components import Triple, add, add_vectors, cross, dot


class Expansion(NamedTuple):
    """Of g at many places: value, derivatives in the variables, and in u."""

    value: Places
    slope: Float[Array, "n places"]
    curvature: Float[Array, "n n places"]
    mixed: Float[Array, "n places"]  # ∂²g/∂z∂u
    rate: Places  # ∂g/∂u
    bend: Places  # ∂²g/∂u²


def slopes(
    setting: Setting, changes: Changes, index: Int[Array, ""], limit: Scalar, u: Places
) -> tuple[Places, Float[Array, "n places"]]:
    """g at the places `u`, and its derivatives in the variables."""
    curves = setting.curves
    scale, per_log = scaling(setting, index, limit)

    def of(group: Group) -> Callable[[], tuple[Places, Array]]:
        def branch() -> tuple[Places, Array]:
            r = along_u(curves.up_to(group.order), u, 0)[0]
            moved = along_u(changes.first.up_to(group.order), u, 0)[0]
            if group.upright:
                angle, first = (angle_at(x.angle, u, 0)[0] for x in (curves, changes.first))
                moved = turned(setting.axes, angle, moved + first[:, None, None] * spun(r)[None])
                r = turned(setting.axes, angle, r)
            G, bar, _ = _gradient(group, _vectors(r), index)
            along = [dot(_wide(b), v) for b, v in zip(bar, _vectors(moved), strict=True)]
            return G, add(along)

        return branch

    places = curves.place, changes.first.place, setting.given
    G, of_slopes = by_group(index, of, lambda: corridor.slopes(*places, u))
    slope = changes.slopes.T @ of_slopes + (per_log * changes.log_duration)[:, None] * G[None]
    return 0.5 * (scale * G - 1), 0.5 * scale * slope


def expansions(setting: Setting, changes: Changes, index: Int[Array, ""], limit: Scalar, u: Places) -> Expansion:
    """g at the places `u`, with first and second derivatives in the variables and in u."""
    scale, per_log = scaling(setting, index, limit)
    places = setting.curves.place, changes.first.place, setting.given
    found = by_group(
        index,
        lambda group: lambda: _expanded(group, setting, changes, index, u),
        lambda: corridor.expanded(*places, u),
    )
    G = Expansion(*found)
    # The slopes are T times velocities: what is linear in the velocities is so in T, too.
    J, e = changes.slopes, changes.log_duration[:, None]
    slope, mixed = J.T @ G.slope, J.T @ G.mixed
    curved = jnp.einsum("in,ijp,jm->nmp", J, G.curvature, J)
    with_log = e[:, None] * slope[None]
    both = e[:, None] * e[None] * jnp.sum(e * slope, axis=0)[None, None]
    curved = curved + with_log + jnp.swapaxes(with_log, 0, 1) - both
    # κ = exp(−2p ln T)/limit².
    first = per_log * e
    cross = first[:, None] * slope[None]
    second = first[:, None] * first[None] * G.value[None, None]
    return Expansion(
        0.5 * (scale * G.value - 1),
        0.5 * scale * (slope + first * G.value[None]),
        0.5 * scale * (curved + second + cross + jnp.swapaxes(cross, 0, 1)),
        0.5 * scale * (mixed + first * G.rate[None]),
        0.5 * scale * G.rate,
        0.5 * scale * G.bend,
    )


def _expanded(group: Group, setting: Setting, changes: Changes, index: Int[Array, ""], u: Places) -> tuple[Array, ...]:
    """G, its derivatives in the slopes at the ends, those in slopes and u, and in u.

    In the directions w of the slopes and of u, with s for invariants and Y for blocks,
    G_ww = Σ G_ss s_w s_w + Σ W Y_w Y_w + Σ Ȳ·Y_ww, where W are the weights of the blocks' products and Ȳ = G_Y.
    """
    curves = setting.curves
    r, in_u, in_u_twice = along_u(curves.up_to(group.order), u, 2)
    moved, moved_in_u = along_u(changes.first.up_to(group.order), u, 1)
    w = jnp.concatenate([moved, in_u[None]])
    back: Any = lambda bar: (bar, 0.0)  # noqa: E731
    if group.upright:
        r, w, back = in_world(setting.axes, setting.curves.angle, changes.first.angle, r, w, u)
    directions = _vectors(w)
    vectors = _vectors(r)
    G, bar, (Y, bar_Y, of_s, hessian) = _gradient(group, vectors, index)
    in_w = {f"r{k + 1}": v for k, v in enumerate(directions)}
    for name, k in group.crossed.items():
        in_w[name] = add_vectors(cross(directions[0], _wide(vectors[k])), cross(_wide(vectors[0]), directions[k]))
    s_w, weighed = [], dict.fromkeys(in_w, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            s_w.append(in_w[a][2])
            continue
        axes = 2 if name in LEVEL else 3
        s_w.append(add([dot(in_w[a][:axes], _wide(Y[b])[:axes]), dot(in_w[b][:axes], _wide(Y[a])[:axes])]))
        weight = of_s[i][None]
        weighed[a] = add_vectors(weighed[a], _scaled(in_w[b], weight, axes))
        weighed[b] = add_vectors(weighed[b], _scaled(in_w[a], weight, axes))
    onto = jnp.einsum("ijp,jmp->imp", hessian, jnp.stack(s_w))
    curved = [_outer(onto[i], x) for i, x in enumerate(s_w)]
    curved += [_outer(x, y) for name in in_w for x, y in zip(in_w[name], weighed[name], strict=True)]
    for name, k in group.crossed.items():
        half = add([_outer(x, y) for x, y in zip(cross(_wide(bar_Y[name]), directions[0]), directions[k], strict=True)])
        curved += [half, jnp.swapaxes(half, 0, 1)]
    curved = add(curved)
    own, turned = back(jnp.stack([jnp.stack(b) for b in bar]))
    curved = curved + turned
    if changes.second is not None:
        second = changes.second.up_to(group.order)
        powers = [jnp.ones_like(u)]
        for _ in range(second.shape[-2] - 1):
            powers.append(powers[-1] * u)
        onto = own[:, None] * jnp.stack(powers)[None, :, None]
        added = unpacked(second.reshape(second.shape[0], -1) @ onto.reshape(-1, u.shape[0]))
        curved = curved + jnp.pad(added, ((0, 1), (0, 1), (0, 0)))
    n = moved.shape[0]
    flat = add([dot(_wide(b), v) for b, v in zip(bar, directions, strict=True)])
    own = _vectors(own)
    mixed = add([dot(_wide(b), v) for b, v in zip(own, _vectors(moved_in_u), strict=True)])
    bend = add([dot(b, v) for b, v in zip(own, _vectors(in_u_twice), strict=True)])
    return G, flat[:n], curved[:n, :n], curved[:n, n] + mixed, flat[n], curved[n, n] + 2 * bend


def _gradient(group: Group, r: list[Triple], index: Int[Array, ""]) -> tuple[Places, list[Triple], tuple[Any, ...]]:
    """G and its derivatives in r', r'', …; then blocks, the derivatives in them and in the invariants, the Hessian."""
    Y = {f"r{k + 1}": v for k, v in enumerate(r)}
    Y |= {name: cross(r[0], r[k]) for name, k in group.crossed.items()}
    s = []
    for name, (a, b) in group.products.items():
        axes = 2 if name in LEVEL else 3
        s.append(Y[a][2] if b == "up" else dot(Y[a][:axes], Y[b][:axes]))
    member = jnp.asarray(MEMBER)[index]
    coefficients, exponents = (jnp.asarray(x, s[0].dtype)[member] for x in group.table)
    G, of_s, hessian = monomials.expand(coefficients, exponents, jnp.stack(s))
    bar: dict[str, Any] = dict.fromkeys(Y, (0, 0, 0))
    for i, (name, (a, b)) in enumerate(group.products.items()):
        if b == "up":
            bar[a] = add_vectors(bar[a], (0, 0, of_s[i]))
            continue
        axes = 2 if name in LEVEL else 3
        bar[a] = add_vectors(bar[a], _scaled(Y[b], of_s[i], axes))
        bar[b] = add_vectors(bar[b], _scaled(Y[a], of_s[i], axes))
    bar = {name: tuple(_full(x, G) for x in v) for name, v in bar.items()}
    own = [bar[f"r{k + 1}"] for k in range(group.order)]
    for name, k in group.crossed.items():
        own[0], own[k] = add_vectors(own[0], cross(r[k], bar[name])), add_vectors(own[k], cross(bar[name], r[0]))
    return G, own, (Y, bar, of_s, hessian)


def _vectors(r: Array) -> list[Triple]:
    """Vectors (*rest, orders, 3, places) as triples of arrays (*rest, places), one for each order."""
    return [(r[..., k, 0, :], r[..., k, 1, :], r[..., k, 2, :]) for k in range(r.shape[-3])]


def _wide(v: Triple) -> Triple:
    """The vector for all directions, which stand on a first axis."""
    return (v[0][None], v[1][None], v[2][None])


def _scaled(v: Triple, weight: Array, axes: int) -> Triple:
    """weight·v, without the vertical for two axes."""
    return (weight * v[0], weight * v[1], weight * v[2] if axes == 3 else 0)


def _outer(a: Any, b: Any) -> Any:
    """The products of all pairs of directions."""
    return 0 if isinstance(a, int) or isinstance(b, int) else a[:, None] * b[None]


def _full(x: Any, like: Array) -> Array:
    return jnp.zeros_like(like) if isinstance(x, int) else x
