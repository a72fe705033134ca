"""Define recorded tracks: the measured positions of a vehicle at a sequence of times."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import as_float, concrete, like, part, warn_if_coarse
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent
from qtraj.foundation.seconds import absolute, first_time, seconds, since_first
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import labels_of

MIN_SAMPLES = 4
"""Minimum number of samples of a track; fewer samples do not determine a curve."""

CHORDS = 24
"""Maximum number of chords for the length, and for the direction of travel if no velocities were recorded.

The chords are long compared with the noise, and short enough to follow eight whole turns.
"""

STANDING = 0.05
"""Fraction of the maximum speed below which a sample has no direction of travel."""

STANDSTILL = 0.1
"""If all positions are within this horizontal distance [m] of their mean, the track is at rest.

The velocities are then only noise.
"""

RECORDED_ATTITUDE = "recorded quaternion, scalar first, Hamilton, body to world, not normalised"
RECORDED_RATE = "recorded angular rate, axes of the gyro"
VERTICAL_RATE = "recorded angular rate about the vertical axis of the vehicle, positive to the left"


@storable
class Track(AbstractResult):
    """A recording of the motion of a vehicle.

    `times` (n,) [s] and `positions` (n, 3) [m] are required. `velocities` (n, 3) [m/s], `attitudes` (n, 4) and `rates`
    [rad/s] are optional. Attitudes are quaternions from body to world, scalar first, with any nonzero norm. Positions
    and velocities are in world axes. `rates` are angular rates (n, 3) in the axes of the gyro. Rates (n, 1) contain
    only the rate about the vertical axis of the vehicle, positive to the left.

    Times of NumPy, pandas and Python are converted to seconds. Absolute times (`datetime64`, with a time zone in UTC)
    count from the first of them, which is the `epoch`: the absolute time at which `times` is 0, in ISO 8601, such as
    "2026-05-06T09:00:00.250", or None if unknown. For times in seconds, `epoch` may be given.

    **Raises:** ValueError for wrong shapes, values that are not finite, or times that do not increase strictly; the
    message contains the number of the sample. Also for an `epoch` that is not one absolute time, or was given although
    the times are absolute.
    """

    times: Float[Array, " n"]
    positions: Float[Array, "n 3"]
    velocities: Float[Array, "n 3"] | None
    attitudes: Float[Array, "n 4"] | None
    rates: Float[Array, "n axes"] | None
    epoch: str | None = eqx.field(static=True)

    def __init__(
        self,
        times: ArrayInput,
        positions: ArrayInput,
        velocities: ArrayInput | None = None,
        attitudes: ArrayInput | None = None,
        rates: ArrayInput | None = None,
        epoch: np.datetime64 | str | None = None,
    ):
        first = first_time(times)
        if first is not None and epoch is not None:
            raise ValueError("absolute times were given, and their first is the epoch: omit epoch")
        first = first if epoch is None else absolute(epoch)
        self.epoch = None if first is None else str(first)
        self.times = _times(since_first(times))
        count = self.times.shape[0]
        self.positions = _samples(positions, "positions", count, 3)
        self.velocities = None if velocities is None else _samples(velocities, "velocities", count, 3)
        self.attitudes = None if attitudes is None else _samples(attitudes, "attitudes", count, 4)
        if self.attitudes is not None:
            _require_nonzero(self.attitudes)
        size = 1 if rates is not None and as_float(rates).shape == (count, 1) else 3
        self.rates = None if rates is None else _samples(rates, "rates", count, size)
        warn_if_coarse(positions, "a recorded track")

    def record(self) -> Record:
        """Return the samples over `time`, on the clock of the recording.

        `qtraj.read_track` can read a CSV file of these samples.
        """
        columns = {"position": self.positions, "velocity": self.velocities, "quaternion": self.attitudes}
        recorded = {name: x for name, x in columns.items() if x is not None}
        variables = {name: CHANNELS[name].labelled(x, "time") for name, x in recorded.items()}
        if "quaternion" in variables:
            variables["quaternion"] = variables["quaternion"]._replace(meaning=RECORDED_ATTITUDE)
        if self.rates is not None and self.rates.shape[-1] == 1:
            variables["vertical_rate"] = Quantity(self.rates[..., 0], "rad s-1", VERTICAL_RATE, ("time",))
        elif self.rates is not None:
            variables["rate"] = Quantity(self.rates, "rad s-1", RECORDED_RATE, ("time", "body"))
        time = Quantity(self.times, "s", "time on the recording's own clock", ("time",))
        summary = f"{self.times.shape[-1]} samples, {extent(self.times, 's')}: {', '.join(variables)}"
        about = {"frame": "world"} | ({} if self.epoch is None else {"epoch": self.epoch})
        return Record(summary, variables, {"time": time}, about, labels_of(""))

    @property
    def start_time(self) -> Scalar:
        """The time [s] of the first sample, on the clock of the recording."""
        return self.times[0]

    @property
    def duration(self) -> Scalar:
        """The time [s] from the first to the last sample."""
        return self.times[-1] - self.times[0]

    @property
    def elapsed(self) -> Float[Array, " n"]:
        """The times (n,) [s] since the first sample; they equal the times of a path that starts at the first sample."""
        return self.times - self.times[0]

    @property
    def turn(self) -> Scalar:
        """The turn [rad] of the horizontal direction of travel from the first to the last sample, positive to the left.

        The turn is computed from the recorded velocities or, without velocities, from chords between positions. Samples
        slower than a twentieth of the maximum horizontal speed are ignored. The turn is 0 for a track that stays within
        a horizontal distance of 0.1 m from its mean position.
        """
        return like(np.asarray(travel_turn(self)), self.positions)

    def window(self, t0: ArrayInput, t1: ArrayInput) -> "Track":
        """Return the samples with t0 ≤ time ≤ t1 [s], on the clock of the recording, or absolute if it has an `epoch`.

        **Raises:** ValueError if t0 ≥ t1, or if the window extends beyond the recording or has fewer than 4 samples.
        """
        times = to_float64(self.times)
        origin = None if self.epoch is None else np.datetime64(self.epoch)
        start, end = (float(np.asarray(seconds(absolute(t) if isinstance(t, str) else t, origin))) for t in (t0, t1))
        span = f"the recording runs from {times[0]:.9g} to {times[-1]:.9g} s"
        if not start < end:
            raise ValueError(f"a window must end after it starts, but {start:.9g} to {end:.9g} s was given; {span}")
        if start < times[0] or end > times[-1]:
            raise ValueError(f"the window {start:.9g} to {end:.9g} s extends beyond the recording; {span}")
        first, last = np.searchsorted(times, start, "left"), np.searchsorted(times, end, "right")
        if last - first < MIN_SAMPLES:
            raise ValueError(
                f"the window {start:.9g} to {end:.9g} s contains {last - first} samples, but at least {MIN_SAMPLES} "
                f"are needed. Pass a wider window; {span}."
            )
        chosen = slice(int(first), int(last))
        velocities = None if self.velocities is None else part(self.velocities, chosen)
        attitudes = None if self.attitudes is None else part(self.attitudes, chosen)
        rates = None if self.rates is None else part(self.rates, chosen)
        return Track(part(self.times, chosen), part(self.positions, chosen), velocities, attitudes, rates, self.epoch)


def require_track(track: Track) -> None:
    """Raise a ValueError if the argument `track` is not a track."""
    require_type(track, Track, "track", "a Track, such as the result of qtraj.read_track")


def to_float64(x: Array) -> np.ndarray:
    """Return the values of a recording as a NumPy array in float64.

    **Raises:** ValueError inside a trace, where the values are not concrete.
    """
    values = concrete(x)
    if values is None:
        raise ValueError(
            "the values of a recorded track must be concrete, but they are traced inside jit, grad or vmap"
        )
    return values.astype(np.float64)


def elapsed_times(track: Track) -> np.ndarray:
    """Return the times [s] since the first sample, in float64."""
    times = to_float64(track.times)
    return times - times[0]


def travel_turn(track: Track, standstill: float = STANDSTILL) -> float:
    """Return the signed turn [rad] of the direction of travel.

    The turn is 0 for a track that stays within the horizontal distance `standstill` [m] from its mean position.
    """
    if spread_radius(track) <= standstill:
        return 0.0
    if track.velocities is not None:
        direction = directions(to_float64(track.velocities))[1]
        return float(direction[-1] - direction[0]) if len(direction) else 0.0
    chords, seconds = _chords(track)
    direction = directions(chords / seconds[:, None])[1]
    if len(direction) < 2:
        return 0.0
    # A chord has the direction of the path at its midpoint, so extrapolate the turn by half a chord at both ends.
    end_turns = direction[1] - direction[0] + direction[-1] - direction[-2]
    return float(direction[-1] - direction[0] + 0.5 * end_turns)


def travel_length(track: Track) -> float:
    """Return the horizontal length [m] of the track, measured along chords to reduce the effect of noise."""
    chords, _ = _chords(track)
    return float(np.hypot(*chords.T).sum())


def spread_radius(track: Track) -> float:
    """Return the largest horizontal distance [m] of a sample from the mean position."""
    positions = to_float64(track.positions)[:, :2]
    return float(np.hypot(*(positions - positions.mean(axis=0)).T).max())


def directions(velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices (m,) of the velocities that have a direction, and their unwrapped directions (m,) [rad].

    A velocity has a direction if its horizontal magnitude exceeds `STANDING` times the largest horizontal magnitude.
    """
    speed = np.hypot(*velocities[:, :2].T)
    moving = np.flatnonzero(speed > STANDING * speed.max(initial=0.0))
    x, y = velocities[moving, :2].T
    return moving, np.unwrap(np.arctan2(y, x))


def chord_marks(count: int) -> np.ndarray:
    """Return the indices of the samples at which chords start and end, for a track of `count` samples."""
    return np.linspace(0, count - 1, min(count, CHORDS + 1)).round().astype(int)


def _chords(track: Track) -> tuple[np.ndarray, np.ndarray]:
    positions, times = to_float64(track.positions)[:, :2], to_float64(track.times)
    marks = chord_marks(len(times))
    return np.diff(positions[marks], axis=0), np.diff(times[marks])


def _times(values: ArrayInput) -> Float[Array, " n"]:
    times = as_float(values)
    if times.ndim != 1 or times.shape[0] < MIN_SAMPLES:
        raise ValueError(
            f"the times of a track must be a vector of at least {MIN_SAMPLES} times, "
            f"but an array of shape {times.shape} was given"
        )
    _require_finite(times, "times")
    stored, original = concrete(times), np.asarray(values) if concrete(times) is not None else None
    if stored is None or original is None:
        return times
    not_increasing = np.flatnonzero(~(np.diff(original) > 0))
    if not_increasing.size:
        k = int(not_increasing[0]) + 1
        raise ValueError(
            f"the times of a track must increase strictly, but times[{k}] = {original[k]:.17g} s follows "
            f"times[{k - 1}] = {original[k - 1]:.17g} s"
        )
    if not np.all(np.diff(stored) > 0):
        raise ValueError(
            f"the times of this track, about {stored[0]:.9g} s, are not distinct in {stored.dtype}. "
            "Call jax.config.update('jax_enable_x64', True) first, or subtract the start time."
        )
    return times


def _samples(values: ArrayInput, name: str, count: int, size: int) -> Float[Array, "n m"]:
    samples = as_float(values)
    if samples.shape != (count, size):
        raise ValueError(
            f"the {name} of a track must have shape ({count}, {size}), one row for each time, "
            f"but an array of shape {samples.shape} was given"
        )
    _require_finite(samples, name)
    return samples


def _require_finite(samples: Array, name: str) -> None:
    values = concrete(samples)
    if values is None:
        return
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        raise ValueError(
            f"the {name} of a track must be finite, but sample {bad[0][0]} is {values[bad[0][0]].tolist()}"
        )


def _require_nonzero(attitudes: Array) -> None:
    values = concrete(attitudes)
    if values is None:
        return
    bad = np.flatnonzero(~values.any(axis=1))
    if bad.size:
        raise ValueError(f"the attitudes of a track must be nonzero quaternions, but sample {bad[0]} is zero")
