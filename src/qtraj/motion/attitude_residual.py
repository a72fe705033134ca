"""Compare recorded attitudes with a program, after removing the constant mounting of the recorder."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import as_array, as_float, concrete, real_vector
from qtraj.foundation.devices import of_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import AbstractProgram, require_program
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.track import Track, elapsed_times, require_track, to_float64
from qtraj.path.trihedral import AbstractFrame, trihedral

OVERHANG = 1e-6
"""A track may be longer than the program by this fraction of the program's duration, to allow for rounding errors."""


@storable
class AttitudeResidual(AbstractResult):
    """The residual of recorded attitudes relative to a program, at all samples at which the program's frame is defined.

    The recorded attitude is λ⁰(t)∘m∘δ(t), where λ⁰ is the attitude of the program, m a constant mounting and δ a
    residual rotation. `mounting` (4,): the unit quaternion m, which transforms from the axes of the recorder to the
    axes of the program. `rms` and `maximum` [rad]: the root mean square and the maximum of the angle of δ. `axis_rms`
    (3,) [rad]: root mean square of each component of the rotation vector of δ, in the axes of the recorder. `time` [s]:
    the time of the largest angle, measured from the first sample. `samples`: the number of samples that were compared.
    """

    mounting: Quat
    rms: Scalar
    maximum: Scalar
    axis_rms: Vec3
    time: Scalar
    samples: Int[Array, ""]

    def __init__(
        self,
        mounting: ArrayInput,
        rms: ArrayInput,
        maximum: ArrayInput,
        axis_rms: ArrayInput,
        time: ArrayInput,
        samples: ArrayInput,
    ):
        self.mounting, self.axis_rms = as_float(mounting), as_float(axis_rms)
        self.rms, self.maximum, self.time = as_float(rms), as_float(maximum), as_float(time)
        self.samples = as_array(samples, int)

    def record(self) -> Record:
        """Return the fields with units and meanings."""
        variables = {
            "mounting": Quantity(
                self.mounting,
                "1",
                "constant attitude of the recorder relative to the program's axes, scalar first",
                ("component",),
            ),
            "rms": Quantity(self.rms, "rad", "root mean square of the angle of the residual rotation"),
            "maximum": Quantity(self.maximum, "rad", "largest angle of the residual rotation"),
            "axis_rms": Quantity(
                self.axis_rms,
                "rad",
                "root mean square of each component of the residual rotation vector, recorder axes",
                ("body",),
            ),
            "time": Quantity(self.time, "s", "time of the largest angle, from the first sample"),
            "samples": Quantity(self.samples, "1", "number of samples compared"),
        }
        summary = (
            f"RMS {extent(self.rms, 'rad')}, largest {extent(self.maximum, 'rad')}, {extent(self.samples)} samples"
        )
        return Record(f"{batch_prefix(self.samples.shape)}{summary}", variables, attributes={"frame": "body"})


@of_one_device
def compare_attitude(
    program: "AbstractProgram", track: "Track", mounting: ArrayInput | None = None
) -> "AttitudeResidual":
    """Compare the recorded attitudes of `track` with `program`, which starts at the first sample of the track.

    `mounting` (4,): the attitude of the recorder relative to the program's axes, not necessarily normalised. With None,
    the mounting is estimated as the average of λ̄⁰∘λ, where λ are the recorded attitudes and λ⁰ the attitudes of the
    program. The average minimises the sum of squared chordal distances (Markley, Cheng, Crassidis and Oshman,
    "Averaging quaternions", JGCD 30, 2007). The signs and norms of the recorded quaternions have no effect. A frame
    that flips, such as the natural frame at an inflection point, causes a large residual. For vehicles use
    `FrameProgram(path, Upright())`.

    Samples at which the frame of the program is not defined, for example at a stop, are not compared.

    **Raises:** ValueError for a track that has no attitudes, lasts longer than the program or is traced; if the
    program's frame is undefined at all samples; and for a mounting that is zero, not finite or of another shape.
    """
    require_program(program)
    require_track(track)
    if track.attitudes is None:
        raise ValueError(
            "this track has no attitudes to compare: read attitudes with qtraj.read_track, as quaternions qw, qx, qy, "
            "qz or as roll, pitch and heading with angles=qtraj.AttitudeAngles(…)"
        )
    times = elapsed_times(track)
    require_covered(program, float(times[-1]))
    user_mounting = None if mounting is None else real_vector(mounting, "the mounting", 4)
    value = None if user_mounting is None else concrete(user_mounting)
    if value is not None and not value.any():
        raise ValueError("the mounting must be a non-zero quaternion (4,), but (0, 0, 0, 0) was given")
    dtype = jnp.result_type(program.duration, float)
    attitudes = as_array(to_float64(track.attitudes), dtype)
    unit_mounting, vectors, defined = _compare(program, as_array(times, dtype), attitudes, user_mounting)
    _require_any(concrete(defined))
    components = jnp.where(defined[:, None], vectors**2, 0.0)
    squares, samples = jnp.sum(components, axis=1), jnp.sum(defined.astype(dtype))
    worst = jnp.argmax(squares)
    return AttitudeResidual(
        mounting=unit_mounting,
        rms=_root(jnp.sum(squares) / samples),
        maximum=_root(squares[worst]),
        axis_rms=_root(jnp.sum(components, axis=0) / samples),
        time=as_array(times, dtype)[worst],
        samples=samples,
    )


def _require_any(defined: np.ndarray | None) -> None:
    if defined is not None and not defined.any():
        raise ValueError(
            "the frame of this program is not defined at any sample of the track, so there is nothing to compare. "
            "Select an interval in which the vehicle moves: track.window(t0, t1)."
        )


@eqx.filter_jit
def _compare(
    program: AbstractProgram, times: Float[Array, " n"], attitudes: Float[Array, "n 4"], user_mounting: Quat | None
) -> tuple[Quat, Float[Array, "n 3"], Bool[Array, " n"]]:
    """Return the mounting, the rotation vectors of the residuals, and whether the program's frame is defined.

    The rotation vectors [rad] are in the axes of the recorder.
    """
    defined = _defined(program, times)
    reference = jax.vmap(lambda t: program(t).quaternion)(times)
    mounted = jax.vmap(lambda p, q: quaternion.product(quaternion.conjugate(p), quaternion.unit(q)))(
        reference, attitudes
    )
    dtype = mounted.dtype
    if user_mounting is None:
        mounting = rotation.mean(mounted, defined.astype(dtype))
    else:
        mounting = quaternion.unit(user_mounting.astype(dtype))
    residual = jax.vmap(lambda q: quaternion.product(quaternion.conjugate(mounting), q))(mounted)
    return mounting, jax.vmap(rotation.to_rotation_vector)(residual), defined


def _defined(program: AbstractProgram, times: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Return, for each time, whether the program's frame is defined; true for a program without a frame."""
    if not isinstance(program, FrameProgram) or not isinstance(program.frame, AbstractFrame):
        return jnp.ones(times.shape, bool)
    path, frame = program.path, program.frame
    return jax.vmap(lambda t: trihedral(path, t, frame).defined)(times)


def _root(square: Array) -> Array:
    """Return √square, with a zero derivative at zero."""
    return jnp.where(square == 0, 0.0, jnp.sqrt(jnp.where(square == 0, 1.0, square)))


def require_covered(program: AbstractProgram, duration: float) -> None:
    """Raise a ValueError if a track of this duration [s] is longer than the program."""
    available = concrete(program.duration)
    if available is not None and duration > float(available) * (1 + OVERHANG):
        raise ValueError(
            f"the track lasts {duration:.9g} s, but the program lasts only {float(available):.9g} s. Select an "
            "interval of the track that is not longer than the program: track.window(t0, t1)."
        )


def mounting_text(residual: AttitudeResidual) -> str:
    """Return the mounting and the remaining difference, such as "mounted at yaw 92.1°, ...; beyond that 4.20° RMS"."""
    yaw, pitch, roll = np.round(np.degrees(mounting_angles(residual)), 1) + 0.0  # no -0.0
    nose = f" (nose {'down' if pitch > 0 else 'up'})" if pitch else ""
    return (
        f"mounted at yaw {yaw:.1f}°, pitch {pitch:.1f}°{nose}, roll {roll:.1f}°; beyond that "
        f"{np.degrees(float(residual.rms)):.2f}° RMS"
    )


def mounting_angles(residual: AttitudeResidual) -> np.ndarray:
    """Return yaw, pitch and roll (3,) [rad] of the mounting, for rotations about z, y and x in this order (Z-Y-X)."""
    return np.asarray(rotation.to_euler(residual.mounting, "ZYX"))
