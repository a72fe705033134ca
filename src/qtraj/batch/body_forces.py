"""Compute components of the force that moves a vehicle along a path, and of the moment that rotates the vehicle.

The module `qtraj.path.contact` computes the components of the same force relative to the road.
"""

from typing import Any

from qtraj.path.components import Triple, add_vectors, cross
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import Vehicle


def path_force(road: RoadParameters, derivatives: list[Triple], up: Triple, speed: Any) -> Triple:
    """Return the force m(r'' + g·up) + ½ρC_dA v r' [N] at the speed v = `speed`, in the axes of the derivatives.

    `derivatives` contains r and its time derivatives r' and r''. `up` is the unit vector of the vertical. The mass m,
    the gravitational acceleration g and the drag term ½ρC_dA/m (`drag`) are parameters of `road`.
    """
    terms = zip(derivatives[2], up, derivatives[1], strict=True)
    x, y, z = (road.mass * (a + road.gravity * u + road.drag * speed * v) for a, u, v in terms)
    return x, y, z


def turning_moment(vehicle: Vehicle, rate: Triple, acceleration: Triple) -> Triple:
    """Return the moment Jε + ω×Jω [N m] on a vehicle with the inertia J, in the axes of the frame.

    ω = `rate` [rad/s] and ε = `acceleration` [rad/s²] describe the rotation of the frame, in its own axes.
    """
    J: Any = vehicle.inertia_in_frame().astype(rate[0].dtype)

    def entry(k: int, m: int) -> Any:
        return J[k, m] if J.ndim == 2 else J[:, k, m, None]  # one vehicle, or one for each path

    def momentum(v: Triple) -> Triple:
        x, y, z = (entry(k, 0) * v[0] + entry(k, 1) * v[1] + entry(k, 2) * v[2] for k in range(3))
        return x, y, z

    return add_vectors(momentum(acceleration), cross(rate, momentum(rate)))
