"""The routes of a box, their worst values, and the findings on their limits.

The vehicle deviates on all segments, a state at an end of the route only on the first or the last segment. So each
segment is a problem with its own parameters, and the limits on a segment without any are those of `certify`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.proof.certify import certify
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.proof.route_segments import RANK
from qtraj.design.robust.box import VEHICLE, Box
from qtraj.design.robust.box_certificate import BoxCertificate
from qtraj.design.robust.box_problem import BoxProblem, Finding, Worst, certificate_of, grid_of, strictest
from qtraj.design.robust.family_of_segment import family_of_segment, states_on
from qtraj.path.driving import segments_of
from qtraj.path.quantity import quantity
from qtraj.path.route import Route


class SegmentProblem(NamedTuple):
    """A segment that starts at a time [s], and the problem of its own parameters, which are `columns` of the box."""

    start: float
    problem: BoxProblem
    columns: list[int]

    def values(self, deviations: Float[np.ndarray, "n p"]) -> tuple[np.ndarray, np.ndarray]:
        """Return times and worst values for deviations of all parameters of the box."""
        own, rows = np.unique(deviations[:, self.columns], axis=0, return_inverse=True)
        times, values = self.problem.values(own)
        return self.start + times[rows.ravel()], values[rows.ravel()]


class RouteBoxProblem(NamedTuple):
    """A route and limits, of which the strictest values count, for the deviations of a box.

    `fixed` are the findings without deviations, and `rows` the indices of the segments that deviate.
    """

    limits: Limits
    box: Box
    fixed: RouteCertificate
    rows: list[int]
    segments: list[SegmentProblem]

    @classmethod
    def of(cls, route: Route, limits: Limits, box: Box) -> RouteBoxProblem:
        """Return the problem of `certify_box`."""
        strict = strictest(limits, box)
        whole = segments_of(route)
        rows, problems = [], []
        for row, start in enumerate(whole.starts.tolist()):
            names = states_on(whole, row, box)
            vehicle = [name for name in box.names if name in VEHICLE and strict.uses_vehicle]
            if not (names or vehicle):
                continue
            own = Box(intervals={name: box.intervals[name] for name in (*names, *vehicle)})
            problem = BoxProblem(family_of_segment(whole, row, own), strict, own)
            rows.append(row)
            problems.append(SegmentProblem(start, problem, [box.names.index(name) for name in own.names]))
        return cls(strict, box, certify(route, strict), rows, problems)

    def grid(self) -> Float[np.ndarray, "n p"]:
        """Return a grid of deviations, with the corners of the box."""
        return grid_of(self.box)

    def values(self, deviations: Float[np.ndarray, "n p"]) -> tuple[np.ndarray, np.ndarray]:
        """Return the times and the worst values (n, k) of the limited quantities for some deviations."""
        sides = np.array([quantity(name).side for name in self.limits.given()])
        kept = np.setdiff1d(np.arange(len(np.asarray(self.fixed.starts))), self.rows)
        found = [(np.asarray(self.fixed.segments.times)[k], np.asarray(self.fixed.segments.values)[k]) for k in kept]
        count = len(deviations)
        found = [(np.tile(t, (count, 1)), np.tile(v, (count, 1))) for t, v in found]
        found += [each.values(deviations) for each in self.segments]
        times, values = (np.stack(x) for x in zip(*found, strict=True))
        size = np.where(np.isnan(values), np.inf, sides * values)
        worst = np.argmax(size, axis=0)[None]
        return np.take_along_axis(times, worst, 0)[0], np.take_along_axis(values, worst, 0)[0]

    def certificate(self) -> BoxCertificate:
        """Return the findings on all limits: for each of them, the worst one of all segments."""
        each = [*self._findings()]
        names = [*self.limits.given()]
        found = [_worst([x[k] for x in each], quantity(name).side) for k, name in enumerate(names)]
        return certificate_of(found, self.limits, self.box)

    def _findings(self) -> Iterator[list[Finding]]:
        """Yield the findings on each segment, with deviations of all parameters."""
        nearest = np.clip(0.0, self.box.lowest, self.box.highest)
        parts = self.fixed.segments
        columns = (np.asarray(x).tolist() for x in (parts.codes, parts.times, parts.values))
        for row, (codes, times, values) in enumerate(zip(*columns, strict=True)):
            own = [Finding(c, Worst(nearest, t, v)) for c, t, v in zip(codes, times, values, strict=True)]
            if row in self.rows:
                own = _embedded(self.segments[self.rows.index(row)], own, nearest)
            yield own


def _embedded(segment: SegmentProblem, fixed: list[Finding], nearest: np.ndarray) -> list[Finding]:
    """Return the findings on a segment that deviates; those of limits on which nothing depends are `fixed`."""
    problem, found = segment.problem, []
    moves = bool(problem.family.names)
    names = [*problem.limits.given()]
    needed = [name for name in names if moves or quantity(name).uses_vehicle]
    own = dict(zip(needed, problem.findings(needed), strict=True))
    for name, other in zip(names, fixed, strict=True):
        if name not in own:
            found.append(other)
            continue
        code, worst = own[name]
        deviations = nearest.copy()
        deviations[segment.columns] = worst.deviations
        found.append(Finding(code, Worst(deviations, segment.start + worst.time, worst.value)))
    return found


def _worst(found: list[Finding], side: int) -> Finding:
    """Return the worst status of all segments, and the worst value of the segments that have this status.

    A quantity that is proved somewhere with a larger value than where it is not proved does not explain the status.
    """
    code = max((x.code for x in found), key=lambda c: RANK[c])
    values = [x.worst for x in found if x.code == code]
    return Finding(code, max(values, key=lambda x: np.inf if np.isnan(x.value) else side * x.value))
