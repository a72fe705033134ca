"""Tune with random own objectives whose optimum is known:  python -m benchmarks.tuning.own_objectives [--problems N]

An objective is factor·(q + constant). The factor and the magnitude of the constant span 16 decades. q is a random sum
of convex functions, whose minimum is at random boundary velocities and a random duration, or at a bound on the
duration.
"""

import argparse
import time
from typing import Any, NamedTuple

import equinox as eqx
import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402  (after float64 is enabled)
import numpy as np  # noqa: E402

import qtraj as qt  # noqa: E402

METHODS = ("sqp", "lbfgs", "adam")
SEED = 11
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1])
DURATION, SPEED = 4.6, 8.6
WIDE = qt.Limits(speed=1e4)
DECADES = (-8.0, 8.0)  # of the factor and of the constant
STEEP = (0.0, 6.0)  # decades of the steepness of a kink
CONDITION = 10.0  # largest ratio of the scales of the variables
ERROR = 1e-4  # largest error of a variable of an optimum that counts as found


class Own(eqx.Module):
    """An objective with a known minimum; its arrays are arguments of the compiled search."""

    target: Any  # boundary velocities in units of SPEED, and ln(duration/DURATION)
    mixing: Any  # (7, 7)
    weights: Any  # (5,) of the convex functions
    steepness: Any
    factor: Any
    constant: Any

    def __call__(self, path: qt.SpiralHelix) -> Any:
        """Return factor·(q + constant)."""
        x = self.mixing @ (variables(path) - self.target)
        below = jax.nn.relu(-0.1 - x)
        terms = (x**2, x**4, jnp.log(jnp.cosh(x)), jnp.exp(x) - x - 1, self.steepness * below**2)
        q = sum(weight * jnp.sum(term) for weight, term in zip(self.weights, terms, strict=True))
        return self.factor * (q + self.constant)


class Drawn(NamedTuple):
    """An objective, the lower bound on the duration [s], and the variables of the optimum."""

    objective: Own
    shortest: float
    optimum: np.ndarray


def variables(path: qt.SpiralHelix) -> Any:
    """Return the cylindrical boundary velocities in units of `SPEED`, and ln(duration/DURATION), (7,)."""
    ends = [path.rotating_derivatives(t, 1)[1] for t in (jnp.zeros(()), path.duration)]
    return jnp.concatenate([*(v / SPEED for v in ends), jnp.log(path.duration / DURATION)[None]])


def problems(count: int, seed: int) -> list[Drawn]:
    """Return random objectives, reproducible by `seed`; a third of the optima is at a bound on the duration."""
    random, initial = np.random.default_rng(seed), np.asarray(variables(qt.SpiralHelix.hermite(START, END, DURATION)))
    return [_drawn(random, initial, k % 3 == 0) for k in range(count)]


def _drawn(random: np.random.Generator, initial: np.ndarray, at_bound: bool) -> Drawn:
    target = initial + random.uniform(-0.3, 0.3, 7)
    scales = CONDITION ** random.uniform(0, 1, 7)
    mixed = 6 if at_bound else 7  # at the bound, the duration is separate from the velocities
    mixing = np.eye(7)
    mixing[:mixed, :mixed] = np.linalg.qr(random.standard_normal((mixed, mixed)))[0]
    mixing, shortest, optimum = mixing * scales, DURATION * np.exp(-2.0), target.copy()
    if at_bound:
        optimum[6] = target[6] + 0.2
        shortest = DURATION * np.exp(optimum[6])
    weights = np.array([random.uniform(0.3, 1.0), *(random.uniform(0, 1, 4) * (random.uniform(size=4) < 0.5))])
    steepness, factor, size = (10.0 ** random.uniform(*x) for x in (STEEP, DECADES, DECADES))
    constant = size * random.choice([-1.0, 1.0])
    arrays = (jnp.asarray(x) for x in (target, mixing, weights, steepness, factor, constant))
    return Drawn(Own(*arrays), float(shortest), optimum)


def found(drawn: list[Drawn], method: Any, starts: int = 1) -> np.ndarray:
    """Return the largest error of the variables of each solution; infinity if the search did not converge."""
    errors = []
    for own in drawn:
        bounds = {"duration": (own.shortest, 10 * DURATION)}
        best = qt.tune(
            START, END, WIDE, own.objective, "hermite", DURATION, bounds=bounds, method=method, starts=starts
        )
        error = np.abs(np.asarray(variables(best.path)) - own.optimum).max()
        errors.append(error if best.converged else np.inf)
    return np.asarray(errors)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=300)
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    chosen = parser.parse_args()
    drawn = problems(chosen.problems, SEED)
    for method in chosen.methods:
        found(drawn[:1], method)  # compilation
        began = time.perf_counter()
        errors = found(drawn, method)
        seconds = (time.perf_counter() - began) / len(drawn)
        known = errors[np.isfinite(errors)]
        print(
            f"{method}: {np.sum(errors < ERROR)} of {len(drawn)} optima found, {known.size} converged, largest error "
            f"{known.max(initial=0.0):.1e}, median {np.median(known):.1e}; {seconds:.2f} s per problem",
            flush=True,
        )


if __name__ == "__main__":
    main()
