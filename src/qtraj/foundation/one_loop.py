"""Several arrays worked out in one loop over their elements.

XLA's compiler for CPUs gives each array a loop of its own, which repeats all that it shares with the others; only a
reduction may have several results. Elementwise arrays become one when they are summed over an axis that is added for
it, (x, 0) for each: what does not depend on that axis is worked out once. Other compilers need no such help.
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import Array


def in_one_loop(arrays: Sequence[Array]) -> list[Array]:
    """The arrays, of one shape, as they are; those of floats are worked out in one loop, in which a −0 may become 0."""
    floats = [jnp.issubdtype(x.dtype, jnp.inexact) for x in arrays]
    known = [x for x, is_float in zip(arrays, floats, strict=True) if is_float]
    found = iter(_passed.bind(*known, joined="values") if known else [])
    return [next(found) if is_float else x for x, is_float in zip(arrays, floats, strict=True)]


def derivatives_in_one_loop(arrays: Sequence[Array]) -> list[Array]:
    """The arrays of floats, of one shape, as they are; the reverse pass works out their cotangents in one loop."""
    return _passed.bind(*arrays, joined="cotangents")


def _as_they_are(*arrays: Array, joined: str) -> list[Array]:
    return list(arrays)


def _worked_out(*arrays: Array, joined: str) -> list[Array]:
    if joined == "cotangents" or len(arrays) == 1:
        return list(arrays)
    first = lax.broadcasted_iota(jnp.int32, (2, *arrays[0].shape), 0) == 0
    zeros = tuple(jnp.zeros((), x.dtype) for x in arrays)
    padded = tuple(jnp.where(first, x[None], zero) for x, zero in zip(arrays, zeros, strict=True))
    return list(lax.reduce(padded, zeros, lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)), (0,)))


def _transposed(cotangents: Sequence[Any], *arrays: Any, joined: str) -> list[Any]:
    """Cotangents of values that shared a loop pass as they are, the others share one; without those that vanish."""
    known = [x for x in cotangents if not isinstance(x, ad.Zero)]
    other = "cotangents" if joined == "values" else "values"
    found = iter(_passed.bind(*known, joined=other) if known else [])
    wanted = [x if isinstance(x, ad.Zero) else next(found) for x in cotangents]
    return [x if ad.is_undefined_primal(array) else None for x, array in zip(wanted, arrays, strict=True)]


def _batched(arrays: Sequence[Array], axes: Sequence[Any], joined: str) -> tuple[list[Array], list[int]]:
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    front = [batching.bdim_at_front(x, axis, size) for x, axis in zip(arrays, axes, strict=True)]
    return _passed.bind(*front, joined=joined), [0] * len(front)


def _asked_for(used: list[bool], equation: Any) -> tuple[list[bool], Any]:
    """Without the arrays that nobody uses: once in a loop with others, no compiler finds them."""
    if not any(used):
        return used, None
    kept = lambda variables: [v for v, is_used in zip(variables, used, strict=True) if is_used]  # noqa: E731
    return used, equation.replace(invars=kept(equation.invars), outvars=kept(equation.outvars))


_passed = Primitive("in_one_loop")
_passed.multiple_results = True
_passed.def_impl(_as_they_are)
_passed.def_abstract_eval(lambda *arrays, joined: [x.update(weak_type=False) for x in arrays])
ad.deflinear2(_passed, _transposed)
batching.primitive_batchers[_passed] = _batched
partial_eval.dce_rules[_passed] = _asked_for
mlir.register_lowering(_passed, mlir.lower_fun(_as_they_are, multiple_results=True))
mlir.register_lowering(_passed, mlir.lower_fun(_worked_out, multiple_results=True), platform="cpu")
