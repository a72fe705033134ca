"""Rotation increments of single steps of 2λ̇ = λ∘ω(t) with a known rate, and the products of many increments.

Steps are independent of each other, so all increments are computed at once and multiplied in parallel. This module
works in body axes. Problems in inertial axes are conjugated, λ̄(ω_ξ) = λ(−ω_x), which changes the sign of every cross
product. The scalar part of the rate commutes and is integrated separately: λ(t+h) = e^{½∫ω0}·λ(t)∘(unit increment).
"""

import abc
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion
from qtraj.foundation.types import Quat, Scalar

exact_product = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)
"""Matrix product in full precision; by default an accelerator may round float32 to about four digits."""

BLOCK = 1024
"""Number of steps computed together: enough for the vector units of a processor, and few enough for its caches."""

SEQUENTIAL = 64
"""Up to this number, increments are multiplied sequentially, which runs and compiles faster than in parallel."""


class AbstractIncrement(eqx.Module):
    """A one-step method: it computes the rotation increment of a step from the rates at its nodes."""

    order: eqx.AbstractVar[int]
    """The global order: the error on a fixed interval decreases as h^order."""

    @property
    @abc.abstractmethod
    def nodes(self) -> np.ndarray:
        """The nodes on [0, 1] at which the rate is evaluated (s,)."""

    @property
    @abc.abstractmethod
    def weights(self) -> np.ndarray:
        """Quadrature weights of the nodes (s,), of the same order."""

    @abc.abstractmethod
    def increment(self, rates: Float[Array, "s 3"], h: Scalar) -> Quat:
        """The unit quaternion E with λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes of a step of `h` [s]."""


def increments(
    method: AbstractIncrement, rates: Float[Array, "n s k"], h: Float[Array, " n"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Unit increments (n, 4) and log-scales ½∫ω0 (n,) of n steps of `h` [s]; `rates` have three or four components."""

    def one(step):
        return method.increment(*step)

    steps = rates[:, :, -3:], h
    rotations = jax.vmap(one)(steps) if h.shape[0] <= BLOCK else jax.lax.map(one, steps, batch_size=BLOCK)
    if rates.shape[2] == 3:
        return rotations, jnp.zeros_like(h)
    return rotations, 0.5 * h * exact_product(rates[:, :, 0], jnp.asarray(method.weights, h.dtype))


def products(rotations: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """E_1∘…∘E_k for every k, computed in parallel for more than `SEQUENTIAL` increments."""
    if rotations.shape[0] > SEQUENTIAL:
        return jax.lax.associative_scan(jax.vmap(quaternion.product), rotations)

    def multiply(total, rotation):
        total = quaternion.product(total, rotation)
        return total, total

    identity = jnp.zeros_like(rotations, shape=4).at[0].set(1.0)
    return jax.lax.scan(multiply, identity, rotations)[1]


def accumulate(q0: Quat, rotations: Float[Array, "n 4"], log_scales: Float[Array, " n"]) -> Float[Array, "n 4"]:
    """q0 after each increment; its norm is |q0|·exp(Σ log_scales) to round-off."""
    totals = products(rotations)
    totals = totals / jnp.sqrt(jnp.sum(totals * totals, axis=1, keepdims=True))  # removes round-off only
    return jax.vmap(quaternion.product, (None, 0))(q0, totals) * jnp.exp(jnp.cumsum(log_scales))[:, None]


def to_body(q0: Quat, rates: Float[Array, "n s k"], axes: str) -> tuple[Quat, Float[Array, "n s k"]]:
    """Initial quaternion and rates of the equivalent problem in body axes, conjugated for inertial axes."""
    if axes == "body":
        return q0, rates
    return quaternion.conjugate(q0), jnp.concatenate([rates[:, :, :-3], -rates[:, :, -3:]], axis=2)


def from_body(qs: Float[Array, "n 4"], axes: str) -> Float[Array, "n 4"]:
    """The solution in the original axes: the inverse of `to_body`."""
    return qs if axes == "body" else jax.vmap(quaternion.conjugate)(qs)
