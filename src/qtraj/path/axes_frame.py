"""Define a frame by a function that returns its axes; its rates follow by differentiation."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.cosines import TOLERANCE, rotation_defect
from qtraj.foundation.arrays import concrete
from qtraj.foundation.shown import shown
from qtraj.foundation.signature import accepts
from qtraj.foundation.types import Mat3, Scalar, Vec3
from qtraj.path.frame_components import Basis, curvature, torsion, triple
from qtraj.path.trihedral import AbstractFrame, Trihedral

SAMPLE = [[1.0, 2.0, 3.0], [3.0, -1.0, 0.5], [0.2, 1.0, -0.4]]
"""Position, velocity and acceleration with which the function of a frame is checked once."""


class AxesFrame(AbstractFrame):
    """A frame from a function of position, velocity and acceleration that returns its axes.

    With the direction cosines C, the rate ω and the acceleration ε in the axes of the frame follow from Ċ = −[ω]×C and
    its time derivative. The frame is not defined, and its values are NaN, where an axis is not finite, or where the
    axes are not right-handed unit vectors at right angles to within 1e-3.

    Args:
        axes: A function (position, velocity, acceleration), each (3,) in world axes [m, m/s, m/s²], that returns the
            three unit vectors along the body axes x, y and z, as rows of a (3, 3) array or a list. The function is
            written with `jax.numpy`; it may be a callable Module.

    Raises:
        ValueError: If `axes` is not callable, has other arguments or returns no such axes for a sample motion; when it
            is called, if it cannot be traced by JAX.

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
        if not accepts(axes, 3):
            raise ValueError(
                "the function of a frame must have the arguments position, velocity and acceleration, but its "
                f"signature is {inspect.signature(axes)}"
            )
        wrapped: Any = axes if isinstance(axes, eqx.Module) else jax.tree_util.Partial(axes)
        self.axes = wrapped
        _require_rotation(self._dcm(jnp.asarray(SAMPLE)))

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
        defined = rotation_defect(dcm) <= TOLERANCE  # false for NaN
        dcm, rate, acceleration = (jnp.where(defined, x, jnp.nan) for x in (dcm, rate, acceleration))
        speed = jnp.sqrt(jnp.asarray(i.S))
        bend, twist = (jnp.asarray(x, r.dtype) for x in (curvature(i, span), torsion(i, span)))
        return Trihedral(dcm[0], dcm[1], dcm[2], speed.astype(r.dtype), bend, twist, rate, acceleration, defined)

    def _dcm(self, x: Float[Array, "3 3"]) -> Mat3:
        try:
            axes = self.axes(*x)
        except jax.errors.JAXTypeError as error:
            raise ValueError(
                "the function of a frame cannot be traced by JAX: write it with jax.numpy, for one instant"
            ) from error
        axes = jnp.stack([jnp.asarray(row, x.dtype) for row in axes]) if isinstance(axes, list | tuple) else axes
        if jnp.shape(axes) != (3, 3):
            raise ValueError(f"the function of a frame must return three axes, (3, 3), but returned {jnp.shape(axes)}")
        return jnp.asarray(axes).astype(x.dtype)


def _require_rotation(dcm: Mat3) -> None:
    """Raise a ValueError if the axes of a sample are finite, but not right-handed unit vectors at right angles."""
    values: Any = concrete(dcm)
    if values is not None and rotation_defect(values) > TOLERANCE:
        raise ValueError(
            "the axes of a frame must be right-handed unit vectors at right angles, in rows, but for the position, "
            f"velocity and acceleration {SAMPLE} the function returned {np.round(values, 6).tolist()}"
        )


def _vector(m: Mat3) -> Vec3:
    """Return v of the skew-symmetric part of m = −[v]×."""
    return 0.5 * jnp.stack([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])
