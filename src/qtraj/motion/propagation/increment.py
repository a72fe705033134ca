"""Compute rotation increments of the steps of 2λ̇ = λ∘ω(t) with a prescribed rate ω(t), and multiply them.

Steps are independent of each other, so all increments are computed at once and multiplied in parallel. All functions
except `to_body` and `from_body` use body axes. Problems in inertial axes are conjugated: 2λ̇ = ω_ξ∘λ becomes 2 dλ̄/dt =
λ̄∘ω̄_ξ, which has the form of a problem in body axes. The scalar part ω0 of the rate commutes with the rotation and is
integrated separately: λ(t+h) = e^{½∫ω0}·λ(t)∘E with the unit increment E.

All formulas are written for NumPy arrays and for JAX arrays.
"""

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion
from qtraj.foundation.argument import require_type
from qtraj.foundation.devices import device_of
from qtraj.foundation.namespace import float_dtype, is_host, matmul, to_jax, xp
from qtraj.foundation.types import Quat

BLOCK = 1024
"""Number of steps that are computed together: enough for vector instructions, and few enough for the CPU caches."""

SEQUENTIAL = 64
"""Up to this number, JAX multiplies increments sequentially, because the code then runs and compiles faster."""


class AbstractIncrement(eqx.Module):
    """A one-step method that computes the rotation increment of a step from the rates at the nodes of the step."""

    order: eqx.AbstractVar[int]
    """The global order: the error on a fixed interval is O(h^order) for steps of length h."""

    @property
    @abc.abstractmethod
    def nodes(self) -> Any:
        """The nodes (s,) on [0, 1] at which the rate is evaluated."""

    @property
    @abc.abstractmethod
    def weights(self) -> Any:
        """The weights (s,) of the nodes in a quadrature that has the same order as the method."""

    @abc.abstractmethod
    def increment(self, rates: Float[Array, "*batch s 3"], h: Float[Array, "*batch"]) -> Float[Array, "*batch 4"]:
        """Return the unit quaternion E with λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes of a step of `h` [s].

        Leading axes are a batch of steps.
        """


def require_method(method: AbstractIncrement | None) -> None:
    """Raise a ValueError unless `method` is an integration method or None."""
    expected = "an integration method, GaussLegendre(stages=8) or Magnus(order=6), or None"
    require_type(method, AbstractIncrement | None, "method", expected)


def increments(
    method: AbstractIncrement, rates: Float[Array, "n s k"], h: Float[Array, " n"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Return the unit increments (n, 4) and the log-scales ½∫ω0 (n,) of n steps of lengths `h` (n,) [s].

    The axes of `rates` (n, s, k) are steps, nodes, and components: three, or four with the scalar part first.
    """
    rotations = _rotations(method, rates[:, :, -3:], h)
    if rates.shape[2] == 3:
        return rotations, xp.zeros_like(h)
    return rotations, 0.5 * h * matmul(rates[:, :, 0], constant(method.weights, h))


def _rotations(method: AbstractIncrement, rates: Float[Array, "n s 3"], h: Float[Array, " n"]) -> Float[Array, "n 4"]:
    if h.shape[0] <= BLOCK:
        return method.increment(rates, h)
    if is_host(rates, h):
        return xp.concatenate(
            [method.increment(rates[k : k + BLOCK], h[k : k + BLOCK]) for k in range(0, len(h), BLOCK)]
        )
    return jax.lax.map(lambda step: method.increment(*step), (rates, h), batch_size=BLOCK)


def products(rotations: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """Return the products E_1∘…∘E_k of the first k increments, for every k (see `SEQUENTIAL`)."""
    if is_host(rotations):
        return _parallel_products(rotations)
    if rotations.shape[0] > SEQUENTIAL:
        return jax.lax.associative_scan(quaternion.product, rotations)

    def multiply(total: Quat, rotation: Quat) -> tuple[Quat, Quat]:
        total = quaternion.product(total, rotation)
        return total, total

    identity = jnp.zeros_like(rotations, shape=4).at[0].set(1.0)
    return jax.lax.scan(multiply, identity, rotations)[1]


def _parallel_products(rotations: Any) -> Any:
    """Return the `products` from the products of pairs, in a number of operations that grows with the logarithm."""
    if len(rotations) < 2:
        return rotations
    pairs = _parallel_products(quaternion.product(rotations[:-1:2], rotations[1::2]))
    totals = np.empty_like(rotations)
    totals[0], totals[1::2] = rotations[0], pairs
    totals[2::2] = quaternion.product(pairs[: len(rotations[2::2])], rotations[2::2])
    return totals


def accumulate(q0: Quat, rotations: Float[Array, "n 4"], log_scales: Float[Array, " n"]) -> Float[Array, "n 4"]:
    """Return the quaternion after each increment, from the initial `q0`, with the norm |q0|·exp(Σ log_scales)."""
    totals = products(rotations)
    totals = totals / xp.sqrt(xp.sum(totals * totals, axis=1, keepdims=True))  # removes round-off only
    return quaternion.product(q0, totals) * xp.exp(xp.cumsum(log_scales))[:, None]


def to_body(q0: Quat, rates: Float[Array, "n s k"], axes: str) -> tuple[Quat, Float[Array, "n s k"]]:
    """Return the initial quaternion and the rates of the equivalent problem in body axes.

    If the rates are in inertial axes, the quaternion and the rates are conjugated.
    """
    if axes == "body":
        return q0, rates
    return quaternion.conjugate(q0), xp.concatenate([rates[:, :, :-3], -rates[:, :, -3:]], axis=2)


def from_body(qs: Float[Array, "n 4"], axes: str) -> Float[Array, "n 4"]:
    """Return the solution in the original axes, by the inverse of `to_body`."""
    return qs if axes == "body" else quaternion.conjugate(qs)


def propagated(
    method: AbstractIncrement, axes: str, q0: Quat, rates: Float[Array, "n s k"], h: Float[Array, " n"]
) -> Float[Array, "n 4"]:
    """Return the quaternion after each of n steps of lengths `h` (n,) [s], from `q0` and the rates at the nodes."""
    start, body_rates = to_body(q0, rates, axes)
    return from_body(accumulate(start, *increments(method, body_rates, h)), axes)


def as_inputs(result: Any, inputs: Any) -> Any:
    """Return results of NumPy as JAX arrays if an input is a JAX array, in the widest float dtype of the inputs."""
    if is_host(*inputs):
        return result
    arrays = [x for x in inputs if not is_host(x)]
    return to_jax(result, float_dtype(x.dtype for x in arrays), device_of(arrays))


def constant(x: Any, like: Any) -> Any:
    """Return constants in the dtype of the array `like`."""
    return np.asarray(x, like.dtype)
