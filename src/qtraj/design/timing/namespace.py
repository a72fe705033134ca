"""Select the array library of a formula: NumPy for concrete problems, JAX for traced ones."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def namespace(*arrays: Any) -> Any:
    """Return `jax.numpy` if one of the arrays is a JAX array, otherwise `numpy`."""
    return jnp if any(isinstance(x, jax.Array) for x in arrays) else np


def total(terms: Any) -> Any:
    """Return the sum of a sequence of arrays."""
    first, *others = terms
    for term in others:
        first = first + term
    return first
