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
COLUMNS = (
    "problems",
    "starts",
    "method",
    "CPU time per problem",
    "over sqp",
    "proved",
    "as good as sqp with 8 starts",
    "better",
)
MANY = 64  # number of starts of the last two rows, for a tenth of the problems


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=1000)
    count = parser.parse_args().problems
    given = problems(count, SEED)
    limits = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.asarray(given.limits))
    every = (given.starts, given.ends, limits)
    few = jax.tree.map(lambda x: x[: max(1, count // 10)], every)
    print(f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|")
    best = qt.tune(*every, starts=8)
    for data, starts in ((every, 1), (every, 8), (few, MANY)):
        usual = None
        for name, method in (("sqp", "sqp"), ("adam", ADAM)):
            each, counts = measured(data, starts, method, np.asarray(best.objective))
            usual = each if usual is None else usual
            cells = (len(data[0].position), starts, name, f"{1e3 * each:.1f} ms", f"{each / usual:.2g}", *counts)
            print(f"| {' | '.join(map(str, cells))} |", flush=True)


def measured(data: tuple[Any, ...], starts: int, method: Any, best: np.ndarray) -> tuple[float, tuple[int, ...]]:
    """Return the CPU time per problem [s] without compilation, and the numbers of the last three columns."""
    if method != "sqp":
        qt.tune(*data, starts=starts, method=method)
    begun = time.process_time()
    found = qt.tune(*data, starts=starts, method=method)
    count = found.objective.size
    each = (time.process_time() - begun) / count
    ratio = np.asarray(found.objective) / best[:count]
    return each, tuple(int(np.sum(x)) for x in (found.certificate.holds, ratio <= 1 + EQUAL, ratio < 1 - EQUAL))


if __name__ == "__main__":
    main()
