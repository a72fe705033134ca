"""Define trihedra along a path: the natural trihedral (τ, n, b) of paper S and the upright frame of vehicles.

Let c = r' × r'' and v = |r'|. Then the curvature is κ = |c|/v³, and the torsion is χ = c·r'''/|c|². In its own axes,
the natural trihedral has the angular rate ω⁰ = (vχ, 0, |c|/v²) and the angular acceleration ε⁰ = dω⁰/dt. Where |r'| or
|c| is zero the natural trihedral does not exist: `defined` is false, and all values and gradients are finite.
"""

import abc
import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.algebra.cosines import from_rotation
from qtraj.algebra.cpu import in_one_loop, root
from qtraj.algebra.vector import unit
from qtraj.foundation.arrays import concrete, one_instant, real_vector
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.methods import method
from qtraj.foundation.namespace import in_numpy, matmul, xp
from qtraj.foundation.record import Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Mat3, Quat, Scalar, ScalarLike, Vec3
from qtraj.path import frame_components
from qtraj.path.channel import CHANNELS
from qtraj.path.components import dot
from qtraj.path.frame_axes import framed, labels_of
from qtraj.path.frame_components import Basis, FrameComponents, curvature, filled, torsion, triple
from qtraj.path.frenet import Invariants
from qtraj.path.hodograph import AbstractHodograph, require_path
from qtraj.path.moving_basis import in_moving_basis
from qtraj.path.rate_axes import BODY, INERTIAL, in_axes, require_axes
from qtraj.path.regularity import rotating_span
from qtraj.path.route import Route


class Trihedral(AbstractResult):
    """A right-handed trihedral on a path at one instant.

    `tangent`, `normal` and `binormal` are unit vectors (3,) in world axes along the body axes x, y and z. The x axis is
    the tangent of the path, except in the frame `ThrustAligned`, and in the frame `Driving` at a stop or in reverse.
    `speed` [m/s], `curvature` and `torsion` [1/m] describe the path. `rate` [rad/s] and `acceleration` [rad/s²] are the
    angular rate and acceleration (3,) in `axes`, which is "body" for the trihedral's own axes or "inertial" for world
    axes. `defined` is false where the trihedral does not exist; its values are then finite fallback values. The type of
    frame is not stored, so trihedra of all frames have the same tree structure, which the branches of `jax.lax.cond`
    require.
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
        """Return the direction cosines α of paper S, with the rows τ, n and b; they map world to body components."""
        return _stacked((self.tangent, self.normal, self.binormal))

    def quaternion(self) -> Quat:
        """Return the unit quaternion, trihedral to world; its first non-zero component is positive.

        `rotation.continuous` makes the signs of consecutive quaternions continuous.
        """
        return from_rotation(self.dcm())

    def gibbs(self) -> Vec3:
        """Return the Gibbs vector e·tan(Φ/2) of the rotation by Φ about e; it is infinite at Φ = π."""
        return rotation.to_gibbs(self.quaternion())

    def in_axes(self, axes: str) -> "Trihedral":
        """Return the same trihedral with rate and acceleration in these `axes`, "body" or "inertial".

        **Raises:** ValueError if `axes` is neither 'body' nor 'inertial'.
        """
        require_axes(axes)
        return self if axes == self.axes else _in_axes(self, axes)

    def record(self) -> Record:
        """Return the fields with the names used in `qtraj.evaluate`, batch axes first.

        The rows of `dcm` are the axes τ, n and b in world components.
        """
        dcm = self.dcm()
        values = {
            "dcm": dcm,
            "quaternion": from_rotation(dcm),
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
    """A rule that assigns a trihedral to each instant of a path."""

    supports_numpy: ClassVar[bool] = False
    """Whether `components_at` accepts NumPy arrays, and is not None; other frames are computed by JAX."""

    @property
    def name(self) -> str:
        """The name of the frame in labelled data, by default the class name in lower case."""
        return type(self).__name__.lower()

    @abc.abstractmethod
    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral from the position and its first four time derivatives (rows of `r`) in world axes."""

    def at(self, t: Scalar, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral at the time `t` [s]; only frames that depend on time override this method."""
        return self.trihedral(r, span)

    def components(self, i: Invariants, basis: Basis, span: Array) -> FrameComponents | None:
        """Return the frame from the derivatives of a path in its moving basis, or None if this form is not available.

        Arrays may have any shape. With this form, many instants are evaluated in one loop, without world axes.
        """
        return None

    def components_at(self, t: Array, i: Invariants, basis: Basis, span: Array) -> FrameComponents | None:
        """Return `components` at the times `t` [s]; only frames that depend on time override this method."""
        return method(self, "components")(i, basis, span)


def trihedral(
    path: "AbstractHodograph", t: ScalarLike, frame: "AbstractFrame | None" = None, axes: str = BODY
) -> "Trihedral":
    """Compute the trihedral of `path` at one instant `t` [s].

    The default of `frame` is `Upright()` for a route and `Natural()` for any other path. `axes` are the axes of rate
    and acceleration: "body" for the trihedral's own axes, or "inertial" for world axes.

    **Raises:** ValueError for an array of instants, unknown `axes`, or an invalid `frame`.
    """
    require_path(path)
    require_axes(axes)
    if frame is None:
        frame = Upright() if isinstance(path, Route) else Natural()
    if not isinstance(frame, AbstractFrame):
        raise ValueError(f"a frame such as Natural() or Upright() was expected, but {frame!r} was given")
    compute = _trihedral if path.supports_numpy and frame.supports_numpy else _compiled_trihedral
    return compute(path, one_instant(t), frame, axes)


def frames(path: AbstractHodograph, t: Array, frame: AbstractFrame) -> tuple[Any, Basis, Any, FrameComponents | None]:
    """Return invariants, moving basis, span and frame at the times `t` [s], of any shape."""
    polynomials = method(path, "polynomials")()
    if polynomials is None:
        rows = method(path, "sampled" if xp.ndim(t) else "derivatives")(t, 4)
        basis, rows, span = Basis(), [triple(row) for row in rows], method(path, "span")(t)
    else:
        x, y, z, angle = method(polynomials, "series")(t, 4)
        basis, rows = Basis(angle[0], polynomials.placement), in_moving_basis(x, y, z, angle)
        span = rotating_span(path.duration, angle[1])
    zero = xp.zeros_like(rows[0][0])
    i = basis.invariants([filled(row, zero) for row in rows])
    span = xp.asarray(span).astype(i.S.dtype)
    return i, basis, span, method(frame, "components_at")(t, i, basis, span)


def dcms(
    path: AbstractHodograph, times: Float[Array, " n"], frame: AbstractFrame
) -> tuple[Float[Array, "n 3 3"], Float[Array, " n"]]:
    """Return the direction cosines of a frame at many instants [s], as `Trihedral.dcm`, and its rates [rad/s]."""
    _, basis, _, found = frames(path, times, frame)
    if found is None:
        each = jax.vmap(lambda t: trihedral(path, t, frame))(times)
        return jax.vmap(lambda x: x.dcm())(each), jnp.linalg.norm(each.rate, axis=-1)
    rows = [xp.stack(basis.world(v), axis=-1) for v in found.axes]
    return xp.stack(rows, axis=-2), xp.sqrt(dot(found.rate, found.rate)) + xp.zeros_like(times)


def _jax_trihedral(path: AbstractHodograph, t: Scalar, frame: AbstractFrame, axes: str) -> Trihedral:
    i, basis, span, found = frames(path, t, frame)
    at = frame.at(t, path.derivatives(t, 4), span) if found is None else _assembled(i, basis, found, span)
    return at if axes == BODY else at.in_axes(axes)


_compiled_trihedral = on_one_device(eqx.filter_jit(_jax_trihedral))
_trihedral = in_numpy(_jax_trihedral, _compiled_trihedral)


def _assembled(i: Invariants, basis: Basis, found: FrameComponents, span: Scalar) -> Trihedral:
    """Return the trihedral of a frame in components; all numbers are computed in one loop."""
    axes = [basis.world(v) for v in found.axes]
    numbers = in_one_loop(
        [
            root(i.S),
            curvature(i, span),
            torsion(i, span),
            xp.where(found.defined, xp.ones_like(i.S), 0.0),  # an array of bool would need a second loop
            *(xp.asarray(x, i.S.dtype) for v in (*axes, found.rate, found.acceleration) for x in v),
        ]
    )
    tangent, normal, binormal, rate, acceleration = (xp.stack(numbers[k : k + 3]) for k in range(4, 19, 3))
    return Trihedral(
        tangent, normal, binormal, numbers[0], numbers[1], numbers[2], rate, acceleration, defined=numbers[3] > 0
    )


def from_rows(frame: AbstractFrame, t: Any, r: Float[Array, "5 3"], span: Scalar) -> Any:
    """Return the trihedral of a frame that provides components, from r and its time derivatives in world axes."""
    basis = Basis()
    i = basis.invariants([triple(row) for row in r])
    span = span.astype(r.dtype)
    found: Any = frame.components_at(t, i, basis, span)
    return _assembled(i, basis, found, span)


@in_numpy
def _in_axes(frame: Trihedral, axes: str) -> Trihedral:
    dcm = frame.dcm()
    turn = dcm.mT if axes == INERTIAL else dcm
    rate, acceleration = (matmul(turn, x[..., None])[..., 0] for x in (frame.rate, frame.acceleration))
    return dataclasses.replace(frame, rate=rate, acceleration=acceleration, axes=axes)


@in_numpy
def _stacked(axes: tuple[Vec3, Vec3, Vec3]) -> Mat3:
    return xp.stack(axes, axis=-2)


@storable
class Natural(AbstractFrame):
    """The natural (Frenet) trihedral: tangent, principal normal, binormal (paper S, errata corrected)."""

    supports_numpy: ClassVar[bool] = True

    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the natural trihedral from r and its first four time derivatives, in world axes."""
        return from_rows(self, None, r, span)

    def components(self, i: Invariants, basis: Basis, span: Array) -> FrameComponents:
        """Return the natural trihedral in components."""
        return frame_components.natural(i, basis, span)


@storable
class Upright(AbstractFrame):
    """The frame of a vehicle that stays upright: x along the path, y to the left, z up.

    `up` (3,), in world axes, need not be normalised. The frame does not exist where the velocity is zero or parallel to
    `up`. On a vertical loop it therefore jumps by 180° about the path where the path is vertical, so that z points up
    again: rates and accelerations are finite before and after, but the attitude is not continuous. For loops use
    `qtraj.RotationMinimizing` or `qtraj.ThrustAligned`.

    **Raises:** ValueError for an `up` that is zero, not finite, or of another shape.
    """

    up: Vec3
    supports_numpy: ClassVar[bool] = True

    def __init__(self, up: ArrayInput = (0.0, 0.0, 1.0)):
        self.up = real_vector(up, "the up direction of an upright frame", 3)
        value = concrete(self.up)
        if value is not None and not value.any():
            raise ValueError("the up direction of an upright frame must not be zero")

    def __repr__(self) -> str:
        return shown(self)

    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the upright trihedral from r and its first four time derivatives, in world axes."""
        return from_rows(self, None, r, span)

    def components(self, i: Invariants, basis: Basis, span: Array) -> FrameComponents:
        """Return the upright frame in components."""
        return frame_components.upright(i, basis, span, triple(self.unit_up(span.dtype)))

    def unit_up(self, dtype: Any) -> Vec3:
        """Return the unit vector along `up`."""
        up = self.up.astype(dtype)
        return unit(up, np.eye(3, dtype=dtype)[2])
