"""Derivatives of the constraint values in zones of the distance travelled.

The time u(z) at a fixed distance s has the derivative −s_z/s_u, where s(z, u) is the distance, z are the variables, and
u is the time divided by the duration. The value at an end of a zone is that at a fixed distance; a peak inside the zone
moves, as in `model`.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from qtraj.algebra.jets import Jet
from qtraj.design.tuning.searches import CurveJets
from qtraj.design.tuning.travelled import NODES, WEIGHTS
from qtraj.design.tuning.zones import Zone

PANELS = 4
"""Number of panels of the quadrature of the derivatives of a distance."""

DIFFERENCE = 1e-6
"""Relative change of a limit for the derivative of a constraint value with respect to it."""

AT_PLACES = ((np.arange(PANELS)[:, None] + NODES) / PANELS).ravel()
WEIGHTS_AT = np.tile(WEIGHTS / PANELS, PANELS)


class Expanded(NamedTuple):
    """Constraint values at points, and their gradients and Hessians in the variables."""

    value: Float[np.ndarray, " points"]
    gradient: Float[np.ndarray, "n points"]
    hessian: Float[np.ndarray, "n n points"]


class _Distance(NamedTuple):
    """A distance s(z, u) at points, and its derivatives."""

    value: np.ndarray
    z: np.ndarray
    zz: np.ndarray
    u: np.ndarray
    uu: np.ndarray
    zu: np.ndarray


def expand_in_zone(
    curves: CurveJets,
    zone: Zone,
    owner: Int[np.ndarray, " points"],
    time: Float[np.ndarray, " points"],
    moves: Float[np.ndarray, " points"],
) -> Expanded:
    """Return the constraint values of a zone at points, with their derivatives.

    `moves` is true for peaks, and false for points at fixed distances. Peaks at the ends of the path have fixed times.
    """
    n, own = curves.n, zone.take(owner)
    s = _distance(curves, owner, time)
    limit = own.limit(s.value) if zone.is_linear else own.values[0]
    g = curves.expand(zone.name, owner, time, limit=limit)
    g_z, g_u, g_zz, g_uu, g_zu = g.gradient[:n], g.gradient[n], g.hessian[:n, :n], g.hessian[n, n], g.hessian[:n, n]
    u_z = -s.z / s.u
    cross = s.zu[:, None] * u_z
    u_zz = -(s.zz + cross + cross.swapaxes(0, 1) + s.uu * u_z[:, None] * u_z) / s.u
    mixed = g_zu[:, None] * u_z
    gradient = g_z + g_u * u_z
    hessian = g_zz + mixed + mixed.swapaxes(0, 1) + g_uu * u_z[:, None] * u_z + g_u * u_zz
    drift = g_zu + g_uu * u_z + g_u * (s.z * s.uu / s.u - s.zu) / s.u
    relative = own.slope / np.where(limit != 0, limit, 1.0)
    bend = g_uu - relative * s.uu + (relative * s.u) ** 2
    inner = moves & (time > 0) & (time < 1) & (bend < 0)
    hessian = hessian - np.where(inner, drift[:, None] * drift / np.where(inner, bend, 1.0), 0.0)
    still = moves & ((time == 0) | (time == 1))
    if zone.is_linear:
        g_z = g_z + _by_limit(curves, zone, owner, time, limit) * own.slope * s.z
    return Expanded(g.value, np.where(still, g_z, gradient), np.where(still, g_zz, hessian))


def _by_limit(curves: CurveJets, zone: Zone, owner: np.ndarray, time: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Return the derivatives of constraint values with respect to the limit."""
    step = DIFFERENCE * np.maximum(np.abs(limit), np.abs(zone.take(owner).values).max(axis=0))
    above, below = (curves.expand(zone.name, owner, time, False, limit + x).value for x in (step, -step))
    return (above - below) / (2 * step)


def _distance(curves: CurveJets, owner: np.ndarray, time: np.ndarray) -> _Distance:
    n, count = curves.n, AT_PLACES.size
    at = (AT_PLACES[:, None] * time).ravel()
    inside = curves.speeds(np.tile(owner, count), at)
    weights = WEIGHTS_AT[:, None] * time

    def summed(x: Any) -> np.ndarray:
        return np.sum(x.reshape(*x.shape[:-1], count, time.size) * weights, axis=-2)

    here: Jet = curves.speeds(owner, time)
    z, zz = summed(inside.gradient[:n]), summed(inside.hessian[:n, :n])
    return _Distance(summed(inside.value), z, zz, here.value, here.gradient[n], here.gradient[:n])
