"""Gauss–Legendre collocation of 2λ̇ = λ∘ω(t): any number of stages s, order 2s, |λ| kept to round-off.

The stage equations Y_i = 1 + (h/2) Σ_j a_ij Y_j∘ω_j are linear. They are solved by fixed-point sweeps, since 4s × 4s
is small and a dense solver 6 to 40 times slower (8 stages, 256 to 8192 steps on a CPU). A solution times a constant
quaternion is a solution, so they start with Y = 1 in the middle of the step instead of at its first instant: the k-th
sweep has half the way to go, (½)^k/k!, which saves up to a fifth of them. The derivative is that of the solution, by
sweeps of its own, not of the sweeps. Nodes, weights and a_ij are computed with 50 digits and then rounded.
"""

import decimal
import functools
import math
from decimal import Decimal
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion
from qtraj.foundation.types import Quat, Scalar
from qtraj.motion.propagation.increment import AbstractIncrement, exact_product

DIGITS = 50
MOST_STAGES = 64
TURN_PER_STEP = 2.0
"""[rad] Up to this turn in a step, h·max|ω|, the sweeps reach round-off; a longer step shows in the error estimate."""


class GaussLegendre(AbstractIncrement):
    """Collocation at `stages` Gauss points, order 2·stages.

    **Raises:** ValueError for a number of stages that is no integer from 1 to 64.
    """

    stages: int = eqx.field(static=True)
    order: int = eqx.field(static=True)

    def __init__(self, stages: int = 8):
        if not 1 <= stages <= MOST_STAGES:
            raise ValueError(f"the number of stages must be an integer from 1 to {MOST_STAGES}, not {stages!r}")
        self.stages, self.order = stages, 2 * stages

    @property
    def nodes(self) -> np.ndarray:
        return tableau(self.stages).c

    @property
    def weights(self) -> np.ndarray:
        return tableau(self.stages).b

    def turn(self, rates: Float[Array, "s 3"], h: Scalar) -> Quat:
        scheme = tableau(self.stages)
        half = 0.5 * h * rates.T
        stages = _stages(scheme.sweeps, jnp.asarray(scheme.around, h.dtype), half)
        slopes = _times_pure(stages, half)
        first = (-exact_product(slopes, jnp.asarray(scheme.before, h.dtype))).at[0].add(1.0)
        last = exact_product(slopes, jnp.asarray(scheme.b - scheme.before, h.dtype)).at[0].add(1.0)
        return quaternion.product(quaternion.conjugate(first), last) / quaternion.norm_squared(first)


class Tableau(NamedTuple):
    """Nodes c (s,), weights b (s,) and coefficients a (s, s) on [0, 1]; what the sweeps take.

    `before` (s,) are the weights of the integral from 0 to ½, `around` (s, s) those of the integrals from ½ to the
    nodes; `sweeps` reach round-off.
    """

    c: np.ndarray
    b: np.ndarray
    a: np.ndarray
    before: np.ndarray
    around: np.ndarray
    sweeps: int


@functools.cache
def tableau(stages: int) -> Tableau:
    """The Gauss–Legendre scheme, exact to the last bit but rounding.

    a_ij = b_j [c_i + ½ Σ_k P_k(x_j)(P_{k+1}(x_i) − P_{k−1}(x_i))], the integral of the Lagrange polynomials by their
    Legendre series, in which nothing cancels; x = 2c − 1.
    """
    with decimal.localcontext(decimal.Context(prec=DIGITS)):
        x = [_root(stages, i) for i in range(stages)]
        p = [_legendre(stages + 1, xi) for xi in x]
        half = Decimal("0.5")
        b = [(1 - xi * xi) / (stages * pi[stages - 1]) ** 2 for xi, pi in zip(x, p, strict=True)]
        c = [half * (1 + xi) for xi in x]
        a = [_integral(c[i], p[i], p, b) for i in range(stages)]
        before = _integral(half, _legendre(stages + 1, Decimal(0)), p, b)
        around = _rounded([[x - y for x, y in zip(row, before, strict=True)] for row in a])
        return Tableau(_rounded(c), _rounded(b), _rounded(a), _rounded(before), around, _sweeps(around))


@functools.cache
def lobatto(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights (count,) on [0, 1] of the quadrature with both ends, of order 2·count − 2: it checks another.

    The nodes are the ends and the extrema of P_{count−1}; the weights 1/(count (count − 1) P²).
    """
    degree = count - 1
    with decimal.localcontext(decimal.Context(prec=DIGITS)):
        x = [Decimal(-math.cos(math.pi * i / degree)) for i in range(count)]
        for _ in range(12):
            p = [_legendre(degree, xi) for xi in x]
            x = [xi - (xi * pi[-1] - pi[-2]) / (count * pi[-1]) for xi, pi in zip(x, p, strict=True)]
        weights = [1 / (count * degree * _legendre(degree, xi)[-1] ** 2) for xi in x]
        return _rounded([(1 + xi) / 2 for xi in x]), _rounded(weights)


def _integral(c: Decimal, p: list[Decimal], at_nodes: list[list[Decimal]], b: list[Decimal]) -> list[Decimal]:
    """Weights of the integral from 0 to c, from the Legendre polynomials there and at the nodes."""
    half = Decimal("0.5")
    return [
        bj * (c + half * sum(pj[k] * (p[k + 1] - p[k - 1]) for k in range(1, len(b))))
        for pj, bj in zip(at_nodes, b, strict=True)
    ]


def _legendre(count: int, x: Decimal) -> list[Decimal]:
    """P_0(x) to P_count(x)."""
    p = [Decimal(1), x]
    for k in range(1, count):
        p.append(((2 * k + 1) * x * p[k] - k * p[k - 1]) / (k + 1))
    return p


def _root(stages: int, i: int) -> Decimal:
    """The i-th zero of P_stages, ascending, by Newton's method from the usual cosine."""
    x = Decimal(-math.cos(math.pi * (i + 0.75) / (stages + 0.5)))
    for _ in range(8):  # digits double from about 3
        p = _legendre(stages, x)
        x -= p[stages] * (1 - x * x) / (stages * (p[stages - 1] - x * p[stages]))
    return x


def _rounded(values: list) -> np.ndarray:
    return np.vectorize(float)(np.array(values, dtype=object))


def _sweeps(a: np.ndarray) -> int:
    """Sweeps until the powers of (h|ω|/2)·a no longer count."""
    term, count = np.ones(len(a)), 0
    while np.max(np.abs(term)) > 0.5 * np.finfo(float).eps:
        term, count = 0.5 * TURN_PER_STEP * (a @ term), count + 1
    return count


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _stages(sweeps: int, a: Float[Array, "s s"], half: Float[Array, "3 s"]) -> Float[Array, "4 s"]:
    """Y of the stage equations, `half` being (h/2)ω at the nodes."""
    identity = jnp.zeros_like(half, shape=(4, half.shape[1])).at[0].set(1.0)
    return _sweep(sweeps, a, half, identity)


@_stages.defjvp
def _(sweeps, primals, tangents):
    a, half = primals
    stages = _stages(sweeps, a, half)  # dY = (dY∘ω + Y∘dω) a: the same equations with another right side
    right = exact_product(_times_pure(stages, tangents[1]), a.T)
    return stages, _sweep(sweeps, a, half, right)


def _sweep(sweeps: int, a: Array, half: Array, right: Array) -> Array:
    """y = right + (y∘half) aᵀ by `sweeps` fixed-point sweeps; a loop, not unrolled, compiles twice as fast.

    The loop carries y∘half: a sum and the products after it are one pass over memory.
    """

    def body(slopes, _):
        return _times_pure(right + exact_product(slopes, a.T), half), None

    slopes = jax.lax.scan(body, _times_pure(right, half), None, length=sweeps - 1)[0]
    return right + exact_product(slopes, a.T)


def _times_pure(y: Float[Array, "4 s"], half: Float[Array, "3 s"]) -> Float[Array, "4 s"]:
    """The products y∘(0, half) at each stage, componentwise over stages."""
    s, x, y_, z = y
    a, b, c = half
    return jnp.stack([-(x * a + y_ * b + z * c), s * a + y_ * c - z * b, s * b + z * a - x * c, s * c + x * b - y_ * a])
