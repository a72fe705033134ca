"""Compare recorded angular rates with an attitude program, after removing the constant mounting of the gyro."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.attitude import require_program
from qtraj.motion.attitude_residual import require_covered
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path import headings
from qtraj.path.driving import segments_of
from qtraj.path.route import Route
from qtraj.path.track import Track, elapsed_times, require_track, to_float64

AXES = ("x", "y", "z")

MIN_SPEED = 3.0
"""Default speed [m/s] above which rates are compared; at low speeds, noise determines the direction of travel."""

MIN_SAMPLES = 3
"""Minimum number of samples for a correlation."""

OPPOSITE = -0.5
"""A correlation below this value is that of the same motion with another sign; above it, noise is more likely."""

ONE_AXIS = 1e-9
"""Rates count as rates about one axis if the second singular value of Σpωᵀ is at most this fraction of the first.

For each sample, p (3,) is the rate of the program, and ω (3,) the recorded rate. The sum is over the samples.
"""


@storable
class RateResidual(AbstractResult):
    """The residual of recorded angular rates relative to a program, at all samples with a speed above a minimum.

    `mounting` (4,): the constant unit quaternion from the axes of the gyro to the axes of the program, or None if only
    the yaw rate was recorded. `rms` [rad/s]: the root mean square of the difference between the recorded rates and
    the rates of the program. `correlation`: the correlation between these rates. Both refer to the rates about each
    axis of the program (3,), or about its z axis (1,) if only the yaw rate was recorded. The correlation is 0
    where one of the rates is constant. `samples`: the number of samples that were compared. `note` explains a
    correlation below 0, such as that of a yaw rate that is positive to the right.
    """

    rms: Float[Array, " axes"]
    correlation: Float[Array, " axes"]
    samples: Int[Array, ""]
    mounting: Quat | None

    def __init__(
        self, rms: ArrayInput, correlation: ArrayInput, samples: ArrayInput, mounting: ArrayInput | None = None
    ):
        self.rms, self.correlation = as_float(rms), as_float(correlation)
        self.samples = as_array(samples, int)
        self.mounting = None if mounting is None else as_float(mounting)

    @property
    def note(self) -> str:
        """A text about correlations below 0, with the likely cause; empty if there are none."""
        correlation = np.asarray(self.correlation)
        if not (correlation < 0).any():
            return ""
        names = ("yaw",) if correlation.size == 1 else AXES
        k = int(np.argmin(correlation))
        return f"the correlation about {names[k]} is {correlation[k]:.3f}: {self._cause(float(correlation[k]))}"

    def _cause(self, correlation: float) -> str:
        """Return the likely cause of the smallest correlation."""
        if correlation > OPPOSITE:
            return "the rate about this axis is probably mostly noise, or the recording has other times"
        if self.mounting is None:
            return (
                "the recorded yaw rate is probably positive to the right, as in the body axes forward, right, down, "
                "but must be positive to the left: change its sign"
            )
        return (
            "no rotation of the gyro explains this, so its axes are probably left-handed, or one of the rates has the "
            "wrong sign or column"
        )

    def record(self) -> Record:
        """Return the fields with units and meanings."""
        along = "body" if self.mounting is not None else "vertical"
        variables = {
            "rms": Quantity(
                self.rms, "rad s-1", "RMS difference between the recorded rate and the program's rate", (along,)
            ),
            "correlation": Quantity(
                self.correlation, "1", "correlation of the recorded rate with the program's rate", (along,)
            ),
            "samples": Quantity(self.samples, "1", "number of samples compared"),
        }
        if self.note:
            variables["note"] = Quantity(np.array(self.note), "", "correlations below 0, with the likely cause")
        if self.mounting is not None:
            meaning = "constant attitude of the gyro relative to the program's axes, scalar first"
            variables["mounting"] = Quantity(self.mounting, "1", meaning, ("component",))
        summary = f"RMS {extent(self.rms, 'rad s-1')}, {extent(self.samples)} samples{self.note and '; '}{self.note}"
        return Record(summary, variables, attributes={"frame": "body"})


@of_one_device
def compare_rates(program: FrameProgram, track: Track, min_speed: float | int = MIN_SPEED) -> RateResidual:
    """Compare the recorded angular rates of `track` with `program`, which starts at the first sample of the track.

    Samples are compared if the speed of the path exceeds `min_speed` [m/s] and the rate of the program is finite. With
    rates (n, 3), the mounting of the gyro is estimated. The estimate minimises the sum of squared differences between
    the rotated recorded rates and the program's rates (Kabsch, "A solution for the best rotation to relate two sets of
    vectors", Acta Cryst. A32, 1976). If all rates are about one axis, the rotation about this axis is undetermined, and
    the mounting is the smallest rotation from the axis of the recorded rates to the axis of the program's rates. Rates
    (n, 1) are compared with the rate about the program's z axis. A constant bias of the gyro is not estimated. It does
    not change the correlation of rates (n, 1); for rates (n, 3), it changes the estimated mounting.

    The result is not differentiable.

    **Raises:** ValueError for a track without rates, a track that lasts longer than the program, fewer than three
    samples above `min_speed`, and inside a trace.
    """
    require_program(program)
    require_track(track)
    if track.rates is None:
        raise ValueError(
            "this track has no angular rates to compare: read them with "
            'qtraj.read_track(..., columns={"rate": ["wx", "wy", "wz"]}) or columns={"rate": "wz"}'
        )
    found = compare_fast(program, track, min_speed)
    if found is None:
        raise ValueError(
            f"the path exceeds min_speed = {float(min_speed):g} m/s at fewer than {MIN_SAMPLES} samples of the track, "
            "too few for a comparison: pass a smaller min_speed"
        )
    return found


def compare_fast(program: FrameProgram, track: Track, min_speed: float | int = MIN_SPEED) -> RateResidual | None:
    """Return the result of `compare_rates`, or None if the track has no rates or too few samples above `min_speed`."""
    if track.rates is None:
        return None
    times = elapsed_times(track)
    require_covered(program, float(times[-1]))
    expected, speeds = map(to_float64, _rates(program, as_array(times, jnp.result_type(program.duration, float))))
    return _compared(to_float64(track.rates), expected, speeds, min_speed)


def compare_upright(path: Route, track: Track) -> RateResidual | None:
    """Return the result of `compare_rates` for the default program of a route, without compiled code.

    Return None if the track has no rates, or too few samples above `MIN_SPEED`.
    """
    if track.rates is None:
        return None
    times, segments, up = elapsed_times(track), segments_of(path), np.array([0.0, 0.0, 1.0])
    _, velocity, acceleration = segments.rows(times, 2)
    speeds = np.sqrt(np.einsum("nk,nk->n", velocity, velocity))
    expected = headings.body_rates(headings.along(segments, up), up, times, velocity, acceleration)
    return _compared(to_float64(track.rates), expected, speeds, MIN_SPEED)


def _compared(
    rates: np.ndarray, expected: np.ndarray, speeds: np.ndarray, min_speed: float | int
) -> RateResidual | None:
    """Compare the recorded `rates`, (n, 3) or (n, 1), with the rates `expected` (n, 3) from a program [rad/s].

    Only samples with `speeds` (n,) above `min_speed` [m/s] are compared. Return None if there are too few such samples.
    """
    fast = (speeds > min_speed) & np.isfinite(expected).all(axis=1)
    if fast.sum() < MIN_SAMPLES:
        return None
    recorded, expected, mounting = rates[fast], expected[fast], None
    if recorded.shape[1] == 1:
        expected = expected[:, 2:]
    else:
        recorded, mounting = _mounted(recorded, expected)
    rms = np.sqrt(np.mean((recorded - expected) ** 2, axis=0))
    return RateResidual(rms, _correlations(recorded, expected), int(fast.sum()), mounting)


@eqx.filter_jit
def _rates(program: FrameProgram, times: Float[Array, " n"]) -> tuple[Float[Array, "n 3"], Float[Array, " n"]]:
    """Return the rate [rad/s] of the program, in the axes of the frame, and the speed [m/s] of the path."""

    def at(t: Scalar) -> tuple[Array, Array]:
        return program(t).rate, jnp.linalg.norm(program.path.velocity(t))

    return jax.vmap(at)(times)


def _mounted(recorded: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the recorded rates (n, 3) in the axes of the program, and the mounting (4,), from gyro to program axes."""
    from scipy.spatial.transform import Rotation

    left, sizes, right = np.linalg.svd(expected.T @ recorded)
    if sizes[1] <= ONE_AXIS * sizes[0]:
        found = Rotation.align_vectors(left[:, :1].T, right[:1])[0]
    else:
        found = Rotation.align_vectors(expected, recorded)[0]
    x, y, z, w = found.as_quat(canonical=True)
    return found.apply(recorded), np.array([w, x, y, z])


def _correlations(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the correlation between each column of `a` and the same column of `b`; 0 if one of them is constant."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    scales = np.sqrt(np.sum(a**2, axis=0) * np.sum(b**2, axis=0))
    return np.where(scales > 0, np.sum(a * b, axis=0) / np.where(scales > 0, scales, 1.0), 0.0)
