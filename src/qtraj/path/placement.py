"""Define the position and orientation of a path's own axes in the world."""

import equinox as eqx

from qtraj.algebra import quaternion
from qtraj.foundation.arrays import concrete, real_vector, warn_if_coarse
from qtraj.foundation.document import storable
from qtraj.foundation.float_arguments import float_arguments
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Vec3


@storable
class Placement(eqx.Module):
    """The position and orientation of a path's own axes in the world; the z axis is the axis of the path.

    `origin` (3,) [m] is a point on the axis in world coordinates. `orientation` (4,) is a quaternion of any nonzero
    norm from the path's axes to world axes. For a vertical axis, only the origin is needed.

    **Raises:** ValueError for wrong shapes, values that are not finite, or a zero quaternion.
    """

    origin: Vec3
    orientation: Quat

    def __init__(self, origin: ArrayInput = (0.0, 0.0, 0.0), orientation: ArrayInput = (1.0, 0.0, 0.0, 0.0)):
        self.origin = real_vector(origin, "the origin of a placement", 3)
        self.orientation = real_vector(orientation, "the orientation of a placement", 4)
        warn_if_coarse(origin, "the origin of a placement")
        orientation_value = concrete(self.orientation)
        if orientation_value is not None and not orientation_value.any():
            raise ValueError("the orientation of a placement must be a nonzero quaternion, but all components are 0")

    def __repr__(self) -> str:
        return shown(self, origin="m")

    @float_arguments
    def to_world(self, vector: Vec3) -> Vec3:
        """Convert free vectors (..., 3) from the path's axes to world components."""
        return quaternion.rotate(_like(self.orientation, vector), vector)

    @float_arguments
    def to_local(self, vector: Vec3) -> Vec3:
        """Convert free vectors (..., 3) from world components to the path's axes."""
        return quaternion.rotate(quaternion.conjugate(_like(self.orientation, vector)), vector)


def _like(orientation: Quat, vector: Vec3) -> Quat:
    """Return the orientation with the dtype and the number of axes of `vector`."""
    return orientation.astype(vector.dtype).reshape((1,) * (vector.ndim - orientation.ndim) + orientation.shape)
