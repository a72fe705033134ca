"""The recording that a route is fitted to, in units of its own."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.fitting.route_sigmas import Sigmas, read_sigmas
from qtraj.design.fitting.units import Units, units
from qtraj.foundation.types import ArrayInput
from qtraj.path.track import Track, to_float64


class Recording(NamedTuple):
    """The n samples of a recording in its own units: times and positions relative to the first sample, and velocities.

    The weights are 0 for outliers and otherwise 1. They are multiplied by the weights from the standard deviations. In
    a fit along the course of a drive, the times are its parameters, and `rates` their derivatives; otherwise None.
    """

    times: Float[np.ndarray, " n"]
    positions: Float[np.ndarray, "n 3"]
    velocities: Float[np.ndarray, "n 3"] | None
    weights: Float[np.ndarray, " n"]
    position_sigmas: Sigmas
    velocity_sigmas: Sigmas
    units: Units
    rates: Float[np.ndarray, " n"] | None = None

    @property
    def position_weights(self) -> Float[np.ndarray, "n *axes"]:
        """The weights (n,) or (n, 3) of the positions."""
        return self.position_sigmas.of(self.weights)

    @property
    def step(self) -> float:
        """The median time step."""
        return float(np.median(np.diff(self.times)))


def read_recording(track: Track, position_sigma: ArrayInput | None, velocity_sigma: ArrayInput | None) -> Recording:
    """Return the samples of a track with their standard deviations [m], [m/s].

    **Raises:** ValueError for invalid standard deviations, or those of velocities that were not recorded.
    """
    times, positions = to_float64(track.times), to_float64(track.positions)
    times, positions = times - times[0], positions - positions[0]
    velocities = None if track.velocities is None else to_float64(track.velocities)
    if velocities is None and velocity_sigma is not None:
        raise ValueError("velocity_sigma was given, but the track has no velocities: omit velocity_sigma")
    own = units(times, positions)
    speed = own.length / own.time
    return Recording(
        times / own.time,
        positions / own.length,
        None if velocities is None else velocities / speed,
        np.ones(len(times)),
        read_sigmas(position_sigma, "position_sigma", len(times)).per(own.length),
        read_sigmas(velocity_sigma, "velocity_sigma", len(times)).per(speed),
        own,
    )
