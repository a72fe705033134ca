"""Titles and column headers of the printed tables of a path; the tables are at most 80 characters wide."""

from collections.abc import Container

from qtraj.path.frame_axes import axes_of
from qtraj.path.moment_quantities import MOMENT_QUANTITIES
from qtraj.path.road_quantities import ROAD_QUANTITIES

MOTION = {"position": ["x", "y", "z"], "speed": ["speed"], "curvature": ["κ"], "torsion": ["χ"]}
QUATERNION = ["λ0", "λ1", "λ2", "λ3"]


def path_tables(frame: str, available: Container[str]) -> dict[str, dict[str, list[str]]]:
    """Return the headers of the columns of each table by its title: motion, attitude in a `frame`, forces, moments.

    Tables with a column that is not `available` are omitted.
    """
    rates = [f"ω_{symbol}" for symbol in axes_of(frame).symbols]
    forces = {x.name: [x.name if x.unit == "1" else x.symbol] for x in ROAD_QUANTITIES}
    moments = {x.name: [x.symbol] for x in MOMENT_QUANTITIES}
    tables = {
        "t [s], position [m], speed [m/s], curvature κ and torsion χ [1/m]": MOTION,
        f"t [s], quaternion λ and rate ω [rad/s] of the {frame} frame": {"quaternion": QUATERNION, "rate": rates},
        "t [s], forces F of the road [N], friction utilisation, power P of the drive [W]": forces,
        "t [s], moments M that rotate the vehicle with the natural trihedral [N·m]": moments,
    }
    shown = {title: headers for title, headers in tables.items() if all(name in available for name in headers)}
    return {title: {"time": ["t"]} | headers for title, headers in shown.items()}
