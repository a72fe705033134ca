"""qtraj: where a vehicle must be, and how it must turn. Differentiable trajectories and orientation in JAX."""

from qtraj._version import __version__
from qtraj.algebra import quaternion, rotation
from qtraj.foundation.document import load
from qtraj.path.boundary import BoundaryState
from qtraj.path.hodograph import AbstractHodograph, Curve
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import Natural, Trihedral, Upright, trihedral

__all__ = [
    "AbstractHodograph",
    "BoundaryState",
    "Curve",
    "Natural",
    "Placement",
    "SpiralHelix",
    "Trihedral",
    "Upright",
    "__version__",
    "load",
    "quaternion",
    "rotation",
    "trihedral",
]
