"""Find the parts of pieces that may be near an obstacle, in floats; all other parts are certainly clear.

The Bernstein coefficients of the position on a part are within a ball about its middle, and so is the path. Those of
the direction bound how much the axes of the body's frame turn. The distance from an obstacle changes by at most as much
as a point moves. Parts that these facts do not decide are divided in half. Rounding errors are far smaller than the
fraction `ROUNDING` of all numbers that a distance must exceed.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from jaxtyping import Float

from qtraj.design.obstacles.body import Body
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.piece import Piece, floats

LEVELS = 8
"""Number of halvings."""

STEADY = 1e-5
"""A direction is known in floats if its length is at least this fraction of the sum of its coefficients."""

ROUNDING = 1e-9
"""The smallest distance that counts, as a fraction of the numbers from which it is computed."""

Parts = Float[np.ndarray, "terms n 3"]


class NearParts:
    """The pieces in floats; the work that is the same for all obstacles is done once."""

    def __init__(self, pieces: Sequence[Piece]):
        self._count = len(pieces)
        self._position = floats([x.position for x in pieces])
        self._time = floats([[x.time] * 3 for x in pieces])[..., :1]
        zero = [pieces[0].position[0] * 0] * 3
        self._directions = _bernstein(floats([zero if x.direction is None else x.direction for x in pieces]))
        self._known = np.array([x.direction is not None and x.sign != 0 and x.tilt is not None for x in pieces])
        self._sign = np.array([x.sign for x in pieces], float)
        self._tilt = np.array([float(x.tilt or 0) for x in pieces])
        self._error = np.array([float(x.error) for x in pieces])

    def of(self, obstacle: AbstractObstacle, offset: Sequence[float], radius: float) -> list[list[tuple[float, float]]]:
        """Return, for each piece, the intervals of fractions in which a ball of the body may be near an obstacle."""
        relative, terms = self._relative(obstacle)
        still, size = obstacle.at_rest(), terms + np.abs(offset).sum() + radius
        position, direction = _bernstein(relative), self._directions
        piece, low, found = np.arange(self._count), np.zeros(self._count), []
        body, numbers = Body([offset], [0.0]), size + obstacle.size
        for level in range(LEVELS + 1):
            if not piece.size:
                break
            halves, halves_d = _halves(position), _halves(direction)
            middle, spread = halves[0][-1], _spread(position, halves[0][-1])
            with np.errstate(invalid="ignore", divide="ignore"):
                centre, turning = self._centres(body, middle, direction, halves_d[0][-1], piece)
            distance = still.at_least(centre)
            reach = radius + spread + turning + self._error[piece]
            far = distance - reach > ROUNDING * (numbers[piece] + np.abs(distance))
            done = (distance + reach < 2 * radius) | np.full(piece.shape, level == LEVELS)
            found += [(int(i), float(a), 0.5**level) for i, a in zip(piece[~far & done], low[~far & done], strict=True)]
            more = ~far & ~done
            position, direction = (np.concatenate([x[:, more] for x in pair], axis=1) for pair in (halves, halves_d))
            low = np.concatenate([low[more], low[more] + 0.5 ** (level + 1)])
            piece = np.tile(piece[more], 2)
        return _joined(found, self._count)

    def _relative(self, obstacle: AbstractObstacle) -> tuple[Parts, np.ndarray]:
        """Return the coefficients of the position relative to a moving obstacle, or of the position itself.

        The second result (n,) is the sum of the magnitudes of all terms that were added.
        """
        size = np.abs(self._position).sum(axis=(0, 2))
        if not obstacle.moves:
            return self._position, size
        track, power = np.asarray(obstacle.track, float), np.ones((1, self._count, 1))
        terms = max(len(self._position), (len(self._time) - 1) * (len(track) - 1) + 1)
        found = np.zeros((terms, self._count, 3))
        found[: len(self._position)] = self._position
        for row in track:
            found[: len(power)] -= power * row
            size = size + np.abs(power).sum(axis=(0, 2)) * np.abs(row).sum()
            power = _product(power, self._time)
        return found, size

    def _centres(
        self, body: Body, middle: np.ndarray, direction: Parts, ahead: np.ndarray, piece: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the centres in the middle, and bounds on their distance from the position plus the rotated offset."""
        offset = np.abs(np.asarray(body.offsets, float)[0])
        if not offset.any():
            return middle, np.zeros(len(piece))
        own = np.asarray(body.centres(middle, ahead, self._sign[piece]))[0]
        along = 2 * _spread(direction, ahead) / np.linalg.norm(ahead, axis=-1)
        level = 2 * _spread(direction[..., :2], ahead[..., :2]) / np.linalg.norm(ahead[..., :2], axis=-1)
        tilt = self._tilt[piece]
        turning = offset @ [along + tilt, level + tilt, along + level + along * level + tilt]
        if not (offset[1] or offset[2]):
            turning = offset[0] * (along + tilt)
        used = ahead[..., :2] if offset[1] or offset[2] else ahead
        steady = np.linalg.norm(used, axis=-1) >= STEADY * np.abs(direction).sum(axis=(0, 2))
        unknown = ~self._known[piece] | ~steady | ~np.isfinite(turning) | np.isnan(own).any(axis=-1)
        longest = np.linalg.norm(offset)
        return np.where(unknown[:, None], middle, own), np.where(unknown, longest, np.minimum(turning, 2 * longest))


def _spread(bernstein: Parts, middle: np.ndarray) -> np.ndarray:
    return np.linalg.norm(bernstein - middle, axis=-1).max(axis=0)


def _bernstein(c: Parts) -> Parts:
    """Return the Bernstein coefficients on [0, 1]; the weights are at most 1."""
    n = len(c) - 1
    table = np.array([[comb(i, k) / comb(n, k) if k <= i else 0.0 for k in range(n + 1)] for i in range(n + 1)])
    return np.einsum("ik,kna->ina", table, c)


def _halves(b: Parts) -> tuple[Parts, Parts]:
    """Return the Bernstein coefficients on both halves, by means of coefficients (de Casteljau)."""
    left, right, row = [b[0]], [b[-1]], b
    for _ in range(len(b) - 1):
        row = 0.5 * (row[:-1] + row[1:])
        left.append(row[0])
        right.append(row[-1])
    return np.stack(left), np.stack(right[::-1])


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    found = np.zeros((len(a) + len(b) - 1, *a.shape[1:]))
    for k, row in enumerate(a):
        found[k : k + len(b)] += row * b
    return found


def _joined(parts: list[tuple[int, float, float]], count: int) -> list[list[tuple[float, float]]]:
    """Return the intervals of each piece, of which adjacent ones are joined."""
    found: list[list[tuple[float, float]]] = [[] for _ in range(count)]
    for i, start, width in sorted(parts):
        own = found[i]
        if own and own[-1][1] == start:
            own[-1] = (own[-1][0], start + width)
        else:
            own.append((start, start + width))
    return found
