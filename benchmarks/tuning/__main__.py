"""Compare qtraj, SLSQP and IPOPT on the same random problems:  python -m benchmarks.tuning [--problems N]"""

import argparse
import time

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402  (after float64 is enabled)
import numpy as np  # noqa: E402

import qtraj as qt  # noqa: E402
from benchmarks.tuning import ipopt, slsqp  # noqa: E402
from benchmarks.tuning.problems import Problems, problems  # noqa: E402
from qtraj.design.tuning.multistart import starting_points  # noqa: E402

SEED = 7
FEASIBLE = 1 + 1e-10
WORSE = 1e-6  # tolerance relative to the best cost, or to a thousandth of V_ref² if that is larger
REPEATS = 3
SOLVED_BY_SLSQP = 200  # number of problems in the comparison of speed
RACED = (1, 8)  # numbers of starts
NONE = np.zeros(slsqp.ADDED)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--slsqp-starts", type=int, default=16)
    parser.add_argument("--ipopt-starts", type=int, default=4)
    parser.add_argument("--own-starts", type=int, default=8, help="number of starts for qtraj")
    parser.add_argument(
        "--batch", type=int, default=1000, help="number of problems in the comparison of speed (0: none)"
    )
    chosen = parser.parse_args()
    if chosen.batch:
        race(chosen.batch)
    given = problems(chosen.problems, SEED)
    ours, seconds = own(given, chosen.own_starts)
    single = own(given, 1)[1]
    rivals = {
        "SLSQP": best_of(given, chosen.slsqp_starts, slsqp.solve),
        "IPOPT": best_of(given, chosen.ipopt_starts, ipopt.solve),
    }
    report(chosen, given, ours, seconds, single, rivals)


def race(count: int) -> None:
    """Solve a batch of problems with qtraj, including certificates, and some of them with SLSQP, without checks.

    SLSQP starts from the initial states only. qtraj runs before and after SLSQP, because the speed of the machine may
    change.
    """
    given = problems(count, SEED)
    before = {starts: own(given, starts) for starts in RACED}
    rival, median = by_slsqp(given, min(count, SOLVED_BY_SLSQP))
    print(f"SLSQP, one by one: {1e3 * rival:.2f} ms per problem on average, {1e3 * median:.2f} ms median")
    for starts, (best, spent) in before.items():
        each = (spent + own(given, starts)[1]) / 2 / count
        print(f"qtraj, {starts} start(s): {1e3 * each:.2f} ms per problem, amortised over a batch of {count},", end=" ")
        print(f"{rival / each:.1f} times as fast as SLSQP on average; {best}\n")


def by_slsqp(given: Problems, tried: int) -> tuple[float, float]:
    """Return the mean and the median time [s] of one run."""
    seconds, solved = [], 0
    compile_first(given, slsqp.solve)
    for k in range(tried):
        problem, limit = slsqp.take(given.posed, k), float(given.limits[k])
        begun = time.perf_counter()
        z = slsqp.minimised(problem, limit, np.zeros(problem.size), NONE)
        seconds.append(time.perf_counter() - begun)
        found = slsqp.exchanged(problem, limit, slsqp.outcome(problem, limit, z))
        solved += found.ratio <= FEASIBLE
    print(f"SLSQP satisfies the limit in {solved} of {tried} problems, after its own peaks are added to the instants")
    return float(np.mean(seconds)), float(np.median(seconds))


def compile_first(given: Problems, solve) -> None:
    """Solve the first problem once, so that no measured time includes compilation."""
    problem = slsqp.take(given.posed, 0)
    solve(problem, float(given.limits[0]), np.zeros(problem.size), NONE)


def own(given: Problems, starts: int) -> tuple[qt.Tuned, float]:
    """Return the result of one batch, and its time [s] without compilation."""
    limits = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.asarray(given.limits))
    best = jax.block_until_ready(qt.tune(given.starts, given.ends, limits, starts=starts))
    seconds = []
    for _ in range(REPEATS):
        begun = time.perf_counter()
        jax.block_until_ready(qt.tune(given.starts, given.ends, limits, starts=starts))
        seconds.append(time.perf_counter() - begun)
    return best, float(np.median(seconds))


def best_of(given: Problems, starts: int, solve) -> tuple[np.ndarray, float]:
    """Return the smallest feasible cost of each problem, and the time [s] of one run from the initial states."""
    costs, seconds = np.full(given.limits.size, np.inf), []
    points = starting_points(given.posed.names, starts)
    compile_first(given, solve)
    for k, limit in enumerate(map(float, given.limits)):
        problem = slsqp.take(given.posed, k)
        for place, point in enumerate(points):
            begun = time.perf_counter()
            found = solve(problem, limit, point, NONE)
            if place == 0:
                seconds.append(time.perf_counter() - begun)
            for _ in range(slsqp.EXCHANGES):
                if found.ratio <= FEASIBLE or found.ratio > 1.01 or found.cost > costs[k]:
                    break
                found = solve(problem, limit, found.z, np.asarray(slsqp.refined_peak(problem, limit, found.z)[0]))
            if found.ratio <= FEASIBLE:
                costs[k] = min(costs[k], found.cost)
    return costs, float(np.mean(seconds))


def report(chosen, given: Problems, ours: qt.Tuned, seconds: float, single: float, rivals: dict) -> None:
    """Print the table of docs/tuning.md, and the problems for which qtraj was not among the best."""
    own_costs = np.asarray(ours.objective) / np.asarray(given.posed.scale)
    own_costs = np.where(ours.converged, own_costs, np.inf)
    least = np.min([own_costs, *(costs for costs, _ in rivals.values())], axis=0)
    allowed = least + WORSE * np.maximum(least, 1e-3)
    each = 1e3 / chosen.problems
    print("| solver | starts | solved | best of all | time per problem, one start |")
    print("|---|---|---|---|---|")
    rows = {"qtraj": (own_costs, single / chosen.problems, chosen.own_starts)}
    starts_of = {"SLSQP": chosen.slsqp_starts, "IPOPT": chosen.ipopt_starts}
    rows |= {name: (costs, one, starts_of[name]) for name, (costs, one) in rivals.items()}
    for name, (costs, one, starts) in rows.items():
        good = int(np.sum(costs <= allowed))
        print(f"| {name} | {starts} | {int(np.isfinite(costs).sum())} | {good} | {1e3 * one:.2f} ms |")
    print(
        "\n'Solved' and 'best of all' use all starts. The time is for one start with its check; for qtraj, amortised."
    )
    print(f"qtraj with {chosen.own_starts} starts: {each * seconds:.2f} ms per problem, certificates included.")
    print(ours)
    for k in np.flatnonzero(~(own_costs <= allowed)):
        others = ", ".join(f"{name} {costs[k]:.9g}" for name, (costs, _) in rivals.items())
        print(f"problem {k}: qtraj {own_costs[k]:.9g} ({ours[int(k)].status}), {others}")


if __name__ == "__main__":
    main()
