"""Compute rotation increments of the steps of 2λ̇ = λ∘ω(t) with a prescribed rate ω(t), and multiply them.

Steps are independent of each other, so all increments are computed at once and multiplied in parallel. All functions
except `to_body` and `from_body` use body axes. Problems in inertial axes are conjugated: 2λ̇ = ω_ξ∘λ becomes 2 dλ̄/dt =
λ̄∘ω̄_ξ, which has the form of a problem in body axes. The scalar part ω0 of the rate commutes with the rotation and is
integrated separately: λ(t+h) = e^{½∫ω0}·λ(t)∘E with the unit increment E.
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
"""The matrix product in full precision; by default an accelerator may round float32 to about four digits."""

BLOCK = 1024
"""Number of steps that are computed together: enough for vector instructions, and few enough for the CPU caches."""

SEQUENTIAL = 64
"""Up to this number, increments are multiplied sequentially, because the code then runs and compiles faster."""


class AbstractIncrement(eqx.Module):
    """A one-step method that computes the rotation increment of a step from the rates at the nodes of the step."""

    order: eqx.AbstractVar[int]
    """The global order: the error on a fixed interval is O(h^order) for steps of length h."""

    @property
    @abc.abstractmethod
    def nodes(self) -> np.ndarray:
        """The nodes (s,) on [0, 1] at which the rate is evaluated."""

    @property
    @abc.abstractmethod
    def weights(self) -> np.ndarray:
        """The weights (s,) of the nodes in a quadrature that has the same order as the method."""

    @abc.abstractmethod
    def increment(self, rates: Float[Array, "s 3"], h: Scalar) -> Quat:
        """Return the unit quaternion E with λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes of a step of `h` [s]."""


def increments(
    method: AbstractIncrement, rates: Float[Array, "n s k"], h: Float[Array, " n"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Return the unit increments (n, 4) and the log-scales ½∫ω0 (n,) of n steps of lengths `h` (n,) [s].

    The axes of `rates` (n, s, k) are steps, nodes, and components: three, or four with the scalar part first.
    """

    def one(step):
        return method.increment(*step)

    steps = rates[:, :, -3:], h
    rotations = jax.vmap(one)(steps) if h.shape[0] <= BLOCK else jax.lax.map(one, steps, batch_size=BLOCK)
    if rates.shape[2] == 3:
        return rotations, jnp.zeros_like(h)
    return rotations, 0.5 * h * exact_product(rates[:, :, 0], jnp.asarray(method.weights, h.dtype))


def products(rotations: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """Return the products E_1∘…∘E_k of the first k increments, for every k (see `SEQUENTIAL`)."""
    if rotations.shape[0] > SEQUENTIAL:
        return jax.lax.associative_scan(jax.vmap(quaternion.product), rotations)

    def multiply(total, rotation):
        total = quaternion.product(total, rotation)
        return total, total

    identity = jnp.zeros_like(rotations, shape=4).at[0].set(1.0)
    return jax.lax.scan(multiply, identity, rotations)[1]


def accumulate(q0: Quat, rotations: Float[Array, "n 4"], log_scales: Float[Array, " n"]) -> Float[Array, "n 4"]:
    """Return the quaternion after each increment, from the initial `q0`, with the norm |q0|·exp(Σ log_scales)."""
    totals = products(rotations)
    totals = totals / jnp.sqrt(jnp.sum(totals * totals, axis=1, keepdims=True))  # removes round-off only
    return jax.vmap(quaternion.product, (None, 0))(q0, totals) * jnp.exp(jnp.cumsum(log_scales))[:, None]


def to_body(q0: Quat, rates: Float[Array, "n s k"], axes: str) -> tuple[Quat, Float[Array, "n s k"]]:
    """Return the initial quaternion and the rates of the equivalent problem in body axes.

    If the rates are in inertial axes, the quaternion and the rates are conjugated.
    """
    if axes == "body":
        return q0, rates
    return quaternion.conjugate(q0), jnp.concatenate([rates[:, :, :-3], -rates[:, :, -3:]], axis=2)


def from_body(qs: Float[Array, "n 4"], axes: str) -> Float[Array, "n 4"]:
    """Return the solution in the original axes, by the inverse of `to_body`."""
    return qs if axes == "body" else jax.vmap(quaternion.conjugate)(qs)
