"""Fit a drive with stops again: next to each stop a regular curve, with a progress along it.

The fit in time determines the stops and the progress. Then all states of the route are fitted to all samples again, as
functions of the parameter w of its course, which does not stop. Where the vehicle reverses, the curve continues with
the opposite tangent and the same curvature vector: the vehicle keeps its heading and its steering angle.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting import route_choice as choice
from qtraj.design.fitting.course import Course, Joints, course, joints
from qtraj.design.fitting.motion import Motion
from qtraj.design.fitting.recording import Recording
from qtraj.design.fitting.route_choice import Problem
from qtraj.design.fitting.route_solution import Solution, solution
from qtraj.design.fitting.units import Units
from qtraj.design.fitting.zone_progress import SPACING, Criterion, progress_in
from qtraj.design.fitting.zones import find_zones, scale_of, with_slow_points
from qtraj.path import pieces, progress

STIFF = 5.0
"""Weight of the jerk in a zone, relative to its weight elsewhere: the curve is slow there, so noise would bend it."""


class Curves(NamedTuple):
    """A fit along the course of a drive: the samples at their parameters w, the problem, and its solution."""

    recording: Recording
    problem: Problem
    found: Solution
    course: Course
    joints: Joints


def with_curves(recording: Recording, problem: Problem, motion: Motion, smoothing: float) -> Curves | None:
    """Return the fit with curves at the slow points, or None for a drive without a slow point that has zones."""
    scale = scale_of(motion)
    motion = with_slow_points(motion, scale)
    zones = find_zones(motion, scale)
    if not zones:
        return None
    own = progress_in(motion, zones, Criterion(smoothing, recording.step, SPACING * scale.time))
    along = course(float(recording.times[-1]), motion.stops, zones, own)
    is_stop = problem.stops.matrix[-4, 3::3] < 0
    at = joints(along, problem.knots, is_stop)
    w, rates = along.at(recording.times)
    moved = recording._replace(times=w, rates=rates)
    in_zone = np.array([along.pieces[k].zone is not None for k in at.piece])
    new = choice.problem(moved, at.knots, at.is_stop, [], np.where(in_zone, STIFF, 1.0), at.sense)
    return Curves(moved, new, solution(moved, new, smoothing), along, at)


def segments(of: Curves, unit: Units) -> tuple[Any, Any, Any]:
    """Return the starts [s], the coefficients [m] and the progress of the segments, for positions from the first."""
    states = of.found.states * unit.length / unit.time ** np.arange(3)[:, None]
    curves = pieces.hermite(np.diff(of.joints.knots) * unit.time, states, of.joints.sense)
    curves[of.joints.is_stop, 1:] = 0.0
    starts, rows, own = [], [], []
    for k, piece in enumerate(of.course.pieces):
        mine = np.flatnonzero(of.joints.piece == k)
        if piece.stop:
            before = np.searchsorted(of.joints.knots, piece.first)
            starts.append(np.array([piece.start]))
            rows.append(_resting(states[before, 0], curves.shape[1]))
            own.append(progress.IDENTITY[None])
        elif piece.zone is None:
            starts.append(piece.start + (of.joints.knots[mine] - piece.first))
            rows.append(curves[mine])
            own.append(np.tile(progress.IDENTITY, (len(mine), 1)))
        else:
            starts.append(piece.zone.times)
            rows.append(np.repeat(curves[mine], len(piece.zone.times), axis=0))
            own.append(progress.slowed(piece.zone.rows, np.full(len(piece.zone.times), unit.time)))
    return np.concatenate(starts) * unit.time, np.concatenate(rows), np.concatenate(own)


def _resting(position: Float[np.ndarray, "3"], terms: int) -> Float[np.ndarray, "1 terms 3"]:
    found = np.zeros((1, terms, 3))
    found[0, 0] = position
    return found
