"""Prove that a route stays within a tube around another route, at equal fractions of corresponding segments.

The square of the half-width minus the square of the distance is a polynomial of degree up to 14 on each segment. Its
smallest Bernstein coefficient is a lower bound. Segments without a proof are halved. All computations use NumPy.
"""

from math import comb

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.tuning_route.geometry import same_terms

DEPTH = 26
"""Maximum number of times that a segment is halved."""

ROUNDINGS = 64
"""Bound on the number of rounding errors in each coefficient before the halvings: at most 8 in a square, 3 in the sum
of squares, and 17 in the conversion to Bernstein coefficients."""


class Displacement:
    """The displacement of the segments of one route from the segments of another, as polynomials in the fraction u.

    `c` (n, terms, 3) [m]: ascending coefficients in u. `error` (n,) [m]: a bound on the rounding error at any u.
    """

    def __init__(self, new: np.ndarray, h_new: np.ndarray, old: np.ndarray, h_old: np.ndarray):
        """Create the displacement from the coefficients (n, terms, 3) and durations (n,) of both routes."""
        powers = np.arange(max(new.shape[1], old.shape[1]))[None, :, None]
        ours, theirs = (
            c * h[:, None, None] ** powers for c, h in zip(same_terms(new, old), (h_new, h_old), strict=True)
        )
        self.c = ours - theirs
        size = np.abs(self.c[:, 0]).max(axis=1) + (np.abs(ours) + np.abs(theirs))[:, 1:].sum(axis=1).max(axis=1)
        self.error = ROUNDINGS * np.finfo(float).eps * size

    def largest(self, count: int = 65) -> Float[np.ndarray, "n 2"]:
        """Return the largest horizontal and vertical distances [m] at `count` instants of each segment."""
        powers = np.linspace(0, 1, count)[:, None] ** np.arange(self.c.shape[1])
        d = np.einsum("fk,nkc->nfc", powers, self.c)
        return np.stack([np.hypot(d[..., 0], d[..., 1]).max(axis=1), np.abs(d[..., 2]).max(axis=1)], axis=1)

    def within(self, tube: Float[np.ndarray, "joints 2"]) -> Bool[np.ndarray, "n 2"]:
        """Return whether the horizontal and the vertical distance are proved to be at most the half-widths [m]."""
        width = np.stack([tube[:-1], tube[1:] - tube[:-1]], axis=1)
        level = _square(self.c[:, :, 0]) + _square(self.c[:, :, 1])
        found = []
        for k, square in enumerate((level, _square(self.c[:, :, 2]))):
            slack = -square
            slack[:, :3] += _square(width[:, :, k])
            most = np.abs(self.c).sum(axis=(1, 2))
            error = 6 * self.error * (most + self.error) + ROUNDINGS * np.finfo(float).eps * (
                most**2 + np.abs(width[:, :, k]).sum(axis=1) ** 2
            )
            found.append(_positive(_bernstein(slack), error))
        return np.stack(found, axis=1)


def _square(c: np.ndarray) -> np.ndarray:
    """Return the squares of polynomials (n, terms)."""
    found = np.zeros((len(c), 2 * c.shape[1] - 1))
    for k in range(c.shape[1]):
        found[:, k : k + c.shape[1]] += c[:, k : k + 1] * c
    return found


def _bernstein(c: np.ndarray) -> np.ndarray:
    """Return the Bernstein coefficients on [0, 1] of polynomials (n, terms)."""
    degree = c.shape[1] - 1
    table = np.array(
        [[comb(j, k) / comb(degree, k) if k <= j else 0.0 for k in range(degree + 1)] for j in range(degree + 1)]
    )
    return c @ table.T


def _positive(b: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return whether polynomials with Bernstein coefficients `b` (n, terms) are proved to be ≥ `error` on [0, 1]."""
    proved = np.ones(len(b), bool)
    index = np.arange(len(b))
    # A coefficient after a halving results from at most `degree` successive means, each rounded once.
    rounding = (b.shape[1] - 1) * np.finfo(float).eps * np.abs(b).max(axis=1, initial=0.0)
    for halvings in range(DEPTH):
        bound = (error + halvings * rounding)[index]
        open_ = b.min(axis=1) < bound
        # The first and the last coefficient are values of the polynomial. If one is below the bound, no proof is
        # possible.
        lost = open_ & (np.minimum(b[:, 0], b[:, -1]) < bound)
        proved[index[lost]] = False
        kept = open_ & proved[index]
        if not kept.any():
            return proved
        left, right = _halves(b[kept])
        b, index = np.concatenate([left, right]), np.concatenate([index[kept]] * 2)
    proved[index] = False
    return proved


def _halves(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Bernstein coefficients on both halves, by de Casteljau's algorithm."""
    left, right, row = [b[:, 0]], [b[:, -1]], b
    for _ in range(b.shape[1] - 1):
        row = 0.5 * (row[:, :-1] + row[:, 1:])
        left.append(row[:, 0])
        right.append(row[:, -1])
    return np.stack(left, axis=1), np.stack(right[::-1], axis=1)
