"""One step of 2λ̇ = λ∘ω(t) with a known rate: the turn between two instants, and the product of many turns.

The steps are independent of each other, so all are computed at once and multiplied in parallel. Everything here is in
body axes; inertial axes follow by conjugation, λ̄(ω_ξ) = λ(−ω_x), which flips every cross product. The scalar part of
the rate commutes and is carried apart: λ(t+h) = e^{½∫ω0}·λ(t)∘(unit turn).
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
"""Matrix product in full precision: an accelerator would round float32 to about four digits."""

BLOCK = 1024
"""Steps computed at a time: enough for the processor's vector units, few enough for its caches."""

SEQUENTIAL = 64
"""So few turns are multiplied one after the other: that is faster than in parallel, to run and much more to compile."""


class AbstractIncrement(eqx.Module):
    """A rule that turns the rates at the nodes of one step into the quaternion of its turn."""

    order: eqx.AbstractVar[int]
    """The global order: the error of a fixed interval falls as h^order."""

    @property
    @abc.abstractmethod
    def nodes(self) -> np.ndarray:
        """Where in the step the rate is wanted, as parts of it (s,)."""

    @property
    @abc.abstractmethod
    def weights(self) -> np.ndarray:
        """Quadrature weights of the nodes (s,), of the same order."""

    @abc.abstractmethod
    def turn(self, rates: Float[Array, "s 3"], h: Scalar) -> Quat:
        """The unit quaternion E of the turn over `h` [s], λ(t+h) = λ(t)∘E, from `rates` [rad/s] at the nodes."""


def increments(
    method: AbstractIncrement, rates: Float[Array, "n s k"], h: Float[Array, " n"]
) -> tuple[Float[Array, "n 4"], Float[Array, " n"]]:
    """Unit turns (n, 4) and growths ½∫ω0 (n,) of n steps of `h` [s]; `rates` of three or four components."""

    def one(step):
        return method.turn(*step)

    steps = rates[:, :, -3:], h
    turns = jax.vmap(one)(steps) if h.shape[0] <= BLOCK else jax.lax.map(one, steps, batch_size=BLOCK)
    if rates.shape[2] == 3:
        return turns, jnp.zeros_like(h)
    return turns, 0.5 * h * exact_product(rates[:, :, 0], jnp.asarray(method.weights, h.dtype))


def products(turns: Float[Array, "n 4"]) -> Float[Array, "n 4"]:
    """E_1∘…∘E_k for every k, in parallel where there are many."""
    if turns.shape[0] > SEQUENTIAL:
        return jax.lax.associative_scan(jax.vmap(quaternion.product), turns)

    def onwards(total, turn):
        total = quaternion.product(total, turn)
        return total, total

    identity = jnp.zeros_like(turns, shape=4).at[0].set(1.0)
    return jax.lax.scan(onwards, identity, turns)[1]


def accumulate(q0: Quat, turns: Float[Array, "n 4"], growths: Float[Array, " n"]) -> Float[Array, "n 4"]:
    """q0 after each of the turns; the length is |q0|·exp(Σ growths) to round-off."""
    totals = products(turns)
    totals = totals / jnp.sqrt(jnp.sum(totals * totals, axis=1, keepdims=True))  # only round-off is divided away
    return jax.vmap(quaternion.product, (None, 0))(q0, totals) * jnp.exp(jnp.cumsum(growths))[:, None]


def to_body(q0: Quat, rates: Float[Array, "n s k"], axes: str) -> tuple[Quat, Float[Array, "n s k"]]:
    """The initial quaternion and the rates of the equivalent problem in body axes: conjugates for inertial axes."""
    if axes == "body":
        return q0, rates
    return quaternion.conjugate(q0), jnp.concatenate([rates[:, :, :-3], -rates[:, :, -3:]], axis=2)


def from_body(qs: Float[Array, "n 4"], axes: str) -> Float[Array, "n 4"]:
    """Undoes `to_body` in the solution."""
    return qs if axes == "body" else jax.vmap(quaternion.conjugate)(qs)
