"""Simulate many closed loops of very different stiffness, in one batch or in blocks, beside plain diffrax.

python -m benchmarks.loops [--loops N]
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import diffrax  # noqa: E402  (after float64 is enabled)
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402

import qtraj as qt  # noqa: E402

SEED, DURATION = 7, 20.0
RTOL, ATOL = 1e-10, 1e-12
SAME = 1e-7  # largest difference of the errors of attitude; both solvers have the tolerances above
PROGRAM = qt.FrameProgram(qt.SpiralHelix([20.0, 1.0], [0.2, 0.35], [1.0, 0.4], DURATION))
TIMES = jnp.linspace(0.0, DURATION, 21)
BEGIN = PROGRAM(0.0)


def start(c: Any) -> tuple[Any, Any]:
    """Return the first quaternion and rate (4,) [rad/s], with an error of attitude of the size c."""
    q = qt.quaternion.product(jnp.asarray(BEGIN.quaternion), jnp.stack([1 - 0 * c, c, -c, 0.5 * c]))
    return q, jnp.concatenate([jnp.zeros(1), jnp.asarray(BEGIN.rate)])


def law(k: Any) -> qt.AccelerationLaw:
    """Return the critically damped law with two poles at −k [1/s]."""
    return qt.AccelerationLaw(2 * k, k**2)


def with_qtraj(k: Any, c: Any) -> Any:
    """Return the quaternions of one loop."""
    return qt.simulate(PROGRAM, law(k), *start(c), TIMES, rtol=RTOL, atol=ATOL).quaternion


def with_diffrax(k: Any, c: Any) -> Any:
    """Return the quaternions of one loop: λ̇ = ½λ∘ω and ω̇ = ε, solved by one call of diffrax."""

    def field(t: Any, y: Any, _: Any) -> Any:
        q, rate = y[:4], y[4:]
        return jnp.concatenate([qt.quaternion.derivative(q, rate), law(k)(PROGRAM(t), q, rate)])

    found = diffrax.diffeqsolve(
        diffrax.ODETerm(field), diffrax.Dopri8(), 0.0, DURATION, 0.01, jnp.concatenate(start(c)),
        saveat=diffrax.SaveAt(ts=TIMES), stepsize_controller=diffrax.PIDController(RTOL, ATOL), max_steps=100_000,
    )  # fmt: skip
    return jnp.asarray(found.ys)[:, :4]


def spent(call: Callable[[], Any]) -> tuple[float, float, Any]:
    """Return CPU seconds and seconds of a call, and its result."""
    cpu, begun = time.process_time(), time.perf_counter()
    found = jax.block_until_ready(call())
    return time.process_time() - cpu, time.perf_counter() - begun, np.asarray(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=512)
    count = parser.parse_args().loops
    rng = np.random.default_rng(SEED)
    k, c = 10 ** rng.uniform(0, 2, count), rng.uniform(-0.3, 0.3, count)
    mapped, plain = jax.jit(jax.vmap(with_qtraj)), jax.jit(jax.vmap(with_diffrax))
    calls = {
        "diffrax, jit(vmap)": lambda k, c: plain(k, c),
        "simulate, jit(vmap)": lambda k, c: mapped(k, c),
        "simulate, in_blocks": lambda k, c: qt.in_blocks(with_qtraj, k, c),
        "simulate, in_blocks, cost": lambda k, c: qt.in_blocks(with_qtraj, k, c, cost=k),
    }
    print(f"| {count} loops of {DURATION:g} s | CPU time [s] | time [s] | time of a first call with {count - 9} [s] |")
    print("|---|---|---|---|")
    expected = None
    for name, call in calls.items():
        spent(lambda call=call: call(k, c))
        cpu, seconds, found = spent(lambda call=call: call(k, c))
        expected = found if expected is None else expected
        worst = np.max(np.abs(found - expected))
        if not worst <= SAME:
            raise SystemExit(f"{name} differs from diffrax by {worst:.2g}")
        _, other, _ = spent(lambda call=call: call(k[:-9], c[:-9]))
        print(f"| {name} | {cpu:.2f} | {seconds:.2f} | {other:.2f} |", flush=True)


if __name__ == "__main__":
    main()
