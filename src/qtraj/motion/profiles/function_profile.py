"""Define a motion profile by a function of time.

The function is replaced by polynomials of degree 9 in cells of equal length, which have its values and its first four
derivatives at both ends of each cell (Hermite interpolation). So peaks, torques and figures of slews, which need
polynomials, support it. With 16 cells, the interpolation error of a function that is smooth on the scale of its
duration is below round-off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import concrete, real_scalar, require_positive
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.namespace import xp
from qtraj.foundation.seconds import seconds
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.motion.profiles.profile import AbstractProfile, Profile

SMOOTH = 4
"""Order of the derivatives that are continuous between cells."""
CELLS = 16
REST = 1e-9
"""A function is at rest at an end if its rate there is below this fraction of its mean rate."""

_HIGH = [[math.perm(SMOOTH + 1 + i, j) for i in range(SMOOTH + 1)] for j in range(SMOOTH + 1)]
_INVERSE = np.linalg.inv(np.array(_HIGH, float))
"""The coefficients of u⁵, …, u⁹ from the derivatives at u = 1 that the lower powers lack."""


def _fields(profile: FunctionProfile) -> dict[str, Any]:
    return {"function": profile.function, "duration": profile.duration, "cells": profile.pieces.shape[0]}


def _build(function: Any, duration: Any, cells: int = CELLS) -> FunctionProfile:
    return FunctionProfile(function, duration, cells)


@stored_as(_fields, _build)
@storable
class FunctionProfile(AbstractProfile):
    """A profile from a function of time: Φ(t) = angle·(f(t) − f(0))/(f(T) − f(0)), 0 ≤ t ≤ T.

    Only the form of f counts, so its values may be angles, or fractions from 0 to 1. Rate, acceleration and jerk follow
    by differentiation; f must be smooth (four derivatives) on the scale of its cells.

    Args:
        function: A function f of the time t [s], written with `jax.numpy`, or a callable Module, with respect to whose
            arrays slews can be differentiated.
        duration: The duration T [s] of every slew.
        cells: The number of polynomial pieces, by default 16; increase it for functions that oscillate.

    Raises:
        ValueError: If JAX cannot trace the function, its value is not a scalar or not finite, its values at both ends
            are equal, or the duration is not positive.

    Example:
        >>> profile = FunctionProfile(lambda t: t - jnp.sin(t), 2 * jnp.pi).profile(1.0)
        >>> profile.angle(jnp.pi).round(12)
        Array(0.5, dtype=float64)
    """

    function: Callable[..., Any]
    duration: Scalar | None
    pieces: Float[Array, "n m"]
    end_rate: Scalar
    at_rest: bool = eqx.field(static=True)
    name: ClassVar[str] = "function"
    supports_numpy: ClassVar[bool] = True

    def __init__(self, function: Callable[..., Any], duration: ArrayInput, cells: int = CELLS):
        if not callable(function):
            raise ValueError(f"a profile needs a function of time, but {function!r} is not callable")
        wrapped: Any = function if isinstance(function, eqx.Module) else jax.tree_util.Partial(function)
        self.function = wrapped
        span = real_scalar(seconds(duration), "the duration of a profile")
        require_positive(span, "the duration of a profile", "s")
        self.duration = span
        if not isinstance(cells, int) or cells < 1:
            raise ValueError(f"cells must be a positive integer, but {cells!r} was given")
        rows = _derivatives(wrapped, span, cells)
        rise = rows[-1, 0] - rows[0, 0]
        values = concrete(rows)
        if values is not None and not (np.isfinite(values).all() and values[-1, 0] != values[0, 0]):
            raise ValueError(
                "the function of a profile must be finite, with four derivatives, and have different values at 0 and "
                f"at the duration, but f(0) = {values[0, 0]:.6g} and f(duration) = {values[-1, 0]:.6g}"
            )
        self.pieces = _pieces(rows.at[:, 0].add(-rows[0, 0]) / rise)
        self.end_rate = rows[-1, 1] / rise * cells / span
        ends = None if values is None else np.abs(values[[0, -1], 1] * cells / (values[-1, 0] - values[0, 0]))
        self.at_rest = ends is not None and bool((ends < REST).all())

    def __repr__(self) -> str:
        return shown(self, duration="s")

    def _fixed(self) -> Any:
        return self.duration

    def timed(self, total: Scalar) -> tuple[Profile, Scalar]:
        """Return the profile of a slew of `total` [rad], and its duration [s], which is always the same."""
        count = self.pieces.shape[0]
        duration = xp.asarray(self._fixed()).astype(total.dtype)
        width = duration / count
        pieces = xp.asarray(self.pieces).astype(total.dtype)
        profile = Profile(
            total,
            duration,
            starts=width * np.arange(count).astype(total.dtype),
            widths=width * np.ones(count, total.dtype),
            pieces=pieces if self.at_rest else total * pieces,
            end_rate=total * (0.0 if self.at_rest else xp.asarray(self.end_rate).astype(total.dtype)),
            feasible=xp.asarray(True),
            proportional=self.at_rest,
        )
        return profile, duration


def _derivatives(function: Callable[..., Any], duration: Scalar, cells: int) -> Float[Array, "n+1 5"]:
    """Return f and its first four derivatives at the ends of the cells, in the variable u of a cell."""
    width = jnp.asarray(duration) / cells

    def jet(order: int) -> Callable[[Scalar], tuple[Array, ...]]:
        if order == 0:
            return lambda x: (_scalar(function(x * width)),)

        def extended(x: Scalar) -> tuple[Array, ...]:
            values, rates = jax.jvp(jet(order - 1), (x,), (jnp.ones_like(x),))
            return (*values, rates[-1])

        return extended

    try:
        return jax.vmap(lambda x: jnp.stack(jet(SMOOTH)(x)))(jnp.arange(cells + 1).astype(width.dtype))
    except (jax.errors.JAXTypeError, AttributeError, TypeError) as error:
        raise ValueError(
            "the function of a profile cannot be traced by JAX: write it with jax.numpy, as a function of one instant "
            "that returns a scalar"
        ) from error


def _scalar(value: Any) -> Array:
    array = jnp.asarray(value)
    if array.shape != ():
        raise ValueError(f"the function of a profile must return a scalar, but returned shape {array.shape}")
    return array.astype(jnp.result_type(float)) if array.dtype.kind != "f" else array


def _pieces(rows: Float[Array, "n+1 5"]) -> Float[Array, "n 10"]:
    """Return the ascending coefficients in u of each cell."""
    low = rows[:-1] / np.array([[float(math.factorial(k)) for k in range(SMOOTH + 1)]], rows.dtype)
    powers = np.array([[math.perm(k, j) for k in range(SMOOTH + 1)] for j in range(SMOOTH + 1)], rows.dtype)
    high = jnp.matmul(rows[1:] - jnp.matmul(low, powers.T, precision="highest"), _INVERSE.T.astype(rows.dtype))
    return jnp.concatenate([low, high], axis=1)
