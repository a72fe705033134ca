"""The rotation-minimizing frame: it never turns about its own tangent, ω_ξ = c/v² with c = r' × r'', v = |r'|.

Near any instant it is an upright frame, for the up direction that it has itself at a node close by, turned about the
tangent τ by −∫ω·τ dt from that node. So it is regular wherever the path moves, straight or not, and needs no r''''.
The nodes follow from each other by quaternion products, computed once.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import stop_gradient
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.vector import norm, unit
from qtraj.foundation.arrays import as_float, concrete, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Mat3, Quat, Scalar, Vec3
from qtraj.motion.attitude import Attitude
from qtraj.path.frame_axes import MINIMIZING
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import AbstractFrame, trihedral

GAUSS = 6
"""Quadrature nodes between two nodes of the frame: order 12."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(GAUSS)

Stretch = Float[Array, "_ 4 3"]

TILT = 0.01
"""The forward axis of a given first attitude may be so far from the path [rad]."""


@storable
class RotationMinimizing(eqx.Module):
    """The frame that turns as little as a frame along the path can: ω·τ = 0.

    `initial` chooses it among those that differ by a constant turn about τ: its attitude at the start (4,), whose
    forward axis must be along the path within 0.01 rad and is aligned with it, or a direction (3,), world axes, whose
    part across the path is its first normal. Without it, it starts as the natural frame, or upright where the path
    starts straight.

    **Raises:** ValueError for an `initial` that is zero, not finite or of another shape.
    """

    initial: Float[Array, " k"] | None

    def __init__(self, initial: ArrayInput | None = None):
        self.initial = None if initial is None else as_float(initial)
        if self.initial is None:
            return
        if self.initial.shape not in ((3,), (4,)):
            raise ValueError(
                "the initial attitude of a rotation-minimizing frame is a quaternion (4,) or a normal (3,), "
                f"but shape {self.initial.shape} was given"
            )
        real_vector(self.initial, "the initial attitude of a rotation-minimizing frame", self.initial.shape[0])
        known = concrete(self.initial)
        if known is not None and not known.any():
            raise ValueError("the initial attitude of a rotation-minimizing frame must not be zero")


Frame = TypeAliasType("Frame", AbstractFrame | RotationMinimizing)
"""Whatever frame can be hung on a whole path."""


def name_of(frame: Frame) -> str:
    """What the frame is called in labelled data."""
    return MINIMIZING if isinstance(frame, RotationMinimizing) else frame.name


def attitude(path: AbstractHodograph, t: Scalar, node: Scalar, at_node: Quat) -> Attitude:
    """The frame at `t` [s] from its attitude at the time `node`; the sign of the quaternion is that of `at_node`."""
    stretch = _sampled(path, node, t)
    dcm = _carried(stretch, quaternion.rotate(at_node, _axis(at_node, 2)), t - node)
    q = rotation.from_dcm(dcm)
    r = stretch[-1]
    square = r[1] @ r[1]
    square = jnp.where(square > 0, square, 1.0)
    omega = jnp.cross(r[1], r[2]) / square
    epsilon = jnp.cross(r[1], r[3]) / square - 2 * omega * ((r[1] @ r[2]) / square)
    return Attitude(
        quaternion=jnp.where(q @ at_node < 0, -q, q),
        rate=_across(dcm, omega),
        acceleration=_across(dcm, epsilon),
    )


def start(path: AbstractHodograph, initial: Float[Array, " k"] | None) -> Quat:
    """The frame at the start of the path."""
    natural = trihedral(path, 0.0)
    if initial is None:
        return natural.quaternion()
    normal = _direction(initial.astype(natural.normal.dtype), 1)
    across = normal - natural.tangent * (natural.tangent @ normal)
    return rotation.from_dcm(_dcm(natural.tangent, unit(across, natural.normal)))


def nodes(path: AbstractHodograph, start: Quat, times: Float[Array, " n"]) -> Float[Array, "n 4"]:
    """The frame at these times [s], rising from 0, as quaternions with continuous signs from `start`."""
    steps = jax.vmap(lambda a, b: _step(path, a, b))(times[:-1], times[1:])

    def turn(before: Quat, step: Quat) -> tuple[Quat, Quat]:
        after = quaternion.product(step, before)
        return after, after

    _, later = jax.lax.scan(turn, start, steps)
    return jax.vmap(quaternion.unit)(jnp.concatenate([start[None], later]))


def require_initial(path: AbstractHodograph, initial: Float[Array, " k"] | None) -> None:
    """Raise a ValueError where the given attitude does not fit the start of the path."""
    if initial is None:
        return
    tangent = concrete(path.velocity(0.0))
    given = concrete(_direction(initial, 0 if initial.shape == (4,) else 1))
    if tangent is None or given is None:
        return
    sine = np.linalg.norm(np.cross(given, tangent)) / (np.linalg.norm(given) * np.linalg.norm(tangent))
    if initial.shape == (4,) and (sine > TILT or given @ tangent < 0):
        angle = float(np.arctan2(sine, given @ tangent / np.linalg.norm(given) / np.linalg.norm(tangent)))
        raise ValueError(
            f"the forward axis of the initial attitude is {angle:.6g} rad off the path, which starts along "
            f"{tangent.tolist()}. Give an attitude whose x axis is along the path, or only a normal (3,)."
        )
    if initial.shape == (3,) and sine < 1e-6:
        raise ValueError("the initial normal of a rotation-minimizing frame must not be along the path")


def _direction(initial: Float[Array, " k"], axis: int) -> Vec3:
    """A body axis of a given attitude, or the given vector itself."""
    return initial if initial.shape == (3,) else quaternion.rotate(initial, _axis(initial, axis))


def _step(path: AbstractHodograph, a: Scalar, b: Scalar) -> Quat:
    """The turn, in world axes, of every rotation-minimizing frame from time `a` to time `b`."""
    stretch = _sampled(path, a, b)
    tangent = _tangent(stretch[0, 1])
    smallest = stop_gradient(jnp.argmin(jnp.abs(tangent)))
    side = jnp.where(jnp.arange(3) == smallest, 1.0, jnp.zeros_like(tangent))
    before = _dcm(tangent, unit(jnp.cross(side, tangent), side))
    after = _carried(stretch, before[2], b - a)
    turn = quaternion.product(rotation.from_dcm(after), quaternion.conjugate(rotation.from_dcm(before)))
    return jnp.where(turn[0] < 0, -turn, turn)


def _sampled(path: AbstractHodograph, a: Scalar, b: Scalar) -> Stretch:
    """r and its first three derivatives at `a`, at the quadrature nodes between, and at `b`."""
    points = jnp.asarray(np.concatenate([[0.0], (_POINTS + 1) / 2, [1.0]]), a.dtype)
    return jax.vmap(lambda t: path.derivatives(t, 3))(a * (1 - points) + b * points)


def _carried(stretch: Stretch, up: Vec3, span: Scalar) -> Mat3:
    """Direction cosines at the end of the stretch of the frame whose binormal at its start is `up`."""
    twists = jax.vmap(lambda r: _twist(up, r[1], r[2]))(stretch[1:-1])
    angle = -span * (jnp.asarray(_WEIGHTS / 2, span.dtype) @ twists)
    tangent = _tangent(stretch[-1, 1])
    level = unit(jnp.cross(up, tangent), _axis(tangent, 1))
    return _dcm(tangent, level * jnp.cos(angle) + jnp.cross(tangent, level) * jnp.sin(angle))


def _twist(up: Vec3, r1: Vec3, r2: Vec3) -> Scalar:
    """ω·τ of the upright frame for this up direction [rad/s]: [(u × r'')·B]/|u × r'|."""
    level = jnp.cross(up, r1)
    size = norm(r1) * (level @ level)
    exists = size > 0
    return jnp.where(exists, jnp.cross(up, r2) @ jnp.cross(r1, level) / jnp.where(exists, size, 1.0), 0.0)


def _tangent(velocity: Vec3) -> Vec3:
    return unit(velocity, _axis(velocity, 0))


def _dcm(tangent: Vec3, normal: Vec3) -> Mat3:
    return jnp.stack([tangent, normal, jnp.cross(tangent, normal)])


def _across(dcm: Mat3, vector: Vec3) -> Vec3:
    """Body components of a vector that has none along the tangent: that one is zero, not round-off."""
    return jnp.concatenate([jnp.zeros_like(vector, shape=1), dcm[1:] @ vector])


def _axis(like: Float[Array, " k"], k: int) -> Vec3:
    return jnp.zeros_like(like, shape=3).at[k].set(1.0)
