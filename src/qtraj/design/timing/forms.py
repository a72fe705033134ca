"""Quadratic forms in a = u̇² and its derivatives with respect to the path parameter."""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.path.frenet import Invariants


def symmetric(entries: Float[Any, "entries *nodes"]) -> Float[Any, "n n *nodes"]:
    """Return the symmetric matrix with the rows of its lower triangle in `entries`."""
    return entries[np.array([[0, 1], [1, 2]] if entries.shape[0] == 3 else [[0, 1, 3], [1, 2, 4], [3, 4, 5]])]


def square(p: Any, q: Any) -> tuple[Any, Any, Any]:
    """Return the entries (aa, ab, bb) of the form (p·a + q·b)², where b = a'."""
    return p * p, p * q, q * q


def squared_norm(i: Invariants, half: Any) -> tuple[Any, Any, Any]:
    """Return the entries of the form of the squared acceleration; r'·a' is multiplied by `half`."""
    return i.A, half * i.B, half * half * i.S
