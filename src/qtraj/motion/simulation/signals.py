"""Define signals: disturbances and torques as constants, functions of time, or functions of time and state."""

import inspect
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float
from typing_extensions import TypeAliasType

from qtraj.algebra.quaternion import unit
from qtraj.foundation.arrays import as_float, real_vector
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3

Signal = Callable[..., Vec3] | Vec3
"""A constant vector, or a vector as a function of the time [s] or of time, attitude and rate."""

SignalInput = TypeAliasType("SignalInput", Callable[..., Any] | ArrayInput)

OF_TIME = "a function t [s] → (3,)"
OF_STATE = f"{OF_TIME} or (t, quaternion (4,), rate (3,)) → (3,)"


def checked_signal(signal: SignalInput, name: str, of_state: bool = False) -> Any:
    """Return a function as a pytree, or a constant vector (3,); raise a ValueError for other values.

    `of_state`: whether a function may have the arguments time, attitude and rate instead of the time alone.
    """
    if not callable(signal):
        return real_vector(signal, name, 3)
    if not (_accepts(signal, 1) or (of_state and _accepts(signal, 3))):
        raise ValueError(
            f"{name} must be {OF_STATE if of_state else OF_TIME}, but its signature is {inspect.signature(signal)}"
        )
    return signal if isinstance(signal, eqx.Module | jax.tree_util.Partial) else jax.tree_util.Partial(signal)


def _accepts(function: Callable[..., Any], count: int) -> bool:
    """Return whether a function can be called with `count` arguments."""
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return count == 1  # functions written in C may have no signature; if the argument is wrong, the call fails
    try:
        signature.bind(*range(count))
    except TypeError:
        return False
    return True


def at_instant(signal: Signal, t: Scalar) -> Vec3:
    """Return the vector (3,) of a signal that does not depend on the state, at the time `t` [s]."""
    return _vector(signal(t)) if callable(signal) else signal


def at_state(signal: Signal, t: Scalar, quaternion: Quat | None, rate: Float[Array, " k"] | None) -> Vec3:
    """Return the vector (3,) at the time `t` [s] and a state: the attitude λ (4,) and the rate, (3,) or (4,) [rad/s].

    A function of the state receives the unit quaternion λ/|λ| and the physical rate (3,) in body axes.
    """
    if not callable(signal) or _accepts(signal, 1):
        return at_instant(signal, t)
    if quaternion is None or rate is None:
        raise ValueError("this signal depends on the state, so it needs a quaternion (4,) and a rate (3,) [rad/s] too")
    return _vector(signal(t, unit(quaternion), rate[-3:]))


def _vector(value: Any) -> Vec3:
    vector = as_float(jnp.asarray(value) if isinstance(value, list | tuple) else value)
    if vector.shape != (3,):
        raise ValueError(f"a disturbance must return a vector (3,) at each time, but returned shape {vector.shape}")
    return vector
