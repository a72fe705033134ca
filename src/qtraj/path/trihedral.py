"""Trihedra along a path: the natural one (τ, n, b) of paper S and the upright one of vehicles.

Let c = r' × r'', v = |r'|, D = c·r'''. Then κ = |c|/v³, χ = D/|c|², and the natural trihedral turns at
ω⁰ = (vχ, 0, |c|/v²) in its own axes, and ε⁰ = dω⁰/dt. Where |r'| or |c| is zero there is no natural trihedral:
`defined` is false there, and all values and gradients are finite.
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
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Mat3, Quat, Scalar, ScalarLike, Vec3
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.frenet import Invariants, natural_acceleration, natural_rate, upright_rates
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.rate_axes import BODY, INERTIAL, in_axes, require_axes
from qtraj.path.regularity import has_natural_frame, has_tangent, has_upright_frame
from qtraj.path.route import Route

STEEP = 0.75
"""If the squared vertical component of a unit tangent is larger, fallback axes refer to world x instead of world z."""


class Trihedral(AbstractResult):
    """A right-handed trihedral on a path at one instant.

    `tangent`, `normal`, `binormal`: unit vectors (3,), world axes; they are the body axes x, y and z. The x axis is the
    tangent of the path in all frames except `ThrustAligned`. `speed` [m/s], `curvature` and `torsion` [1/m] belong to
    the path. `rate` [rad/s] and `acceleration` [rad/s²] are angular, (3,), in `axes`: "body", the trihedral's own, or
    "inertial", the world's. `defined` is false where the trihedral does not exist; the values there are finite fallback
    values. The type of frame is not stored, so trihedra of all frames have the same tree structure, as the branches of
    `jax.lax.cond` must have.
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
        """The Gibbs vector G = e·tan(Φ/2), singular at Φ = π."""
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
        """The fields with the names of `qtraj.evaluate`, the axes as `dcm`; for many trihedra, batch axes first."""
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
        values_text = f"speed {extent(self.speed, 'm s-1')}, curvature {extent(self.curvature, 'm-1')}"
        summary = f"{batch_prefix(self.speed.shape)}{values_text}, torsion {extent(self.torsion, 'm-1')}{exists}"
        return Record(summary, variables, attributes=framed("trihedral"), labels=labels_of("trihedral"))


class AbstractFrame(eqx.Module):
    """A rule that assigns a trihedral to each point of a path."""

    @property
    def name(self) -> str:
        """The name of the frame in labelled data, by default the class name in lower case."""
        return type(self).__name__.lower()

    @abc.abstractmethod
    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral from r and its first four derivatives, world axes, on a path of this duration [s]."""

    def at(self, t: Scalar, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The trihedral at the time `t` [s]; only frames that depend on time override this."""
        return self.trihedral(r, duration)


def trihedral(
    path: "AbstractHodograph", t: ScalarLike, frame: "AbstractFrame | None" = None, axes: str = BODY
) -> "Trihedral":
    """The trihedral of `path` at one instant `t` [s]: of `frame`, by default upright for a route, else natural.

    `axes` are those of its rate and acceleration: "body", the trihedral's own, or "inertial", the world's.

    **Raises:** ValueError for an array of instants, other axes, or an invalid `frame`.
    """
    require_axes(axes)
    if frame is None:
        frame = Upright() if isinstance(path, Route) else Natural()
    if not isinstance(frame, AbstractFrame):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    t = one_instant(t)
    return frame.at(t, path.derivatives(t, 4), as_float(path.duration)).in_axes(axes)


@storable
class Natural(AbstractFrame):
    """The natural (Frenet) trihedral: tangent, principal normal, binormal (paper S, errata corrected)."""

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The natural trihedral from r and its first four derivatives, world axes."""
        i = Invariants(r)
        defined = has_natural_frame(i, duration.astype(r.dtype))
        arguments = (i, inverse_root(i.S, defined), inverse_root(i.N, defined), _torsion(i, defined))
        rate, acceleration = natural_rate(*arguments), natural_acceleration(*arguments)
        zero = jnp.zeros_like(rate[0])
        return _trihedral(
            i,
            duration,
            # n from c × r', then b = τ × n: orthonormal to round-off even where c has lost most of its digits.
            jnp.where(defined, jnp.cross(i.c, r[1]), 0.0),
            jnp.stack([rate[0], zero, rate[1]]),
            jnp.stack([acceleration[0], zero, acceleration[1]]),
            defined,
        )


@storable
class Upright(AbstractFrame):
    """The frame of a vehicle that stays upright: x along the path, y to the left, z up.

    `up` (3,), world axes, may have any length. The frame does not exist where the path is parallel to `up`.

    **Raises:** ValueError for an `up` that is zero, not finite or has another shape.
    """

    up: Vec3

    def __init__(self, up: ArrayInput = (0.0, 0.0, 1.0)):
        self.up = real_vector(up, "the up direction of an upright frame", 3)
        value = concrete(self.up)
        if value is not None and not value.any():
            raise ValueError("the up direction of an upright frame must not be zero")

    def __repr__(self) -> str:
        return shown(self)

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """The upright trihedral from r and its first four derivatives, world axes."""
        i = Invariants(r, self.unit_up(r.dtype))
        defined = has_upright_frame(i, duration.astype(r.dtype))
        rates = upright_rates(i, inverse_root(i.S, defined), inverse_root(i.H, defined))
        rate, acceleration = (jnp.stack(x) for x in rates)
        return _trihedral(i, duration, jnp.cross(i.up, r[1]), rate, acceleration, defined)

    def unit_up(self, dtype: Any) -> Vec3:
        """The unit vector along `up`."""
        up = self.up.astype(dtype)
        return unit(up, axis(up, 2))


def _trihedral(
    i: Invariants, duration: Scalar, direction: Vec3, rate: Vec3, acceleration: Vec3, defined: Flag
) -> Trihedral:
    """The trihedral whose normal has this `direction`, or is horizontal if the direction is zero."""
    r1 = i.r[1]
    tangent = unit(r1, axis(r1, 0))
    normal = unit(direction, jnp.cross(_fallback_binormal(tangent), tangent))
    return with_axes(i, duration, tangent, normal, rate, acceleration, defined)


def with_axes(
    i: Invariants, duration: Scalar, x: Vec3, y: Vec3, rate: Vec3, acceleration: Vec3, defined: Flag
) -> Trihedral:
    """The trihedral with the unit axes x and y, on the path with the invariants `of`."""
    moving, curved = has_tangent(i, duration.astype(x.dtype)), has_natural_frame(i, duration.astype(x.dtype))
    return Trihedral(
        tangent=x,
        normal=y,
        binormal=jnp.cross(x, y),
        speed=norm(i.r[1]),
        curvature=norm(i.c) * inverse_root(i.S, moving) ** 3,
        torsion=_torsion(i, curved),
        rate=rate,
        acceleration=acceleration,
        defined=defined,
    )


def _torsion(i: Invariants, curved: Flag) -> Scalar:
    return jnp.where(curved, i.T / jnp.where(curved, i.N, 1.0), 0.0)


def inverse_root(x: Scalar, exists: Flag) -> Scalar:
    """1/√x, or 0 with derivative 0 where `exists` is false."""
    return jnp.where(exists, jnp.where(exists, x, 1.0) ** -0.5, 0.0)


def _fallback_binormal(tangent: Vec3) -> Vec3:
    """A unit vector orthogonal to the tangent: upwards if possible, so that b points up on a straight level road."""
    reference = jnp.where(tangent[2] ** 2 > STEEP, axis(tangent, 0), axis(tangent, 2))
    orthogonal = reference - tangent * (reference @ tangent)
    return orthogonal / norm(orthogonal)


def axis(v: Vec3, k: int) -> Vec3:
    """The unit vector along axis `k`, in the precision of `v`."""
    return jnp.zeros_like(v).at[k].set(1.0)
