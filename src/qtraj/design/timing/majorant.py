"""Represent polynomials in cells by their values at nodes and by a majorant, the sum of the magnitudes of all terms.

The majorant bounds the function on ellipses around the cell in the complex plane, and all errors are relative to the
majorant. Suppose that the errors of the inputs are at most `RELATIVE` times their majorants, and that the products in a
polynomial formula have at most `FACTORS`/2 factors. Then the error of the formula is at most `FACTORS`·`RELATIVE`
times its majorant; rounding errors are far smaller. So an operation acts on one array, and no error bounds have to be
propagated.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.chebyshev_model import NODES, SLACK, ChebyshevModel

ELLIPSES = 3

RELATIVE = 2.0**-40
"""Largest error of an input relative to its majorant; the majorant is enlarged if necessary."""

FACTORS = 32
"""Twice the largest number of inputs in a product, so that the bound covers all rounding errors, too.

Each of at most 200 operations adds a unit of round-off, 2⁻⁵³, and (1 + RELATIVE)¹⁶(1 + 2⁻⁵³)²⁰⁰ − 1 < 17·RELATIVE.
"""

SMALLEST = 2.0**-40
"""Lower bound on a majorant, so that no product underflows and errors remain relative to the majorant."""

ENLARGED = 1 + 2.0**-30
"""Factor that covers the rounding of a majorant, and of the coefficients of an input on ellipses of semi-axis 16."""

SIGNS = np.concatenate([np.full(NODES, -1.0), np.ones(ELLIPSES)])[:, None]
"""Signs with which a difference subtracts values and adds majorants."""


class Majorant:
    """Values at the nodes of each cell, followed by the majorants on the ellipses: (nodes + ellipses, cells)."""

    def __init__(self, both: Float[Array, "rows cells"]):
        self.both = both

    def __add__(self, other: "Majorant") -> "Majorant":
        return Majorant(self.both + other.both)

    def __sub__(self, other: "Majorant") -> "Majorant":
        return Majorant(self.both + other.both * SIGNS)

    def __mul__(self, other: "Majorant") -> "Majorant":
        return Majorant(self.both * other.both)

    def __rmul__(self, factor: float | Array) -> "Majorant":
        """Return the product with a positive number."""
        return Majorant(factor * self.both)

    def one(self) -> "Majorant":
        """Return the constant 1 in the same cells."""
        return Majorant(jnp.ones_like(self.both))


def from_model(p: ChebyshevModel) -> tuple[Majorant, ...]:
    """Return one majorant for each component of a vector-valued model, whose cell axis must have length 1."""
    enough = jnp.maximum(p.error / RELATIVE, SMALLEST)
    bound = jnp.maximum(jnp.maximum(p.bound, p.size[None]), enough[None]) * SLACK
    return tuple(Majorant(jnp.concatenate([row, bound])[:, 0]) for row in p.values)


def to_model(functions: Sequence[Majorant]) -> ChebyshevModel:
    """Stack the functions along the cell axis and return them as one model."""
    both = jnp.stack([f.both for f in functions], axis=1)
    bound = both[NODES:] * ENLARGED
    return ChebyshevModel(both[:NODES], bound[0], FACTORS * RELATIVE * bound[0], bound)
