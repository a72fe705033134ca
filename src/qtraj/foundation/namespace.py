"""Compute formulas in NumPy or JAX, whichever the arguments belong to, and concrete JAX arrays of a CPU in NumPy.

A formula is written once, with the functions of `xp`. Each function of `xp` uses NumPy if all its arguments are numbers
and NumPy arrays, and `jax.numpy` otherwise. NumPy compiles nothing, and is faster for a single problem. The functions
that users call have the decorator `in_numpy`: numbers and NumPy arrays are computed in NumPy, in float64; so are
concrete JAX arrays on a CPU, whose results are JAX arrays again, on the device of the arguments; tracers and arrays on
an accelerator are computed by JAX.
"""

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from qtraj.foundation.argument import described
from qtraj.foundation.devices import device_of
from qtraj.foundation.trailing_axes import require_trailing, trailing_shapes

Function = TypeVar("Function", bound=Callable[..., Any])
Tree = TypeVar("Tree")


class _Types(dict[type, bool]):
    """Whether values of a type belong to NumPy; computed once for each type, because `isinstance` is slow for JAX."""

    def __missing__(self, kind: type) -> bool:
        self[kind] = result = not issubclass(kind, jax.Array | Tracer)
        return result


_in_numpy = _Types()


def is_host(*arguments: Any) -> bool:
    """Return whether no argument is a JAX array, traced or concrete; sequences are searched, other trees are not."""
    for x in arguments:
        kind = type(x)
        if kind is list or kind is tuple:
            if not is_host(*x):
                return False
        elif not _in_numpy[kind]:
            return False
    return True


def namespace(*arguments: Any) -> Any:
    """Return the module `numpy` if no argument is a JAX array, otherwise `jax.numpy`."""
    return np if is_host(*arguments) else jnp


class _Functions:
    """The functions of `numpy` and `jax.numpy` by name, each of which chooses the module from its arguments."""

    def __getattr__(self, name: str) -> Any:
        host, other = getattr(np, name), getattr(jnp, name)
        value = host if isinstance(host, type) or not callable(host) else _chosen(host, other)
        setattr(self, name, value)
        return value


def _chosen(host: Callable[..., Any], other: Callable[..., Any]) -> Callable[..., Any]:
    @functools.wraps(host)
    def function(*args: Any, **kwargs: Any) -> Any:
        return (host if is_host(*args) else other)(*args, **kwargs)

    return function


xp: Any = _Functions()


def stop_gradient(tree: Any) -> Any:
    """Return the same values, treated as constants in differentiation."""
    return jax.tree.map(lambda x: x if is_host(x) else jax.lax.stop_gradient(x), tree)


def matmul(a: Any, b: Any) -> Any:
    """Return the matrix product, in full precision on every device."""
    return a @ b if is_host(a, b) else jnp.matmul(a, b, precision="highest")


def with_component(v: Any, k: int, value: Any) -> Any:
    """Return the vector `v` (n,) with component `k` replaced by `value`."""
    return xp.stack([value if i == k else v[i] for i in range(v.shape[0])])


def repeat(count: int, step: Callable[[Any], Any], start: Any) -> Any:
    """Return the result of `count` applications of `step`, in a Python loop or in one that JAX compiles."""
    if is_host(*jax.tree.leaves(start)):
        for _ in range(count):
            start = step(start)
        return start
    return jax.lax.fori_loop(0, count, lambda _, state: step(state), start)


def scan(step: Callable[[Any, Any], tuple[Any, Any]], start: Any, rows: Any) -> tuple[Any, Any]:
    """Return the last state and the stacked outputs of `step` along the first axis, as `jax.lax.scan` does."""
    if not is_host(*jax.tree.leaves(rows)):
        return jax.lax.scan(step, jax.tree.map(jnp.asarray, start), rows)
    outputs = []
    for k in range(len(jax.tree.leaves(rows)[0])):
        start, output = step(start, jax.tree.map(lambda x: x[k], rows))  # noqa: B023
        outputs.append(output)
    return start, jax.tree.map(lambda *x: np.stack(x), *outputs)


def mapped(function: Function) -> Function:
    """Map a function over the first axis of its arrays, as `jax.vmap` does; in NumPy in a Python loop."""

    @functools.wraps(function)
    def over(*args: Any) -> Any:
        if not is_host(*jax.tree.leaves(args)):
            return jax.vmap(function)(*args)
        count = len(jax.tree.leaves(args)[0])
        results = [function(*jax.tree.map(lambda x: x[k], args)) for k in range(count)]  # noqa: B023
        return jax.tree.map(lambda *x: np.stack(x), *results)

    return over  # type: ignore[return-value]


def needs_jax(leaves: Iterable[Any]) -> bool:
    """Return whether any leaf is a tracer or an array on an accelerator."""
    return any(not _in_numpy[type(x)] and (isinstance(x, Tracer) or not _on_cpu(x)) for x in leaves)


def in_numpy(function: Function, otherwise: Callable[..., Any] | None = None) -> Function:
    """Compute a function in NumPy unless an argument contains a tracer or an array on an accelerator.

    The arguments are trees of arrays. Floats of any precision are computed in float64. If an argument contains JAX
    arrays, the results are JAX arrays, in the widest of their float dtypes. `otherwise` is the function for tracers and
    accelerators, by default the same function.
    """
    other = function if otherwise is None else otherwise

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        leaves, structure = jax.tree.flatten((args, kwargs))
        if needs_jax(leaves):
            device_of(leaves)
            if other is function:  # NumPy arrays cannot be indexed by tracers
                args, kwargs = structure.unflatten(jnp.asarray(x) if type(x) is np.ndarray else x for x in leaves)
            return other(*args, **kwargs)
        inputs = [x for x in leaves if not _in_numpy[type(x)]]
        with np.errstate(all="ignore"):  # as in JAX, invalid operations result in NaN and infinity
            if not inputs:
                return function(*args, **kwargs)
            device = device_of(inputs)
            args, kwargs = structure.unflatten(map(on_host, leaves))
            return to_jax(function(*args, **kwargs), float_dtype(x.dtype for x in inputs), device)

    return call  # type: ignore[return-value]


def in_numpy_or_jit(function: Function) -> Function:
    """Compute a function in NumPy as `in_numpy` does; for tracers and on accelerators, compile it as a whole."""
    return in_numpy(function, eqx.filter_jit(function))


def of_arrays(function: Function) -> Function:
    """Compute a function of arrays as `in_numpy` does; lists and arrays of integers become floats.

    The last axes of arrays that are annotated as a quaternion, a vector or a matrix are checked.
    """
    shapes = trailing_shapes(function)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if all(type(x) is np.ndarray and x.dtype == np.float64 for x in args) and not kwargs:
            require_trailing(function, shapes, args)
            with np.errstate(all="ignore"):
                return function(*args)
        names, values = tuple(kwargs), [as_floats(x) for x in (*args, *kwargs.values())]
        require_trailing(function, shapes, values[: len(args)], dict(zip(names, values[len(args) :], strict=True)))
        if needs_jax(values):
            device_of(values)
            values = [jnp.asarray(x) if type(x) is np.ndarray else x for x in values]
            return function(*values[: len(args)], **dict(zip(names, values[len(args) :], strict=True)))
        inputs = [x for x in values if not _in_numpy[type(x)]]
        hosts = [on_host(x) for x in values]
        with np.errstate(all="ignore"):
            result = function(*hosts[: len(args)], **dict(zip(names, hosts[len(args) :], strict=True)))
        return to_jax(result, float_dtype(x.dtype for x in inputs), device_of(inputs)) if inputs else result

    return call  # type: ignore[return-value]


def on_host(x: Any) -> Any:
    """Return a concrete JAX or NumPy array as a NumPy array, floats in float64; any other value is unchanged."""
    if _in_numpy[type(x)] and type(x) is not np.ndarray:
        return x
    if jnp.issubdtype(x.dtype, jax.dtypes.extended):  # keys of random numbers
        return x
    array = np.asarray(x)
    return array.astype(np.float64) if jnp.issubdtype(array.dtype, jnp.floating) else array


def in_float64(tree: Tree) -> Tree:
    """Return a tree with its concrete float32 arrays as NumPy arrays in float64; tracers are unchanged.

    What searches and proofs compute is then not limited by JAX's 64-bit mode, and the numbers do not change.
    """

    def converted(x: Any) -> Any:
        kind = getattr(x, "dtype", np.dtype(float))
        narrow = kind != np.float64 and jnp.issubdtype(kind, jnp.floating) and not isinstance(x, Tracer)
        return np.asarray(x, np.float64) if narrow else x

    return jax.tree.map(converted, tree)


def to_jax(tree: Any, dtype: Any, device: Any = None) -> Any:
    """Return a tree with its NumPy arrays and numbers as JAX arrays on `device`, floats in `dtype`."""

    def converted(x: Any) -> Any:
        if not isinstance(x, np.ndarray | np.generic | float):
            return x
        x = np.asarray(x)
        kind = dtype if x.dtype.kind == "f" else jax.dtypes.canonicalize_dtype(x.dtype)
        return jax.device_put(np.array(x, kind), device)

    return jax.tree.map(converted, tree)


def float_dtype(dtypes: Iterable[Any]) -> Any:
    """Return the widest float dtype of `dtypes`, or JAX's default float if there is none."""
    floats = [x for x in dtypes if jnp.issubdtype(x, jnp.floating)]
    return max(floats, key=lambda x: x.itemsize) if floats else jnp.result_type(float)


def _on_cpu(x: jax.Array) -> bool:
    return all(device.platform == "cpu" for device in x.devices())


def as_floats(x: Any) -> Any:
    """Convert lists and arrays of integers to floats; any other value is unchanged."""
    kind = type(x)
    if kind in (list, tuple) or (kind is np.ndarray and x.dtype.kind in "iub"):
        try:
            return np.asarray(x, np.float64) if is_host(x) else jnp.asarray(x, jnp.result_type(float))
        except (TypeError, ValueError) as error:
            raise ValueError(f"numbers in rows of equal length were expected, but {described(x)} was given") from error
    if not _in_numpy[kind] and x.dtype.kind in "iub":
        return x.astype(jnp.result_type(float))
    return x
