"""Compute several arrays in one loop over their elements.

XLA's compiler for CPUs generates a separate loop for each array, and each loop repeats the computations that the arrays
share; only a reduction can have several results. Therefore `in_one_loop` converts the arrays to one reduction: each
array is summed over an added axis with the elements (x, 0). Everything that does not depend on that axis is computed
once. XLA's compilers for other devices do not need this conversion.
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from jax import lax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir, partial_eval
from jaxtyping import Array

from qtraj.foundation.namespace import is_host


def in_one_loop(arrays: Sequence[Array]) -> list[Array]:
    """Return arrays of one shape unchanged, but compute the float arrays in one loop, in which −0 may become 0."""
    if is_host(*arrays):
        return list(arrays)
    floats = [jnp.issubdtype(x.dtype, jnp.inexact) for x in arrays]
    float_arrays = [x for x, is_float in zip(arrays, floats, strict=True) if is_float]
    outputs = iter(_identity.bind(*float_arrays, joined="values") if float_arrays else [])
    return [next(outputs) if is_float else x for x, is_float in zip(arrays, floats, strict=True)]


def derivatives_in_one_loop(arrays: Sequence[Array]) -> list[Array]:
    """Return float arrays of one shape unchanged; in reverse mode their cotangents are computed in one loop."""
    return list(arrays) if is_host(*arrays) else _identity.bind(*arrays, joined="cotangents")


def _unchanged(*arrays: Array, joined: str) -> list[Array]:
    return list(arrays)


def _reduced(*arrays: Array, joined: str) -> list[Array]:
    if joined == "cotangents" or len(arrays) == 1:
        return list(arrays)
    first = lax.broadcasted_iota(jnp.int32, (2, *arrays[0].shape), 0) == 0
    zeros = tuple(jnp.zeros((), x.dtype) for x in arrays)
    padded = tuple(jnp.where(first, x[None], zero) for x, zero in zip(arrays, zeros, strict=True))
    return list(lax.reduce(padded, zeros, lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)), (0,)))


def _transposed(cotangents: Sequence[Any], *arrays: Any, joined: str) -> list[Any]:
    """Join the cotangents in one loop, but only if the values were not joined; symbolic zeros are omitted."""
    nonzero = [x for x in cotangents if not isinstance(x, ad.Zero)]
    other = "cotangents" if joined == "values" else "values"
    outputs = iter(_identity.bind(*nonzero, joined=other) if nonzero else [])
    results = [x if isinstance(x, ad.Zero) else next(outputs) for x in cotangents]
    return [x if ad.is_undefined_primal(array) else None for x, array in zip(results, arrays, strict=True)]


def _batched(arrays: Sequence[Array], axes: Sequence[Any], joined: str) -> tuple[list[Array], list[int]]:
    size = next(x.shape[axis] for x, axis in zip(arrays, axes, strict=True) if axis is not None)
    front = [batching.bdim_at_front(x, axis, size) for x, axis in zip(arrays, axes, strict=True)]
    return _identity.bind(*front, joined=joined), [0] * len(front)


def _without_unused(used: list[bool], *others: Any) -> tuple[list[bool], Any]:
    """Remove unused arrays, because no compiler can remove them from the joined loop.

    The last argument is the equation; JAX 0.12 passes which inputs are live before it.
    """
    equation = others[-1]
    if not any(used):
        return used, None
    kept = lambda variables: [v for v, is_used in zip(variables, used, strict=True) if is_used]  # noqa: E731
    return used, equation.replace(invars=kept(equation.invars), outvars=kept(equation.outvars))


_identity = Primitive("in_one_loop")
_identity.multiple_results = True
_identity.def_impl(_unchanged)
_identity.def_abstract_eval(lambda *arrays, joined: [x.update(weak_type=False) for x in arrays])
ad.deflinear2(_identity, _transposed)
batching.primitive_batchers[_identity] = _batched
partial_eval.dce_rules[_identity] = _without_unused
mlir.register_lowering(_identity, mlir.lower_fun(_unchanged, multiple_results=True))
mlir.register_lowering(_identity, mlir.lower_fun(_reduced, multiple_results=True), platform="cpu")
