"""How far a recorded attitude is from a program, besides the constant mounting of whatever recorded it."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra import quaternion, rotation
from qtraj.foundation.arrays import as_array, as_float, concrete, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.attitude import AbstractProgram
from qtraj.motion.programs.frame_program import FrameProgram
from qtraj.path.track import Track, elapsed_times, to_float64
from qtraj.path.trihedral import AbstractFrame, trihedral

OVERHANG = 1e-6
"""A track may outlast the program it is compared with by this part of the program's duration: rounding, no more."""


@storable
class AttitudeResidual(AbstractResult):
    """Recorded attitudes against a program, over all samples at which its frame is defined.

    `mounting` (4,), the constant unit quaternion m from the recorder's axes to those of the program: the recorded
    attitude is λ⁰(t)∘m∘δ(t). Of the rest δ: `rms` and `maximum` [rad], the root mean square and the largest of its
    angle; `axis_rms` (3,) [rad], the root mean square of its rotation vector's components, recorder's axes; `time` [s],
    when it is largest, since the first sample. `samples`, how many were compared.
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
        """The fields."""
        variables = {
            "mounting": Quantity(
                self.mounting,
                "1",
                "constant attitude of the recorder in the program's axes, scalar first",
                ("component",),
            ),
            "rms": Quantity(self.rms, "rad", "root mean square of the angle between recorded and mounted attitude"),
            "maximum": Quantity(self.maximum, "rad", "largest angle between recorded and mounted attitude"),
            "axis_rms": Quantity(self.axis_rms, "rad", "root mean square about each axis of the recorder", ("body",)),
            "time": Quantity(self.time, "s", "time of the largest angle since the first sample"),
            "samples": Quantity(self.samples, "1", "samples compared"),
        }
        summary = (
            f"RMS {extent(self.rms, 'rad')}, largest {extent(self.maximum, 'rad')}, {extent(self.samples)} samples"
        )
        return Record(f"{batch_prefix(self.samples.shape)}{summary}", variables, attributes={"frame": "body"})


def compare_attitude(program: AbstractProgram, track: Track, mounting: ArrayInput | None = None) -> AttitudeResidual:
    """The recorded attitudes of `track`, whose first sample is at program time 0, against `program`.

    `mounting` (4,) is the attitude of the recorder in the program's axes, of any length but zero. Without it, the
    constant one is estimated that makes the sum of the squared chordal distances least: the mean of λ̄⁰(t)∘λ(t) by its
    quaternion outer products (Markley, Cheng, Crassidis and Oshman, "Averaging quaternions", JGCD 30, 2007). Signs and
    lengths of recorded quaternions do not matter. Where the frame of a program flips, as the natural one does at
    inflections, the comparison shows it: take `FrameProgram(path, Upright())` for vehicles.

    Samples at which the frame of a program is not defined, such as those at a stop, are left out.

    **Raises:** ValueError where the track has no attitudes or lasts longer than the program, where the program's frame
    is defined at no sample, for a mounting that is zero, not finite or of another shape, or inside a trace in which the
    track is not known.
    """
    if track.attitudes is None:
        raise ValueError(
            "this track has no attitudes to compare. Read them with qtraj.read_track: as quaternions qw, qx, qy, qz, "
            "or as roll, pitch and heading with angles=qtraj.AttitudeAngles(…)."
        )
    times = elapsed_times(track)
    _require_covered(program, float(times[-1]))
    given = None if mounting is None else real_vector(mounting, "the mounting", 4)
    size = None if given is None else concrete(given)
    if size is not None and not size.any():
        raise ValueError("the mounting must be a quaternion other than zero")
    dtype = jnp.result_type(program.duration, float)
    attitudes = as_array(to_float64(track.attitudes), dtype)
    estimated, vectors, defined = _compared(program, as_array(times, dtype), attitudes, given)
    _require_some(concrete(defined))
    components = jnp.where(defined[:, None], vectors**2, 0.0)
    squares, samples = jnp.sum(components, axis=1), jnp.sum(defined.astype(dtype))
    worst = jnp.argmax(squares)
    return AttitudeResidual(
        mounting=estimated,
        rms=_root(jnp.sum(squares) / samples),
        maximum=_root(squares[worst]),
        axis_rms=_root(jnp.sum(components, axis=0) / samples),
        time=as_array(times, dtype)[worst],
        samples=samples,
    )


def _require_some(defined: np.ndarray | None) -> None:
    if defined is not None and not defined.any():
        raise ValueError(
            "the frame of this program is defined at no sample of the track, so there is no attitude to compare with: "
            "take a part of the track on which the vehicle moves, track.window(t0, t1)"
        )


def mean(quaternions: Float[Array, "n 4"], weights: Float[Array, " n"]) -> Quat:
    """The average rotation: the eigenvector of Σwqqᵀ with the largest eigenvalue, scalar part ≥ 0."""
    unit = weights[:, None] ** 0.5 * jax.vmap(quaternion.unit)(quaternions)
    return quaternion.canonical(jnp.linalg.eigh(jnp.matmul(unit.T, unit, precision="highest"))[1][:, -1])


@eqx.filter_jit
def _compared(
    program: AbstractProgram, times: Float[Array, " n"], attitudes: Float[Array, "n 4"], given: Quat | None
) -> tuple[Quat, Float[Array, "n 3"], Bool[Array, " n"]]:
    """The mounting, the rotation vectors of the rest in the recorder's axes, and where the program is defined."""
    defined = _defined(program, times)
    wanted = jax.vmap(lambda t: program(t).quaternion)(times)
    mounted = jax.vmap(lambda p, q: quaternion.product(quaternion.conjugate(p), quaternion.unit(q)))(wanted, attitudes)
    dtype = mounted.dtype
    mounting = mean(mounted, defined.astype(dtype)) if given is None else quaternion.unit(given.astype(dtype))
    rest = jax.vmap(lambda q: quaternion.product(quaternion.conjugate(mounting), q))(mounted)
    return mounting, jax.vmap(rotation.to_rotation_vector)(rest), defined


def _defined(program: AbstractProgram, times: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Where the frame of a path exists; everywhere for other programs."""
    if not isinstance(program, FrameProgram) or not isinstance(program.frame, AbstractFrame):
        return jnp.ones(times.shape, bool)
    path, frame = program.path, program.frame
    return jax.vmap(lambda t: trihedral(path, t, frame).defined)(times)


def _root(square: Array) -> Array:
    """The square root, whose derivative vanishes where it does."""
    return jnp.where(square == 0, 0.0, jnp.sqrt(jnp.where(square == 0, 1.0, square)))


def _require_covered(program: AbstractProgram, wanted: float) -> None:
    available = concrete(program.duration)
    if available is not None and wanted > float(available) * (1 + OVERHANG):
        raise ValueError(
            f"the track lasts {wanted:.9g} s, but the program only {float(available):.9g} s: compare with the window "
            "of the track that the program covers, track.window(t0, t1)."
        )


def mounting_angles(residual: AttitudeResidual) -> np.ndarray:
    """Yaw, pitch and roll (3,) [rad] of the mounting, the turns about z, y and x in this order (Z-Y-X)."""
    return np.asarray(rotation.to_euler(residual.mounting, "ZYX"))
