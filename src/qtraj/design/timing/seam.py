"""Join the end of a lap to its start: the squared speed u̇²(u) is a periodic spline.

A periodic spline with n cells has n coefficients. It is represented by n + 3 coefficients, like any other spline, of
which the last three repeat the first three. So value, slope and second derivative are equal at both ends. In a gradient
and in a matrix of second derivatives, the entries of a coefficient and of its repetition are added. The matrix is then
a cyclic band matrix. Its rows are taken alternately from both ends, which makes it a band matrix of twice the width.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import is_host, namespace

DEGREE = 3


def repeated(coefficients: Float[Any, "*batch cells+3"], seam: Any) -> Float[Any, "*batch cells+3"]:
    """Return the coefficients; if `seam` is 1, the last three repeat the first three. If it is 0, nothing changes."""
    if is_host(seam) and not seam:
        return coefficients
    xp = namespace(coefficients, seam)
    last = coefficients[..., -DEGREE:] * (1 - seam) + coefficients[..., :DEGREE] * seam
    return xp.concatenate([coefficients[..., :-DEGREE], last], axis=-1)


def added(gradient: Float[Any, "*batch cells+3"], seam: Any) -> Float[Any, "*batch cells+3"]:
    """Return a gradient; if `seam` is 1, the entries of repeated coefficients are added to those of the first three."""
    if is_host(seam) and not seam:
        return gradient
    xp, own = namespace(gradient, seam), gradient[..., -DEGREE:]
    first = gradient[..., :DEGREE] + own * seam
    return xp.concatenate([first, gradient[..., DEGREE:-DEGREE], own * (1 - seam)], axis=-1)


def order(count: int) -> np.ndarray:
    """Return the indices 0, n − 1, 1, n − 2, … of `count` coefficients, in which cyclic neighbours are close."""
    found = np.empty(count, int)
    found[::2], found[1::2] = np.arange((count + 1) // 2), np.arange(count - 1, (count - 1) // 2, -1)
    return found


def folded(diagonals: tuple[Float[np.ndarray, "batch cells+3"], ...]) -> Float[np.ndarray, "batch cells width"]:
    """Return a cyclic matrix as rows of a band matrix, whose coefficients have the order of `order`.

    Any d of `diagonals` contains the entries (i, i − d) for all cells + 3 coefficients. Row i of the result contains
    the entries (i, i − width + 1) to (i, i).
    """
    batch, count = diagonals[0].shape[0], diagonals[0].shape[1] - DEGREE
    place, width = np.argsort(order(count)), 2 * DEGREE + 1
    band = np.zeros((batch, count, width))
    for d, entries in enumerate(diagonals):
        at = np.arange(d, count + DEGREE)
        rows, columns = place[at % count], place[(at - d) % count]
        low, high = np.minimum(rows, columns), np.maximum(rows, columns)
        place_in_band: Any = (slice(None), high, width - 1 - (high - low))
        np.add.at(band, place_in_band, entries[:, d:])  # a repeated coefficient has the place of another one
    return band
