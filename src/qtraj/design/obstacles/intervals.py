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
        broken = [pieces[i] for i in np.flatnonzero(found.codes[:, j] == BROKEN).tolist()]
        for piece, own in zip(broken, _of_pieces(broken, obstacle, body), strict=True):
            for ends in own:
                start, end = np.ravel(piece.report(np.array(ends)))
                result.append((j, (float(start), float(end))))
    return result


def _of_pieces(pieces: Sequence[Piece], obstacle: AbstractObstacle, body: Body) -> list[list[tuple[float, float]]]:
    """Return the intervals of fractions with a negative clearance in each piece; all pieces together, to save time.

    If all samples of a piece are positive, the interval is the point of the minimum.
    """
    if not pieces:
        return []
    samples, count = Samples(pieces, body), len(pieces)
    lowest = samples.smallest(obstacle)[0]
    u = np.sort(np.append(np.tile(np.linspace(0.0, 1.0, INSTANTS)[:, None], (1, count)), lowest[None], axis=0), axis=0)
    inside = (samples.clearances(obstacle, u) < 0) | (u == lowest)
    piece, k = np.nonzero((inside[1:] != inside[:-1]).T)
    low, high, before = u[k, piece], u[k + 1, piece], inside[k, piece]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        same = (samples.clearances(obstacle, middle[None], piece)[0] < 0) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    changes = 0.5 * (low + high)
    found = []
    for i in range(count):
        edges = [*([0.0] if inside[0, i] else []), *changes[piece == i].tolist(), *([1.0] if inside[-1, i] else [])]
        found.append(list(zip(edges[::2], edges[1::2], strict=True)))
    return found
