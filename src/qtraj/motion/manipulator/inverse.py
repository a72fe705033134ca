"""Compute joint accelerations for an acceleration of the gripper, by least squares with damping near singularities.

Let J be the Jacobian, q̇ the joint rates, and b the desired acceleration of the gripper minus J̇q̇. The joint
accelerations are q̈ = Jᵀ(JJᵀ + ρ²I)⁻¹ b with the identity matrix I. Without damping (ρ = 0), q̈ is the solution of Jq̈ = b
with the smallest norm. If the smallest singular value σ of J is below a threshold σ₀, q̈ is kept bounded by the damping
ρ² = (1 − (σ/σ₀)²) ρ₀² (Chiaverini, Siciliano and Egeland, 1994). Jq̈ then deviates from b in the nearly singular
directions.
"""

import equinox as eqx
import jax.numpy as jnp
from jax.lax import stop_gradient
from jaxtyping import Array, Float

from qtraj.foundation.arrays import concrete, real_scalar, require_finite, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar


@storable
class Damping(eqx.Module):
    """The damping of joint accelerations near singularities.

    `threshold` σ₀: damping is active if the smallest singular value of the Jacobian (in rad and m) is below σ₀.
    `largest` ρ₀: the value of ρ at a singularity. `idle` [1/s]: the decay rate of joint motion that does not move the
    gripper, for arms with redundant joints.

    **Raises:** ValueError for a threshold or damping that is not positive, or a decay rate that is negative or not
    finite.
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
        value = concrete(self.idle)
        if value is not None and value < 0:
            raise ValueError(f"the decay rate 'idle' must not be negative [1/s], but {value.tolist()} was given")


def smallest_singular_value(jacobian: Float[Array, "m n"]) -> Scalar:
    """Return the smallest singular value σ of J; σ is 0 if the gripper cannot move in some direction.

    σ is treated as a constant in differentiation.
    """
    square = jnp.linalg.eigvalsh(stop_gradient(_gram(jacobian)))[0]
    return jnp.sqrt(jnp.maximum(square, 0.0))


def joint_accelerations(
    jacobian: Float[Array, "m n"], target: Float[Array, " m"], joint_rates: Float[Array, " n"], damping: Damping
) -> Float[Array, " n"]:
    """Return joint accelerations q̈ with Jq̈ = `target` if damping is not active; J is `jacobian`.

    The joint motion that does not move the gripper decays at the rate `damping.idle`.
    """
    sigma, threshold = smallest_singular_value(jacobian), damping.threshold.astype(target.dtype)
    damping_sq = jnp.maximum(1 - (sigma / threshold) ** 2, 0.0) * damping.largest.astype(target.dtype) ** 2
    gram = _gram(jacobian) + damping_sq * jnp.eye(jacobian.shape[0], dtype=jacobian.dtype)
    gripper_rate = _matmul(jacobian, joint_rates)
    idle = damping.idle.astype(target.dtype)
    # With J⁺ = Jᵀ(JJᵀ + ρ²I)⁻¹, one solve computes the sum of −idle·(q̇ − J⁺Jq̇) and J⁺·target.
    return _matmul(jacobian.T, jnp.linalg.solve(gram, target + idle * gripper_rate)) - idle * joint_rates


def _gram(jacobian: Float[Array, "m n"]) -> Float[Array, "m m"]:
    return _matmul(jacobian, jacobian.T)


def _matmul(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision="highest")
