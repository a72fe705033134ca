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
from qtraj.algebra.vector import unit
from qtraj.foundation.arrays import as_float, concrete, real_scalar, real_vector, require_finite
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Flag, Scalar, Vec3
from qtraj.path.frame_axes import THRUST_ALIGNED
from qtraj.path.frame_components import STEEP
from qtraj.path.frenet import Invariants
from qtraj.path.regularity import has_tangent, is_significant
from qtraj.path.trihedral import AbstractFrame, Trihedral, axis, with_axes

STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²]."""

Three = tuple[Vec3, Vec3, Vec3]
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

    def trihedral(self, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """Return the trihedral at t = 0; the time is relevant only if the heading is a function of time."""
        return self.at(jnp.zeros_like(duration), r, duration)

    def at(self, t: Scalar, r: Float[Array, "5 3"], duration: Scalar) -> Trihedral:
        """Return the trihedral at the time `t` [s] from r and its first four time derivatives, in world axes."""
        i, duration = Invariants(r), duration.astype(r.dtype)
        gravity = self.gravity.astype(r.dtype)
        f = (r[2] - gravity, r[3], r[4])
        exists = has_tangent(i, duration) if self.heading is None else jnp.asarray(True)
        c = (r[1], r[2], r[3]) if self.heading is None else self._level(t.astype(r.dtype))
        w = _cross(f, c)
        F, C, W = f[0] @ f[0], c[0] @ c[0], w[0] @ w[0]
        exists &= is_significant(F, r[2] @ r[2] + gravity @ gravity + duration**2 * (r[3] @ r[3])) & is_significant(
            W, F * C
        )
        z = unit(f[0], axis(r[2], 2))
        side = w[0] - z * (z @ w[0])  # orthogonal to the thrust to within round-off, even if w has lost most digits
        y = unit(jnp.where(exists, side, 0.0), _fallback_y(z))
        x = jnp.cross(y, z)
        rate, acceleration = _rates((x, y, z), f, w, inverse_root(F, exists), inverse_root(W, exists))
        return with_axes(i, duration, x, y, rate, acceleration, exists)

    def _level(self, t: Scalar) -> Three:
        """Return the direction of the heading and its first two time derivatives."""
        if not callable(self.heading):
            psi = self.heading.astype(t.dtype)
            still = jnp.zeros((3,), t.dtype)
            return _direction(psi), still, still
        psi = lambda t: jnp.asarray(self.heading(t)).astype(t.dtype)  # noqa: E731
        along = lambda t: _direction(psi(t))  # noqa: E731
        once = lambda t: jax.jvp(along, (t,), (jnp.ones_like(t),))  # noqa: E731
        (c, c1), (_, c2) = jax.jvp(once, (t,), (jnp.ones_like(t),))
        return c, c1, c2


def _rates(axes: Three, f: Three, w: Three, inv_f: Scalar, inv_w: Scalar) -> tuple[Vec3, Vec3]:
    """Return the angular rate ω [rad/s] and acceleration ε [rad/s²] of the frame in its own axes x, y and z.

    `f` is the acceleration minus gravity, and `w` is f × c with the forward reference c, each with two derivatives. The
    axes are z = f/|f|, y = w/|w| and x = y × z; `inv_f` is 1/|f|, and `inv_w` is 1/|w|.

    ω = (−f'·y/|f|, f'·x/|f|, −w'·x/|w|), and ε is the derivative of ω. (Mellinger and Kumar, eqs 7 and 8, denote the
    first two components by h_ω.)
    """
    x, y, z = axes
    log_f_rate, log_w_rate = (f[1] @ z) * inv_f, (w[1] @ y) * inv_w  # logarithmic derivatives of |f| and |w|
    p, q, s = -(f[1] @ y) * inv_f, (f[1] @ x) * inv_f, -(w[1] @ x) * inv_w
    return jnp.stack([p, q, s]), jnp.stack(
        [
            -(f[2] @ y) * inv_f - 2 * p * log_f_rate + q * s,
            (f[2] @ x) * inv_f - 2 * q * log_f_rate - p * s,
            -(w[2] @ x) * inv_w - 2 * s * log_w_rate + q * (w[1] @ z) * inv_w,
        ]
    )


def _cross(a: Three, b: Three) -> Three:
    """Return a × b and its first two time derivatives."""
    first = jnp.cross(a[1], b[0]) + jnp.cross(a[0], b[1])
    second = jnp.cross(a[2], b[0]) + 2 * jnp.cross(a[1], b[1]) + jnp.cross(a[0], b[2])
    return jnp.cross(a[0], b[0]), first, second


def _direction(psi: Scalar) -> Vec3:
    return jnp.stack([jnp.cos(psi), jnp.sin(psi), jnp.zeros_like(psi)])


def _fallback_y(z: Vec3) -> Vec3:
    """Return the y axis for a fallback heading along world x, or along world y if `z` is close to world x."""
    steep: Flag = z[0] ** 2 > STEEP
    side = jnp.cross(z, jnp.where(steep, axis(z, 1), axis(z, 0)))
    return unit(side, axis(z, 1))


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
        user_gravity = jnp.zeros_like(size, shape=3).at[2].set(-size)
    return real_vector(user_gravity, "the gravity of a thrust-aligned frame", 3)
