"""The paths of a box, their worst values, and the findings on their limits."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.divisors import factors as factors_of
from qtraj.design.limits import Limits, limits_of
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED, UNDEFINED
from qtraj.design.robust.box import STATES, VEHICLE, Box
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_claims import BoxClaims
from qtraj.design.robust.box_vehicle import BoxVehicle
from qtraj.design.robust.family import Family
from qtraj.design.robust.family_of_path import family_of_path
from qtraj.path.path_quantity import PathQuantity
from qtraj.path.quantity import quantity
from qtraj.path.spiral_helix import SpiralHelix

GRID = 5
"""Number of values of each parameter at which worst values are looked for."""

LARGE = 1e12
"""A limit on the speed that every path satisfies, to find the largest speed."""


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


class Finding(NamedTuple):
    """The code of the status of a limit, and its worst value."""

    code: int
    worst: Worst


class BoxProblem(NamedTuple):
    """A path and limits, of which the strictest values count, for the deviations of a box."""

    family: Family
    limits: Limits
    box: Box

    @classmethod
    def of(cls, path: SpiralHelix, limits: Limits, box: Box) -> BoxProblem:
        """Return the problem of `certify_box`."""
        return cls(family_of_path(path, box), strictest(limits, box), box)

    def grid(self) -> Float[np.ndarray, "n p"]:
        """Return a grid of deviations, with the corners of the box."""
        return grid_of(self.box)

    def values(self, deviations: Float[np.ndarray, "n p"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the times and the worst values (n, k) of the limited quantities for some deviations."""
        states = [k for k, name in enumerate(self.box.names) if name in STATES]
        vehicles = None
        if len(states) < len(self.box.names):
            vehicle = {name: deviations[:, k] for k, name in enumerate(self.box.names) if name in VEHICLE}
            zero = np.zeros(len(deviations))
            vehicles = np.stack([vehicle.get(name, zero) for name in VEHICLE], axis=1)
        return self.family.certified(deviations[:, states], self.limits, vehicles)

    def certificate(self) -> BoxCertificate:
        """Return the findings on all limits."""
        return certificate_of(self.findings(), self.limits, self.box)

    def findings(self, names: Collection[str] | None = None) -> list[Finding]:
        """Return the status and the worst value of each limit; by default of all of them."""
        claims, factors = self._claims(), factors_of(self.limits, float)
        points = self.grid()
        times, values = self.values(points)
        found = []
        for k, (name, bound) in enumerate(self.limits.given().items()):
            if names is not None and name not in names:
                continue
            entry = quantity(name)
            own = Worst.of(points, times[:, k], values[:, k], entry.side)
            numbers = float(np.asarray(bound)), float(np.asarray(factors[k]))
            found.append(Finding(*self._finding(claims, k, entry, own, *numbers)))
        return found

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
        speeds = self.family.certified(self.grid()[:, states], Limits(speed=LARGE), None)[1]
        source = self.family.source
        fastest = float((np.nanmax(speeds) * source.duration[0] / source.length[0]) ** 2)
        return BoxClaims(self.family, BoxVehicle.of(self.limits, self.box), fastest)


def grid_of(box: Box) -> Float[np.ndarray, "n p"]:
    """Return a grid of deviations, with the corners of the box."""
    ends = zip(box.lowest, box.highest, strict=True)
    return np.array(list(product(*(np.linspace(low, high, GRID) for low, high in ends))))


def certificate_of(found: list[Finding], limits: Limits, box: Box) -> BoxCertificate:
    """Return findings on limits as a certificate."""
    given = limits.given()
    where, times, values = (np.array(x) for x in zip(*(x.worst for x in found), strict=True))
    bounds = [float(np.asarray(x)) for x in given.values()]
    shape = len(found), len(box.names)
    return BoxCertificate(tuple(given), box, [x.code for x in found], times, where.reshape(shape), values, bounds)


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
