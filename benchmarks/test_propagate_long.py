"""Solve one long problem to 1e-10 rad: 3700 cones in 10 000 s (β = 10°, Ω = 0.74π).

An eighth-order method needs about 1e5 steps. For a known rate, qtraj computes and multiplies the steps in parallel,
whereas an ODE solver takes one step after the other. For comparison, `one_after_another` performs the steps of qtraj in
a sequential scan.
"""

import functools

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.algebra import quaternion
from qtraj.motion.propagation.increment import products

from .coning import Batch, rate, with_diffrax, with_scipy, with_steps
from .race import decades, loosest, race, report, seconds

TARGET, ROUNDS, STEPS = 1e-10, 7, 100_000
CLOSEST = 5e-10
"""Error [rad] of DOP853 at the tightest tolerance that SciPy accepts."""
PROBLEM = Batch(np.radians([10.0]), np.array([0.74 * np.pi]), 1e4)
FEWEST = {"Gauss-Legendre 8": range(9000, 12001, 500), "Gauss-Legendre 4": range(100_000, 120_001, 5000)}

PEERS = {
    "Gauss-Legendre 8": (with_steps(PROBLEM, qt.GaussLegendre(8)), FEWEST["Gauss-Legendre 8"]),
    "Gauss-Legendre 4": (with_steps(PROBLEM, qt.GaussLegendre(4)), FEWEST["Gauss-Legendre 4"]),
    "diffrax Tsit5": (with_diffrax(PROBLEM, diffrax.Tsit5()), decades(-12, -14, 8)),
    "diffrax Dopri8": (with_diffrax(PROBLEM, diffrax.Dopri8()), decades(-13, -15, 8)),
    "SciPy DOP853": (with_scipy(PROBLEM), [2.3e-14]),
}


def one_after_another(method, steps):
    """Return a function that computes and multiplies the steps of `propagate` one after the other."""

    @jax.jit
    def call(first):
        h, nodes = PROBLEM.end / steps, jnp.asarray(method.nodes)
        omega = functools.partial(rate, PROBLEM.beta[0], PROBLEM.omega[0])

        def step(q, k):
            rates = jax.vmap(omega)((k + nodes) * h)
            return quaternion.product(q, method.increment(rates, jnp.asarray(h))), None

        return jax.lax.scan(step, first, jnp.arange(steps, dtype=float))[0][None]

    return functools.partial(call, jnp.asarray(PROBLEM.at(0.0)[0]))


@functools.cache
def tuned(name):
    """Return (call without arguments, setting, error, seconds of the first call) for one of the `PEERS`."""
    call, settings = PEERS[name]
    first = 0.0 if "SciPy" in name else seconds(lambda: call(settings[0]))
    target = CLOSEST if "SciPy" in name else TARGET
    setting, found = loosest(call, settings, PROBLEM.error, target)
    return functools.partial(call, setting), setting, found, first


@pytest.mark.benchmark(group="10 000 s of coning to 1e-10 rad")
@pytest.mark.parametrize("name", [name for name in PEERS if "SciPy" not in name])
def test_long(benchmark, name):
    call, setting, found, first = tuned(name)
    benchmark.extra_info |= {"setting": setting, "error_rad": found, "first_call_s": first, "jax": jax.__version__}
    assert found <= TARGET
    benchmark.pedantic(lambda: jax.block_until_ready(call()), rounds=3, warmup_rounds=1)


def test_ratios():
    runners = {name: tuned(name)[0] for name in PEERS}
    remarks = {
        name: f"{tuned(name)[1]:.4g}, error {tuned(name)[2]:.1e}, first {tuned(name)[3]:.1f} s" for name in PEERS
    }
    slow = {"SciPy DOP853": runners.pop("SciPy DOP853")}
    spent = race(runners, ROUNDS) | race(slow, 1)
    ratios = report("10 000 s of coning to 1e-10 rad", spent, remarks)
    assert min(ratio for name, ratio in ratios.items() if "diffrax" in name or "SciPy" in name) > 3


@pytest.mark.parametrize("stages", [8, 4])
def test_parallel_in_time(stages):
    """Compare 1e5 steps in parallel with the same steps one after the other."""
    method = qt.GaussLegendre(stages)
    at_once = functools.partial(with_steps(PROBLEM, method), STEPS)
    in_turn = one_after_another(method, STEPS)
    np.testing.assert_allclose(at_once(), in_turn(), rtol=0, atol=2e-10)
    ratios = report(
        f"1e5 steps of Gauss-Legendre {stages}",
        race({"at once": at_once, "one after another": in_turn}, ROUNDS),
        {"at once": f"error {PROBLEM.error(at_once()):.1e}", "one after another": ""},
    )
    assert ratios["one after another"] > 2


def test_products_alone():
    """Time only the product of 1e5 known rotations, for which a compiled loop is hard to beat on few cores."""
    turns = jax.jit(jax.vmap(qt.rotation.from_rotation_vector))(0.1 * np.random.default_rng(0).normal(size=(STEPS, 3)))

    @jax.jit
    def in_turn(turns):
        def onwards(total, turn):
            total = quaternion.product(total, turn)
            return total, total

        return jax.lax.scan(onwards, jnp.asarray([1.0, 0.0, 0.0, 0.0]), turns)[1]

    at_once = jax.jit(products)
    np.testing.assert_allclose(at_once(turns), in_turn(turns), rtol=0, atol=1e-12)
    runners = {"at once": lambda: at_once(turns), "one after another": lambda: in_turn(turns)}
    report("1e5 products", race(runners, 50), dict.fromkeys(runners, ""))
