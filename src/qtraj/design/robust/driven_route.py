"""The routes whose states at both ends deviate, and the largest values of limited quantities along them."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.divisors import factors as factors_of
from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.proof.findings import Findings, Limit
from qtraj.design.proof.route_segments import findings
from qtraj.design.robust.driven import BLOCK
from qtraj.design.robust.vehicles import deviating
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.path.driving import segments_of
from qtraj.path.quantity import quantity
from qtraj.path.stops import Segments
from qtraj.path.vehicle import fixed_parameters

AT_START = np.array([[1.0, 0, 0, -10, 15, -6], [0.0, 1, 0, -6, 8, -3]])
AT_END = np.array([[0.0, 0, 0, 10, -15, 6], [0.0, 0, 0, -4, 7, -3]])
"""The quintics on [0, 1] with position or velocity 1 at one end, and zero in the other states up to acceleration."""


class DrivenRoute(NamedTuple):
    """The routes with other states at both ends than a tuned one, with the same times.

    Only the first and the last segment differ: they lead from the deviating state to the next joint of the tuned route,
    and from the last but one to the deviating state. The accelerations at the joints are those of the tuned route.
    """

    segments: Segments
    between: Float[np.ndarray, " k"]
    limits: Limits

    def largest(
        self, deviations: Float[np.ndarray, "n 12"], vehicle: Float[np.ndarray, "n 2"] | None = None
    ) -> Float[np.ndarray, "n k"]:
        """Return the largest values along the routes, the smallest for lower bounds, of the limited quantities.

        `deviations` of the states [m, m/s] and, unless None, of the `vehicle` (see `deviating`); NaN where a quantity
        is undefined somewhere on a segment that deviates.
        """
        blocks = [slice(first, first + BLOCK) for first in range(0, len(deviations), BLOCK)]
        return np.concatenate([self._largest(deviations[x], None if vehicle is None else vehicle[x]) for x in blocks])

    def _largest(
        self, deviations: Float[np.ndarray, "n 12"], vehicle: Float[np.ndarray, "n 2"] | None
    ) -> Float[np.ndarray, "n k"]:
        given = self.limits.given()
        sides = np.array([quantity(name).side for name in given])
        start, end = np.split(deviations.reshape(-1, 4, 3), 2, axis=1)
        last = len(self.segments.starts) - 1
        ends = [(0, _change(self._h(0), AT_START, start))]
        if last:
            ends.append((last, _change(self._h(last), AT_END, end)))
        else:
            ends[0] = 0, ends[0][1] + _change(self._h(0), AT_END, end)
        values = [np.broadcast_to(self.between, (len(deviations), len(sides)))]
        if vehicle is not None:
            same = np.zeros((len(deviations), 6, 3))
            values = [self._values(row, same, vehicle) for row in range(1, last)]
        values += [self._values(*x, vehicle) for x in ends]
        return sides * np.max(sides * np.stack(values), axis=0)  # NaN remains NaN

    def _h(self, row: int) -> float:
        return float(self.segments.durations[row])

    def _values(
        self, row: int, change: Float[np.ndarray, "n 6 3"], deviations: Float[np.ndarray, "n 2"] | None
    ) -> Float[np.ndarray, "n k"]:
        """Return the largest values on a segment whose coefficients change, for deviations of the vehicle."""
        if len(change) > 1 and deviations is None and not change.any():
            return np.repeat(self._values(row, change[:1], None), len(change), axis=0)
        count = len(change)
        same = self.segments.part(np.full(count, row))
        coefficients = np.zeros((count, max(6, same.coefficients.shape[1]), 3))
        coefficients[:, : same.coefficients.shape[1]] = same.coefficients
        coefficients[:, :6] += change
        return findings_on(same._replace(coefficients=coefficients), self.limits, deviations).values


def findings_on(segments: Segments, limits: Limits, deviations: Float[np.ndarray, "n 2"] | None = None) -> Findings:
    """Return the findings on segments, for deviations of the vehicle (see `deviating`) unless they are None."""
    vehicle: Any = limits.vehicle
    if deviations is not None:
        vehicle = deviating(vehicle, deviations)
    each = zip(limits.constant().items(), factors_of(limits, float), strict=True)
    bounds = [Limit(quantity(name), np.asarray(x, float), np.asarray(factor, float)) for (name, x), factor in each]
    return findings(segments, bounds, fixed_parameters(vehicle, float) if limits.uses_vehicle else None)


def _change(h: float, basis: np.ndarray, deviations: Float[np.ndarray, "n 2 3"]) -> Float[np.ndarray, "n 6 3"]:
    """Return the changes of the coefficients of a segment of `h` seconds for deviations of its state at one end."""
    own = basis * np.array([[1.0], [h]]) / h ** np.arange(6)
    return np.einsum("sk,nsc->nkc", own, deviations)


def driven_route(tuned: TunedRoute, limits: Limits) -> DrivenRoute:
    """Return the routes near a tuned one."""
    found, sides = certify(tuned.path, limits), np.array([quantity(name).side for name in limits.given()])
    values = np.asarray(found.segments.values)[1:-1]
    between = np.max(sides * values, axis=0, initial=-np.inf) * sides
    return DrivenRoute(segments_of(tuned.path), between, limits)
