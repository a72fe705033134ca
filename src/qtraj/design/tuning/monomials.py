"""The squares of path quantities as sums of monomials in the invariants: tables of coefficients and exponents.

The tables follow from the formulas of the registry, which are evaluated in symbols. The derivatives of a square
Σ c·Π sᵢ^eᵢ are monomials again, ∂/∂sᵢ = eᵢ/sᵢ and so on: one piece of arithmetic serves every quantity.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.path.quantity import PathQuantity

VANISHING = 1e-70
"""Stands for an invariant that is zero: its monomials and their derivatives then come out as their limits."""


class Table(NamedTuple):
    """Coefficients (monomials,) and exponents (monomials, invariants) of one square."""

    coefficients: np.ndarray
    exponents: np.ndarray


class _Sum:
    """A polynomial in symbols: exponents of each term, and its coefficient."""

    def __init__(self, terms: dict[tuple[int, ...], float]):
        self.terms = terms

    def __add__(self, other: "_Sum") -> "_Sum":
        terms = dict(self.terms)
        for exponents, coefficient in other.terms.items():
            terms[exponents] = terms.get(exponents, 0.0) + coefficient
        return _Sum(terms)

    def __sub__(self, other: "_Sum") -> "_Sum":
        return self + (-1) * other

    def __mul__(self, other: Any) -> "_Sum":
        if not isinstance(other, _Sum):
            return _Sum({exponents: other * coefficient for exponents, coefficient in self.terms.items()})
        total = _Sum({})
        for p, a in self.terms.items():
            total = total + _Sum(
                {tuple(x + y for x, y in zip(p, q, strict=True)): a * b for q, b in other.terms.items()}
            )
        return total

    __rmul__ = __mul__


def table(entry: PathQuantity, invariants: Sequence[str]) -> Table:
    """The square of one quantity in these invariants.

    **Raises:** ValueError for a denominator that is no single product of invariants.
    """
    unit = np.eye(len(invariants), dtype=int)
    symbols = SimpleNamespace(**{name: _Sum({tuple(unit[k].tolist()): 1.0}) for k, name in enumerate(invariants)})
    part = entry.numerator(symbols).terms
    whole = {(0,) * len(invariants): 1.0} if entry.denominator is None else entry.denominator(symbols).terms
    if len(whole) != 1:
        raise ValueError(f"the denominator of {entry.name} is a sum: give it as one product of invariants")
    (below, divisor) = next(iter(whole.items()))
    exponents = np.asarray([*part]) - np.asarray(below)
    return Table(np.asarray([*part.values()]) / divisor, exponents)


def stacked(tables: Sequence[Table]) -> Table:
    """Tables of several squares in one, filled up with monomials that vanish: quantities on the first axis."""
    most = max(len(t.coefficients) for t in tables)
    coefficients = np.stack([np.pad(t.coefficients, (0, most - len(t.coefficients))) for t in tables])
    exponents = np.stack([np.pad(t.exponents, ((0, most - len(t.exponents)), (0, 0))) for t in tables])
    return Table(coefficients, exponents.astype(float))


def expand(
    coefficients: Float[Array, " t"], exponents: Float[Array, "t i"], s: Float[Array, "i p"]
) -> tuple[Float[Array, " p"], Float[Array, "i p"], Float[Array, "i i p"]]:
    """A square at many places, its gradient and its Hessian in the invariants."""
    safe = jnp.where(jnp.abs(s) < VANISHING, VANISHING, s)
    negative = (exponents % 2) @ jnp.where(safe < 0, 1.0, 0.0)
    sign = jnp.where(negative % 2 == 1, -coefficients[:, None], coefficients[:, None])
    terms = sign * jnp.exp(exponents @ jnp.log(jnp.abs(safe)))
    over = 1 / safe
    once = exponents.T @ terms
    twice = jnp.einsum("ti,tj,tp->ijp", exponents, exponents, terms)
    unit = jnp.eye(s.shape[0], dtype=s.dtype)[:, :, None]
    return jnp.sum(terms, axis=0), once * over, (twice - unit * once[:, None]) * over[:, None] * over[None]
