"""Compute the differences between a path and a recorded track."""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.foundation.arrays import as_array, as_float, bucket, concrete, like
from qtraj.foundation.document import reads_older, storable
from qtraj.foundation.namespace import in_numpy, is_host, needs_jax, xp
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import STANDING, Track, elapsed_times, to_float64

DURATION_TOLERANCE = 1e-6
"""Fraction of the path's duration by which a track may be longer than the path, to allow for rounding."""

MEANINGS = {
    "horizontal_rms": ("m", "root mean square of the horizontal distance"),
    "vertical_rms": ("m", "root mean square of the vertical distance"),
    "distance_rms": ("m", "root mean square of the distance"),
    "maximum": ("m", "largest distance"),
    "turn": ("rad", "turn of the recorded direction of travel, positive to the left"),
    "samples": ("1", "number of samples compared"),
    "velocity_rms": ("m s-1", "root mean square of the difference of velocities"),
    "direction_rms": ("rad", "root mean square of the angle between recorded velocity and tangent"),
    "radius_min": ("m", "smallest radius at the samples"),
    "radius_max": ("m", "largest radius at the samples"),
}
"""Unit and meaning of every field."""


def _from_older(fields: dict[str, Any]) -> dict[str, Any]:
    """Remove the result of the fit, which older residuals contained, from the fields of a document."""
    return {name: value for name, value in fields.items() if name not in ("converged", "message")}


@reads_older(_from_older)
@storable
class Residual(AbstractResult):
    """Differences between a recorded track and a path, over all samples; RMS is the root mean square.

    `horizontal_rms`, `vertical_rms` and `distance_rms` [m] refer to the horizontal, vertical and spatial distances
    between the recorded position and the path at the same time; `maximum` [m] is the largest spatial distance.
    `velocity_rms` [m/s] refers to the difference of the velocities, and `direction_rms` [rad] to the angle between the
    recorded velocity and the tangent of the path at samples where the vehicle moves. Both are None if no velocities
    were recorded. `turn` [rad] is the turn of the recorded direction of travel, positive to the left (`path.turn` is
    the angle about the axis). `radius_min` and `radius_max` [m] are the smallest and the largest distance of the path
    from its axis at the samples; they are None if the path is not a spiral-helix.
    """

    horizontal_rms: Scalar
    vertical_rms: Scalar
    distance_rms: Scalar
    maximum: Scalar
    turn: Scalar
    samples: Int[Array, ""]
    velocity_rms: Scalar | None
    direction_rms: Scalar | None
    radius_min: Scalar | None
    radius_max: Scalar | None

    def __init__(
        self,
        horizontal_rms: ArrayInput,
        vertical_rms: ArrayInput,
        distance_rms: ArrayInput,
        maximum: ArrayInput,
        turn: ArrayInput,
        samples: ArrayInput,
        velocity_rms: ArrayInput | None = None,
        direction_rms: ArrayInput | None = None,
        radius_min: ArrayInput | None = None,
        radius_max: ArrayInput | None = None,
    ):
        self.horizontal_rms = as_float(horizontal_rms)
        self.vertical_rms = as_float(vertical_rms)
        self.distance_rms = as_float(distance_rms)
        self.maximum = as_float(maximum)
        self.turn = as_float(turn)
        self.samples = as_array(samples, int)
        self.velocity_rms = _optional(velocity_rms)
        self.direction_rms = _optional(direction_rms)
        self.radius_min = _optional(radius_min)
        self.radius_max = _optional(radius_max)

    def record(self) -> Record:
        """Return labelled quantities for the fields that are not None."""
        quantities = {name: Quantity(getattr(self, name), unit, text) for name, (unit, text) in MEANINGS.items()}
        variables = {name: q for name, q in quantities.items() if q.values is not None}
        rms = f"{extent(self.horizontal_rms, 'm')} horizontal, {extent(self.vertical_rms, 'm')} vertical"
        summary = f"{batch_prefix(self.samples.shape)}RMS {rms}, largest {extent(self.maximum, 'm')}"
        return Record(f"{summary}, {extent(self.samples)} samples", variables, attributes={"frame": "world"})


def compare(path: AbstractHodograph, track: Track) -> Residual:
    """Compare `path` with `track`; the first sample of the track corresponds to time 0 of the path.

    The result is differentiable with respect to the path.

    **Raises:** ValueError if the track is longer than the path.
    """
    _require_covered(path, track)
    elapsed = elapsed_times(track)
    dtype = path.duration.dtype
    velocities = None if track.velocities is None else to_float64(track.velocities)
    positions = to_float64(track.positions)
    if path.supports_numpy and not needs_jax(jax.tree.leaves(path)):
        count: Any = len(elapsed)
        v = None if velocities is None else like(velocities, path.duration)
        measures = _measures_in_numpy(path, like(elapsed, path.duration), like(positions, path.duration), v, count)
        return Residual(**measures, turn=track.turn, samples=len(elapsed))

    # Pad with copies of the first sample, so that tracks of similar length share an executable. `count` is the number
    # of samples without the copies.
    def padded(x: np.ndarray) -> Array:
        padding = np.repeat(x[:1], bucket(len(x)) - len(x), axis=0)
        return as_array(np.concatenate([x, padding]), dtype)

    v = None if velocities is None else padded(velocities)
    measures = _compiled_measures(path, padded(elapsed), padded(positions), v, as_array(len(elapsed), int))
    return Residual(**measures, turn=track.turn, samples=len(elapsed))


def _measures(
    path: AbstractHodograph,
    times: Float[Array, " n"],
    positions: Float[Array, "n 3"],
    velocities: Float[Array, "n 3"] | None,
    count: Int[Array, ""],
) -> dict[str, Any]:
    """Compute the fields of the residual from the first `count` samples."""
    position, velocity = _states(path, times)
    valid = xp.arange(times.shape[0]) < count
    squares = xp.where(valid[:, None], position - positions, 0.0) ** 2
    distance = xp.sum(squares, axis=1)
    sums = {"horizontal_rms": squares[:, 0] + squares[:, 1], "vertical_rms": squares[:, 2], "distance_rms": distance}
    if velocities is not None:
        sums["velocity_rms"] = xp.sum(xp.where(valid[:, None], velocity - velocities, 0.0) ** 2, axis=1)
        angles, moving = _angles(velocity, velocities, valid)
        sums["direction_rms"] = angles**2 * xp.asarray(count / moving, angles.dtype)
    means = xp.sum(xp.stack([*sums.values()]), axis=1) / xp.asarray(count, times.dtype)
    measures: dict[str, Any] = dict.fromkeys(("velocity_rms", "direction_rms", "radius_min", "radius_max"))
    measures |= dict(zip(sums, _root(means), strict=True)) | {"maximum": _root(xp.max(distance))}
    if isinstance(path, SpiralHelix):
        radius = xp.polyval(path.radius[::-1], times)
        measures |= {"radius_min": xp.min(radius), "radius_max": xp.max(radius)}
    return measures


_compiled_measures, _measures_in_numpy = eqx.filter_jit(_measures), in_numpy(_measures)


def _states(path: AbstractHodograph, times: Float[Array, " n"]) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """Return the positions and velocities of a path."""
    if is_host(times):
        position, velocity = path.sampled(times, 1)
        return position, velocity
    states = jax.vmap(lambda t: path.derivatives(t, 1))(times)
    return states[:, 0], states[:, 1]


def _angles(
    velocities: Float[Array, "n 3"], recorded: Float[Array, "n 3"], valid: Bool[Array, " n"]
) -> tuple[Float[Array, " n"], Int[Array, ""]]:
    """Return the angles (n,) [rad] between tangent and recorded velocity, and the number of samples with motion.

    For a sample without motion, the angle is 0. If no sample has motion, the number is 1, so that it can be a divisor.
    """
    speeds = xp.sum(recorded**2, axis=1)
    moving = valid & (speeds > STANDING**2 * xp.max(speeds)) & (xp.sum(velocities**2, axis=1) > 0)
    along = xp.where(moving, xp.sum(velocities * recorded, axis=1), 1.0)
    across = xp.where(moving[:, None], xp.cross(velocities, recorded), 0.0)
    return xp.arctan2(_root(xp.sum(across**2, axis=1)), along), xp.maximum(xp.sum(moving), 1)


def _root(squares: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """Return square roots whose derivative is 0 at 0."""
    zero = squares == 0
    return xp.where(zero, 0.0, xp.sqrt(xp.where(zero, 1.0, squares)))


def _optional(x: ArrayInput | None) -> Scalar | None:
    return None if x is None else as_float(x)


def _require_covered(path: AbstractHodograph, track: Track) -> None:
    duration, track_duration = concrete(path.duration), elapsed_times(track)[-1]
    if duration is None:
        return
    if track_duration > float(duration) * (1 + DURATION_TOLERANCE):
        raise ValueError(
            f"the track lasts {track_duration:.9g} s, but the path only {float(duration):.9g} s: "
            "pass the interval of the track that the path covers, track.window(t0, t1)."
        )
