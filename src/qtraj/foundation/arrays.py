"""Convert input to float arrays, and check concrete values."""

import warnings
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array

from qtraj.foundation.devices import device_of
from qtraj.foundation.namespace import is_host
from qtraj.foundation.seconds import seconds, since_first
from qtraj.foundation.types import ArrayInput, ScalarLike

COARSE_METRES = 1e-3
"""Resolution [m] of positions in float32 above which a warning is issued."""

MAX_SHOWN = 12
"""Maximum size of an array that an error message shows in full; for a larger array, the first invalid row is shown."""

MIN_BUCKET = 64
"""Minimum number of rows to which arrays are padded."""

_warned: set[str] = set()


def as_float(x: ArrayInput) -> Array:
    """Return a JAX array of floats unchanged, other JAX arrays in JAX's default float, anything else in NumPy, float64.

    **Raises:** ValueError for complex numbers, objects, strings and dates.
    """
    if is_host(x):
        x = np.asarray(x)
        if x.dtype.kind not in "fiub":
            raise ValueError(f"real numbers were expected, but the input has dtype {x.dtype}")
        copy: Any = np.array(x, np.float64)  # because the caller may overwrite its memory
        return copy
    x = jnp.asarray(x)
    if jnp.issubdtype(x.dtype, jnp.floating):
        return x
    if not jnp.issubdtype(x.dtype, jnp.integer) and x.dtype != bool:
        raise ValueError(f"real numbers were expected, but the input has dtype {x.dtype}")
    return x.astype(jnp.result_type(float))


def as_seconds(times: ArrayInput, from_first: bool = False) -> Array:
    """Return times [s] as `as_float` does; durations of NumPy, pandas and Python are converted to seconds.

    With `from_first`, absolute times count from the first of them.

    **Raises:** ValueError for absolute times without `from_first`, and for missing times.
    """
    return as_float(since_first(times) if from_first else seconds(times))


def as_array(x: ArrayInput, dtype: Any) -> Array:
    """Convert `x` to a JAX array of `dtype`; unless `x` is a JAX array, nothing is compiled.

    If JAX's 64-bit mode is not enabled, the array has the 32-bit form of `dtype`.
    """
    if isinstance(x, jax.Array):
        return jnp.asarray(x, dtype)
    # Copy the values, because JAX may keep a reference to the memory, and the caller may overwrite it.
    return jax.device_put(np.array(x, jax.dtypes.canonicalize_dtype(dtype)))


def as_code(x: ArrayInput, *numbers: Any) -> Array:
    """Convert integers, such as result codes, to 32 bits: to a NumPy array if the `numbers` of the result are of NumPy.

    So a result on the host does not start a device of JAX, which takes a tenth of a second.
    """
    host: Any = np.array(x, np.int32) if is_host(x, *numbers) else as_array(x, np.int32)
    return host


def like(values: np.ndarray, x: Any) -> Any:
    """Return the values as an array of the same kind (NumPy or JAX), dtype and device as `x`."""
    if is_host(x):
        return values
    array, device = as_array(values, x.dtype), device_of([x])
    return array if device is None else jax.device_put(array, device)


def is_traced(*trees: Any) -> bool:
    """Return whether any leaf is traced, that is, has an unknown value or is differentiated."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))


def require_concrete(function: str, *trees: Any) -> None:
    """Raise a ValueError if any leaf is traced; `function` is the name of the function that needs the values."""
    if is_traced(*trees):
        raise ValueError(
            f"{function} needs concrete values, but traced values were given: call it outside jit, grad and vmap"
        )


def constants(tree: Any) -> Any:
    """Return `tree` with its traced arrays replaced by constants; under grad outside jit and vmap, these are concrete.

    Unlike the result of `jax.lax.stop_gradient`, a differentiated Python number becomes an array, and nothing is
    compiled for arrays that are not traced.
    """

    def constant(x: Any) -> Any:
        return as_array(jax.lax.stop_gradient(x), x.dtype) if isinstance(x, Tracer) else x

    return jax.tree.map(constant, tree)


def concrete(x: Any) -> np.ndarray | None:
    """Return the value of `x` as a NumPy array, or None if it is traced."""
    return None if isinstance(x, Tracer) else np.asarray(x)


def part(x: Array | np.ndarray, index: Any) -> Array:
    """Return `x[index]`; if `x` and `index` are concrete, NumPy computes it, because JAX is slower for small arrays."""
    if isinstance(x, Tracer) or isinstance(index, Tracer):
        return x[index]
    return like(np.asarray(np.asarray(x)[index]), x)


def bucket(count: int) -> int:
    """Return the padded number of rows for `count` rows: a power of two, so that similar sizes share one executable."""
    return max(MIN_BUCKET, 1 << (count - 1).bit_length())


def real_vector(x: ArrayInput, name: str, size: int) -> Array:
    """Convert `x` to a finite float vector of `size` components.

    **Raises:** ValueError if `x` is not finite or has another shape; the message contains `name`. Traced values are
    not checked for NaN and infinity.
    """
    try:
        vector = as_float(x)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be {size} real numbers, but {x!r} was given") from error
    if vector.shape != (size,):
        raise ValueError(f"{name} must have shape ({size},), but an array of shape {vector.shape} was given")
    require_finite(vector, name)
    return vector


def real_scalar(x: ArrayInput | None, name: str) -> Array:
    """Convert `x` to one float.

    **Raises:** ValueError if `x` is not one number; the message contains `name`.
    """
    try:
        scalar = as_float(x)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be a number, but {x!r} was given") from error
    if scalar.ndim != 0:
        raise ValueError(f"{name} must be one number, but an array of shape {scalar.shape} was given")
    return scalar


def one_instant(t: ScalarLike) -> Array:
    """Convert `t` to a 0-d float array.

    **Raises:** ValueError if `t` is an array of instants.
    """
    t = as_seconds(t)
    if t.ndim != 0:
        raise ValueError(
            f"one instant t was expected, but an array of shape {t.shape} was given: "
            "use jax.vmap over the instants, or qtraj.evaluate"
        )
    return t


def require_finite(x: Array, name: str) -> None:
    """Raise a ValueError if `x` is concrete and contains NaN or infinity."""
    value = concrete(x)
    if value is not None and not np.all(np.isfinite(value)):
        raise ValueError(f"{name} must be finite, but {_first_not_finite(value)}")


def _first_not_finite(value: np.ndarray) -> str:
    """Describe a small array completely, and a larger array by its first row that contains NaN or infinity."""
    if value.ndim == 0 or value.size <= MAX_SHOWN:
        return f"{value.tolist()} was given"
    bad = ~np.isfinite(value).reshape(len(value), -1).all(axis=1)
    row, count = int(bad.argmax()), int(bad.sum())
    shown = value[row].tolist() if value[row].size <= MAX_SHOWN else "not"
    others = f"; it is the first of {count} samples that are not finite" if count > 1 else ""
    return f"sample {row} (samples are numbered from 0 to {len(value) - 1}) is {shown}{others}"


def require_positive(x: Array, name: str, unit: str) -> None:
    """Raise a ValueError if `x` is concrete and not all its elements are positive and finite."""
    value = concrete(x)
    if value is not None and not (np.all(np.isfinite(value)) and np.all(value > 0)):
        raise ValueError(f"{name} must be positive and finite [{unit}], but {value.tolist()} was given")


def require_element(index: Any, count: int, what: str) -> None:
    """Raise an IndexError if `index` is a concrete integer (Python, NumPy or JAX) outside [−count, count − 1].

    `what` names the elements in the message.
    """
    value = concrete(index) if isinstance(index, int | np.integer | np.ndarray | jax.Array) else None
    if value is None or value.ndim > 0 or value.dtype.kind not in "iu":
        return
    if not -count <= int(value) < count:
        raise IndexError(f"index {index} is out of range: there are {count} {what}")


def warn_if_coarse(x: ArrayInput, name: str) -> None:
    """Warn if positions in float32 have a resolution coarser than a millimetre, once for each `name`."""
    if getattr(x, "dtype", None) != np.float32:  # lists and numbers are float64
        return
    value = concrete(x)
    if value is None or value.size == 0:
        return
    resolution = float(np.spacing(np.max(np.abs(value))))
    if resolution > COARSE_METRES and name not in _warned:
        _warned.add(name)
        warnings.warn(
            f"{name} in float32 has a resolution of only {resolution:.2g} m at this distance from the origin. "
            "Call jax.config.update('jax_enable_x64', True) first, or move the origin closer to the path.",
            stacklevel=2,
        )


def require_inside(times: Any, duration: Any, what: str, extrapolates: bool = True) -> None:
    """Raise a ValueError if concrete instants [s] are outside [0, duration] by more than rounding in float32.

    `times` are (n,) or (b, n), and `duration` is () or (b,). A path whose duration is not finite has no times to check.
    `extrapolates`: whether the function that is called has an argument `extrapolate`.
    """
    last = concrete(duration)
    if last is None or isinstance(times, Tracer) or not np.isfinite(last).all():  # the result of a failed search
        return
    low, high = (_extreme(times, least) for least in (True, False))
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise ValueError("times must be finite, but some are NaN or infinite")
    slack = 4 * np.finfo(np.float32).eps * np.abs(last)
    early, late = np.broadcast_arrays(low < -slack, high > last + slack)
    if early.any() or late.any():
        wrong = np.broadcast_to(low, early.shape)[early] if early.any() else np.broadcast_to(high, late.shape)[late]
        raise ValueError(
            f"times must be within the {what}, which lasts from 0 to {float(last.max()):.9g} s, but "
            f"{float(wrong[0]):.9g} s was given: pass {'extrapolate=True to extrapolate, or ' * extrapolates}"
            "track.elapsed for the times of a recording, which has its own clock"
        )


def _extreme(times: Any, least: bool) -> np.ndarray:
    """Return the first or the last instant of each row; an accelerator reduces its own arrays."""
    if isinstance(times, jax.Array) and any(device.platform != "cpu" for device in times.devices()):
        with jax.ensure_compile_time_eval():
            return np.asarray(times.min(axis=-1) if least else times.max(axis=-1))
    values = np.asarray(times)
    return values.min(axis=-1) if least else values.max(axis=-1)
