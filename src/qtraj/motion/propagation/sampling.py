"""Evaluate a user's rate ω(t) at many instants, outside a trace.

A function that computes with NumPy is called with NumPy instants: with all of them at once if it accepts arrays,
otherwise one at a time. A function that computes with JAX is compiled, because single operations of JAX are slow; only
this function is compiled.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_array, constants, is_traced
from qtraj.foundation.namespace import is_host

CHUNKS = (512, 16384)
"""Numbers of instants for which a JAX function is compiled; the larger one is used from `MANY` instants."""
MANY = 4096
ROUND_OFF = 16
"""Values for an array of instants and for single instants may differ by this multiple of round-off."""


class Sampler:
    """A rate as a function from NumPy instants (m,) [s] to NumPy rates (m, k) [rad/s], where k is 3 or 4.

    `dtype` is the dtype of the instants for functions that compute with JAX. `differentiated`: the values are known,
    but the function uses numbers that are differentiated.
    """

    def __init__(self, omega: Callable[..., Any], dtype: Any):
        self.omega, self.dtype = omega, dtype
        self.uses_jax = _uses_jax(omega)
        self.accepts_arrays = True
        self.differentiated = False

    def __call__(self, times: Any) -> Any:
        """Return the rates, or None if they are traced.

        **Raises:** ValueError for a rate of another shape.
        """
        if self.uses_jax:
            return self._in_chunks(times)
        rates = self._at_once(times) if self.accepts_arrays and len(times) > 4 else None
        self.accepts_arrays = rates is not None
        return _one_by_one(self.omega, times) if rates is None else rates

    def _at_once(self, times: Any) -> Any:
        """Return the rates from one call, or None if the function does not accept an array of instants.

        Three of the values are compared with values of single calls.
        """
        try:
            with np.errstate(all="ignore"):
                values = np.asarray(self.omega(times), float)
        except Exception:  # any error of a user's function, which expects one instant
            return None
        if values.ndim != 2 or len(times) not in values.shape:
            return None
        values = values if values.shape[0] == len(times) else values.T
        rows = [0, len(times) // 2, len(times) - 1]
        singles = _one_by_one(self.omega, times[rows])
        if values.shape[1:] != singles.shape[1:]:
            return None
        scale = ROUND_OFF * np.finfo(float).eps * np.max(np.abs(singles), initial=0.0)
        same = np.allclose(values[rows], singles, rtol=0, atol=scale, equal_nan=True)
        return values if same else None

    def _in_chunks(self, times: Any) -> Any:
        size = CHUNKS[len(times) >= MANY]
        chunks = []
        for k in range(0, len(times), size):
            part = times[k : k + size]
            chunk = np.pad(part, (0, size - len(part)), mode="edge")
            rates = vectorized(self.omega, as_array(chunk, self.dtype))
            self.differentiated |= is_traced(rates)
            values = constants(rates)
            if is_traced(values):
                return None
            chunks.append(np.asarray(values, float)[: len(part)])
        return np.concatenate(chunks)


def require_rate(shape: tuple[int, ...]) -> None:
    """Raise a ValueError unless `shape` is the shape of a rate."""
    if shape not in ((3,), (4,)):
        raise ValueError(
            f"omega(t) must have shape (3,), or (4,) with the scalar part first, but has shape {tuple(shape)}"
        )


def _uses_jax(omega: Callable[..., Any]) -> bool:
    """Return whether the value of a function is computed by JAX, even for an instant that is a NumPy number.

    The function is called once, in a trace, where operations of JAX are not executed.
    """
    result = []

    def call() -> None:
        result.append(jax.tree.leaves(omega(np.float64(0.0))))

    try:
        with np.errstate(all="ignore"):
            jax.eval_shape(call)
    except jax.errors.JAXTypeError:  # the function needs the values of JAX arrays
        return False
    except Exception:  # the function does not accept NumPy numbers
        return True
    return not is_host(*result[0])


def _one_by_one(omega: Callable[..., Any], times: Any) -> Any:
    with np.errstate(all="ignore"):
        values = [np.asarray(omega(t)) for t in times]
    require_rate(values[0].shape)
    _require_real(values[0].dtype)
    return np.stack(values).astype(float)


def _require_real(dtype: Any) -> None:
    if not (jnp.issubdtype(dtype, jnp.floating) or np.dtype(dtype).kind in "iub"):
        raise ValueError(f"omega(t) must return real numbers [rad/s], but it returns an array of dtype {dtype}")


@eqx.filter_jit
def vectorized(omega: Callable[..., Any], times: Float[Array, " m"]) -> Float[Array, "m k"]:
    """Return the rates (m, k) at `times` (m,) by JAX.

    **Raises:** ValueError for a rate of another shape, complex rates, and a function that JAX cannot trace.
    """
    try:
        rates = jax.vmap(lambda t: jnp.asarray(omega(t)))(times)
    except jax.errors.JAXTypeError as error:
        raise ValueError(
            "omega cannot be traced by JAX, because it uses numpy or math: write it with jax.numpy. A NumPy function "
            "needs times and parameters that are neither traced (jit, vmap) nor differentiated."
        ) from error
    require_rate(rates.shape[1:])
    _require_real(rates.dtype)
    return rates.astype(times.dtype)
