"""Define a frame by a function that returns its axes; its rates follow by differentiation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.shown import shown
from qtraj.foundation.types import Mat3, Scalar, Vec3
from qtraj.path.frame_components import Basis, curvature, torsion, triple
from qtraj.path.trihedral import AbstractFrame, Trihedral


class AxesFrame(AbstractFrame):
    """A frame from a function of position, velocity and acceleration that returns its axes.

    With the direction cosines C, the rate ω and the acceleration ε in the axes of the frame follow from Ċ = −[ω]×C and
    its time derivative. The frame is not defined where an axis is not finite.

    Args:
        axes: A function (position, velocity, acceleration), each (3,) in world axes [m, m/s, m/s²], that returns the
            three unit vectors along the body axes x, y and z, as rows of a (3, 3) array or a list. The axes must be
            right-handed and orthogonal. The function is written with `jax.numpy`; it may be a callable Module.

    Raises:
        ValueError: If `axes` is not callable, or returns another shape.

    Example:
        >>> import qtraj as qt
        >>> east_north_up = AxesFrame(lambda position, velocity, acceleration: jnp.eye(3))
        >>> path = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)
        >>> qt.trihedral(path, 1.0, east_north_up).quaternion()
        Array([1., 0., 0., 0.], dtype=float64)
    """

    axes: Callable[..., Any]

    def __init__(self, axes: Callable[..., Any]):
        if not callable(axes):
            raise ValueError(f"a frame needs a function of position, velocity and acceleration, but {axes!r} was given")
        wrapped: Any = axes if isinstance(axes, eqx.Module) else jax.tree_util.Partial(axes)
        self.axes = wrapped

    def __repr__(self) -> str:
        return shown(self)

    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral from the position and its first four time derivatives, in world axes."""
        r = jnp.asarray(r)

        def change(x: Array, velocity: Array) -> tuple[Mat3, Mat3]:
            return jax.jvp(self._dcm, (x,), (velocity,))

        (dcm, first), (_, second) = jax.jvp(change, (r[:3], r[1:4]), (r[1:4], r[2:5]))
        rate = _vector(jnp.matmul(first, dcm.T, precision="highest"))
        acceleration = _vector(jnp.matmul(second, dcm.T, precision="highest"))
        i = Basis().invariants([triple(row) for row in r])
        defined = jnp.all(jnp.isfinite(dcm))
        speed = jnp.sqrt(jnp.asarray(i.S))
        bend, twist = (jnp.asarray(x, r.dtype) for x in (curvature(i, span), torsion(i, span)))
        return Trihedral(dcm[0], dcm[1], dcm[2], speed.astype(r.dtype), bend, twist, rate, acceleration, defined)

    def _dcm(self, x: Float[Array, "3 3"]) -> Mat3:
        axes = self.axes(*x)
        axes = jnp.stack([jnp.asarray(row, x.dtype) for row in axes]) if isinstance(axes, list | tuple) else axes
        if jnp.shape(axes) != (3, 3):
            raise ValueError(f"the function of a frame must return three axes, (3, 3), but returned {jnp.shape(axes)}")
        return jnp.asarray(axes).astype(x.dtype)


def _vector(m: Mat3) -> Vec3:
    """Return v of the skew-symmetric part of m = −[v]×."""
    return 0.5 * jnp.stack([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])
