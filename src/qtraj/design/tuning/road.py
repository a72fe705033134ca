"""Limits on the forces of the road, as functions of r', r'' and gravity, with their derivatives.

With u = t/T as the time, gravity is g·T². So these quantities depend on the duration T not only through the scale of
their limit, and derivatives with respect to ln T are appended to the derivatives with respect to the slopes. The square
of each quantity is a short formula in five numbers at each instant: two invariants and three forces. The five numbers
are functions of seven others: the components of r' and r'', and gravity. JAX differentiates the formula and these
functions, and the chain rule combines the derivatives. The derivatives of the five numbers are common to all
quantities.
"""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning.curves import CurveDerivatives, along_u, angle_at, second_along
from qtraj.design.tuning.world_axes import cross_axis, from_world, to_world, world_derivatives
from qtraj.path.frenet import Invariants
from qtraj.path.road_quantities import ROAD_QUANTITIES

ORDER = 2
"""The highest order of the derivatives of the path on which these quantities depend."""

FORCES = 5
"""The number of invariants and forces on which the squares depend."""

Places = Float[Array, " places"]
Forces = Float[Array, "5 places"]
Numbers = Float[Array, "7 places"]


def value(setting: Any, r: Float[Array, "2 3 places"], member: Int[Array, ""]) -> Places:
    """Return the square of the quantity `member` at several instants; `r` contains r' and r'' in world axes."""
    return _square(setting, member, _forces(setting)(_numbers(r, _gravity(setting, r))), 0)[0]


def slopes(
    member: Int[Array, ""], setting: Any, derivatives: CurveDerivatives, u: Places
) -> tuple[Places, Float[Array, "n places"]]:
    """Return the square of the quantity `member` at the instants `u`, and its derivatives.

    The derivatives are with respect to the slopes at both ends and to ln T, where T is the duration.
    """
    curves = setting.curves
    r = along_u(curves.up_to(ORDER), u, 0)[0]
    directions = along_u(derivatives.first.up_to(ORDER), u, 0)[0]
    angle, first = (angle_at(x.angle, u, 0)[0] for x in (curves, derivatives.first))
    directions = to_world(setting.axes, angle, directions + first[:, None, None] * cross_axis(r)[None])
    gravity = _gravity(setting, r)
    p = _numbers(to_world(setting.axes, angle, r), gravity)
    f, pullback = jax.vjp(_forces(setting), p)
    square, weights, _ = _square(setting, member, f, 1)
    (gradient,) = pullback(weights)
    return square, jnp.sum(gradient[None] * _directions(directions, gravity), axis=1)


def second_order(
    member: Int[Array, ""], setting: Any, derivatives: CurveDerivatives, u: Places
) -> tuple[Places, Array, Array, Array, Places, Places]:
    """Return the square of the quantity `member` at the instants `u`, and its derivatives.

    The derivatives are the first and second derivatives with respect to the slopes and ln T (T is the duration), the
    mixed second derivatives with respect to these variables and u, and the first and second derivatives with respect to
    u.
    """
    curves = setting.curves
    moving_r, in_u, in_u_twice = along_u(curves.up_to(ORDER), u, 2)
    moved, moved_in_u = along_u(derivatives.first.up_to(ORDER), u, 1)
    moving_w = jnp.concatenate([moved, in_u[None]])
    rotation = setting.axes, curves.angle, derivatives.first.angle
    r, w = world_derivatives(*rotation, moving_r, moving_w, u)
    gravity, n = _gravity(setting, r), moved.shape[0]
    p, directions = _numbers(r, gravity), _directions(w, gravity)  # slopes, u, ln T
    forces = _forces(setting)
    value, weights, bend = _square(setting, member, forces(p), 2)

    def with_weights(p: Numbers) -> tuple[Forces, Numbers]:
        f, pullback = jax.vjp(forces, p)
        return f, pullback(weights)[0]

    (_, gradient), change = jax.linearize(with_weights, p)
    # The Hessian is symmetric, and block-diagonal with one block per instant.
    rates, projected = jax.vmap(change)(directions)
    hessian = jnp.sum(directions[:, None] * projected[None], axis=2)
    hessian = hessian + jnp.sum(rates[:, None] * jnp.sum(bend[None] * rates[:, None], axis=2)[None], axis=2)
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
    """Return the derivatives of the seven numbers in all directions.

    Along the directions `w` of the path, gravity is constant. In the last direction, the logarithm of the duration,
    only gravity changes.
    """
    paths = jnp.pad(w.reshape(w.shape[0], -1, w.shape[-1]), ((0, 0), (0, 1), (0, 0)))
    return jnp.concatenate([paths, jnp.pad(2 * gravity[None, None], ((0, 0), (w[0, ..., 0].size, 0), (0, 0)))])


def _forces(setting: Any) -> Callable[[Numbers], Forces]:
    """Return the function of the components of r' and r'', and gravity, that computes S, H and the forces of `Contact`.

    S is the squared speed, and H the squared horizontal speed.
    """

    def forces(p: Numbers) -> Forces:
        i = Invariants([None, (p[0], p[1], p[2]), (p[3], p[4], p[5])], vehicle=setting.road._replace(gravity=p[6]))
        return jnp.stack([i.S, i.H, i.contact.along, i.contact.across, i.contact.onto])

    return forces


def _square(setting: Any, member: Int[Array, ""], f: Forces, order: int) -> tuple[Places, Array, Array]:
    """Return the square of the quantity `member`, and its derivatives up to `order` with respect to `f`.

    `f` contains the five results of the function that `_forces` returns.

    Derivatives of higher order are empty arrays. Each branch differentiates its own formula, because a derivative of
    the switch would store the intermediate results of all branches.
    """

    def of(square: Callable[[Any], Places]) -> tuple[Places, Array, Array]:
        def formula(f: Forces) -> Places:
            S, H, along, across, onto = f
            forces = SimpleNamespace(along=along, across=across, onto=onto)
            return square(SimpleNamespace(S=S, H=H, contact=forces, pace=1, vehicle=setting.road))

        none = jnp.zeros((0, *f.shape))
        if order == 0:
            return formula(f), none, none
        with_gradient = lambda f: _with_gradient(formula, f)  # noqa: E731
        if order == 1:
            return *with_gradient(f), none
        (value, gradient), change = jax.linearize(with_gradient, f)
        basis = jnp.broadcast_to(jnp.eye(FORCES, dtype=f.dtype)[:, :, None], (FORCES, *f.shape))
        return value, gradient, jax.vmap(lambda d: change(d)[1])(basis)

    return jax.lax.switch(member, [lambda entry=entry: of(entry.squared) for entry in ROAD_QUANTITIES])


def _with_gradient(square: Callable[[Array], Places], x: Array) -> tuple[Places, Array]:
    value, pullback = jax.vjp(square, x)
    return value, pullback(jnp.ones_like(value))[0]
