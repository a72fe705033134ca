"""Joint accelerations that give the gripper an acceleration: least squares, damped where the arm is singular.

q̈ = Jᵀ(JJᵀ + ρ²I)⁻¹ b is the shortest q̈ with Jq̈ = b where ρ = 0. Near a singularity, where the smallest singular value
σ of J falls below a threshold σ₀, ρ² = (1 − (σ/σ₀)²) ρ₀² keeps q̈ bounded (Chiaverini, Siciliano and Egeland, 1994): the
acceleration of the gripper is then smaller than commanded, in the direction in which it can hardly move.
"""

import equinox as eqx
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.arrays import real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar


@storable
class Damping(eqx.Module):
    """How joint accelerations are bounded near singularities.

    `threshold` σ₀: smallest singular value of the Jacobian, in rad and m, below which damping begins. `largest` ρ₀: at
    the singularity itself. `idle` [1/s]: the decay rate of joint motion that does not move the gripper, for
    arms with redundant joints.

    **Raises:** ValueError for numbers that are not positive (`idle`: negative).
    """

    threshold: Scalar
    largest: Scalar
    idle: Scalar

    def __repr__(self) -> str:
        return shown(self, idle="1/s")

    def __init__(self, threshold: ArrayInput = 0.05, largest: ArrayInput = 0.05, idle: ArrayInput = 1.0):
        self.threshold, self.largest = real_scalar(threshold, "the threshold"), real_scalar(largest, "largest")
        self.idle = real_scalar(idle, "idle")
        require_positive(self.threshold, "the threshold of damping", "rad, m")
        require_positive(self.largest, "the largest damping", "rad, m")
        require_finite(self.idle, "idle")


def smallest_singular_value(jacobian: Float[Array, "m n"]) -> Scalar:
    """σ, the smallest singular value of J: 0 where the gripper cannot be moved in some direction."""
    square = jnp.linalg.eigvalsh(stop_gradient(_gram(jacobian)))[0]
    return jnp.sqrt(jnp.maximum(square, 0.0))


def joint_accelerations(
    jacobian: Float[Array, "m n"], wanted: Float[Array, " m"], joint_rates: Float[Array, " n"], damping: Damping
) -> Float[Array, " n"]:
    """q̈ with Jq̈ = `wanted` as closely as the damping permits; joint motion that does not move the gripper decays."""
    sigma, threshold = smallest_singular_value(jacobian), damping.threshold.astype(wanted.dtype)
    share = jnp.maximum(1 - (sigma / threshold) ** 2, 0.0) * damping.largest.astype(wanted.dtype) ** 2
    gram = _gram(jacobian) + share * jnp.eye(jacobian.shape[0], dtype=jacobian.dtype)
    felt = _matmul(jacobian, joint_rates)
    idle = damping.idle.astype(wanted.dtype)
    # −idle·(q̇ − J⁺Jq̇) and J⁺·wanted, in one solve.
    return _matmul(jacobian.T, jnp.linalg.solve(gram, wanted + idle * felt)) - idle * joint_rates


def _gram(jacobian: Float[Array, "m n"]) -> Float[Array, "m m"]:
    return _matmul(jacobian, jacobian.T)


def _matmul(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision="highest")
