"""Apply a function to each element of a batch in blocks of fixed size, sorted by their cost."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.foundation import cores
from qtraj.foundation.argument import described, is_whole
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.devices import default_platform, device_of
from qtraj.foundation.types import ArrayInput

SMALLEST = 8
"""Smallest block. A batch that is smaller than a block is one block, whose size is a power of two."""

ON_CPU, ON_DEVICE = 64, 1024
"""Default sizes of a block. On a CPU, the arrays of a block fit into its cache."""


def in_blocks(
    function: Callable[..., Any], *arguments: Any, block: int | None = None, cost: ArrayInput | None = None
) -> Any:
    """Apply `function` to each element of a batch, compiled, in blocks of equal size.

    `jax.vmap` of an adaptive solve, as in `simulate`, `integrate` and `propagate`, takes as many steps for every
    element as for the slowest one, and is compiled again for each number of elements. In blocks, an element waits only
    for the elements of its own block, and batches of all sizes share a few compiled functions. On a CPU, the blocks are
    distributed over the cores.

    Args:
        function: A function of one element, which JAX can compile. Define it once, not in each call, because it is
            compiled again for each new function.
        arguments: The arguments of the function. Each array in them, including arrays of random keys, has the elements
            of the batch on its first axis. All else, such as lists and numbers, is the same for each element.
        block: The number of elements that are computed at once; by default 64 on a CPU, 1024 on an accelerator. A
            smaller batch is one block, whose size is a power of two.
        cost: For each element, a number (n,) that is larger for slower elements, such as the initial rate or the gain.
            Elements of similar cost are computed in the same block. By default the blocks have the order of the batch.

    Returns:
        What `function` returns, with the elements on the first axis of each array, in the order of the arguments.
        Inside `jit`, `grad` and `vmap`, the whole batch is one block, also if only `function` contains traced values.

    Raises:
        ValueError: For arrays of different first axes, an empty batch, no array, a `cost` of another shape or with NaN,
            or a `block` that is not a positive integer.

    Example:
        >>> import jax.numpy as jnp
        >>> in_blocks(lambda x: x**2, jnp.arange(3.0)).tolist()
        [0.0, 1.0, 4.0]
    """
    arrays, rest = eqx.partition(arguments, eqx.is_array)
    leaves = jax.tree.leaves(arrays)
    count = _count(leaves)
    if block is not None and not (is_whole(block) and block > 0):
        raise ValueError(f"block must be a positive integer, but {block!r} was given")
    order = np.arange(count) if cost is None or is_traced(cost) else _sorted(cost, count)
    if not is_traced(function, leaves, cost):
        # If the function contains traced values, so do the results, which cannot be copied to the host.
        with suppress(jax.errors.TracerArrayConversionError):
            return _divided(function, arrays, rest, order, block)
    return _mapped(function, arrays, rest)


def _divided(function: Callable[..., Any], arrays: Any, rest: Any, order: np.ndarray, block: int | None) -> Any:
    """Return the results of concrete arrays, computed in blocks of the elements in the given order."""
    count = order.size
    device = device_of(jax.tree.leaves((function, arrays)))
    platform = default_platform() if device is None else device.platform
    largest = block or (ON_CPU if platform == "cpu" else ON_DEVICE)
    size = min(largest, max(SMALLEST, 1 << (count - 1).bit_length()))
    on_host = jax.tree.map(np.asarray, _with_data(arrays))
    calls = [(function, cores.take(on_host, part, size), rest) for part in cores.split(order, size)]
    found = list(cores.map_blocks(_mapped_data, calls, device))
    back = np.argsort(order, kind="stable")
    whole = lambda *parts: np.concatenate(parts)[:count][back]  # noqa: E731
    return _with_keys(jax.device_put(jax.tree.map(whole, *found), device))


@eqx.filter_jit
def _mapped(function: Callable[..., Any], arrays: Any, rest: Any) -> Any:
    return jax.vmap(lambda x: function(*eqx.combine(x, rest)))(arrays)


@eqx.filter_jit
def _mapped_data(function: Callable[..., Any], arrays: Any, rest: Any) -> Any:
    return _with_data(_mapped(function, _with_keys(arrays), rest))


class _KeyData(eqx.Module):
    """The integers of an array of random keys, because NumPy has no keys."""

    data: Array
    kind: Any = eqx.field(static=True)


def _with_data(tree: Any) -> Any:
    """Replace arrays of random keys by their integers."""

    def data(x: Any) -> Any:
        is_key = eqx.is_array(x) and jnp.issubdtype(x.dtype, jax.dtypes.prng_key)
        return _KeyData(jax.random.key_data(x), jax.random.key_impl(x)) if is_key else x

    return jax.tree.map(data, tree)


def _with_keys(tree: Any) -> Any:
    """Replace the integers of random keys by arrays of keys."""
    is_data = lambda x: isinstance(x, _KeyData)  # noqa: E731
    keys = lambda x: jax.random.wrap_key_data(x.data, impl=x.kind) if is_data(x) else x  # noqa: E731
    return jax.tree.map(keys, tree, is_leaf=is_data)


def _count(leaves: list[Any]) -> int:
    """Return the number of elements."""
    if not leaves:
        raise ValueError(
            "in_blocks needs arrays with the elements of the batch on their first axis, but no argument is an array; "
            "lists and numbers are not divided: pass jnp.asarray(...)"
        )
    sizes = {x.shape[:1] for x in leaves}
    if len(sizes) != 1 or not min(sizes) or not min(sizes)[0]:
        found = ", ".join(str(x.shape) for x in leaves)
        raise ValueError(
            "in_blocks needs arrays with the elements of the batch on their first axis, at least one element and the "
            f"same number in each array, but the shapes are {found}"
        )
    return min(sizes)[0]


def _sorted(cost: ArrayInput, count: int) -> np.ndarray:
    """Return the numbers of the elements, sorted by cost."""
    try:
        costs = np.asarray(cost)
    except (TypeError, ValueError):  # lists of different lengths
        costs = np.empty(0)
    if costs.shape != (count,) or costs.dtype.kind not in "fiub" or np.isnan(costs).any():
        raise ValueError(
            f"cost must contain one number for each of {count} elements, without NaN, but {described(cost)} was given"
        )
    return np.argsort(costs, kind="stable")
