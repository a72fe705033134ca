"""Apply a function to each element of a batch in blocks of fixed size, sorted by their cost."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

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
        arguments: The arguments of the function. Each array in them has the elements of the batch on its first axis.
        block: The number of elements that are computed at once; by default 64 on a CPU, 1024 on an accelerator. A
            smaller batch is one block, whose size is a power of two.
        cost: For each element, a number (n,) that is larger for slower elements, such as the initial rate or the gain.
            Elements of similar cost are computed in the same block. By default the blocks have the order of the batch.

    Returns:
        What `function` returns, with the elements on the first axis of each array, in the order of the arguments.
        Inside `jit`, `grad` and `vmap`, the whole batch is one block.

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
    order = np.arange(count) if cost is None else _sorted(cost, count)
    if is_traced(leaves):
        return _mapped(function, arrays, rest)
    device = device_of(leaves)
    platform = default_platform() if device is None else device.platform
    largest = block or (ON_CPU if platform == "cpu" else ON_DEVICE)
    size = min(largest, max(SMALLEST, 1 << (count - 1).bit_length()))
    on_host = jax.tree.map(np.asarray, arrays)
    calls = [(function, cores.take(on_host, part, size), rest) for part in cores.split(order, size)]
    found = list(cores.map_blocks(_mapped, calls, device))
    back = np.argsort(order, kind="stable")
    whole = lambda *parts: jnp.asarray(np.concatenate(parts)[:count][back])  # noqa: E731
    return jax.device_put(jax.tree.map(whole, *found), device)


@eqx.filter_jit
def _mapped(function: Callable[..., Any], arrays: Any, rest: Any) -> Any:
    return jax.vmap(lambda x: function(*eqx.combine(x, rest)))(arrays)


def _count(leaves: list[Any]) -> int:
    """Return the number of elements."""
    sizes = {x.shape[:1] for x in leaves}
    if len(sizes) != 1 or not min(sizes) or not min(sizes)[0]:
        found = ", ".join(str(x.shape) for x in leaves) or "none"
        raise ValueError(
            "in_blocks needs arrays with the elements of the batch on their first axis, at least one element and the "
            f"same number in each array, but the shapes are {found}"
        )
    return min(sizes)[0]


def _sorted(cost: ArrayInput, count: int) -> np.ndarray:
    """Return the numbers of the elements, sorted by cost."""
    costs = np.asarray(cost)
    if costs.shape != (count,) or costs.dtype.kind not in "fiub" or np.isnan(costs).any():
        raise ValueError(
            f"cost must contain one number for each of {count} elements, without NaN, but {described(cost)} was given"
        )
    return np.argsort(costs, kind="stable")
