"""Compute the outputs for one block of paths and instants; each component is a separate array."""

from typing import Any

from jaxtyping import Array, Float

from qtraj.batch.instants import Instants
from qtraj.foundation.namespace import xp
from qtraj.path.channel import CHANNELS
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame
from qtraj.path.vehicle import Vehicle

Channels = dict[str, tuple[Array, ...]]
"""Components of each output by its name; each component is an array (paths, instants)."""


def channels(
    paths: AbstractHodograph,
    t: Float[Array, "rows instants"],
    frame: tuple[AbstractFrame, str, Vehicle | None],
    names: tuple[str, ...],
) -> Channels:
    """Return the named outputs of a batch of paths at the times `t` [s].

    `t` has one row for all paths, or one row for each path. `frame` consists of a frame, the axes of its rate and
    acceleration, and a vehicle or None.
    """
    at, shape = Instants(paths, t, *frame), (paths.duration.shape[0], t.shape[1])

    def components(value: Any) -> tuple[Array, ...]:
        return tuple(xp.broadcast_to(x, shape) for x in (value if isinstance(value, tuple) else (value,)))

    return {name: components(CHANNELS[name].formula(at)) for name in names}
