"""Define curves: paths that are given as a function of time."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.arrays import one_instant, real_scalar, require_positive
from qtraj.foundation.seconds import seconds
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path.hodograph import AbstractHodograph, require_order


class Curve(AbstractHodograph):
    """A path defined by any differentiable function t -> (3,), with derivatives by nested forward differentiation.

    `position` may be a plain function, also one that returns a list of three numbers, or a callable Module; derivatives
    with respect to arrays of the Module are supported.

    **Raises:** ValueError if JAX cannot trace `position`, if its result is not (3,) or complex, or if `duration` [s] is
    not positive.
    """

    function: Callable[..., Vec3]
    duration: Scalar

    def __init__(self, position: Any, duration: ArrayInput):
        if not callable(position):
            raise ValueError(f"a Curve needs a function t -> (3,), but {position!r} is not callable")
        wrapped: Any = position if isinstance(position, eqx.Module) else jax.tree_util.Partial(position)
        self.function = wrapped
        self.duration = real_scalar(seconds(duration), "the duration of a curve")
        require_positive(self.duration, "the duration of a curve", "s")
        _require_vector(self.function, self.duration)

    def __repr__(self) -> str:
        return shown(self, duration="s")

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return r and its time derivatives up to `order` at one instant; row k in [m s^-k]."""
        require_order(order)
        jet: Jet = lambda t: (_vector(self.function(t), t.dtype),)  # noqa: E731
        for _ in range(order):
            jet = _with_next_derivative(jet)
        return jnp.stack(jet(one_instant(t)))


Jet = Callable[[Scalar], tuple[Vec3, ...]]
"""A function of time that returns a vector and its time derivatives, in ascending order from the first."""


def _with_next_derivative(jet: Jet) -> Jet:
    """Return a jet with one more derivative than `jet`."""

    def extended(t: Scalar) -> tuple[Vec3, ...]:
        values, rates = jax.jvp(jet, (t,), (jnp.ones_like(t),))
        return (*values, rates[-1])

    return extended


def _vector(value: Any, dtype: Any) -> Array:
    """Return the result of a user's function as an array of `dtype` or a wider float; it may be a list of numbers.

    **Raises:** ValueError for complex numbers.
    """
    array = jnp.stack([jnp.asarray(x) for x in value]) if isinstance(value, list | tuple) else jnp.asarray(value)
    if not (jnp.issubdtype(array.dtype, jnp.floating) or array.dtype.kind in "iub"):
        raise ValueError(
            f"the function of a curve must return real numbers [m], but it returns an array of dtype {array.dtype}"
        )
    return array if jnp.issubdtype(array.dtype, jnp.floating) else array.astype(dtype)


def _require_vector(function: Callable[[Scalar], Vec3], duration: Scalar) -> None:
    """Raise a ValueError if `function` is not a JAX function of one instant that returns three components."""
    advice = "write it with jax.numpy, as a function of one instant that returns an array of shape (3,)"
    try:
        given = jax.ShapeDtypeStruct((), duration.dtype)
        shape = jax.eval_shape(lambda t: _vector(function(t), t.dtype), given).shape
    except (jax.errors.JAXTypeError, AttributeError, TypeError) as error:
        raise ValueError(f"the function of a curve cannot be traced by JAX: {advice}") from error
    if shape != (3,):
        raise ValueError(f"the function of a curve returns an array of shape {shape}: {advice}")
