"""Recorded tracks: the measured positions of a vehicle, sample by sample."""

import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_array, as_float, concrete, part, warn_if_coarse
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import labels_of

MIN_SAMPLES = 4
"""Fewer samples do not determine a curve."""

CHORDS = 24
"""Number of chords for the length, and for the direction of travel without recorded velocities. The chords are long
compared with the noise, and short enough to follow eight whole turns."""

STANDING = 0.05
"""Below this fraction of the maximum speed a sample has no direction of travel."""

STANDSTILL = 0.1
"""[m] A track that stays within this distance of its mean position is at rest: its velocities are only noise."""

RECORDED_ATTITUDE = "recorded quaternion, scalar first, Hamilton, body to world, not normalised"


@storable
class Track(AbstractResult):
    """A recording of the motion of a vehicle.

    `times` (n,) [s] and `positions` (n, 3) [m] are required. `velocities` (n, 3) [m/s] and `attitudes` (n, 4),
    quaternions body to world, scalar first, of any nonzero norm, are optional. Positions and velocities are in world
    axes.

    **Raises:** ValueError for wrong shapes, values that are not finite, or times that do not increase strictly; the
    message names the sample.
    """

    times: Float[Array, " n"]
    positions: Float[Array, "n 3"]
    velocities: Float[Array, "n 3"] | None
    attitudes: Float[Array, "n 4"] | None

    def __init__(
        self,
        times: ArrayInput,
        positions: ArrayInput,
        velocities: ArrayInput | None = None,
        attitudes: ArrayInput | None = None,
    ):
        self.times = _times(times)
        count = self.times.shape[0]
        self.positions = _samples(positions, "positions", count, 3)
        self.velocities = None if velocities is None else _samples(velocities, "velocities", count, 3)
        self.attitudes = None if attitudes is None else _samples(attitudes, "attitudes", count, 4)
        if self.attitudes is not None:
            _require_nonzero(self.attitudes)
        warn_if_coarse(self.positions, "a recorded track")

    def record(self) -> Record:
        """The samples over `time`, on the recording's own clock; `qtraj.read_track` reads them as CSV."""
        columns = {"position": self.positions, "velocity": self.velocities, "quaternion": self.attitudes}
        recorded = {name: x for name, x in columns.items() if x is not None}
        variables = {name: CHANNELS[name].labelled(x, "time") for name, x in recorded.items()}
        if "quaternion" in variables:
            variables["quaternion"] = variables["quaternion"]._replace(meaning=RECORDED_ATTITUDE)
        time = Quantity(self.times, "s", "time on the recording's own clock", ("time",))
        summary = f"{self.times.shape[-1]} samples, {extent(self.times, 's')}: {', '.join(variables)}"
        return Record(summary, variables, {"time": time}, {"frame": "world"}, labels_of(""))

    @property
    def start_time(self) -> Scalar:
        """The time of the first sample [s], on the recording's own clock."""
        return self.times[0]

    @property
    def duration(self) -> Scalar:
        """The time from the first to the last sample [s]."""
        return self.times[-1] - self.times[0]

    @property
    def elapsed(self) -> Float[Array, " n"]:
        """Times since the first sample (n,) [s], which are the times on a path that starts with the track."""
        return self.times - self.times[0]

    @property
    def turn(self) -> Scalar:
        """The turn of the horizontal direction of travel from the first to the last sample, left positive [rad].

        Computed from the recorded velocities, or from chords between positions. Samples slower than a twentieth of the
        maximum speed are ignored. The turn is 0 for a track that stays within 0.1 m of its mean position.
        """
        return as_array(travel_turn(self), self.positions.dtype)

    def window(self, t0: ArrayInput, t1: ArrayInput) -> "Track":
        """The samples with t0 ≤ time ≤ t1, on the recording's own clock [s].

        **Raises:** ValueError if t0 ≥ t1, the window extends beyond the recording, or has fewer than 4 samples.
        """
        times = to_float64(self.times)
        start, end = float(np.asarray(t0)), float(np.asarray(t1))
        span = f"the recording runs from {times[0]:.9g} to {times[-1]:.9g} s"
        if not start < end:
            raise ValueError(f"a window must end after it starts, but {start:.9g} to {end:.9g} s was given; {span}")
        if start < times[0] or end > times[-1]:
            raise ValueError(f"the window {start:.9g} to {end:.9g} s extends beyond the recording; {span}")
        first, last = np.searchsorted(times, start, "left"), np.searchsorted(times, end, "right")
        if last - first < MIN_SAMPLES:
            raise ValueError(
                f"the window {start:.9g} to {end:.9g} s has {last - first} samples, but at least {MIN_SAMPLES} "
                f"are needed. Widen it; {span}."
            )
        chosen = slice(int(first), int(last))
        velocities = None if self.velocities is None else part(self.velocities, chosen)
        attitudes = None if self.attitudes is None else part(self.attitudes, chosen)
        return Track(part(self.times, chosen), part(self.positions, chosen), velocities, attitudes)


def to_float64(x: Array) -> np.ndarray:
    """The values of a recording as a NumPy array in float64.

    **Raises:** ValueError inside a trace, where the values are not concrete.
    """
    values = concrete(x)
    if values is None:
        raise ValueError(
            "the values of a recorded track must be concrete here, but they are traced inside jit, grad or vmap"
        )
    return values.astype(np.float64)


def elapsed_times(track: Track) -> np.ndarray:
    """The times since the first sample [s], in float64."""
    times = to_float64(track.times)
    return times - times[0]


def travel_turn(track: Track, standstill: float = STANDSTILL) -> float:
    """The signed turn of the horizontal direction of travel [rad]; 0 if the track stays within `standstill` [m]."""
    if spread_radius(track) <= standstill:
        return 0.0
    if track.velocities is not None:
        direction = directions(to_float64(track.velocities))[1]
        return float(direction[-1] - direction[0]) if len(direction) else 0.0
    chords, seconds = _chords(track)
    direction = directions(chords / seconds[:, None])[1]
    if len(direction) < 2:
        return 0.0
    # A chord has the direction at its midpoint, so the turn is extrapolated by half a chord at both ends.
    end_turns = direction[1] - direction[0] + direction[-1] - direction[-2]
    return float(direction[-1] - direction[0] + 0.5 * end_turns)


def travel_length(track: Track) -> float:
    """The horizontal length of the track [m], along chords, so that noise has little effect."""
    chords, _ = _chords(track)
    return float(np.hypot(*chords.T).sum())


def spread_radius(track: Track) -> float:
    """The largest horizontal distance of a sample from the mean position [m]."""
    positions = to_float64(track.positions)[:, :2]
    return float(np.hypot(*(positions - positions.mean(axis=0)).T).max())


def directions(velocities: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (m,) of the samples that move, and their continuous horizontal directions (m,) [rad]."""
    speed = np.hypot(*velocities[:, :2].T)
    moving = np.flatnonzero(speed > STANDING * speed.max(initial=0.0))
    x, y = velocities[moving, :2].T
    return moving, np.unwrap(np.arctan2(y, x))


def chord_marks(count: int) -> np.ndarray:
    """The indices, among `count` samples, of the ends of the chords."""
    return np.linspace(0, count - 1, min(count, CHORDS + 1)).round().astype(int)


def _chords(track: Track) -> tuple[np.ndarray, np.ndarray]:
    positions, times = to_float64(track.positions)[:, :2], to_float64(track.times)
    marks = chord_marks(len(times))
    return np.diff(positions[marks], axis=0), np.diff(times[marks])


def _times(values: ArrayInput) -> Float[Array, " n"]:
    times = as_float(values)
    if times.ndim != 1 or times.shape[0] < MIN_SAMPLES:
        raise ValueError(
            f"the times of a track must be a vector of at least {MIN_SAMPLES}, "
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
