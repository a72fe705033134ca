"""Shift, reverse and halve the segments of a route; coefficients are computed exactly and rounded once."""

import math

import numpy as np

from qtraj.path.stops import Segments


def with_halves(segments: Segments, rows: np.ndarray) -> Segments:
    """Replace the segments `rows` by their first halves, and append their second halves."""
    c, h = segments.coefficients, segments.durations.copy()
    h[rows] *= 0.5
    second = np.array([exactly_shifted(c[i], float(h[i])) for i in rows])
    starts = np.concatenate([segments.starts, segments.starts[rows] + h[rows]])
    return Segments(starts, np.concatenate([c, second]), np.concatenate([h, h[rows]]))


def exactly_reversed(c: np.ndarray, h: float) -> np.ndarray:
    """Return the coefficients of the same polynomials in the variable `h` − t, each rounded once."""
    signs = (-1.0) ** np.arange(c.shape[0])
    return signs[:, None] * exactly_shifted(c, h)


def exactly_shifted(c: np.ndarray, time: float) -> np.ndarray:
    """Return the coefficients of the same polynomials in the variable t − `time`, each rounded once."""
    numerator, denominator = float(time).as_integer_ratio()
    degree, result = c.shape[0] - 1, np.zeros_like(c)
    # With integers T = c·2^e and D = time·2^f, the coefficient k is Σ C(j, k) T_j D^(j − k) / 2^(e + f(j − k)), where
    # C(j, k) is the binomial coefficient, and the sum is over j ≥ k.
    powers = [numerator**k * denominator ** (degree - k) for k in range(degree + 1)]
    weights = [[math.comb(j, k) * powers[j - k] for j in range(k, degree + 1)] for k in range(degree + 1)]
    for axis in range(c.shape[1]):
        ratios = [float(x).as_integer_ratio() for x in c[:, axis]]
        common = max(below for _, below in ratios)  # all denominators are powers of two
        terms = [above * (common // below) for above, below in ratios]
        divisor = common * denominator**degree
        result[:, axis] = [
            sum(x * y for x, y in zip(weights[k], terms[k:], strict=True)) / divisor for k in range(degree + 1)
        ]
    return result
