"""Propagate λ(t) from a known ω(t): fast coning (β = 50°, Ω = 2π, 10.3 s), compared with diffrax and SciPy.

Every run computes the final attitude of the same motion, and is timed until the result is ready. Its error is checked
against the closed form before timing. Methods are compared at equal accuracy: each has the loosest setting that reaches
1e-6 or 1e-10 rad. diffrax and SciPy integrate 2λ̇ = λ∘ω in R⁴; qtraj multiplies rotations. In `test_ratios` all methods
alternate in one run, because run times are noisy. The best time of each method is printed relative to qtraj.
"""

import functools
import time

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate

from qtraj.motion.propagation.gauss_legendre import GaussLegendre
from qtraj.motion.propagation.increment import AbstractIncrement
from qtraj.motion.propagation.magnus import Magnus
from qtraj.motion.propagation.propagate import propagate
from qtraj.motion.propagation.solver import AttitudeTerm, QuaternionMagnus

BETA, OMEGA, END = np.radians(50.0), 2 * np.pi, 10.3
TIMES = np.array([0.0, END])
LEVEL, DRIFT = OMEGA * np.sin(BETA), -2 * OMEGA * np.sin(BETA / 2) ** 2
FIRST = np.array([np.cos(BETA / 2), np.sin(BETA / 2), 0.0, 0.0])
LAST = np.array([np.cos(BETA / 2), np.sin(BETA / 2) * np.cos(OMEGA * END), np.sin(BETA / 2) * np.sin(OMEGA * END), 0.0])
ROUNDS, REPEATS = 15, 5


def rate(t):
    return jnp.stack([-LEVEL * jnp.sin(OMEGA * t), LEVEL * jnp.cos(OMEGA * t), DRIFT * jnp.ones_like(t)])


def adaptive(method: AbstractIncrement, tolerance: float):
    return propagate(rate, FIRST, TIMES, method, tolerance=tolerance)[-1]


@functools.partial(jax.jit, static_argnums=(0, 1))
def fixed(method: AbstractIncrement, steps: int):
    return propagate(rate, FIRST, TIMES, method, steps=steps)[-1]


@eqx.filter_jit
def with_diffrax(solver, term, tolerance):
    controller = diffrax.PIDController(rtol=tolerance, atol=tolerance)
    first = jnp.asarray(FIRST)
    return diffrax.diffeqsolve(term, solver, 0.0, END, None, first, stepsize_controller=controller, max_steps=8192).ys[
        0
    ]


def derivative(t, q):
    x, y, z = -LEVEL * np.sin(OMEGA * t), LEVEL * np.cos(OMEGA * t), DRIFT
    s, a, b, c = q
    return 0.5 * np.array([-a * x - b * y - c * z, s * x + b * z - c * y, s * y + c * x - a * z, s * z + a * y - b * x])


def with_scipy(tolerance):
    return scipy.integrate.solve_ivp(derivative, (0.0, END), FIRST, method="DOP853", rtol=tolerance, atol=tolerance).y[
        :, -1
    ]


def peers(target):
    """Return calls by name, each with the loosest setting (in whole decades, or in steps) that reaches the target."""
    tight = target == 1e-10
    term = AttitudeTerm(rate)
    return {
        "Gauss-Legendre 8, fixed steps": lambda: fixed(GaussLegendre(8), 24 if tight else 14),
        "Gauss-Legendre 8, chosen steps": lambda: adaptive(GaussLegendre(8), target),
        "Magnus 6, fixed steps": lambda: fixed(Magnus(6), 1280 if tight else 280),
        "diffrax Tsit5": lambda: with_diffrax(diffrax.Tsit5(), term, 1e-11 if tight else 1e-7),
        "diffrax Dopri8": lambda: with_diffrax(diffrax.Dopri8(), term, 1e-12 if tight else 1e-8),
        "diffrax QuaternionMagnus": lambda: with_diffrax(QuaternionMagnus(), term, 1e-10 if tight else 1e-7),
        "SciPy DOP853": lambda: with_scipy(1e-12 if tight else 1e-8),
    }


def error(q):
    """Return the error of the attitude [rad]."""
    q = np.asarray(q) / np.linalg.norm(q)
    return 2 * np.arcsin(min(1.0, np.linalg.norm(q - LAST) / 2)) * 2


TARGETS = [1e-6, 1e-10]
NAMES = list(peers(1e-6))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("target", TARGETS)
def test_one_attitude(benchmark, target, name):
    benchmark.group = f"fast coning to {target:g} rad"
    call = peers(target)[name]
    start = time.perf_counter()
    found = error(jax.block_until_ready(call()))
    compile_time = time.perf_counter() - start
    assert found <= target
    benchmark.extra_info |= {"error_rad": found, "first_call_s": compile_time, "device": str(jax.devices()[0])}
    benchmark.pedantic(lambda: jax.block_until_ready(call()), rounds=ROUNDS, warmup_rounds=2)


@pytest.mark.parametrize("target", TARGETS)
def test_ratios(target):
    """Print the best time of each method relative to Gauss–Legendre with fixed steps; all methods alternate."""
    calls = peers(target)
    found = {name: error(jax.block_until_ready(call())) for name, call in calls.items()}
    spent = {name: [] for name in calls}
    for _ in range(ROUNDS):
        for name, call in calls.items():
            for _ in range(REPEATS):
                start = time.perf_counter()
                jax.block_until_ready(call())
                spent[name].append(time.perf_counter() - start)
    best = {name: min(times) for name, times in spent.items()}
    ours = best[NAMES[0]]
    print(f"\nto {target:g} rad")
    for name, elapsed in best.items():
        print(f"  {name:32s} {elapsed * 1e6:9.0f} us  x{elapsed / ours:7.1f}  error {found[name]:.1e}")
    assert all(value <= target for value in found.values())
    assert all(best[name] > ours for name in NAMES if "diffrax" in name or "SciPy" in name)
