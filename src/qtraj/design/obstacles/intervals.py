"""The intervals of time in which a body is inside an obstacle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from qtraj.design.obstacles.body import Body
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.piece import Piece
from qtraj.design.obstacles.samples import Samples
from qtraj.design.proof.certificate import BROKEN
from qtraj.design.proof.findings import Findings

INSTANTS, HALVINGS = 65, 40
"""Instants at which the clearance is sampled in a piece, and halvings of the intervals in which it changes its sign."""


def intervals(
    pieces: Sequence[Piece], found: Findings, obstacles: Sequence[AbstractObstacle], body: Body
) -> list[tuple[int, tuple[float, float]]]:
    """Return pairs of the index of an obstacle and an interval (start, end) [s], in order."""
    result = []
    for j, obstacle in enumerate(obstacles):
        for i in np.flatnonzero(found.codes[:, j] == BROKEN).tolist():
            for a, b in _of_piece(Samples([pieces[i]], body), obstacle):
                start, end = np.ravel(pieces[i].report(np.array([a, b])))
                result.append((j, (float(start), float(end))))
    return result


def _of_piece(samples: Samples, obstacle: AbstractObstacle) -> list[tuple[float, float]]:
    """Return intervals of fractions with a negative clearance; one at the minimum if all samples are positive."""

    def inside(u: np.ndarray) -> np.ndarray:
        return samples.clearances(obstacle, u[:, None])[:, 0] < 0

    lowest = float(samples.smallest(obstacle)[0][0])
    u = np.unique(np.append(np.linspace(0.0, 1.0, INSTANTS), lowest))
    own = inside(u) | (u == lowest)
    k = np.flatnonzero(own[1:] != own[:-1])
    low, high, before = u[k], u[k + 1], own[k]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = inside(middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    edges = [*([0.0] if own[0] else []), *(0.5 * (low + high)), *([1.0] if own[-1] else [])]
    return list(zip(edges[::2], edges[1::2], strict=True))
