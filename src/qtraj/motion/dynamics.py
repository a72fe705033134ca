"""Compute torques on a body, and the forces on a vehicle that follows a path (conclusions of papers C and S).

An inertia [kg m²] is a scalar J for a spherical body (paper C, remark 2), an array (3,) of principal moments, or a
tensor (3, 3) in body axes. Gravity is the vector g⃗ (3,) [m/s²] in world axes, or a number g for (0, 0, −g).

`forces`, `power` and `friction_demand` compute the quantities of the papers at one instant, for a point mass without
drag, rolling resistance or bank. Use a `Vehicle` to include these effects, and for limits, proofs and tuning. With a
`Vehicle`, `evaluate` also returns `force`, `moment`, `power`, `friction` and other outputs. For the same mass and
gravity, a `Vehicle` with default values of all other parameters results in the same force, power and friction.
"""

import numpy as np

from qtraj.algebra.inertia import inertia_matrix
from qtraj.algebra.vector import cross, dot, norm
from qtraj.foundation.arrays import as_float, real_vector, require_finite, require_positive
from qtraj.foundation.namespace import in_numpy, matmul, namespace, of_arrays, xp
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Mat3, Scalar, ScalarLike, Vec3
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
"""Last part of the descriptions of both ratios in a `FrictionDemand`."""


def __dir__() -> list[str]:
    return __all__


@in_numpy
def torque(attitude: Attitude, inertia: ArrayInput) -> Vec3:
    """Return the torque M = Jε + ω×Jω [N m] in body axes; M = Jε for a spherical body (paper C, remark 2).

    J is the inertia; ω and ε are the rate and the acceleration (..., 3) of the attitude.

    **Raises:** ValueError for an attitude in inertial axes, and for an inertia that has another shape or is not
    symmetric and positive definite.
    """
    require_body_axes(attitude)
    J = inertia_matrix(inertia).astype(attitude.rate.dtype)
    return _times(J, attitude.acceleration) + cross(attitude.rate, _times(J, attitude.rate))


@of_arrays
def acceleration(torque: Vec3, rate: Vec3, inertia: ArrayInput) -> Vec3:
    """Return the angular acceleration ε = J⁻¹(M − ω×Jω) [rad/s²] in body axes, the inverse of `torque`.

    M = `torque` [N m] and ω = `rate` [rad/s] (..., 3) are in body axes. J is the inertia.

    **Raises:** ValueError for an inertia that has another shape or is not symmetric and positive definite.
    """
    J = inertia_matrix(inertia).astype(torque.dtype)
    net = torque - cross(rate, _times(J, rate))
    return namespace(J, net).linalg.solve(J, net[..., None])[..., 0]


@in_numpy
def rotational_power(attitude: Attitude, inertia: ArrayInput) -> Scalar:
    """Return the power M·ω [W] of the torque M at the rate ω, the time derivative of the kinetic energy ½ω·Jω.

    **Raises:** ValueError in the same cases as `torque`.
    """
    return dot(torque(attitude, inertia), attitude.rate)


def _times(J: Mat3, v: Vec3) -> Vec3:
    """Return J v for one vector or a batch (..., 3)."""
    return matmul(v, J.T)


def forces(
    path: AbstractHodograph,
    t: ScalarLike,
    mass: ArrayInput,
    gravity: ArrayInput,
    frame: AbstractFrame | None = None,
) -> Vec3:
    """Return the force F = m r̈ − m g⃗ [N] on the vehicle, excluding gravity, in the axes of the trihedral.

    m = `mass` [kg], r̈ is the acceleration of the path, and g⃗ the gravity. The components (F_τ, F_n, F_b) are the
    driving force, the side force and the lift. `frame`: None for the natural trihedral, in which the normal n points to
    the centre of curvature; `Upright()` for the components forward, left and up. The output `force` of `evaluate` with
    a `Vehicle` also includes drag.

    **Raises:** ValueError if the mass is not positive, or if the gravity has another shape or is not finite.
    """
    frame = Natural() if frame is None else frame
    at = trihedral(path, t, frame)
    return _rotated(at.dcm(), _world_force(path.acceleration(t), mass, gravity))


def power(path: AbstractHodograph, t: ScalarLike, mass: ArrayInput, gravity: ArrayInput) -> Scalar:
    """Return the power F·ṙ = m(r̈ − g⃗)·ṙ [W] of the force F of `forces` at the velocity ṙ.

    It is the time derivative of the sum of kinetic and potential energy. The path quantity `power` of a `Vehicle` also
    includes the losses by drag and rolling resistance.

    **Raises:** ValueError in the same cases as `forces`.
    """
    r = path.derivatives(t, 2)
    return _product(_world_force(r[2], mass, gravity), r[1])


class FrictionDemand(AbstractResult):
    """The lateral force, and the total force in the plane of the road, divided by the normal force, at one instant.

    F_τ is the component of `forces` along the tangent, F_side the component to the left, and F_normal the component
    normal to the road. `side`: |F_side|/F_normal. `total`: √(F_τ² + F_side²)/F_normal, which is compared with the
    coefficient of friction. Both ratios are infinite if the normal force is not positive. The frame of the forces is
    not stored.
    """

    side: Scalar
    total: Scalar

    def record(self) -> Record:
        """Return both ratios; the arrays of a batch, as returned by `jax.vmap`, have batch axes first."""
        variables = {
            "side": Quantity(self.side, "1", f"lateral force divided by normal force; {NO_CONTACT}"),
            "total": Quantity(
                self.total, "1", f"total force in the plane of the road divided by normal force; {NO_CONTACT}"
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
    """Return the coefficient of friction that the motion requires of the road, for the lateral force and in total.

    `frame`: None for `Upright()`; for a banked road, an `Upright` whose up direction is the normal of the road. The
    result does not depend on the mass. The path quantity `friction` of a `Vehicle` also accounts for drag, a bank and a
    friction ellipse.

    **Raises:** ValueError in the same cases as `forces`.
    """
    return _demand(forces(path, t, mass, gravity, Upright() if frame is None else frame))


@in_numpy
def _demand(force: Vec3) -> FrictionDemand:
    contact = force[2] > 0
    normal = xp.where(contact, force[2], 1.0)
    side, total = abs(force[1]) / normal, norm(force[:2]) / normal
    return FrictionDemand(xp.where(contact, side, xp.inf), xp.where(contact, total, xp.inf))


@of_arrays
def _rotated(dcm: Mat3, force: Vec3) -> Vec3:
    return matmul(dcm, force)


_product = of_arrays(dot)


@in_numpy
def _world_force(acceleration: Vec3, mass: ArrayInput, gravity: ArrayInput) -> Vec3:
    mass, gravity = as_float(mass), as_float(gravity)
    require_positive(mass, "the mass", "kg")
    require_finite(gravity, "gravity")
    if gravity.ndim == 0:
        gravity = xp.stack([xp.zeros_like(gravity), xp.zeros_like(gravity), -gravity])
    gravity = real_vector(gravity, "gravity, a number or a vector,", 3)
    return mass.astype(acceleration.dtype) * (acceleration - gravity.astype(acceleration.dtype))
