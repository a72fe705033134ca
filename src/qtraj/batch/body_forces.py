"""The force that moves a vehicle along a path, and the moment that turns it with a frame, in components."""

from typing import Any

import jax.numpy as jnp

from qtraj.path.components import Triple, add_vectors, cross
from qtraj.path.vehicle import RoadParameters, Vehicle


def path_force(road: RoadParameters, derivatives: list[Triple], up: Triple, speed: Any) -> Triple:
    """m(r'' + g·up) + ½ρC_dA v r' [N], against inertia, gravity and drag, in the axes of the derivatives."""
    terms = zip(derivatives[2], up, derivatives[1], strict=True)
    x, y, z = (road.mass * (a + road.gravity * u + road.drag * speed * v) for a, u, v in terms)
    return x, y, z


def turning_moment(vehicle: Vehicle, rate: Triple, acceleration: Triple) -> Triple:
    """Jε + ω×Jω [N m] in the vehicle's axes."""
    J: Any = jnp.asarray(vehicle.inertia, rate[0].dtype)

    def momentum(v: Triple) -> Triple:
        x, y, z = (J[k, 0] * v[0] + J[k, 1] * v[1] + J[k, 2] * v[2] for k in range(3))
        return x, y, z

    return add_vectors(momentum(acceleration), cross(rate, momentum(rate)))
