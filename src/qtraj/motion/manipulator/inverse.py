"""Joint accelerations for an acceleration of the gripper: least squares, damped near singularities.

For ρ = 0, q̈ = Jᵀ(JJᵀ + ρ²I)⁻¹ b is the smallest q̈ with Jq̈ = b. If the smallest singular value σ of J is below a
threshold σ₀, ρ² = (1 − (σ/σ₀)²) ρ₀² keeps q̈ bounded (Chiaverini, Siciliano and Egeland, 1994). The acceleration of the
gripper then deviates from the command in the nearly singular directions.
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
    """Damping of the joint accelerations near singularities.

    `threshold` σ₀: damping is active if the smallest singular value of the Jacobian (in rad and m) is below it.
    `largest` ρ₀: the damping at a singularity. `idle` [1/s]: for arms with redundant joints, the decay rate of joint
    motion that does not move the gripper.

    **Raises:** ValueError for a threshold or damping that is not positive, or a decay rate that is not finite.
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
    """The smallest singular value σ of J: 0 if the joints cannot move the gripper in some direction."""
    square = jnp.linalg.eigvalsh(stop_gradient(_gram(jacobian)))[0]
    return jnp.sqrt(jnp.maximum(square, 0.0))


def joint_accelerations(
    jacobian: Float[Array, "m n"], target: Float[Array, " m"], joint_rates: Float[Array, " n"], damping: Damping
) -> Float[Array, " n"]:
    """q̈ with Jq̈ = `target`, apart from the damping; joint motion that does not move the gripper decays."""
    sigma, threshold = smallest_singular_value(jacobian), damping.threshold.astype(target.dtype)
    damping_sq = jnp.maximum(1 - (sigma / threshold) ** 2, 0.0) * damping.largest.astype(target.dtype) ** 2
    gram = _gram(jacobian) + damping_sq * jnp.eye(jacobian.shape[0], dtype=jacobian.dtype)
    gripper_rate = _matmul(jacobian, joint_rates)
    idle = damping.idle.astype(target.dtype)
    # −idle·(q̇ − J⁺Jq̇) and J⁺·target, in one solve.
    return _matmul(jacobian.T, jnp.linalg.solve(gram, target + idle * gripper_rate)) - idle * joint_rates


def _gram(jacobian: Float[Array, "m n"]) -> Float[Array, "m m"]:
    return _matmul(jacobian, jacobian.T)


def _matmul(a: Array, b: Array) -> Array:
    return jnp.matmul(a, b, precision="highest")
