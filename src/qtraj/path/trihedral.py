"""Trihedra along a path: the natural one (τ, n, b) of paper S and the upright one of vehicles.

Let c = r' × r'', v = |r'|, D = c·r'''. Then κ = |c|/v³, χ = D/|c|², and the natural trihedral turns at
ω⁰ = (vχ, 0, |c|/v²) in its own axes; ε⁰ is the derivative of that. Where |r'| or |c| vanishes there is no natural
trihedral: `defined` is false there, and every number is finite, as is its gradient.
"""

import abc
import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.algebra.vector import norm, unit
from qtraj.foundation.arrays import as_float, concrete, one_instant, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.record import Record
from qtraj.foundation.result import AbstractResult, extent, in_lanes
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Mat3, Quat, Scalar, ScalarLike, Vec3
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.frenet import Invariants, natural_acceleration, natural_rate, upright_rates
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.rate_axes import BODY, INERTIAL, in_axes, require_axes
from qtraj.path.regularity import bends, leaves_vertical, moves

STEEP = 0.75
"""The square of a tangent's vertical part above which it is steep: fallback values of axes refer to x, not to z."""


class Trihedral(AbstractResult):
    """A right-handed trihedral on a path at one instant.

    `tangent`, `normal`, `binormal`: unit vectors (3,), world axes; body axes x, y, z of the trihedral, whose x axis is
    the tangent in all frames but `ThrustAligned`. `speed` [m/s],
    `curvature` and `torsion` [1/m] of the path. `rate` [rad/s] and `acceleration` [rad/s²]: angular, (3,), in `axes`:
    "body", the trihedral's own, or "inertial", the world's. `defined` is false where the trihedral does not exist; the
    numbers there are finite fallback values. Which frame it is, is not kept: trihedra of different frames are of one
    structure, as branches of a trace must be.
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
    axes: str = eqx.field(static=True, default=BODY)

    def dcm(self) -> Mat3:
        """Direction cosines α: rows τ, n, b; maps world components to trihedral components (paper S)."""
        return jnp.stack([self.tangent, self.normal, self.binormal])

    def quaternion(self) -> Quat:
        """The unit quaternion, trihedral to world, of either sign (`rotation.continuous` makes a sequence agree)."""
        return rotation.from_dcm(self.dcm())

    def gibbs(self) -> Vec3:
        """The Gibbs vector G = e·tan(Φ/2), singular where Φ = π."""
        return rotation.to_gibbs(self.quaternion())

    def in_axes(self, axes: str) -> "Trihedral":
        """The same trihedral with rate and acceleration in these `axes`, "body" or "inertial".

        **Raises:** ValueError for other axes.
        """
        require_axes(axes)
        if axes == self.axes:
            return self
        turn = self.dcm().T if axes == INERTIAL else self.dcm()
        vectors = (jnp.matmul(turn, x, precision="highest") for x in (self.rate, self.acceleration))
        return dataclasses.replace(self, **dict(zip(("rate", "acceleration"), vectors, strict=True)), axes=axes)

    def record(self) -> Record:
        """The fields, with the vectors as `dcm`, by the names of `qtraj.evaluate`; of many, batch axes in front."""
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
        variables = {name: in_axes(CHANNELS[name], self.axes).labelled(x) for name, x in values.items()}
        exists = "" if np.all(self.defined) else ", not defined" if not np.any(self.defined) else ", partly defined"
        shown = f"speed {extent(self.speed, 'm/s')}, curvature {extent(self.curvature, '1/m')}"
        summary = f"{in_lanes(self.speed.shape)}{shown}, torsion {extent(self.torsion, '1/m')}{exists}"
        return Record(summary, variables, attributes=framed("trihedral"), labels=labels_of("trihedral"))


class AbstractFrame(eqx.Module):
    """A rule that hangs a trihedral on a path."""

    @property
    def name(self) -> str:
        """What the frame is called in labelled data: its class in lower case, unless a class says otherwise."""
        return type(self).__name__.lower()

    @abc.abstractmethod
    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral from r and its first four derivatives, world axes, on a path of this duration [s]."""

    def at(self, t: Scalar, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral at the time `t` [s]; only a frame that depends on time itself overrides this."""
        return self.trihedral(r, duration)


def trihedral(
    path: AbstractHodograph, t: ScalarLike, frame: AbstractFrame | None = None, axes: str = BODY
) -> Trihedral:
    """The trihedral of `path` at one instant `t` [s]: the natural one, or that of another `frame`.

    `axes` are those of its rate and acceleration: "body", the trihedral's own, or "inertial", the world's.

    **Raises:** ValueError for many instants at once, other axes, or a `frame` that is none.
    """
    require_axes(axes)
    frame = Natural() if frame is None else frame
    if not isinstance(frame, AbstractFrame):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    t = one_instant(t)
    return frame.at(t, path.derivatives(t, 4), as_float(path.duration)).in_axes(axes)


@storable
class Natural(AbstractFrame):
    """The natural (Frenet) trihedral: tangent, principal normal, binormal (paper S, with its errata mended)."""

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        of = Invariants(r)
        defined = bends(of, duration.astype(r.dtype))
        known = (of, inverse_root(of.S, defined), inverse_root(of.N, defined), _torsion(of, defined))
        rate, acceleration = natural_rate(*known), natural_acceleration(*known)
        zero = jnp.zeros_like(rate[0])
        return _trihedral(
            of,
            duration,
            # n from c × r', then b = τ × n: orthonormal to round-off also where c has lost most of its digits.
            jnp.where(defined, jnp.cross(of.c, r[1]), 0.0),
            jnp.stack([rate[0], zero, rate[1]]),
            jnp.stack([acceleration[0], zero, acceleration[1]]),
            defined,
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

    def __repr__(self) -> str:
        return shown(self)

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        of = Invariants(r, self.unit_up(r.dtype))
        defined = leaves_vertical(of, duration.astype(r.dtype))
        rates = upright_rates(of, inverse_root(of.S, defined), inverse_root(of.H, defined))
        rate, acceleration = (jnp.stack(x) for x in rates)
        return _trihedral(of, duration, jnp.cross(of.up, r[1]), rate, acceleration, defined)

    def unit_up(self, dtype: Any) -> Vec3:
        """The direction of `up`."""
        up = self.up.astype(dtype)
        return unit(up, axis(up, 2))


def _trihedral(
    of: Invariants, duration: Scalar, towards: Vec3, rate: Vec3, acceleration: Vec3, defined: Flag
) -> Trihedral:
    """The trihedral whose normal has the direction `towards`, or stands level where that vanishes."""
    r1 = of.r[1]
    tangent = unit(r1, axis(r1, 0))
    normal = unit(towards, jnp.cross(_across(tangent), tangent))
    return with_axes(of, duration, tangent, normal, rate, acceleration, defined)


def with_axes(
    of: Invariants, duration: Scalar, x: Vec3, y: Vec3, rate: Vec3, acceleration: Vec3, defined: Flag
) -> Trihedral:
    """The trihedral with these unit axes x and y, on the path whose derivatives `of` holds."""
    moving, bending = moves(of, duration.astype(x.dtype)), bends(of, duration.astype(x.dtype))
    return Trihedral(
        tangent=x,
        normal=y,
        binormal=jnp.cross(x, y),
        speed=norm(of.r[1]),
        curvature=norm(of.c) * inverse_root(of.S, moving) ** 3,
        torsion=_torsion(of, bending),
        rate=rate,
        acceleration=acceleration,
        defined=defined,
    )


def _torsion(of: Invariants, bending: Flag) -> Scalar:
    return jnp.where(bending, of.T / jnp.where(bending, of.N, 1.0), 0.0)


def inverse_root(x: Scalar, exists: Flag) -> Scalar:
    """1/√x, or 0 with a derivative of 0 where it does not exist."""
    return jnp.where(exists, jnp.where(exists, x, 1.0) ** -0.5, 0.0)


def _across(tangent: Vec3) -> Vec3:
    """A unit vector across the tangent: level where it can be, so that a straight level road keeps b up."""
    reference = jnp.where(tangent[2] ** 2 > STEEP, axis(tangent, 0), axis(tangent, 2))
    across = reference - tangent * (reference @ tangent)
    return across / norm(across)


def axis(v: Vec3, k: int) -> Vec3:
    """The unit vector along axis `k`, in the precision of `v`."""
    return jnp.zeros_like(v).at[k].set(1.0)
