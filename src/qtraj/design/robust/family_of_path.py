"""The spiral-helices near a path whose boundary states deviate within a box.

A deviation of a velocity adds a cubic that is zero at both ends and has the slope 1 at one of them, and a deviation of
an axial position adds a cubic with slopes of zero.
"""

from __future__ import annotations

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.proof.paths import polynomial_arrays, source_of
from qtraj.design.robust.box import PATH_STATES, Box
from qtraj.design.robust.family import ANGLE, Coefficients, Coordinates, Family, X, Z
from qtraj.design.robust.vehicles import with_vehicles
from qtraj.path.spiral_helix import SpiralHelix


def family_of_path(path: SpiralHelix, box: Box) -> Family:
    """Return the paths near a spiral-helix: radius, azimuth and height are the coordinates x, angle and z."""
    found = polynomial_arrays(path)
    if found is None:
        raise ValueError("the path is not polynomial: pass a SpiralHelix")
    source = source_of([np.asarray(x, float)[None] for x in found])
    radius, height, azimuth = (np.asarray(c, float) for c in (path.radius, path.height, path.angle))
    own: Coefficients = [radius, None, height, azimuth]
    names = [name for name in box.names if name in PATH_STATES]
    changes = [_changes(name, own, float(np.asarray(path.duration))) for name in names]
    sign = 1.0 if source.vertical is None or source.vertical[0, 2] > 0 else -1.0
    origin = 0.0 if path.placement is None else float(np.asarray(path.placement.origin)[2])

    def certified(
        deviations: Float[np.ndarray, "n p"], limits: Limits, vehicles: Float[np.ndarray, "n 2"] | None
    ) -> tuple[np.ndarray, np.ndarray]:
        own = limits if vehicles is None else with_vehicles(limits, vehicles)
        found = certify(paths_of(family, path, deviations), own)
        return np.asarray(found.times), np.asarray(found.values)

    family = Family(names, Coordinates(own, changes, sign, origin), source, box, certified)
    return family


def paths_of(family: Family, path: SpiralHelix, deviations: Float[np.ndarray, "n p"]) -> SpiralHelix:
    """Return the paths of a family with these deviations, as a batch."""
    c = family.coefficients(deviations)
    template = jax.tree.map(lambda x: np.broadcast_to(x, (len(deviations), *np.shape(x))), path)
    return eqx.tree_at(lambda p: (p.radius, p.angle, p.height), template, (c[X], c[ANGLE], c[Z]))


def _changes(name: str, own: Coefficients, duration: float) -> Coefficients:
    """Return the changes of the coefficients of the coordinates per unit of a deviation."""
    end, kind = name.split("_", 1)
    at = 0.0 if end == "start" else duration
    T = duration
    slope = [0.0, 1.0, -2.0 / T, 1.0 / T**2] if end == "start" else [0.0, 0.0, -1.0 / T, 1.0 / T**2]
    value = [1.0, 0.0, -3.0 / T**2, 2.0 / T**3] if end == "start" else [0.0, 0.0, 3.0 / T**2, -2.0 / T**3]
    radius, height, azimuth = (np.polynomial.Polynomial(np.asarray(own[i])) for i in (X, Z, ANGLE))
    radial, axial, rate = (float(p.deriv()(at)) for p in (radius, height, azimuth))
    speed = float(np.sqrt(radial**2 + (float(radius(at)) * rate) ** 2 + axial**2))
    if kind == "speed" and not speed > 0:
        raise ValueError(f"{name} needs a velocity that is not zero at the {end}: pass the radial or the axial speed")
    amounts = {
        "speed": (radial, axial, rate) if not speed else (radial / speed, axial / speed, rate / speed),
        "radial_speed": (1.0, 0.0, 0.0),
        "axial_speed": (0.0, 1.0, 0.0),
        "axial_position": (0.0, 1.0, 0.0),
    }[kind]
    shape = np.array(value if kind == "axial_position" else slope)
    return [amounts[0] * shape, None, amounts[1] * shape, amounts[2] * shape]
