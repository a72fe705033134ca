"""Select the array library of a formula: NumPy for concrete problems, JAX for traced ones."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def namespace(*arrays: Any) -> Any:
    """Return `jax.numpy` if one of the arrays is a JAX array, otherwise `numpy`."""
    for x in arrays:
        if type(x) is not np.ndarray and isinstance(x, jax.Array):
            return jnp
    return np


def total(terms: Any) -> Any:
    """Return the sum of a sequence of arrays."""
    first, *others = terms
    for term in others:
        first = first + term
    return first
