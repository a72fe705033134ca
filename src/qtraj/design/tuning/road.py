"""Limits that need a vehicle: functions of r', r'' and gravity in unit time, with their derivatives.

In unit time gravity is g·T². So these quantities depend on the duration not only through the scale of their limit, and
ln T is one more direction of derivatives, the last one. Their squares are functions of seven numbers at each place,
which JAX differentiates.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.curves import CurveDerivatives, along_u, angle_at, second_along
from qtraj.design.tuning.world_axes import cross_axis, from_world, to_world, world_derivatives
from qtraj.path.frenet import Invariants
from qtraj.path.road_quantities import ROAD_QUANTITIES

ORDER = 2
"""The highest derivative that these quantities need."""

Places = Float[Array, " places"]
Numbers = Float[Array, "7 places"]


def value(setting: Any, r: Float[Array, "2 3 places"], member: Int[Array, ""]) -> Places:
    """The square at places with the derivatives `r`, world axes."""
    return _square(setting, member)(_numbers(r, _gravity(setting, r)))


def slopes(
    member: Int[Array, ""], setting: Any, derivatives: CurveDerivatives, u: Places
) -> tuple[Places, Float[Array, "n places"]]:
    """The square at the places `u`, and its derivatives in the slopes at the ends and in ln T."""
    curves = setting.curves
    r = along_u(curves.up_to(ORDER), u, 0)[0]
    directions = along_u(derivatives.first.up_to(ORDER), u, 0)[0]
    angle, first = (angle_at(x.angle, u, 0)[0] for x in (curves, derivatives.first))
    directions = to_world(setting.axes, angle, directions + first[:, None, None] * cross_axis(r)[None])
    gravity = _gravity(setting, r)
    p = _numbers(to_world(setting.axes, angle, r), gravity)
    square, gradient = _with_gradient(_square(setting, member), p)
    return square, jnp.sum(gradient[None] * _directions(directions, gravity), axis=1)


def second_order(
    member: Int[Array, ""], setting: Any, derivatives: CurveDerivatives, u: Places
) -> tuple[Places, Array, Array, Array, Places, Places]:
    """The square, with first and second derivatives in the slopes and ln T, mixed ones with u, and those in u."""
    curves = setting.curves
    moving_r, in_u, in_u_twice = along_u(curves.up_to(ORDER), u, 2)
    moved, moved_in_u = along_u(derivatives.first.up_to(ORDER), u, 1)
    moving_w = jnp.concatenate([moved, in_u[None]])
    rotation = setting.axes, curves.angle, derivatives.first.angle
    r, w = world_derivatives(*rotation, moving_r, moving_w, u)
    gravity, n = _gravity(setting, r), moved.shape[0]
    p, directions = _numbers(r, gravity), _directions(w, gravity)  # slopes, u, ln T
    square = _square(setting, member)
    value, gradient = _with_gradient(square, p)
    _, hessian_vp = jax.vjp(jax.grad(lambda p: jnp.sum(square(p))), p)
    projected = jax.vmap(lambda v: hessian_vp(v)[0])(directions)  # the Hessian is symmetric, and separate at each place
    hessian = jnp.sum(directions[:, None] * projected[None], axis=2)
    first_order = jnp.sum(gradient[None] * directions, axis=1)
    in_world = gradient[:-1].reshape(ORDER, 3, -1)
    local, rotation_terms = from_world(*rotation, moving_r, moving_w, in_world, u)
    in_path = rotation_terms + jnp.pad(second_along(derivatives, local, ORDER, u), ((0, 1), (0, 1), (0, 0)))
    hessian = hessian + jnp.pad(in_path, ((0, 1), (0, 1), (0, 0)))
    hessian = hessian.at[n + 1, n + 1].add(2 * first_order[n + 1])  # g·T² = g·exp(2 ln T)
    kept = jnp.asarray([*range(n), n + 1])
    mixed = hessian[kept, n] + jnp.pad(jnp.sum(local[None] * moved_in_u, axis=(1, 2)), ((0, 1), (0, 0)))
    second_rate = hessian[n, n] + 2 * jnp.sum(local * in_u_twice, axis=(0, 1))
    return value, first_order[kept], hessian[kept][:, kept], mixed, first_order[n], second_rate


def _gravity(setting: Any, r: Array) -> Places:
    return jnp.broadcast_to(setting.road.gravity * jnp.exp(2 * setting.log_duration), r.shape[-1:])


def _numbers(r: Float[Array, "2 3 places"], gravity: Places) -> Numbers:
    return jnp.concatenate([r.reshape(-1, r.shape[-1]), gravity[None]])


def _directions(w: Float[Array, "n 2 3 places"], gravity: Places) -> Float[Array, "m 7 places"]:
    """The directions of the path, in which gravity is constant, and that of ln T, in which it alone changes."""
    paths = jnp.pad(w.reshape(w.shape[0], -1, w.shape[-1]), ((0, 0), (0, 1), (0, 0)))
    return jnp.concatenate([paths, jnp.pad(2 * gravity[None, None], ((0, 0), (w[0, ..., 0].size, 0), (0, 0)))])


def _with_gradient(square: Callable[[Numbers], Places], p: Numbers) -> tuple[Places, Numbers]:
    value, pullback = jax.vjp(square, p)
    return value, pullback(jnp.ones_like(value))[0]


def _square(setting: Any, member: Int[Array, ""]) -> Callable[[Numbers], Places]:
    def square(p: Numbers) -> Places:
        i = Invariants([None, (p[0], p[1], p[2]), (p[3], p[4], p[5])], vehicle=setting.road._replace(gravity=p[6]))
        i.compute()
        return jax.lax.switch(member, [lambda entry=entry: entry.squared(i) for entry in ROAD_QUANTITIES])

    return square
