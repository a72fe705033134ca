"""Return the polynomials of a path in the representation that the proof uses."""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.timing.directions import Direction, directions
from qtraj.design.timing.parts import known_segments, standing_ends
from qtraj.foundation.arrays import is_traced
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route


class Source(NamedTuple):
    """The polynomials of the segments in their moving basis: ascending coefficients in t [s], and durations [s].

    A route has no `y` of a moving basis, but the world axes; its `angle` is None. `directions` are those of the
    segments that start or end at a stop, by the index of the segment.
    """

    x: Float[Any, "terms segments"]
    y: Float[Any, "terms segments"] | None
    z: Float[Any, "terms segments"]
    angle: Float[Any, "terms segments"] | None
    durations: Float[Any, " segments"]
    directions: dict[int, Direction]


def source(path: AbstractHodograph) -> Source | None:
    """Return the polynomials of the segments and the directions at stops, or None if the path is not polynomial."""
    if isinstance(path, Route):
        segments = known_segments(path)
        c = segments.coefficients.copy()
        c[:, 0] = 0.0  # only derivatives are needed
        x, y, z = (c[:, :, axis].T for axis in range(3))
        return Source(x, y, z, None, segments.durations, directions(segments, standing_ends(segments)))
    own = path.polynomials()
    if own is None:
        return None
    given = own.x, own.y, own.z, own.angle, path.duration
    given = given if is_traced(given) else jax.tree.map(np.asarray, given)
    x, y, z, angle, duration = jax.tree.map(lambda x: x[..., None], given)
    return Source(x, y, z, angle, duration, {})
