"""Prove limits for all deviations in a box."""

from __future__ import annotations  # so that `help` shows short names

from itertools import product
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.divisors import factors as factors_of
from qtraj.design.limits import Limits, limits_of, require_limits
from qtraj.design.obstacles.keep_out import refuse_obstacles
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, UNDEFINED
from qtraj.design.proof.certify import certify
from qtraj.design.robust.box import STATES, VEHICLE, Box
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_claims import BoxClaims
from qtraj.design.robust.box_vehicle import BoxVehicle
from qtraj.design.robust.family import Family
from qtraj.design.robust.vehicles import with_vehicles
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import require_concrete
from qtraj.foundation.devices import of_one_device
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix

GRID = 5
"""Number of values of each parameter at which worst values are looked for."""

LEAST_MASS = 1e-10
"""Smallest ratio of the lowest mass to the highest one."""

LARGE = 1e12
"""A limit on the speed that every path satisfies, to find the largest speed."""


@of_one_device
def certify_box(path: SpiralHelix, limits: Limits, box: Box, *, throw: bool = False) -> BoxCertificate:
    """Prove that all paths near a spiral-helix satisfy `limits`, for every combination of deviations in `box`.

    The states at the ends of the path deviate. The vehicle then drives the spiral-helix whose radius, azimuth and
    height differ from those of `path` by the cubics that change these states and no other ones, in the same time. Along
    such a path, a limit is an inequality between polynomials in the time and in the deviations, and it is decided for
    all of them at once, in exact integers where floats do not suffice (docs/howto/robust.md). The mass and the drag
    area enter in the same way; of limits that deviate, the strictest value is proved. Nothing is linearised or sampled.

    Args:
        path: One spiral-helix, with concrete values.
        limits: Limits that do not change along the way or with the speed, without obstacles and own quantities.
        box: The intervals of the deviations: at most three besides those of limits.
        throw: Raise an error if a limit is not proved.

    Returns:
        A `BoxCertificate` with a status for each limit: "proved" for all deviations; "broken", with deviations that
        violate it; "undefined", if the speed or another divisor is zero for some deviations; or "undecided", if the
        quantity touches its limit, or the proof takes too long, as for the angular acceleration and two parameters.

    Raises:
        ValueError: For a path of another kind, a batch, limits that change or need another axis, a mass or drag area
            without vehicle, and deviations of limits that are not set or reach zero.
        RuntimeError: With `throw`, if a limit is not proved.

    Example:
        >>> import qtraj as qt
        >>> start = qt.BoundaryState([20, 0, 0], [0, 6, 0])
        >>> end = qt.BoundaryState([0, 22, 1], [-6, 0, 0.2])
        >>> path = qt.SpiralHelix.hermite(start, end, 5.5)
        >>> qt.certify_box(path, qt.Limits(speed=7.0), qt.Box(start_speed=0.3, end_speed=0.3)).status
        {'speed': 'proved'}
    """
    require_box(path, limits, box)
    problem = BoxProblem.of(path, limits, box)
    found = problem.certificate()
    return found.check() if throw else found


class Worst(NamedTuple):
    """The worst value that was found, or NaN if the quantity is undefined, with its deviations and its time [s]."""

    deviations: np.ndarray
    time: float
    value: float

    @classmethod
    def of(cls, deviations: np.ndarray, times: np.ndarray, values: np.ndarray, side: int) -> Worst:
        """Return the worst of some values."""
        k = int(np.argmax(np.where(np.isnan(values), np.inf, side * values)))
        return cls(deviations[k], times[k], values[k])


class BoxProblem(NamedTuple):
    """A path and limits, of which the strictest values count, for the deviations of a box."""

    family: Family
    limits: Limits
    box: Box

    @classmethod
    def of(cls, path: SpiralHelix, limits: Limits, box: Box) -> BoxProblem:
        """Return the problem of `certify_box`."""
        return cls(Family(path, box), strictest(limits, box), box)

    def grid(self) -> Float[np.ndarray, "n p"]:
        """Return a grid of deviations, with the corners of the box."""
        ends = zip(self.box.lowest, self.box.highest, strict=True)
        return np.array(list(product(*(np.linspace(low, high, GRID) for low, high in ends))))

    def values(self, deviations: Float[np.ndarray, "n p"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the times and the worst values (n, k) of the limited quantities for some deviations."""
        states = [k for k, name in enumerate(self.box.names) if name in STATES]
        paths, limits = self.family.paths(deviations[:, states]), self.limits
        if len(states) < len(self.box.names):
            vehicle = {name: deviations[:, k] for k, name in enumerate(self.box.names) if name in VEHICLE}
            zero = np.zeros(len(deviations))
            limits = with_vehicles(limits, np.stack([vehicle.get(name, zero) for name in VEHICLE], axis=1))
        return _of_paths(paths, limits)

    def certificate(self) -> BoxCertificate:
        """Return the findings on all limits."""
        given, box = self.limits.given(), self.box
        entries = [quantity(name) for name in given]
        bounds = np.array([float(np.asarray(x)) for x in given.values()])
        claims, factors = self._claims(), factors_of(self.limits, float)
        points = self.grid()
        times, values = self.values(points)
        codes, rows = [], []
        for k, entry in enumerate(entries):
            own = Worst.of(points, times[:, k], values[:, k], entry.side)
            code, own = self._finding(claims, k, entry, own, bounds[k], float(np.asarray(factors[k])))
            codes.append(code)
            rows.append(own)
        where, at, what = (np.array(x) for x in zip(*rows, strict=True))
        shape = len(codes), len(box.names)
        return BoxCertificate(tuple(given), box, codes, at, where.reshape(shape), what, bounds)

    def _finding(
        self, claims: BoxClaims, k: int, entry: PathQuantity, own: Worst, bound: float, factor: float
    ) -> tuple[int, Worst]:
        """Return the status of the limit k and the worst value; `own` is that of the grid."""
        if np.isnan(own.value):
            return UNDEFINED, own
        defined = True
        if entry.divisor is not None:
            divisor = claims.divisor(entry.divisor)
            if divisor.refuted:  # the quantity itself can then not be proved, which takes longest
                time = divisor.at[0] * float(np.asarray(self.family.source.duration[0]))
                return UNDEFINED, Worst(claims.vehicle.deviations(self.box, divisor.at[1:], self.limits), time, np.nan)
            defined = divisor.proved
        found = claims.limit(entry, bound, factor)
        if found.refuted:
            point = claims.vehicle.deviations(self.box, found.at[1:], self.limits)[None]
            at, value = self.values(point)
            own = max(own, Worst.of(point, at[:, k], value[:, k], entry.side), key=lambda x: entry.side * x.value)
        # A bound that was rounded, or numbers of the vehicle, may be violated although the limit and the box are not.
        inexact = bool(entry.tangent_of) or claims.vehicle.rounded
        if found.refuted and (not inexact or entry.side * (own.value - bound) > 0):
            return BROKEN, own
        return (PROVED if found.proved and defined else UNDECIDED), own

    def _claims(self) -> BoxClaims:
        states = [k for k, name in enumerate(self.box.names) if name in STATES]
        speeds = _of_paths(self.family.paths(self.grid()[:, states]), Limits(speed=LARGE))[1]
        source = self.family.source
        fastest = float((np.nanmax(speeds) * source.duration[0] / source.length[0]) ** 2)
        return BoxClaims(self.family, BoxVehicle.of(self.limits, self.box), fastest)


def strictest(limits: Limits, box: Box) -> Limits:
    """Return the strictest limits of a box."""
    changed = {}
    for name, bound in limits.given().items():
        entry, value = quantity(name), float(np.asarray(bound))
        low, high = box.limits.get(name, box.limits.get(entry.base or name, (0.0, 0.0)))
        changed[name] = value + (high if entry.lower else low)
        if value > 0 >= changed[name] and not entry.base:
            raise ValueError(
                f"the limit on {name} is {value:g}, and with its deviation {changed[name]:g}: it must be positive"
            )
    return limits_of(changed, limits.vehicle)


def require_box(path: Any, limits: Limits, box: Box) -> None:
    """Raise a ValueError for arguments of `certify_box` that are not supported."""
    require_type(path, SpiralHelix, "path", "a SpiralHelix")
    require_type(box, Box, "box", "a Box, such as Box(start_speed=0.5)")
    require_limits(limits)
    require_concrete("certify_box", path, limits)
    if np.ndim(path.duration):
        raise ValueError(f"certify_box is for one path, but a batch of shape {np.shape(path.duration)} was given")
    require_box_limits(limits, box, "certify_box")
    level = source_is_vertical(path)
    for name in limits.given():
        if not level and quantity(name).upright:
            raise ValueError(
                f"{name} depends on the vertical, so it needs a path with a vertical axis: omit this limit"
            )


def require_box_limits(limits: Limits, box: Box, what: str) -> None:
    """Raise a ValueError for limits that cannot be proved for a box."""
    refuse_obstacles(limits, what, "omit keep_out")
    limits.require_constant(what, "pass one value for the whole path")
    if not limits.given():
        raise ValueError(f"{what} needs at least one limit, such as Limits(speed=8.0)")
    names = {each for name in limits.given() for each in (name, quantity(name).base or name)}
    if unknown := sorted(box.limits.keys() - names):
        raise ValueError(f"box.limits contains {unknown[0]!r}, but there is no such limit in limits")
    for name in limits.given():
        if quantity(name).own is not None:
            raise ValueError(f"{name} is a quantity of your own, which {what} does not support: omit this limit")
    vehicle = limits.vehicle
    if vehicle is not None and (vehicle.road is not None or np.ndim(vehicle.mass)):
        raise ValueError(f"{what} needs one vehicle, on a road that does not change: pass bank and friction as numbers")
    moved = [name for name in box.names if name in VEHICLE]
    if not moved:
        return
    if vehicle is None:
        raise ValueError(
            f"the {moved[0]} deviates, but limits have no vehicle: pass Limits(..., vehicle=Vehicle(mass=...))"
        )
    if "drag_area" in moved and float(np.asarray(vehicle.drag_area)) + box.intervals["drag_area"][0] < 0:
        raise ValueError(
            f"the drag area {float(np.asarray(vehicle.drag_area)):g} m² must stay 0 or more: make its interval smaller"
        )
    if "mass" in moved:
        low, high = (float(np.asarray(vehicle.mass)) + x for x in box.intervals["mass"])
        if not low > LEAST_MASS * high:
            raise ValueError(
                f"the mass {float(np.asarray(vehicle.mass)):g} kg must stay positive, and its lowest value at least "
                f"{LEAST_MASS:g} of the highest one: make its interval smaller"
            )


def source_is_vertical(path: SpiralHelix) -> bool:
    """Return whether the axis of the path is vertical."""
    if path.placement is None:
        return True
    _, x, y, z = np.asarray(path.placement.orientation, float)
    w = float(np.asarray(path.placement.orientation)[0])
    return (x == 0 and y == 0) or (w == 0 and z == 0)


def _of_paths(paths: SpiralHelix, limits: Limits) -> tuple[np.ndarray, np.ndarray]:
    found = certify(paths, limits)
    return np.asarray(found.times), np.asarray(found.values)
