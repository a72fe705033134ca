"""qtraj: where a vehicle must be, and how it must turn. Differentiable trajectories and orientation in JAX."""

from qtraj._version import __version__
from qtraj.algebra import quaternion, rotation
from qtraj.batch.evaluate import evaluate
from qtraj.batch.table import Table
from qtraj.design.certificate import Certificate
from qtraj.design.fit import fit
from qtraj.design.limits import Limits, peak
from qtraj.design.tune import Tuned, tune
from qtraj.foundation.document import load
from qtraj.io.track_file import read_track
from qtraj.path.boundary import BoundaryState
from qtraj.path.hodograph import AbstractHodograph, Curve
from qtraj.path.placement import Placement
from qtraj.path.residual import Residual
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import Track
from qtraj.path.trihedral import Natural, Trihedral, Upright, trihedral

__all__ = [
    "AbstractHodograph",
    "BoundaryState",
    "Certificate",
    "Curve",
    "Limits",
    "Natural",
    "Placement",
    "Residual",
    "SpiralHelix",
    "Table",
    "Track",
    "Trihedral",
    "Tuned",
    "Upright",
    "__version__",
    "evaluate",
    "fit",
    "load",
    "peak",
    "quaternion",
    "read_track",
    "rotation",
    "trihedral",
    "tune",
]
