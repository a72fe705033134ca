"""Represent squares of path quantities as sums of monomials in the invariants, by tables of coefficients and exponents.

The tables are computed by evaluating the formulas of the registry for symbolic polynomials. The derivatives of a sum
Σ c·Π sᵢ^eᵢ, with coefficients c, invariants sᵢ and exponents eᵢ, are sums of monomials, too, because ∂/∂sᵢ multiplies a
monomial by eᵢ/sᵢ. So one function evaluates all quantities.
"""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.path.path_quantity import PathQuantity

TINY = 1e-70
"""Invariants of smaller magnitude are replaced by this value, so that their logarithms and inverses are finite."""


Expanded = tuple[Float[Array, " p"], Float[Array, "i p"], Float[Array, "i i p"]]
"""A square at p instants, with its gradient and Hessian with respect to i invariants."""


class Table(NamedTuple):
    """The coefficients (monomials,) and exponents (monomials, invariants) of the square of one quantity."""

    coefficients: np.ndarray
    exponents: np.ndarray

    @property
    def odd(self) -> np.ndarray:
        """1 for odd exponents and 0 for even exponents, (monomials, invariants)."""
        return self.exponents % 2.0


class _Polynomial:
    """A symbolic polynomial: a map from exponents to coefficients."""

    def __init__(self, terms: dict[tuple[int, ...], float]):
        self.terms = terms

    def __add__(self, other: "_Polynomial") -> "_Polynomial":
        terms = dict(self.terms)
        for exponents, coefficient in other.terms.items():
            terms[exponents] = terms.get(exponents, 0.0) + coefficient
        return _Polynomial(terms)

    def __sub__(self, other: "_Polynomial") -> "_Polynomial":
        return self + (-1) * other

    def __mul__(self, other: Any) -> "_Polynomial":
        if not isinstance(other, _Polynomial):
            return _Polynomial({exponents: other * coefficient for exponents, coefficient in self.terms.items()})
        total = _Polynomial({})
        for p, a in self.terms.items():
            total = total + _Polynomial(
                {tuple(x + y for x, y in zip(p, q, strict=True)): a * b for q, b in other.terms.items()}
            )
        return total

    __rmul__ = __mul__


def table(entry: PathQuantity, invariants: Sequence[str]) -> Table:
    """Return the square of one quantity as a table of monomials in the given invariants.

    **Raises:** ValueError if the denominator is not a single product of invariants.
    """
    identity = np.eye(len(invariants), dtype=int)
    symbols = SimpleNamespace(
        **{name: _Polynomial({tuple(identity[k].tolist()): 1.0}) for k, name in enumerate(invariants)}
    )
    numerator = entry.numerator(symbols).terms
    denominator = {(0,) * len(invariants): 1.0} if entry.denominator is None else entry.denominator(symbols).terms
    if len(denominator) != 1:
        raise ValueError(f"the denominator of {entry.name} must be one product of invariants, but it is a sum")
    (divisor_exponents, divisor) = next(iter(denominator.items()))
    exponents = np.asarray([*numerator]) - np.asarray(divisor_exponents)
    return Table(np.asarray([*numerator.values()]) / divisor, exponents)


def stacked(tables: Sequence[Table]) -> Table:
    """Stack several tables along a first axis, padded with monomials whose coefficient is zero."""
    max_terms = max(len(t.coefficients) for t in tables)
    coefficients = np.stack([np.pad(t.coefficients, (0, max_terms - len(t.coefficients))) for t in tables])
    exponents = np.stack([np.pad(t.exponents, ((0, max_terms - len(t.exponents)), (0, 0))) for t in tables])
    return Table(coefficients, exponents.astype(float))


@jax.custom_jvp
def expand(
    coefficients: Float[Array, " t"], exponents: Float[Array, "t i"], odd: Float[Array, "t i"], s: Float[Array, "i p"]
) -> Expanded:
    """Return the square at several instants, with its gradient and Hessian with respect to the invariants `s`.

    The results are differentiable with respect to `s` only.
    """
    return _expand(coefficients, exponents, odd, s)


@expand.defjvp
def _differentiate(primals: tuple[Array, ...], tangents: tuple[Array, ...]) -> tuple[Expanded, Expanded]:
    """Use the gradient and the Hessian, because the formulas have no derivatives where an invariant is zero."""
    coefficients, exponents, odd, s = primals
    found = expand(coefficients, exponents, odd, s)
    change = tangents[-1]
    gradient, hessian = found[1:]
    of_hessian = jax.jvp(lambda s: _expand(coefficients, exponents, odd, s)[2], (s,), (change,))[1]
    return found, (jnp.sum(gradient * change, axis=0), jnp.sum(hessian * change[None], axis=1), of_hessian)


def _expand(
    coefficients: Float[Array, " t"], exponents: Float[Array, "t i"], odd: Float[Array, "t i"], s: Float[Array, "i p"]
) -> Expanded:
    safe = jnp.where(jnp.abs(s) < TINY, TINY, s)
    half_negative = 0.5 * odd @ jnp.where(safe < 0, 1.0, 0.0)
    sign = jnp.where(half_negative == jnp.floor(half_negative), coefficients[:, None], -coefficients[:, None])
    terms = sign * jnp.exp(exponents @ jnp.log(jnp.abs(safe)))
    inv = 1 / safe
    first_order = exponents.T @ terms
    second_order = jnp.einsum("ti,tj,tp->ijp", exponents, exponents, terms)
    identity = jnp.eye(s.shape[0], dtype=s.dtype)[:, :, None]
    return (
        jnp.sum(terms, axis=0),
        first_order * inv,
        (second_order - identity * first_order[:, None]) * inv[:, None] * inv[None],
    )
