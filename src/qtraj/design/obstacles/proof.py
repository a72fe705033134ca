"""Prove that a body stays clear of obstacles on the pieces of a path, in exact integers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra import subdivision
from qtraj.design.obstacles.body import Body
from qtraj.design.obstacles.near_parts import NearParts
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.piece import Piece
from qtraj.design.obstacles.samples import Samples
from qtraj.design.proof.certificate import BROKEN, PROVED, UNDECIDED
from qtraj.design.proof.deciding import LITTLE_WORK
from qtraj.design.proof.findings import Findings

HALVINGS = 12
"""A piece is divided at most this often for claims that are stricter than necessary on long pieces."""

PATIENCE = 4
"""After this number of undecided claims, the others may take little work."""


class _Judged(NamedTuple):
    """A status code, and the fraction of the piece where the body enters the obstacle."""

    code: int
    at: float = 0.0


class _Work:
    """The number of claims that stayed undecided."""

    undecided = 0

    @property
    def most(self) -> int:
        """The largest work for the next claim."""
        return subdivision.MAX_WORK if self.undecided < PATIENCE else LITTLE_WORK


def judged(pieces: Sequence[Piece], obstacles: Sequence[AbstractObstacle], body: Body) -> Findings:
    """Return codes, times [s] and clearances [m] (pieces, obstacles).

    The clearance is the smallest one on the piece, and the time that of it. A touch is clear.
    """
    samples, parts = Samples(pieces, body), NearParts(pieces)
    shape = len(pieces), len(obstacles)
    codes, times, values = np.zeros(shape, np.int32), np.zeros(shape), np.zeros(shape)
    balls = list(zip(np.asarray(body.offsets, float).tolist(), np.asarray(body.radii, float).tolist(), strict=True))
    for j, obstacle in enumerate(obstacles):
        at, values[:, j] = samples.smallest(obstacle)
        near, work = [parts.of(obstacle, *ball) for ball in balls], _Work()
        for i, piece in enumerate(pieces):
            if any(own[i] for own in near):
                own = [(*ball, intervals[i]) for ball, intervals in zip(balls, near, strict=True)]
                found = _of_body(piece, obstacle, own, float(at[i]), work)
                codes[i, j] = found.code
                if found.code == BROKEN and values[i, j] >= 0:
                    at[i] = found.at
            times[i, j] = np.ravel(piece.report(np.array([at[i]])))[0]
    return Findings(codes, times, values)


def _of_body(piece: Piece, obstacle: AbstractObstacle, balls: list[Any], at: float, work: _Work) -> _Judged:
    """Return the worst finding on the balls (offset, radius, intervals); the smallest clearance is that `at`."""
    for offset, radius, intervals in balls:
        if intervals and _enters(piece, obstacle, offset, radius, at):
            return _Judged(BROKEN, at)
    found = _Judged(PROVED)
    for offset, radius, intervals in balls:
        for start, end in intervals:
            part = piece if end - start == 1 else piece.between(start, end)
            own = _of_ball(part, obstacle, offset, radius, work)
            if own.code == BROKEN:
                return _Judged(BROKEN, start + (end - start) * own.at)
            found = max(found, own)
    return found


def _enters(piece: Piece, obstacle: AbstractObstacle, offset: list[float], radius: float, u: float) -> bool:
    """Return whether a ball is proved to enter an obstacle at the fraction u."""
    error = piece.uncertainty(offset)
    if error is None or (piece.sign == 0 and any(offset)):
        return False
    at = piece.between(u, u)
    return obstacle.enters(at.place(offset, *_near(at, offset, [0.0])), Fraction(radius) - error)


def _of_ball(
    piece: Piece, obstacle: AbstractObstacle, offset: list[float], radius: float, work: _Work, depth: int = 0
) -> _Judged:
    error = piece.uncertainty(offset)
    if error is None or (piece.sign == 0 and any(offset)):
        return _Judged(UNDECIDED)
    at = _nearest(piece, obstacle, offset)
    place = piece.place(offset, *_near(piece, offset, [0.0, at, 1.0]))
    decision = subdivision.decide(obstacle.outside(place, Fraction(radius) + error), max_work=work.most)
    if decision.proved:
        return _Judged(PROVED)
    for u in {decision.at, at}:
        if _enters(piece, obstacle, offset, radius, u):
            return _Judged(BROKEN, u)
    if obstacle.approximate and radius + error > 0 and depth < HALVINGS:
        found = _Judged(PROVED)
        for k in (0, 1):
            half = piece.between(0.5 * k, 0.5 * (k + 1))
            own = _of_ball(half, obstacle, offset, radius, work, depth + 1)
            if own.code == BROKEN:
                return _Judged(BROKEN, 0.5 * (k + own.at))
            found = max(found, own)
            if own.code == UNDECIDED:
                break
        return found
    work.undecided += 1
    return _Judged(UNDECIDED)


def _nearest(piece: Piece, obstacle: AbstractObstacle, offset: list[float]) -> float:
    """Return the fraction of the piece at which a ball is nearest to an obstacle."""
    own = Samples([piece], Body([offset], [0.0]))
    return float(own.smallest(obstacle)[0][0])


def _near(piece: Piece, offset: list[float], u: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres of a ball and the times at some fractions, in floats."""
    centres, times = Samples([piece], Body([offset], [0.0])).centres(np.array(u)[:, None])
    return centres[0, :, 0], times[:, 0]
