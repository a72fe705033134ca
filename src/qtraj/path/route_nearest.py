"""Find the point on a route nearest to a given point."""

import numpy as np
from jaxtyping import Array

from qtraj.algebra.vector import norm
from qtraj.foundation.namespace import in_numpy_or_jit, repeat, stop_gradient, xp
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path import pieces
from qtraj.path.nearest import Nearest, moved

PARTS = 16
"""Number of intervals between the samples of a segment."""

STEPS = 8
"""Number of Newton steps that refine the nearest sample of a segment."""


@in_numpy_or_jit
def nearest(starts: Array, c: Array, duration: Scalar, point: Vec3) -> Nearest:
    """Find the nearest point on a route; `point` and the resulting position are relative to the origin of the route.

    `starts` (rows,) [s], `c` (rows, terms, 3) and `duration` [s] are start times, coefficients and duration of a
    `Route`.
    """
    fixed, target = stop_gradient((c, point))
    h = stop_gradient(pieces.durations(starts, duration))
    u = np.linspace(0.0, 1.0, PARTS + 1).astype(c.dtype)
    s = h[:, None] * u[None]  # the axes are the segments and the samples
    spread = xp.broadcast_to(fixed[:, None], (*s.shape, *fixed.shape[1:]))
    offset = pieces.values(spread, s, 0)[0] - target[None, None]
    best = xp.argmin(xp.sum(offset**2, axis=-1), axis=1)
    middle = xp.take_along_axis(s, best[:, None], axis=1)[:, 0]
    low, high = xp.maximum(middle - h / PARTS, 0.0), xp.minimum(middle + h / PARTS, h)

    def newton(s: Array) -> Array:
        r, v, a = pieces.values(fixed, s, 2)
        offset = r - target[None]
        gradient, hessian = xp.sum(offset * v, axis=-1), xp.sum(v * v + offset * a, axis=-1)
        convex = hessian > 0
        step = xp.where(convex, -gradient / xp.where(convex, hessian, 1.0), -xp.sign(gradient) * h / PARTS)
        return xp.clip(s + step, low, high)

    refined = repeat(STEPS, newton, middle)
    times = xp.stack([middle, refined])
    both = xp.broadcast_to(fixed[None], (2, *fixed.shape))
    squares = xp.sum((pieces.values(both, times, 0)[0] - target[None, None]) ** 2, axis=-1)
    squares = xp.where(xp.isfinite(starts)[None], squares, xp.inf)
    best = xp.argmin(squares)
    row = best % starts.shape[0]
    s = times.reshape(-1)[best]
    r, v, a = pieces.values(c[row], s, 2)
    time = starts[row] + s
    s = s + moved(r - point, v, a, (time > 0) & (time < duration))
    position = pieces.values(c[row], s, 0)[0]
    return Nearest(starts[row] + s, position, norm(position - point))
