"""Define the frame of a multirotor: z is along the thrust; the yaw follows the velocity or a given heading.

The thrust has the direction of r'' − g, the acceleration minus gravity. Position and heading determine the attitude by
differential flatness (Mellinger and Kumar, "Minimum snap trajectory generation and control for quadrotors", ICRA 2011,
section III). With f = r'' − g and a forward reference c, the axes are z = f/|f|, y = z × c/|z × c| and x = y × z. For a
heading ψ, c = (cos ψ, sin ψ, 0). Then ψ is the first Z-X-Y angle of Mellinger and Kumar, y is perpendicular to the
heading, and x is the heading, projected onto the plane perpendicular to the thrust.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra.cpu import inverse_root
from qtraj.foundation.arrays import as_float, concrete, real_scalar, real_vector, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.path.components import Triple, add_vectors, cross, dot, scaled, select
from qtraj.path.frame_axes import THRUST_ALIGNED
from qtraj.path.frame_components import FORWARD, STEEP, UP, Basis, FrameComponents, triple, vanishes
from qtraj.path.frenet import Invariants
from qtraj.path.regularity import has_tangent, is_significant
from qtraj.path.trihedral import AbstractFrame, Trihedral, from_rows

STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²]."""

LEFT = (0, 1, 0)
"""World y."""

Three = tuple[Triple, Triple, Triple]
"""A vector and its first two time derivatives."""

Heading = TypeAliasType("Heading", ArrayInput | Callable[..., Any])
"""An angle [rad], either constant or a function of time [s]."""


@storable
class ThrustAligned(AbstractFrame):
    """The frame of a multirotor: z is along the thrust, x points forward, and y points to the left.

    The thrust has the direction of a − g, the acceleration minus gravity.

    `heading` is None, a number or a function. With None, the yaw follows the velocity, so that the vehicle does not
    slip sideways (the velocity has no component along y). A number [rad], measured from world x towards world y, is a
    constant heading. A function of time [s], written with `jax.numpy` and twice differentiable, returns the heading
    [rad]. `gravity` is a magnitude [m/s²], along −z of the world, or a vector (3,) [m/s²] in world axes.

    The x axis is not the tangent. It is the direction of the velocity or of the heading, projected onto the plane
    perpendicular to the thrust. `defined` is false where the frame does not exist. The frame does not exist in free
    fall (a = g). With a given heading, it does not exist where the thrust is parallel to the heading. If the yaw
    follows the velocity, it does not exist where the speed is zero or the thrust is parallel to the velocity. Rate and
    acceleration are exact; they use the third and the fourth derivative of the path. A frame whose heading is a
    function cannot be saved.

    **Raises:** ValueError for a heading that is not finite, or is neither a number nor a function that JAX can trace.
    ValueError for a gravity that is negative or not finite, or has the wrong shape.
    """

    heading: Any
    gravity: Vec3

    def __init__(self, heading: Heading | None = None, gravity: ArrayInput = STANDARD_GRAVITY):
        self.heading = None if heading is None else _heading(heading)
        self.gravity = _gravity(gravity)

    def __repr__(self) -> str:
        return shown(self, heading="rad", gravity="m/s²")

    @property
    def name(self) -> str:
        """The name of the frame in labelled data."""
        return THRUST_ALIGNED

    @property
    def supports_numpy(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Whether the heading is not a function, because JAX differentiates functions."""
        return not callable(self.heading)

    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral at t = 0; the time is relevant only if the heading is a function of time."""
        return self.at(xp.zeros_like(span), r, span)

    def at(self, t: Scalar, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral at the time `t` [s] from r and its first four time derivatives, in world axes."""
        return from_rows(self, t.astype(r.dtype), r, span)

    def components_at(self, t: Array, i: Invariants, basis: Basis, span: Array) -> FrameComponents:
        """Return the frame in components at the times `t` [s]."""
        r, dtype = i.r, i.S.dtype
        gravity = basis.local(triple(self.gravity.astype(dtype)))
        f = (add_vectors(r[2], scaled(gravity, -1)), r[3], r[4])
        c = (r[1], r[2], r[3]) if self.heading is None else self._level(t.astype(dtype), basis)
        w = _cross(f, c)
        F, C, W = dot(f[0], f[0]), dot(c[0], c[0]), dot(w[0], w[0])
        exists = is_significant(F, i.A + dot(gravity, gravity) + span**2 * i.J) & is_significant(W, F * C)
        if self.heading is None:
            exists = exists & has_tangent(i, span)
        z = _unit(f[0], F, basis.local(UP))
        # Orthogonal to the thrust to within round-off, even if w has lost most digits.
        side = add_vectors(w[0], scaled(z, -dot(z, w[0])))
        y = select(exists, _unit(side, dot(side, side), FORWARD), _fallback_y(z, basis))
        x = cross(y, z)
        rate, acceleration = _rates((x, y, z), f, w, inverse_root(F, exists), inverse_root(W, exists))
        return FrameComponents((x, y, z), rate, acceleration, exists)

    def _level(self, t: Array, basis: Basis) -> Three:
        """Return the direction of the heading and its first two time derivatives, in the moving basis."""
        zero = xp.zeros_like(t)
        if not callable(self.heading):
            psi = self.heading.astype(t.dtype) + zero
            return basis.local((xp.cos(psi), xp.sin(psi), zero)), (zero, zero, zero), (zero, zero, zero)
        user_heading: Any = self.heading
        angle = jnp.vectorize(lambda t: jnp.asarray(user_heading(t)).astype(t.dtype))
        once = lambda t: jax.jvp(angle, (t,), (jnp.ones_like(t),))  # noqa: E731
        (psi, rate), (_, change) = jax.jvp(once, (t,), (jnp.ones_like(t),))
        cos, sin = jnp.cos(psi), jnp.sin(psi)
        first = (-sin * rate, cos * rate, zero)
        second = (-sin * change - cos * rate**2, cos * change - sin * rate**2, zero)
        return basis.local((cos, sin, zero)), basis.local(first), basis.local(second)


def _rates(axes: Three, f: Three, w: Three, inv_f: Any, inv_w: Any) -> tuple[Triple, Triple]:
    """Return the angular rate ω [rad/s] and acceleration ε [rad/s²] of the frame in its own axes x, y and z.

    `f` is the acceleration minus gravity, and `w` is f × c with the forward reference c, each with two derivatives. The
    axes are z = f/|f|, y = w/|w| and x = y × z; `inv_f` is 1/|f|, and `inv_w` is 1/|w|.

    ω = (−f'·y/|f|, f'·x/|f|, −w'·x/|w|), and ε is the derivative of ω. (Mellinger and Kumar, eqs 7 and 8, denote the
    first two components by h_ω.)
    """
    x, y, z = axes
    log_f_rate, log_w_rate = dot(f[1], z) * inv_f, dot(w[1], y) * inv_w  # logarithmic derivatives of |f| and |w|
    p, q, s = -dot(f[1], y) * inv_f, dot(f[1], x) * inv_f, -dot(w[1], x) * inv_w
    return (p, q, s), (
        -dot(f[2], y) * inv_f - 2 * p * log_f_rate + q * s,
        dot(f[2], x) * inv_f - 2 * q * log_f_rate - p * s,
        -dot(w[2], x) * inv_w - 2 * s * log_w_rate + q * dot(w[1], z) * inv_w,
    )


def _cross(a: Three, b: Three) -> Three:
    """Return a × b and its first two time derivatives."""
    first = add_vectors(cross(a[1], b[0]), cross(a[0], b[1]))
    second = add_vectors(add_vectors(cross(a[2], b[0]), scaled(cross(a[1], b[1]), 2)), cross(a[0], b[2]))
    return cross(a[0], b[0]), first, second


def _unit(v: Triple, square: Array, fallback: Triple) -> Triple:
    """Return the direction of `v`, whose squared norm is `square`, or `fallback` if it is zero."""
    zero = vanishes(square)
    return select(zero, fallback, scaled(v, inverse_root(square, ~zero)))


def _fallback_y(z: Triple, basis: Basis) -> Triple:
    """Return the y axis for a fallback heading along world x, or along world y if `z` is close to world x."""
    forward, left = basis.local(FORWARD), basis.local(LEFT)
    side = cross(z, select(dot(forward, z) ** 2 > STEEP, left, forward))
    return _unit(side, dot(side, side), left)


def _heading(user_heading: Any) -> Any:
    if not callable(user_heading):
        heading = real_scalar(user_heading, "the heading of a thrust-aligned frame")
        require_finite(heading, "the heading of a thrust-aligned frame")
        return heading
    wrapped: Any = user_heading if isinstance(user_heading, eqx.Module) else jax.tree_util.Partial(user_heading)
    try:
        shape = jax.eval_shape(wrapped, jax.ShapeDtypeStruct((), jnp.result_type(float))).shape
    except (jax.errors.JAXTypeError, AttributeError, TypeError) as error:
        raise ValueError(
            "the heading of a thrust-aligned frame cannot be traced by JAX: write it with jax.numpy, as a function of "
            "one instant [s] that returns one angle [rad]"
        ) from error
    if shape != ():
        raise ValueError(f"the heading of a thrust-aligned frame must be one angle [rad], but its shape is {shape}")
    return wrapped


def _gravity(user_gravity: ArrayInput) -> Vec3:
    size = as_float(user_gravity)
    if size.ndim == 0:
        value = concrete(size)
        if value is not None and not value >= 0:
            raise ValueError(
                f"the gravity of a thrust-aligned frame must be a magnitude ≥ 0 [m/s²], along −z, or a vector (3,) "
                f"[m/s²] in world axes, but {value} was given"
            )
        user_gravity = xp.stack([xp.zeros_like(size), xp.zeros_like(size), -size])
    return real_vector(user_gravity, "the gravity of a thrust-aligned frame", 3)
