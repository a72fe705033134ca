"""Compare a closed loop of 6 s with a hand-written loop for SciPy's DOP853: same tolerances, instants and outputs.

The program is coning. The law has an exactly linear error equation and scalar gains. The comparison is made for one
loop, and for 256 initial states.
"""

import functools
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import qtraj as qt
from qtraj.foundation.types import Scalar

from .race import race, report

BETA, OMEGA, K1, K2 = math.radians(50.0), 1.1, 2.6, 1.69
RTOL, ATOL, SAME = 1e-10, 1e-12, 3e-9
TIMES = np.linspace(0.0, 6.0, 61)
BATCH, ROUNDS = 256, 11
_RNG = np.random.default_rng(6)
STARTS = np.array([1.0, 0, 0, 0]) + 0.4 * _RNG.normal(size=(BATCH, 4)) * np.array([0, 1, 1, 1])
RATES = 0.4 * _RNG.normal(size=(BATCH, 4))


class Coning(qt.AbstractProgram):
    """Coning as a program: λ⁰, ω⁰ and ε⁰ in closed form."""

    duration: Scalar = eqx.field(default_factory=lambda: jnp.asarray(6.0))

    def __call__(self, t):
        t = jnp.asarray(t, float)
        cos, sin, none = jnp.cos(OMEGA * t), jnp.sin(OMEGA * t), 0 * t
        half, level = math.sin(BETA / 2), OMEGA * math.sin(BETA)
        return qt.Attitude(
            jnp.stack([math.cos(BETA / 2) + none, half * cos, half * sin, none]),
            jnp.stack([-level * sin, level * cos, none - 2 * OMEGA * half**2]),
            jnp.stack([-level * OMEGA * cos, -level * OMEGA * sin, none]),
        )


@jax.jit
def ours(start, rate):
    solution = qt.simulate(Coning(), qt.AccelerationLaw(K1, K2), start, rate, TIMES, rtol=RTOL, atol=ATOL)
    return jnp.concatenate([solution.quaternion, solution.rate, solution.command], axis=1)


together = jax.jit(jax.vmap(ours))


def product(p, q):
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def turned_back(mu, x, square):
    """Return the vector part of μ⁻¹∘(0, x)∘μ."""
    return [k / square for k in product(product((mu[0], -mu[1], -mu[2], -mu[3]), (0.0, *x)), mu)[1:]]


def command(t, y):
    """Return the command ε of the law in plain numbers, with scalar gains."""
    c, s = math.cos(OMEGA * t), math.sin(OMEGA * t)
    half, level = math.sin(BETA / 2), OMEGA * math.sin(BETA)
    mu = product((math.cos(BETA / 2), -half * c, -half * s, 0.0), y[:4])
    square = mu[0] ** 2 + mu[1] ** 2 + mu[2] ** 2 + mu[3] ** 2
    w = turned_back(mu, (-level * s, level * c, -2 * OMEGA * half**2), square)
    e = turned_back(mu, (-level * OMEGA * c, -level * OMEGA * s, 0.0), square)
    w0, d = y[4], [y[5] - w[0], y[6] - w[1], y[7] - w[2]]
    across = (w[1] * d[2] - w[2] * d[1], w[2] * d[0] - w[0] * d[2], w[0] * d[1] - w[1] * d[0])
    vector = [e[i] + across[i] - (K1 + w0) * d[i] - 2 * K2 * mu[1 + i] / square for i in range(3)]
    scalar = -0.5 * (w0**2 - sum(x * x for x in d)) - K1 * w0 - 2 * K2 * (1 - mu[0] / square)
    return [scalar, *vector]


def derivative(t, y):
    y = y.tolist()
    return [0.5 * k for k in product(y[:4], y[4:])] + command(t, y)


def by_hand(start, rate):
    run = solve_ivp(derivative, (0.0, 6.0), [*start, *rate], "DOP853", TIMES, rtol=RTOL, atol=ATOL)
    return np.concatenate([run.y.T, [command(t, y) for t, y in zip(TIMES, run.y.T.tolist(), strict=True)]], axis=1)


def test_the_results_are_the_same():
    found = together(STARTS[:8], RATES[:8])
    expected = np.stack([by_hand(*pair) for pair in zip(STARTS[:8], RATES[:8], strict=True)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=SAME)


@pytest.mark.parametrize("batch", [1, BATCH])
def test_ratios(batch):
    few = min(batch, 16)  # each solve of SciPy takes the same time
    runners = {
        "simulate": functools.partial(ours, STARTS[0], RATES[0])
        if batch == 1
        else functools.partial(together, STARTS, RATES),
        "SciPy DOP853, by hand": lambda: [by_hand(*pair) for pair in zip(STARTS[:few], RATES[:few], strict=True)],
    }
    spent = race(runners, ROUNDS)
    spent["SciPy DOP853, by hand"] = [batch / few * t for t in spent["SciPy DOP853, by hand"]]
    remarks = dict.fromkeys(runners, "")
    assert report(f"closed loops at once: {batch}", spent, remarks)["SciPy DOP853, by hand"] > 3
