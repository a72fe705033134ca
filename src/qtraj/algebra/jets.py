"""Jets: values of functions of a few variables with their gradients and Hessians, as NumPy arrays over a batch.

A jet of first order has no Hessian (None).
The arithmetic of jets differentiates a formula exactly, without tracing or compilation: a formula that is written for
numbers or arrays also accepts jets. All arrays have the batch axes last, so that every operation runs over contiguous
memory. Constants are numbers, or arrays that broadcast with the values.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float


class Jet:
    """A function of n variables near one point of a batch: its value, gradient and symmetric Hessian, or None.

    The Hessian of a linear function may be the number 0. Derivatives that are the same on the whole batch may have
    batch axes of length 1.
    """

    __slots__ = ("gradient", "hessian", "value")
    __array_ufunc__ = None  # NumPy arrays leave the operators to this class

    def __init__(
        self,
        value: Float[np.ndarray, "*batch"],
        gradient: Float[np.ndarray, "n *batch"],
        hessian: Float[np.ndarray, "n n *batch"] | int | None = None,
    ):
        self.value, self.gradient = value, gradient
        self.hessian: Any = hessian

    def __add__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            hessian = None if self.hessian is None else self.hessian + other.hessian
            return Jet(self.value + other.value, self.gradient + other.gradient, hessian)
        return Jet(self.value + other, self.gradient, self.hessian)

    __radd__ = __add__

    def __sub__(self, other: Any) -> "Jet":
        if isinstance(other, Jet):
            hessian = None if self.hessian is None else self.hessian - other.hessian
            return Jet(self.value - other.value, self.gradient - other.gradient, hessian)
        return Jet(self.value - other, self.gradient, self.hessian)

    def __rsub__(self, other: Any) -> "Jet":
        return -self + other

    def __neg__(self) -> "Jet":
        return Jet(-self.value, -self.gradient, None if self.hessian is None else -self.hessian)

    def __mul__(self, other: Any) -> "Jet":
        if other is self:
            return self.apply(self.value * self.value, 2.0 * self.value, 2.0)
        if not isinstance(other, Jet):
            return Jet(self.value * other, self.gradient * other, _scaled(other, self.hessian))
        a, b, hessian = self, other, None
        if a.hessian is not None:
            hessian = a.gradient[:, None] * b.gradient
            hessian = hessian + hessian.swapaxes(0, 1)
            hessian = _added(_added(hessian, _scaled(a.value, b.hessian)), _scaled(b.value, a.hessian))
        return Jet(a.value * b.value, a.value * b.gradient + b.value * a.gradient, hessian)

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> "Jet":
        return self * other.reciprocal() if isinstance(other, Jet) else self * (1 / other)

    def __rtruediv__(self, other: Any) -> "Jet":
        return self.reciprocal() * other

    def __lt__(self, other: float) -> Any:
        return self.value < other

    def __gt__(self, other: float) -> Any:
        return self.value > other

    def apply(self, value: Any, first: Any, second: Any) -> "Jet":
        """Return the jet of f(x), from the value and the first and second derivatives of f at x."""
        hessian = None
        if self.hessian is not None:
            hessian = _added((second * self.gradient)[:, None] * self.gradient, _scaled(first, self.hessian))
        return Jet(value, first * self.gradient, hessian)

    @property
    def ndim(self) -> int:
        """Number of batch axes."""
        return self.value.ndim

    def __pow__(self, exponent: int) -> "Jet":
        x, n = self.value, exponent
        first, second = (0.0 * x if c == 0 else c * x**k for c, k in ((n, n - 1), (n * (n - 1), n - 2)))
        return self.apply(x**n, first, second)

    def reciprocal(self) -> "Jet":
        """Return 1/x."""
        inverse = 1 / self.value
        return self.apply(inverse, -(inverse**2), 2 * inverse**3)

    def sqrt(self) -> "Jet":
        """Return √x, for x > 0."""
        root = np.sqrt(self.value)
        return self.apply(root, 0.5 / root, -0.25 / (root * self.value))

    def log(self) -> "Jet":
        """Return ln x, for x > 0."""
        inverse = 1 / self.value
        return self.apply(np.log(self.value), inverse, -inverse * inverse)

    def exp(self) -> "Jet":
        """Return the exponential of x."""
        value = np.exp(self.value)
        return self.apply(value, value, value)

    def cos(self) -> "Jet":
        """Return cos x."""
        cos = np.cos(self.value)
        return self.apply(cos, -np.sin(self.value), -cos)

    def sin(self) -> "Jet":
        """Return sin x."""
        sin = np.sin(self.value)
        return self.apply(sin, np.cos(self.value), -sin)


def variables(values: Float[np.ndarray, "n *batch"]) -> list[Jet]:
    """Return the n variables themselves as jets."""
    n, batch = values.shape[0], values.shape[1:]
    zeros, unit = np.zeros((n, n, *batch)), np.eye(n)
    return [
        Jet(value, np.broadcast_to(row.reshape(n, *[1] * len(batch)), (n, *batch)), zeros)
        for value, row in zip(values, unit, strict=True)
    ]


def coordinates(values: Float[np.ndarray, "n *batch"]) -> list[Jet]:
    """Return the same jets as `variables`, with constant derivatives: polynomials of them are faster to compute."""
    n, batch = values.shape[0], values.ndim - 1
    return [Jet(value, row.reshape(n, *[1] * batch), 0) for value, row in zip(values, np.eye(n), strict=True)]


def _scaled(factor: Any, hessian: Any) -> Any:
    """Return the product of a number and a Hessian, which may be 0 or None."""
    return hessian if hessian is None or isinstance(hessian, int) else factor * hessian


def _added(one: np.ndarray, other: Any) -> np.ndarray:
    """Return the sum of two Hessians; the first one may be overwritten, and the second one may be 0."""
    if isinstance(other, int) or one.shape != other.shape:
        return one + other
    one += other
    return one


def replaced(x: Any, where: Any, constant: float) -> Any:
    """Return a jet or an array whose values are replaced by a constant where the condition is true."""
    if not isinstance(x, Jet):
        return _module(x).where(where, constant, x)
    if not np.any(where):
        return x
    hessian = None if x.hessian is None else np.where(where, 0.0, x.hessian)
    return Jet(np.where(where, constant, x.value), np.where(where, 0.0, x.gradient), hessian)


def sqrt(x: Any) -> Any:
    """Return √x of a jet or an array, 0 with derivative 0 where x is not positive, and NaN where x is NaN."""
    bad = (x.value if isinstance(x, Jet) else x) <= 0
    safe = replaced(x, bad, 1.0)
    return replaced(safe.sqrt() if isinstance(x, Jet) else _module(x).sqrt(safe), bad, 0.0)


def log(x: Any, fallback: float = -np.inf) -> Any:
    """Return ln x of a jet or an array, and `fallback` with derivative 0 where x is not positive."""
    bad = ~(x > 0)
    safe = replaced(x, bad, 1.0)
    return replaced(safe.log() if isinstance(x, Jet) else _module(x).log(safe), bad, fallback)


def exp(x: Any) -> Any:
    """Return the exponential of a jet or an array."""
    return x.exp() if isinstance(x, Jet) else _module(x).exp(x)


def cos(x: Any) -> Any:
    """Return cos x of a jet or an array."""
    return x.cos() if isinstance(x, Jet) else _module(x).cos(x)


def sin(x: Any) -> Any:
    """Return sin x of a jet or an array."""
    return x.sin() if isinstance(x, Jet) else _module(x).sin(x)


def spread(x: Any) -> Any:
    """Return a jet or an array with a new first batch axis of length 1."""
    if isinstance(x, Jet):
        hessian = None if x.hessian is None else x.hessian[:, :, None]
        return Jet(x.value[None], x.gradient[:, None], hessian)
    return x[None]


def weighted_sum(x: Any, weights: Float[np.ndarray, " k"]) -> Any:
    """Return the weighted sum of a jet or an array over its first batch axis."""
    if isinstance(x, Jet):
        parts = ((x.value, 0), (x.gradient, 1), (x.hessian, 2))
        return Jet(*(None if x is None else np.tensordot(weights, x, ((0,), (axis,))) for x, axis in parts))  # type: ignore[arg-type]
    return _module(x).tensordot(weights, x, ((0,), (0,)))


def matrix_product(matrix: Float[np.ndarray, "j k"], x: Any) -> Any:
    """Return the product of a constant matrix and a jet or an array over its first batch axis."""
    if isinstance(x, Jet):
        parts = ((x.value, 0), (x.gradient, 1), (x.hessian, 2))
        return Jet(*(None if y is None else _over_axis(matrix, y, axis) for y, axis in parts))  # type: ignore[arg-type]
    return _module(x).tensordot(matrix, x, ((1,), (0,)))


def _over_axis(matrix: np.ndarray, x: np.ndarray, axis: int) -> np.ndarray:
    return np.moveaxis(np.tensordot(matrix, x, ((1,), (axis,))), 0, axis)


def _module(x: Any) -> Any:
    return jnp if isinstance(x, jax.Array) else np
