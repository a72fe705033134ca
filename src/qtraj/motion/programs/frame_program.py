"""Use a frame of a path as an attitude program (λ⁰ of paper S): natural, upright, thrust-aligned and others."""

import warnings
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.algebra.cosines import from_rotation
from qtraj.foundation.arrays import as_float, concrete, one_instant
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import in_numpy, stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, ScalarLike
from qtraj.motion.attitude import AbstractProgram, Attitude
from qtraj.motion.programs import rotation_minimizing
from qtraj.motion.programs.rotation_minimizing import Frame, RotationMinimizing
from qtraj.path.driving import default_frame, require_moving
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.trihedral import AbstractFrame, dcms, trihedral

NODES = 513
"""Smallest number of anchors of a path that is not a route; they are equally spaced in time (see `FrameProgram`)."""

TURN, LONG_TURN, TRACED_TURN = 0.4, 0.6, 1.0
"""Largest turn [rad] of a frame between two anchors: usually, on a path that is too long for this, and on a traced
path, whose number of anchors cannot follow it. On a helix of many turns, 0.4 rad cause an error of 1e-12 rad in total,
0.7 rad with the largest number of anchors 1e-6 rad, and 1 rad with the smallest number 1e-6 rad."""

USUAL = 0.9
"""Quantile of the turns of a frame that determine the number of anchors of its sign; near inflections they are huge."""

MOST_PARTS = 256
"""Largest number of parts into which the smallest intervals between anchors are divided."""

ROUNDING = 16
"""Anchors that only determine a sign are rounded to multiples of 1/16, so that stored programs are small."""


@storable
class FrameProgram(AbstractProgram):
    """A frame of a path as a program: λ⁰ from frame to world axes, and ω⁰ and ε⁰ in the axes of the frame.

    The program has a closed form, except for the quaternion of a rotation-minimizing frame, which is integrated. The
    default frame is `Driving` for a route that stops, `Upright` for other routes, and `Natural` for other paths.

    The quaternion has scalar part ≥ 0 at t = 0 and is continuous in t, even if the program is evaluated at a single
    instant. The `anchors` (n, 4) determine the sign of the quaternion, and also the attitude of a rotation-minimizing
    frame. They are quaternions at n equally spaced times on [0, duration], at least 513; on a route, at least four in
    each segment. The anchors are computed once, when the program is created, and stored with the program. Their number
    is such that the frame turns by less than 0.4 rad between two of them, but at most 256 times the smallest number.
    Beyond 0.6 rad (half a turn for the other frames), a warning is given. For traced paths it is the smallest number,
    and the quaternion of a rotation-minimizing frame is NaN if the path turns by more than 1 rad between two anchors.

    With `RotationMinimizing(closed=True)`, the frame rotates about the path by `twist` [rad/m], which is computed with
    the anchors, so that it closes.

    The program is not defined where the frame is not defined. Examples are the natural frame on a straight path, the
    upright frame where the path is parallel to the up direction, the thrust-aligned frame in free fall, and most frames
    where the velocity is zero. The natural frame flips by π at an inflection point.

    To differentiate with respect to paths or to vmap over paths, create the program inside the transformed function.
    Outside [0, duration] path and program are extrapolated.

    **Raises:** ValueError for an object that is not a frame; for a rotation-minimizing frame if the path is a route
    that stops, if `initial` does not fit the path, or if a closed frame has a path that is not closed; or for anchors
    of another shape.
    """

    path: AbstractHodograph
    frame: AbstractFrame | RotationMinimizing
    anchors: Float[Array, "n 4"]
    twist: Scalar | None

    def __init__(
        self,
        path: "AbstractHodograph",
        frame: Frame | None = None,
        anchors: ArrayInput | None = None,
        twist: ArrayInput | None = None,
    ):
        require_path(path)
        self.path = path
        self.frame = default_frame(path) if frame is None else frame
        if not isinstance(self.frame, AbstractFrame | RotationMinimizing):
            raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
        if isinstance(self.frame, RotationMinimizing):
            require_moving(path)
            rotation_minimizing.require_initial(path, self.frame.initial)
            if self.frame.closed:
                rotation_minimizing.require_closed(path)
        found = (anchors, twist) if anchors is not None else _anchors(path, self.frame)
        self.anchors, self.twist = as_float(found[0]), None if found[1] is None else as_float(found[1])
        if self.anchors.ndim != 2 or self.anchors.shape[0] < 2 or self.anchors.shape[1] != 4:
            raise ValueError(f"anchors must have shape (n, 4) with n ≥ 2, but shape {self.anchors.shape} was given")
        joints = path.nodes()
        if joints is not None and (self.anchors.shape[0] - 1) % (joints.shape[0] - 1):
            raise ValueError(
                f"the anchors of a route must be {joints.shape[0]}, or such that equally many are in each interval of "
                f"`path.nodes()`, but {self.anchors.shape[0]} were given"
            )

    def __repr__(self) -> str:
        return shown(self)

    @property
    def duration(self) -> Scalar:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The duration of the path [s]."""
        return self.path.duration

    @property
    def closing_angle(self) -> Scalar:
        """The angle [rad], from −π to π, about the path by which a closed frame would miss its start without the twist.

        **Raises:** ValueError for a frame that is not closed.
        """
        if self.twist is None:
            raise ValueError("the frame of this program is not closed: pass RotationMinimizing(closed=True)")
        return -self.twist * self.path.length()

    def __call__(self, t: ScalarLike) -> Attitude:
        """Return the attitude at the time `t` [s]."""
        compute = _attitude if _supports_numpy(self.path, self.frame) else _compiled_attitude
        return compute(self, one_instant(t).astype(self.path.duration.dtype))


def _jax_attitude(program: FrameProgram, t: Scalar) -> Attitude:
    node, anchor = _node(program, t)
    if isinstance(program.frame, RotationMinimizing):
        return rotation_minimizing.attitude(program.path, t, node, anchor, program.twist)
    frame = trihedral(program.path, t, program.frame)
    q = frame.quaternion()
    return Attitude(xp.where(q @ anchor < 0, -q, q), frame.rate, frame.acceleration)


def _node(program: FrameProgram, t: Scalar) -> tuple[Scalar, Quat]:
    """Return time [s] and quaternion of the anchor nearest to `t`; on a route, of the last anchor at or before `t`."""
    joints = program.path.nodes()
    if joints is not None:
        times = _divided(joints, (program.anchors.shape[0] - 1) // (joints.shape[0] - 1))
        k = xp.maximum(xp.searchsorted(stop_gradient(times), stop_gradient(t), side="right") - 1, 0)
        return times[k], program.anchors[k]
    last = program.anchors.shape[0] - 1
    share = stop_gradient(xp.clip(t / program.duration, 0.0, 1.0))
    index = xp.round(xp.where(share >= 0, share, 0.0) * last)  # 0 for NaN
    return program.duration * (index / last), program.anchors[index.astype(int)]


Anchors = tuple[Float[Array, "n 4"], Scalar | None]
"""The anchors of a program, and the twist [rad/m] of a closed frame."""


def _anchors(path: AbstractHodograph, frame: AbstractFrame | RotationMinimizing) -> Anchors:
    at_once = _supports_numpy(path, frame)
    minimizing, given = isinstance(frame, RotationMinimizing), frame
    compute: Any = _sign_anchors if at_once else _compiled_sign_anchors
    if isinstance(frame, RotationMinimizing):
        given = (_start if at_once else _compiled_start)(path, frame.initial), frame.closed
        compute = _minimizing_anchors if at_once else _compiled_minimizing_anchors
    anchors, turn, twist = compute(path, given, 1)
    largest = concrete(turn)
    if largest is None:
        return xp.where(turn <= TRACED_TURN, anchors, xp.nan) if minimizing else anchors, twist
    if not largest > TURN:
        return anchors, twist
    parts = 2 ** int(np.ceil(np.log2(min(largest / TURN, MOST_PARTS))))
    if largest > parts * (LONG_TURN if minimizing else np.pi):
        warnings.warn(
            f"the frame turns by {largest / parts:.3g} rad between two of the {parts * (len(anchors) - 1) + 1} anchors "
            "of this program, so its quaternion may be wrong: divide the path into windows, and create a program for "
            "each.",
            stacklevel=3,
        )
    anchors, _, twist = compute(path, given, parts)
    return anchors, twist


def _supports_numpy(path: AbstractHodograph, frame: AbstractFrame | RotationMinimizing) -> bool:
    return path.supports_numpy and (isinstance(frame, RotationMinimizing) or frame.supports_numpy)


def _jax_minimizing_anchors(path: AbstractHodograph, given: tuple[Quat, bool], parts: int) -> Any:
    """Return the anchors, the largest turn between two of them [rad], and the twist of a closed frame."""
    start, closed = given
    return rotation_minimizing.nodes(path, start, _times(path, parts), closed)


def _jax_sign_anchors(path: AbstractHodograph, frame: AbstractFrame, parts: int) -> Any:
    """Return the anchors, the turn between two of them that is exceeded only near singular instants [rad], and None."""
    times = _times(path, parts)
    dcm, rates = dcms(path, times, frame)
    quaternions = stop_gradient(from_rotation(dcm))
    turns = stop_gradient(xp.minimum(rates[1:], rates[:-1]) * xp.diff(times))
    turn = xp.quantile(xp.nan_to_num(turns), USUAL)
    return xp.round(ROUNDING * rotation.continuous(quaternions)) / ROUNDING, turn, None


def _times(path: AbstractHodograph, parts: int) -> Float[Array, " n"]:
    """Return the times of the anchors [s]: those of the smallest number of anchors, each interval divided."""
    joints = path.nodes()
    if joints is not None:
        return _divided(joints, parts)
    return path.duration * np.linspace(0.0, 1.0, (NODES - 1) * parts + 1).astype(path.duration.dtype)


def _divided(times: Float[Array, " n"], parts: int) -> Float[Array, " m"]:
    """Return ascending times with `parts` − 1 equally spaced times in each interval."""
    if parts == 1:
        return times
    shares = (np.arange(parts) / parts).astype(times.dtype)
    inner = times[:-1, None] * (1 - shares) + times[1:, None] * shares
    return xp.concatenate([inner.ravel(), times[-1:]])


_compiled_attitude = eqx.filter_jit(_jax_attitude)
_attitude = in_numpy(_jax_attitude, _compiled_attitude)
_compiled_start = eqx.filter_jit(rotation_minimizing.start)
_start = in_numpy(rotation_minimizing.start, _compiled_start)
_compiled_minimizing_anchors = eqx.filter_jit(_jax_minimizing_anchors)
_minimizing_anchors = in_numpy(_jax_minimizing_anchors, _compiled_minimizing_anchors)
_compiled_sign_anchors = eqx.filter_jit(_jax_sign_anchors)
_sign_anchors = in_numpy(_jax_sign_anchors, _compiled_sign_anchors)
