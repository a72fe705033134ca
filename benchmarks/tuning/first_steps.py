"""Compare "sqp" with first steps of an optax optimiser:  python -m benchmarks.tuning.first_steps [--problems N]"""

import argparse
import time
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402  (after float64 is enabled)
import numpy as np  # noqa: E402
import optax  # noqa: E402

import qtraj as qt  # noqa: E402
from benchmarks.tuning.problems import problems  # noqa: E402

SEED = 7
EQUAL = 1e-6  # relative difference of objectives that count as equal
ADAM = optax.adam(1e-2)
MANY = 64  # number of starts of the last two rows, for a tenth of the problems


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=1000)
    count = parser.parse_args().problems
    given = problems(count, SEED)
    limits = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.asarray(given.limits))
    every = (given.starts, given.ends, limits)
    few = jax.tree.map(lambda x: x[: max(1, count // 10)], every)
    print("| problems | starts | method | CPU time per problem | proved | as good as sqp with 8 starts | better |")
    print("|---|---|---|---|---|---|---|")
    best = qt.tune(*every, starts=8)
    for data, starts in ((every, 1), (every, 8), (few, MANY)):
        for name, method in (("sqp", "sqp"), ("adam", ADAM)):
            print(row(data, starts, name, method, np.asarray(best.objective)), flush=True)


def row(data: tuple[Any, ...], starts: int, name: str, method: Any, best: np.ndarray) -> str:
    """Return a row of the table; compilation is not part of the time."""
    qt.tune(*jax.tree.map(lambda x: x[:1], data), starts=starts, method=method)
    qt.tune(*data, starts=starts, method=method)
    begun = time.process_time()
    found = qt.tune(*data, starts=starts, method=method)
    count = found.objective.size
    each = (time.process_time() - begun) / count
    ratio = np.asarray(found.objective) / best[:count]
    proved, equal, better = (int(np.sum(x)) for x in (found.certificate.holds, ratio <= 1 + EQUAL, ratio < 1 - EQUAL))
    return f"| {count} | {starts} | {name} | {1e3 * each:.1f} ms | {proved} | {equal} | {better} |"


if __name__ == "__main__":
    main()
