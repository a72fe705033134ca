"""Compare a batch of tunings with SciPy's SLSQP, in processor time:  python -m benchmarks.tuning.batches

The uniform problems have a curvature limit, and the hermite problems limits on curvature and lateral acceleration. The
ratio is for one start, from the initial states. The time of qtraj includes certificates; SLSQP has exact derivatives
from JAX, compiled before the measurement, and is measured without checks of its results.
"""

import argparse
import time
from functools import partial
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402  (after float64 is enabled)
import numpy as np  # noqa: E402
from scipy.optimize import minimize  # noqa: E402

import qtraj as qt  # noqa: E402
from benchmarks.tuning.problems import Problems, problems  # noqa: E402
from benchmarks.tuning.slsqp import INSTANTS, OPTIONS, take  # noqa: E402
from qtraj.design.tuning.motions.registry import get_motion  # noqa: E402
from qtraj.design.tuning.objectives.nearest import Nearest  # noqa: E402
from qtraj.design.tuning.problem import Problem, pose  # noqa: E402
from qtraj.path.values import squared  # noqa: E402

SEED = 7
SHARE = (0.86, 1.0)  # range of limits on lateral acceleration, as a fraction of the peak on the initial path
LIMITS = {"uniform": ("curvature",), "hermite": ("curvature", "lateral_acceleration")}


@partial(jax.jit, static_argnums=0)
def functions(names: tuple[str, ...], problem: Problem, limits: Any, z: Any) -> tuple[Any, Any, Any, Any]:
    """Return the cost and the constraint values at all instants, and the derivatives of both."""

    def both(z: Any) -> tuple[Any, Any]:
        path = problem.path(z)
        times = jnp.linspace(0.0, 1.0, INSTANTS) * path.duration
        values = [jax.vmap(lambda t, n=name: squared(path, t, n))(times) for name in names]
        return problem.cost(z), jnp.concatenate([0.5 * (1 - x / y**2) for x, y in zip(values, limits, strict=True)])

    (cost, margin), (slope, jacobian) = both(z), jax.jacfwd(both)(z)
    return cost, margin, slope, jacobian


def by_slsqp(names: tuple[str, ...], problem: Problem, limits: np.ndarray) -> None:
    """Solve one problem."""
    known: dict[bytes, Any] = {}

    def at(z: np.ndarray) -> Any:
        key = z.tobytes()
        if key not in known:
            known.clear()
            known[key] = jax.device_get(functions(names, problem, limits, z))
        return known[key]

    margins = {"type": "ineq", "fun": lambda z: at(z)[1], "jac": lambda z: at(z)[3]}
    minimize(
        lambda z: float(at(z)[0]),
        np.zeros(problem.size),
        jac=lambda z: at(z)[2],
        constraints=margins,
        method="SLSQP",
        options=OPTIONS,
    )


def compare(motion: str, given: Problems, tried: int) -> None:
    """Print the processor time of both solvers for problems of one motion."""
    names, rng = LIMITS[motion], np.random.default_rng(SEED)
    posed = pose(given.starts, given.ends, Nearest(), get_motion(motion))
    peaks = np.stack([jax.jit(jax.vmap(lambda p, n=name: qt.peak(p, n)[1]))(posed.path(posed.zero)) for name in names])
    numbers = peaks * rng.uniform(*SHARE, peaks.shape)
    numbers[0] = given.limits
    limits = jax.vmap(lambda x: qt.Limits(**dict(zip(names, x, strict=True))))(jnp.asarray(numbers.T))
    seconds = []
    for starts in (1, 8):
        begun = time.process_time()
        best = qt.tune(given.starts, given.ends, limits, motion=motion, starts=starts)
        seconds.append((time.process_time() - begun) / given.limits.size)
        print(f"{motion}, {starts} start(s): {1e3 * seconds[-1]:.2f} ms per problem. {str(best).splitlines()[0]}")
    by_slsqp(names, take(posed, 0), numbers[:, 0])
    begun = time.process_time()
    for k in range(tried):
        by_slsqp(names, take(posed, k), numbers[:, k])
    rival = (time.process_time() - begun) / tried
    print(f"{motion}, SLSQP: {1e3 * rival:.2f} ms per problem, {rival / seconds[0]:.1f} times the time of one start")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=1000)
    parser.add_argument("--slsqp", type=int, default=100, help="number of problems that SLSQP solves")
    chosen = parser.parse_args()
    given = problems(chosen.problems, SEED)
    for motion in LIMITS:
        compare(motion, given, min(chosen.slsqp, chosen.problems))


if __name__ == "__main__":
    main()
