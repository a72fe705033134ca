"""Trihedra along a path: the natural one (τ, n, b) of paper S and the upright one of vehicles.

Let c = r' × r'', v = |r'|, D = c·r'''. Then κ = |c|/v³, χ = D/|c|², and the natural trihedral turns at
ω⁰ = (vχ, 0, |c|/v²) in its own axes; ε⁰ is the derivative of that. Where |r'| or |c| vanishes there is no natural
trihedral: `defined` is false there, and every number is finite, as is its gradient.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.algebra.vector import norm, unit
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, in_lanes
from qtraj.foundation.types import ArrayInput, Flag, Mat3, Quat, Scalar, ScalarLike, Vec3
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import Invariants, existence, invariants
from qtraj.path.natural_rates import natural_acceleration, natural_rate
from qtraj.path.quantities import AXES, DESCRIPTIONS, LABELS, framed

DEFINED_TOLERANCE = 4096
"""In machine epsilons: a path that bends by less than this over its own length is straight, and a speed below this
part of its own changes is zero. At the tolerance itself the direction of n still has three good digits."""


class Trihedral(AbstractResult):
    """A right-handed trihedral on a path at one instant.

    `tangent`, `normal`, `binormal`: unit vectors (3,), world axes; body axes x, y, z of the trihedral. `speed` [m/s],
    `curvature` and `torsion` [1/m] of the path. `rate` [rad/s] and `acceleration` [rad/s²]: angular, (3,), in the
    trihedral's own axes. `defined` is false where the trihedral does not exist; the numbers there are finite fillers.
    Which frame it is is not kept: trihedra of different frames are of one structure, as branches of a trace must be.
    """

    tangent: Vec3
    normal: Vec3
    binormal: Vec3
    speed: Scalar
    curvature: Scalar
    torsion: Scalar
    rate: Vec3
    acceleration: Vec3
    defined: Flag

    def dcm(self) -> Mat3:
        """Direction cosines α: rows τ, n, b; maps world components to trihedral components (paper S)."""
        return jnp.stack([self.tangent, self.normal, self.binormal])

    def quaternion(self) -> Quat:
        """The unit quaternion, trihedral to world, of either sign (`rotation.continuous` makes a sequence agree)."""
        return rotation.from_dcm(self.dcm())

    def gibbs(self) -> Vec3:
        """The Gibbs vector G = e·tan(Φ/2), singular where Φ = π."""
        return rotation.to_gibbs(self.quaternion())

    def record(self) -> Record:
        """The fields, with the vectors as `dcm`, by the names of `qtraj.evaluate`; of many, lanes in front."""
        dcm = jnp.stack([self.tangent, self.normal, self.binormal], axis=-2)
        values = {
            "dcm": dcm,
            "quaternion": jnp.vectorize(rotation.from_dcm, signature="(i,j)->(q)")(dcm),
            "speed": self.speed,
            "curvature": self.curvature,
            "torsion": self.torsion,
            "rate": self.rate,
            "angular_acceleration": self.acceleration,
            "defined": self.defined,
        }
        variables = {name: Quantity(x, *DESCRIPTIONS[name], AXES[name]) for name, x in values.items()}
        exists = "" if np.all(self.defined) else ", not defined" if not np.any(self.defined) else ", partly defined"
        shown = f"speed {extent(self.speed, 'm/s')}, curvature {extent(self.curvature, '1/m')}"
        summary = f"{in_lanes(self.speed.shape)}{shown}, torsion {extent(self.torsion, '1/m')}{exists}"
        return Record(summary, variables, attributes=framed("trihedral"), labels=LABELS)


class AbstractFrame(eqx.Module):
    """A rule that hangs a trihedral on a path."""

    @property
    def name(self) -> str:
        """What the frame is called in labelled data: its class in lower case, unless a class says otherwise."""
        return type(self).__name__.lower()

    @abc.abstractmethod
    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral from r and its first four derivatives, world axes, on a path of this duration [s]."""


def trihedral(path: AbstractHodograph, t: ScalarLike, frame: AbstractFrame | None = None) -> Trihedral:
    """The trihedral of `path` at one instant `t` [s]: the natural one, or that of another `frame`.

    **Raises:** ValueError for many instants at once, or a `frame` that is none.
    """
    frame = Natural() if frame is None else frame
    if not isinstance(frame, AbstractFrame):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    return frame.trihedral(path.derivatives(one_instant(t), 4), as_float(path.duration))


@storable
class Natural(AbstractFrame):
    """The natural (Frenet) trihedral: tangent, principal normal, binormal (paper S, with its errata mended)."""

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        shape = _shape(r, duration)
        tangent = unit(r[1], _axis(r, 0))
        # n from c × r', then b = τ × n: orthonormal to round-off also where c has lost most of its digits.
        towards = jnp.where(shape.bending, jnp.cross(shape.c, r[1]), 0.0)
        normal = unit(towards, jnp.cross(_across(tangent), tangent))
        rate, acceleration = _natural_rates(r, shape)
        return Trihedral(
            tangent=tangent,
            normal=normal,
            binormal=jnp.cross(tangent, normal),
            speed=shape.speed,
            curvature=shape.curvature,
            torsion=shape.torsion,
            rate=rate,
            acceleration=acceleration,
            defined=shape.moving & shape.bending,
        )


@storable
class Upright(AbstractFrame):
    """The frame of a vehicle that stays upright: x along the path, y to the left, z up.

    `up` (3,), world axes, any length. It does not exist where the path runs along `up`.

    **Raises:** ValueError for an `up` that is zero, not finite or of another shape.
    """

    up: Vec3

    def __init__(self, up: ArrayInput = (0.0, 0.0, 1.0)):
        self.up = real_vector(up, "the up direction of an upright frame", 3)
        known = concrete(self.up)
        if known is not None and not known.any():
            raise ValueError("the up direction of an upright frame must not be zero")

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        shape = _shape(r, duration)
        up = unit(self.up.astype(r.dtype), _axis(r, 2))
        tangent = unit(r[1], _axis(r, 0))
        level = jnp.cross(up, r[1])
        normal = unit(level, jnp.cross(_across(tangent), tangent))
        exists = shape.moving & (level @ level > _tolerance(r) ** 2 * (r[1] @ r[1]))
        # ε is the derivative of ω along the path, and ω depends on r', r'' alone.
        finite = jnp.where(exists, r[1:], jnp.asarray(_REGULAR, r.dtype))
        rate, acceleration = jax.jvp(
            lambda r1, r2: _upright_rate(up, r1, r2), (finite[0], finite[1]), (finite[1], finite[2])
        )
        nothing = jnp.zeros_like(rate)
        return Trihedral(
            tangent=tangent,
            normal=normal,
            binormal=jnp.cross(tangent, normal),
            speed=shape.speed,
            curvature=shape.curvature,
            torsion=shape.torsion,
            rate=jnp.where(exists, rate, nothing),
            acceleration=jnp.where(exists, acceleration, nothing),
            defined=exists,
        )


class _Shape(eqx.Module):
    """What every frame needs of a path, with finite fillers where it does not exist."""

    c: Vec3
    of: Invariants
    speed: Scalar
    curvature: Scalar
    torsion: Scalar
    safe_speed: Scalar  # [m/s] the speed, or 1 where it vanishes
    safe_area: Scalar  # [m² s⁻³] |c|, or 1 where it vanishes
    moving: Flag
    bending: Flag


_REGULAR = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""Derivatives r' … r'''' of a path on which every formula is regular: the filler behind `where`."""


def _shape(r: Float[Array, "5 3"], duration: Scalar) -> _Shape:
    of = invariants(r[1], r[2], r[3])
    exists = existence(r[1], r[2], r[3], duration.astype(r.dtype))
    moving = exists.motion > _tolerance(r) ** 2
    bending = moving & (exists.bend > _tolerance(r) ** 2)
    safe_s = jnp.where(moving, of.S, 1.0)
    safe_n = jnp.where(bending, of.N, 1.0)
    c = jnp.cross(r[1], r[2])
    return _Shape(
        c=c,
        of=of,
        speed=norm(r[1]),
        curvature=jnp.where(moving, norm(c) / safe_s**1.5, 0.0),
        torsion=jnp.where(bending, of.T / safe_n, 0.0),
        safe_speed=jnp.sqrt(safe_s),
        safe_area=jnp.sqrt(safe_n),
        moving=moving,
        bending=bending,
    )


def _natural_rates(r: Float[Array, "5 3"], shape: _Shape) -> tuple[Vec3, Vec3]:
    """ω⁰ and ε⁰ of the natural trihedral in its own axes, zero where it does not exist."""
    known = (shape.of, 1 / shape.safe_speed, 1 / shape.safe_area, shape.torsion)
    along, across = natural_rate(*known)
    along_rate, across_rate = natural_acceleration(r, shape.c, *known)
    zero = jnp.zeros_like(along)
    rate, acceleration = jnp.stack([along, zero, across]), jnp.stack([along_rate, zero, across_rate])
    return jnp.where(shape.bending, rate, 0.0), jnp.where(shape.bending, acceleration, 0.0)


def _upright_rate(up: Vec3, r1: Vec3, r2: Vec3) -> Vec3:
    """ω = c/v² + τ[(u × r'')·B]/|u × r'| in the upright frame's own axes."""
    tangent = r1 / norm(r1)
    level = jnp.cross(up, r1)
    normal = level / norm(level)
    binormal = jnp.cross(tangent, normal)
    omega = jnp.cross(r1, r2) / (r1 @ r1) + tangent * (jnp.cross(up, r2) @ binormal) / norm(level)
    return jnp.stack([tangent, normal, binormal]) @ omega


def _across(tangent: Vec3) -> Vec3:
    """A unit vector across the tangent: level where it can be, so that a straight level road keeps b up."""
    upwards = jnp.zeros_like(tangent).at[2].set(1.0)
    forwards = jnp.zeros_like(tangent).at[0].set(1.0)
    steep = tangent[2] ** 2 > 0.75
    reference = jnp.where(steep, forwards, upwards)
    across = reference - tangent * (reference @ tangent)
    return across / norm(across)


def _axis(r: Float[Array, "5 3"], k: int) -> Vec3:
    return jnp.zeros_like(r[0]).at[k].set(1.0)


def _tolerance(r: Array) -> float:
    return DEFINED_TOLERANCE * float(jnp.finfo(r.dtype).eps)
