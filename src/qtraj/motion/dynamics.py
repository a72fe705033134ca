"""Torques on a body, and the forces that a vehicle needs to follow a path (conclusions of papers C and S).

Inertias are a scalar J for a spherical body (paper C, remark 2), (3,) principal moments, or a (3, 3) tensor in body
axes [kg m²]. Gravity is the vector g⃗ (3,) [m/s²] in world axes, or a number g for (0, 0, −g).
"""

import jax.numpy as jnp
import numpy as np

from qtraj.algebra.inertia import inertia_matrix
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, real_vector, require_finite, require_positive
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.motion.attitude import Attitude, require_body_axes
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame, Natural, Upright, trihedral

__all__ = [
    "FrictionDemand",
    "acceleration",
    "forces",
    "friction_demand",
    "inertia_matrix",
    "power",
    "rotational_power",
    "torque",
]

NO_CONTACT = "infinite if the normal force is not positive"
"""Suffix of the description of a friction demand."""


def __dir__() -> list[str]:
    return __all__


def torque(attitude: Attitude, inertia: ArrayInput) -> Vec3:
    """M = Jε + ω×Jω [N m] in body axes; for a spherical body M = Jε (paper C, remark 2).

    **Raises:** ValueError for an inertia of another shape, or one that is not symmetric and positive definite.
    """
    require_body_axes(attitude)
    J = inertia_matrix(inertia).astype(attitude.rate.dtype)
    momentum = jnp.matmul(J, attitude.rate, precision="highest")
    return jnp.matmul(J, attitude.acceleration, precision="highest") + jnp.cross(attitude.rate, momentum)


def acceleration(torque: Vec3, rate: Vec3, inertia: ArrayInput) -> Vec3:
    """ε = J⁻¹(M − ω×Jω) [rad/s²] in body axes: the inverse of `torque`.

    **Raises:** ValueError in the same cases as `torque`.
    """
    J = inertia_matrix(inertia).astype(torque.dtype)
    momentum = jnp.matmul(J, rate, precision="highest")
    return jnp.linalg.solve(J, torque - jnp.cross(rate, momentum))


def rotational_power(attitude: Attitude, inertia: ArrayInput) -> Scalar:
    """M·ω [W]: the power of the torque, equal to the time derivative of ½ω·Jω.

    **Raises:** ValueError in the same cases as `torque`.
    """
    return torque(attitude, inertia) @ attitude.rate


def forces(
    path: AbstractHodograph,
    t: ScalarLike,
    mass: ArrayInput,
    gravity: ArrayInput,
    frame: AbstractFrame | None = None,
) -> Vec3:
    """F = m r̈ − m g⃗ [N] in the axes of the trihedral: (F_τ, F_n, F_b), that is drive, side force and lift.

    `mass` [kg]. `frame`: None for the natural trihedral, whose n points to the centre of curvature;
    `Upright()` for the components forward, to the left and up.

    **Raises:** ValueError for a mass that is not positive, or a gravity of another shape.
    """
    frame = Natural() if frame is None else frame
    at = trihedral(path, t, frame)
    return jnp.matmul(at.dcm(), _world_force(path.acceleration(t), mass, gravity), precision="highest")


def power(path: AbstractHodograph, t: ScalarLike, mass: ArrayInput, gravity: ArrayInput) -> Scalar:
    """F·ṙ = m(r̈ − g⃗)·ṙ [W]: the time derivative of the kinetic and potential energy.

    **Raises:** ValueError in the same cases as `forces`.
    """
    r = path.derivatives(t, 2)
    return _world_force(r[2], mass, gravity) @ r[1]


class FrictionDemand(AbstractResult):
    """Tangential divided by normal force at the road, at one instant; infinite if the normal force is not positive.

    `side`: |F_side|/F_normal. `total`: √(F_τ² + F_side²)/F_normal, to compare with the coefficient of friction. Like a
    `Trihedral`, it does not store the frame.
    """

    side: Scalar
    total: Scalar

    def record(self) -> Record:
        """The two numbers. A batch, as from `jax.vmap`, adds its dimensions in front."""
        variables = {
            "side": Quantity(self.side, "1", f"lateral force divided by normal force; {NO_CONTACT}"),
            "total": Quantity(
                self.total, "1", f"√(longitudinal² + lateral²) force divided by normal force; {NO_CONTACT}"
            ),
        }
        airborne = np.isinf(np.asarray(self.total))
        note = "" if not airborne.any() else f", {'' if airborne.all() else 'partly '}without contact with the road"
        summary = f"{batch_prefix(self.total.shape)}side {extent(self.side)}, total {extent(self.total)}{note}"
        return Record(summary, variables, attributes={"frame": "trihedral"})


def friction_demand(
    path: AbstractHodograph,
    t: ScalarLike,
    mass: ArrayInput,
    gravity: ArrayInput,
    frame: AbstractFrame | None = None,
) -> FrictionDemand:
    """The friction coefficient that the road must provide, from the forward, lateral and normal force.

    `frame`: None for `Upright()`; for a banked road, an `Upright` with the road's normal as the up direction. The
    demand does not depend on the mass.

    **Raises:** ValueError in the same cases as `forces`.
    """
    force = forces(path, t, mass, gravity, Upright() if frame is None else frame)
    contact = force[2] > 0
    normal = jnp.where(contact, force[2], 1.0)
    side, total = jnp.abs(force[1]) / normal, norm(force[:2]) / normal
    return FrictionDemand(jnp.where(contact, side, jnp.inf), jnp.where(contact, total, jnp.inf))


def _world_force(acceleration: Vec3, mass: ArrayInput, gravity: ArrayInput) -> Vec3:
    mass, gravity = as_float(mass), as_float(gravity)
    require_positive(mass, "the mass", "kg")
    require_finite(gravity, "gravity")
    if gravity.ndim == 0:
        gravity = jnp.zeros_like(gravity, shape=3).at[2].set(-gravity)
    gravity = real_vector(gravity, "gravity, a number or a vector,", 3)
    return mass.astype(acceleration.dtype) * (acceleration - gravity.astype(acceleration.dtype))
