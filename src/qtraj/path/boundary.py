"""Define boundary states: position, velocity and optional acceleration at the start or the end of a path."""

import equinox as eqx
import numpy as np

from qtraj.algebra.vector import dot, norm, unit
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import real_vector, warn_if_coarse
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy_or_jit, xp
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, vector_text
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.path.placement import Placement


@storable
class BoundaryState(AbstractResult):
    """Position [m], velocity [m/s] and, optionally, acceleration [m/s²], (3,) each, in world axes.

    Boundary states are the input of boundary problems. `path.state(t)` returns the state of a path at one instant.

    **Raises:** ValueError for wrong shapes or values that are not finite.
    """

    position: Vec3
    velocity: Vec3
    acceleration: Vec3 | None

    def __init__(self, position: ArrayInput, velocity: ArrayInput, acceleration: ArrayInput | None = None):
        self.position = real_vector(position, "the position of a boundary state", 3)
        self.velocity = real_vector(velocity, "the velocity of a boundary state", 3)
        self.acceleration = (
            None if acceleration is None else real_vector(acceleration, "the acceleration of a boundary state", 3)
        )
        warn_if_coarse(position, "the position of a boundary state")

    def record(self) -> Record:
        """Return labelled arrays of the fields that are not None; for a batch of states, batch axes come first."""
        columns = {
            "position": Quantity(self.position, "m", "position, world axes", ("world",)),
            "velocity": Quantity(self.velocity, "m s-1", "velocity, world axes", ("world",)),
            "acceleration": Quantity(self.acceleration, "m s-2", "acceleration, world axes", ("world",)),
        }
        variables = {name: q for name, q in columns.items() if q.values is not None}
        return Record(self._summary(), variables, attributes={"frame": "world"})

    def _summary(self) -> str:
        if self.position.ndim > 1:
            speed = extent(np.linalg.norm(np.asarray(self.velocity), axis=-1), "m s-1")
            return f"{batch_prefix(self.position.shape[:-1])}|velocity| {speed}"
        text = f"position {vector_text(self.position)} m, velocity {vector_text(self.velocity)} m/s"
        return text if self.acceleration is None else f"{text}, acceleration {vector_text(self.acceleration)} m/s²"


def require_states(start: BoundaryState, end: BoundaryState) -> None:
    """Raise a ValueError if `start` or `end` is not a boundary state."""
    for name, state in (("start", start), ("end", end)):
        require_type(state, BoundaryState, name, "a BoundaryState, such as BoundaryState(position, velocity)")


class Cylindrical(eqx.Module):
    """A boundary state in cylindrical coordinates: `radius` ρ [m], `azimuth` φ [rad] and `height` h [m].

    `velocity` [m/s] and `acceleration` [m/s²] have components along the radial direction e_ρ, the azimuthal direction
    e_φ and the axis. `planar` (3,) [m] is the position without its axial component, in the axes of the placement.
    Azimuth differences are computed from `planar`, because the subtraction of two azimuths loses digits. `rounding`
    [rad] is the error of the azimuth due to rounding of the coordinates.
    """

    radius: Scalar
    azimuth: Scalar
    height: Scalar
    velocity: Vec3
    acceleration: Vec3 | None
    planar: Vec3
    rounding: Scalar

    @property
    def rate(self) -> Scalar:
        """The angular rate φ̇ = V_φ/ρ about the axis [rad/s], with the azimuthal velocity V_φ and the radius ρ.

        If ρ is zero, the divisor is 1.
        """
        return self.velocity[1] / xp.where(self.radius > 0, self.radius, 1.0)

    @property
    def radial_acceleration(self) -> Scalar:
        """The second derivative of the radius, ρ̈ = a_ρ + ρ φ̇² [m/s²]; the state must have an acceleration.

        a_ρ is the radial component of the acceleration, and φ̇ is the angular rate about the axis.
        """
        return _required(self.acceleration)[0] + self.radius * self.rate**2

    @property
    def angular_acceleration(self) -> Scalar:
        """The second derivative of the azimuth, φ̈ = (a_φ − 2 ρ̇ φ̇)/ρ [rad/s²]; the state must have an acceleration.

        a_φ is the azimuthal component of the acceleration, ρ the radius, and φ̇ the angular rate about the axis.
        """
        return (_required(self.acceleration)[1] - 2 * self.velocity[0] * self.rate) / self.radius


@in_numpy_or_jit
def cylindrical(state: BoundaryState, placement: Placement | None, eps: float | None = None) -> Cylindrical:
    """Convert `state` to cylindrical components about the axis of `placement`; None means the world's z axis.

    `eps` is the machine epsilon of the coordinates, by default the machine epsilon of the computation.
    """
    placement = Placement() if placement is None else placement
    x, y, z = placement.to_local(state.position - placement.origin.astype(state.position.dtype))
    planar = xp.stack([x, y, xp.zeros_like(x)])
    radius = norm(planar)
    # On the axis the radial direction is undefined. A fixed direction keeps the derivatives finite.
    cos, sin, _ = unit(planar, xp.stack([xp.ones_like(x), xp.zeros_like(x), xp.zeros_like(x)]))
    largest = xp.maximum(xp.max(abs(state.position)), xp.max(abs(placement.origin.astype(x.dtype))))

    def components(v: Vec3) -> Vec3:
        a, b, c = placement.to_local(v)
        return xp.stack([a * cos + b * sin, b * cos - a * sin, c])

    return Cylindrical(
        radius=radius,
        azimuth=xp.arctan2(sin, cos),
        height=z,
        velocity=components(state.velocity),
        acceleration=None if state.acceleration is None else components(state.acceleration),
        planar=planar,
        rounding=(float(xp.finfo(x.dtype).eps) if eps is None else eps)
        * (1 + largest / xp.where(radius > 0, radius, 1.0)),
    )


def azimuth_difference(start: Cylindrical, end: Cylindrical) -> Scalar:
    """Return the azimuth of `end` minus the azimuth of `start`, in (−π, π] [rad]."""
    a, b = start.planar, end.planar
    difference = xp.arctan2(a[0] * b[1] - a[1] * b[0], dot(a, b))
    return xp.where(difference <= -xp.pi, -difference, difference)


def _required(acceleration: Vec3 | None) -> Vec3:
    if acceleration is None:
        raise ValueError("the boundary state needs an acceleration, but acceleration=None was given")
    return acceleration
