"""Return the polynomials of a path in the representation that the proof uses."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.timing.directions import directions
from qtraj.design.timing.parts import known_segments, standing_ends
from qtraj.path import pieces
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.moving_basis import MovingPolynomials
from qtraj.path.route import Route


class Source(NamedTuple):
    """The polynomials of the segments (on the last axis), their durations [s], and the directions `ahead`.

    `ahead` contains the fields of `Directions`, with polynomials instead of coefficients. It is None if no moving
    segment starts or ends at a stop.
    """

    polynomials: MovingPolynomials
    durations: Float[Array, " segments"]
    ahead: tuple[MovingPolynomials, Int[np.ndarray, "segments 2"], Float[np.ndarray, " segments"]] | None


def source(path: AbstractHodograph) -> Source | None:
    """Return the polynomials of the segments and the directions at stops, or None if the path is not polynomial."""
    if isinstance(path, Route):
        segments = known_segments(path)
        more = pieces.padded_size(segments.durations.size) - segments.durations.size
        durations = jnp.asarray(np.append(segments.durations, np.ones(more)))
        found = directions(segments, standing_ends(segments))
        if found is None:
            return Source(_in_world(segments.coefficients), durations, None)
        ahead = (
            _in_world(found.coefficients),
            np.pad(found.powers, [(0, more), (0, 0)]),
            np.pad(found.roundings, (0, more)),
        )
        return Source(_in_world(segments.coefficients), durations, ahead)
    own = path.polynomials()
    if own is None:
        return None
    x, y, z, angle = jax.tree.map(lambda x: x[..., None], (own.x, own.y, own.z, own.angle))
    return Source(MovingPolynomials(x, y, z, angle), path.duration[None], None)


def _in_world(c: Float[np.ndarray, "segments terms 3"]) -> MovingPolynomials:
    _, padded = pieces.padded(np.zeros(len(c)), c)  # routes of similar length share an executable
    x, y, z = (np.array(padded[..., k].T) for k in range(3))
    x[0], y[0] = (
        0.0,
        0.0,
    )  # only derivatives are needed; a distant start would enlarge the unit of length and so the rounding errors
    return MovingPolynomials(jnp.asarray(x), jnp.asarray(y), jnp.asarray(z), jnp.zeros((1, x.shape[1])))
