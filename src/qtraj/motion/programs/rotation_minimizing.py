"""Compute the rotation-minimizing frame, whose angular rate about the tangent is zero.

Let r(t) be the position; primes are time derivatives. The angular rate of the frame, in world axes, is c/v² with
c = r' × r'' and v = |r'|. A node is an instant at which the attitude of the frame is stored. The binormal at a node is
the up direction of an upright frame. Let ω be the rate of this upright frame. Near the node, the rotation-minimizing
frame is the upright frame, rotated about the tangent τ by −∫ω·τ dt from the node. The frame is therefore regular
wherever the speed is not zero, even on straight segments, and r'''' is not needed. The attitudes at the nodes are
computed once, by quaternion products from one node to the next.

On a closed path, this frame is usually turned about the tangent after one lap. The frame that closes rotates about the
tangent by a constant angle for each metre, the twist κ, so that its rate is c/v² + κr'.
"""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra import hamilton, quaternion
from qtraj.algebra.cosines import from_rotation
from qtraj.algebra.vector import cross, dot, norm, unit
from qtraj.foundation.arrays import as_float, concrete, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import is_host, stop_gradient, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Mat3, Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.path.frame_axes import MINIMIZING, NATURAL, THRUST_ALIGNED, UPRIGHT
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.thrust_aligned import ThrustAligned
from qtraj.path.trihedral import AbstractFrame, Natural, Upright, trihedral

GAUSS = 6
"""Number of Gauss–Legendre points between two nodes of the frame; the order of the quadrature is 12."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(GAUSS)

GAP = 1e-4
"""Largest distance between the ends of a closed path, relative to its length, and largest angle [rad] there."""

Samples = list[Float[Array, "n _ 3"]]
"""The position and its first three time derivatives, for n intervals, at both ends and at the quadrature points."""

TILT = 0.01
"""Largest angle [rad] between the forward axis of an initial attitude and the direction of the path."""


@storable
class RotationMinimizing(eqx.Module):
    """The frame of a path with no rotation about the tangent: ω·τ = 0.

    `initial` selects one of the frames that differ by a constant rotation about τ. An `initial` (4,) is the attitude at
    the start; its forward axis must be within 0.01 rad of the direction of the path, and is then aligned with this
    direction. An `initial` (3,) is a vector in world axes; its component perpendicular to the path gives the direction
    of the initial normal. With None, the frame starts as the natural frame. If the path is straight at its start, the
    initial binormal is the direction normal to the path that is closest to world z, or closest to world x if the path
    is steep.

    On a `closed` path, one whose position and direction are the same at both ends, the frame is usually turned about τ
    after one lap. With `closed=True` it rotates about τ in proportion to the distance travelled, by the smallest angle
    with which it ends as it starts; `FrameProgram.closing_angle` is the angle that is distributed.

    **Raises:** ValueError for an `initial` that is zero, not finite or of another shape, or if `closed` is not a bool.
    """

    initial: Float[Array, " k"] | None
    closed: bool = eqx.field(static=True)

    def __init__(self, initial: ArrayInput | None = None, closed: bool = False):
        if not isinstance(closed, bool):
            raise ValueError(f"closed must be True or False, but {closed!r} was given")
        self.closed = closed
        self.initial = None if initial is None else as_float(initial)
        if self.initial is None:
            return
        if self.initial.shape not in ((3,), (4,)):
            raise ValueError(
                "the initial attitude of a rotation-minimizing frame must be a quaternion (4,) or a normal (3,), "
                f"but shape {self.initial.shape} was given"
            )
        real_vector(self.initial, "the initial attitude of a rotation-minimizing frame", self.initial.shape[0])
        value = concrete(self.initial)
        if value is not None and np.abs(value).max() < np.finfo(value.dtype).tiny:
            raise ValueError("the initial attitude of a rotation-minimizing frame must not be zero")

    def __repr__(self) -> str:
        return shown(self)


Frame = TypeAliasType("Frame", AbstractFrame | RotationMinimizing)
"""Any frame along a path."""


def name_of(frame: Frame) -> str:
    """Return the name of the frame for labelled data."""
    return MINIMIZING if isinstance(frame, RotationMinimizing) else frame.name


def frame_named(name: str, up: ArrayInput | None = None, heading: ArrayInput | None = None) -> Frame:
    """Return the frame "natural", "upright", "rotation-minimizing" or "thrust-aligned".

    `up` (3,) is the up direction of an upright frame, and `heading` [rad] the heading of a thrust-aligned frame.

    **Raises:** ValueError for another name, for an argument that belongs to another frame, and for invalid values.
    """
    frames = {UPRIGHT: Upright, NATURAL: Natural, MINIMIZING: RotationMinimizing, THRUST_ALIGNED: ThrustAligned}
    if name not in frames:
        raise ValueError(f"unknown frame {name!r}: the frames are {', '.join(frames)}")
    for argument, value, owner in (("up", up, UPRIGHT), ("heading", heading, THRUST_ALIGNED)):
        if value is not None and name != owner:
            raise ValueError(f"{argument!r} is valid only with the frame '{owner}', but the frame is '{name}'")
    if up is not None:
        return Upright(up)
    return frames[name]() if heading is None else ThrustAligned(heading)


def attitude(path: AbstractHodograph, t: Scalar, node: Scalar, at_node: Quat, twist: Scalar | None = None) -> Attitude:
    """Compute the frame with a `twist` [rad/m] at `t` [s] from its quaternion `at_node` at the time `node` [s].

    The quaternion of the result is λ or −λ, whichever is nearer to `at_node`.
    """
    samples = _sample(path, node[None], t[None])
    up, span = quaternion.rotate(at_node, _axis(at_node, 2))[None], (t - node)[None]
    dcm = _transported(samples, up, span, 0.0 if twist is None else twist * _lengths(samples, span))[0]
    q = from_rotation(dcm)
    r = [x[0, -1] for x in samples]
    square = dot(r[1], r[1])
    square = xp.where(square > 0, square, 1.0)
    omega = cross(r[1], r[2]) / square
    epsilon = cross(r[1], r[3]) / square - 2 * omega * (dot(r[1], r[2]) / square)
    q = xp.where(dot(q, at_node) < 0, -q, q)
    if twist is None:
        return Attitude(q, _normal_part(dcm, omega), _normal_part(dcm, epsilon))
    return Attitude(q, dcm @ (omega + twist * r[1]), dcm @ (epsilon + twist * r[2]))


def start(path: AbstractHodograph, initial: Float[Array, " k"] | None) -> Quat:
    """Return the frame at the start of the path, as a quaternion (4,)."""
    natural = trihedral(path, 0.0)
    if initial is None:
        return natural.quaternion()
    normal = _direction(initial.astype(natural.normal.dtype), 1)
    projected = normal - natural.tangent * dot(natural.tangent, normal)
    return from_rotation(_dcm(natural.tangent, unit(projected, natural.normal)))


def nodes(
    path: AbstractHodograph, start: Quat, times: Float[Array, " n"], closed: bool = False
) -> tuple[Float[Array, "n 4"], Scalar, Scalar | None]:
    """Return quaternions of the frame at ascending `times` [s] from 0 to the duration of the path.

    The signs are continuous, and the first quaternion is `start`. The second result is the largest turn [rad] between
    two times, measured by the largest rate at the quadrature points; the third is the twist [rad/m] of a closed frame.
    """
    steps, turn, lengths = _steps(path, times[:-1], times[1:])
    anchors = _chained(start, steps)
    if not closed:
        return anchors, turn, None
    distances = xp.concatenate([0.0 * lengths[:1], xp.cumsum(lengths)])
    missing = quaternion.canonical(quaternion.product(quaternion.conjugate(anchors[-1]), anchors[0]))
    twist = 2 * xp.arctan2(missing[1], missing[0]) / distances[-1]
    about = distances[:, None] * twist * _axis(anchors[:, 1:], 0)
    return quaternion.product(anchors, quaternion.exp(0.5 * about)), turn, twist


def _chained(start: Quat, steps: Float[Array, "n 4"]) -> Float[Array, "n+1 4"]:
    """Return `start` and its products with the rotations `steps`, one after the other."""
    if is_host(start, steps):
        found: list[Any] = [start]
        for step in steps:
            found.append(np.stack(hamilton.product(step, found[-1])))
        stacked: Any = np.stack(found)
        return quaternion.unit(stacked)

    def advance(before: Quat, step: Quat) -> tuple[Quat, Quat]:
        after = quaternion.product(step, before)
        return after, after

    _, later = jax.lax.scan(advance, start, steps)
    return quaternion.unit(xp.concatenate([start[None], later]))


def require_initial(path: AbstractHodograph, initial: Float[Array, " k"] | None) -> None:
    """Raise a ValueError unless the initial attitude fits the start of the path."""
    if initial is None:
        return
    tangent = concrete(path.velocity(0.0))
    direction = concrete(_direction(initial, 0 if initial.shape == (4,) else 1))
    if tangent is None or direction is None:
        return
    direction, tangent = (x / np.abs(x).max() if x.any() else x for x in (direction, tangent))  # no underflow
    sine = np.linalg.norm(np.cross(direction, tangent)) / (np.linalg.norm(direction) * np.linalg.norm(tangent))
    if initial.shape == (4,) and (sine > TILT or direction @ tangent < 0):
        angle = float(np.arctan2(sine, direction @ tangent / np.linalg.norm(direction) / np.linalg.norm(tangent)))
        raise ValueError(
            f"the angle between the forward axis of the initial attitude and the initial velocity {tangent.tolist()} "
            f"of the path is {angle:.6g} rad, but must be at most {TILT} rad. Pass an attitude whose x axis is along "
            "the path, or only a normal (3,)."
        )
    if initial.shape == (3,) and sine < 1e-6:
        raise ValueError("the initial normal of a rotation-minimizing frame must not be parallel to the path")


def _direction(initial: Float[Array, " k"], axis: int) -> Vec3:
    """Return body axis number `axis` of an initial attitude, in world axes, or the initial vector itself."""
    return initial if initial.shape == (3,) else quaternion.rotate(initial, _axis(initial, axis))


def require_closed(path: AbstractHodograph) -> None:
    """Raise a ValueError if position or direction of a concrete path are not the same at both ends."""
    start, end = (concrete(path.derivatives(t, 1)) for t in (0.0, path.duration))
    length = concrete(path.length())
    if start is None or end is None or length is None:
        return
    gap = float(np.linalg.norm(end[0] - start[0]))
    first, last = start[1], end[1]
    angle = float(np.arctan2(np.linalg.norm(np.cross(first, last)), first @ last))
    if gap > GAP * float(length) or angle > GAP:
        raise ValueError(
            f"a closed frame needs a path that ends as it starts, but its ends are {gap:.6g} m apart and its "
            f"directions differ by {angle:.6g} rad: omit closed=True, or close the path"
        )


def _lengths(samples: Samples, spans: Array) -> Array:
    """Return the distances travelled (n,) [m] in intervals of `spans` (n,) [s]."""
    return spans * (norm(samples[1][:, 1:-1]) @ (_WEIGHTS / 2).astype(spans.dtype))


def _steps(path: AbstractHodograph, a: Array, b: Array) -> tuple[Float[Array, "n 4"], Scalar, Float[Array, " n"]]:
    """Return the rotations (n, 4) of the frame from times `a` (n,) to times `b` (n,) [s], in world axes.

    The rotations are the same for every rotation-minimizing frame of the path. The other results are the largest turn
    of the tangent [rad] and the distances travelled [m].
    """
    samples = _sample(path, a, b)
    square = dot(samples[1], samples[1])
    rates = norm(cross(samples[1], samples[2])) / xp.where(square > 0, square, 1.0)
    turn = stop_gradient(xp.max(rates * (b - a)[:, None]))
    tangent = _tangent(samples[1][:, 0])
    smallest = stop_gradient(xp.argmin(abs(tangent), axis=-1))
    side = xp.where(np.arange(3)[None] == smallest[:, None], 1.0, xp.zeros_like(tangent))
    before = _dcm(tangent, unit(cross(side, tangent), side))
    after = _transported(samples, before[..., 2, :], b - a)
    q = quaternion.product(from_rotation(after), quaternion.conjugate(from_rotation(before)))
    return xp.where(q[..., :1] < 0, -q, q), turn, _lengths(samples, b - a)


def _sample(path: AbstractHodograph, a: Array, b: Array) -> Samples:
    """Evaluate r and its first three derivatives at `a`, at the quadrature points between `a` and `b`, and at `b`."""
    points = np.concatenate([[0.0], (_POINTS + 1) / 2, [1.0]]).astype(a.dtype)[None]
    times = a[:, None] * (1 - points) + b[:, None] * points
    return [x.reshape((*times.shape, 3)) for x in path.sampled(times.ravel(), 3)]


def _transported(samples: Samples, up: Vec3, span: Scalar, twisted: Any = 0.0) -> Mat3:
    """Return the direction cosines, world to body, of the frames at the ends of intervals of `span` [s].

    At the start of the intervals, the binormal of the frame is `up`. In them, it is `twisted` [rad] about the tangent.
    """
    roll_rates = _roll_rate(up[:, None], samples[1][:, 1:-1], samples[2][:, 1:-1])
    angle = (twisted - span * (roll_rates @ (_WEIGHTS / 2).astype(span.dtype)))[:, None]
    tangent = _tangent(samples[1][:, -1])
    level = unit(cross(up, tangent), _axis(tangent, 1))
    return _dcm(tangent, level * xp.cos(angle) + cross(tangent, level) * xp.sin(angle))


def _roll_rate(up: Vec3, r1: Vec3, r2: Vec3) -> Scalar:
    """Return ω·τ [rad/s] of the upright frame with the up direction u: (u × r'')·(r' × (u × r'))/(|r'| |u × r'|²).

    r' = `r1` and r'' = `r2` are the velocity and the acceleration. The result is 0 if r' is zero or parallel to u.
    """
    level = cross(up, r1)
    size = norm(r1) * dot(level, level)
    exists = size > 0
    return xp.where(exists, dot(cross(up, r2), cross(r1, level)) / xp.where(exists, size, 1.0), 0.0)


def _tangent(velocity: Vec3) -> Vec3:
    return unit(velocity, _axis(velocity, 0))


def _dcm(tangent: Vec3, normal: Vec3) -> Mat3:
    return xp.stack([tangent, normal, cross(tangent, normal)], axis=-2)


def _normal_part(dcm: Mat3, vector: Vec3) -> Vec3:
    """Return the body components of a vector normal to the tangent; the tangential component is exactly zero."""
    return xp.concatenate([xp.zeros_like(vector[:1]), dcm[1:] @ vector])


def _axis(like: Float[Array, " k"], k: int) -> Vec3:
    """Return the unit vector along axis `k`, with the leading axes and the dtype of `like`."""
    return xp.broadcast_to(np.eye(3, dtype=like.dtype)[k], (*like.shape[:-1], 3))
