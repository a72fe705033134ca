"""Tune whole routes: measure the time against the number of segments, and compare with other solvers.

`python -m benchmarks.tune_route` tunes winding drives of 50 to 5 000 segments, with limits on curvature, lateral
acceleration and speed, within a tube of 0.5 m. With `--compare`, two other solvers solve the same problem. IPOPT
(through CasADi, if installed) imposes the limits at `NODES` instants of each segment, and uses exact derivatives.
L-BFGS (SciPy) minimises penalties with increasing weight. Both stop after `--seconds` of processor time, which the
output then mentions. IPOPT does not impose the limits between its instants, so its objective may be slightly smaller
than the minimum of the problem. The limits of each result are checked at a million samples. Times are processor times.

The package spline-trajectory 0.1.0 also minimises penalties with SciPy's L-BFGS, but it cannot represent this problem.
Its variables are waypoints and durations, which determine the velocities and accelerations at the joints (minimum jerk,
C⁴). Therefore it cannot represent the given route or change a velocity or an acceleration independently. It also calls
a Python function for each sample. The penalties in this benchmark are compiled, and have the same variables as the
other solvers.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt
from qtraj.design.tuning_route import constraints, rounds, setup
from qtraj.design.tuning_route.problem import objective, segments

NAMES = ("curvature", "speed", "lateral_acceleration")
BOUNDS = (0.022, 9.0, 1.4)
TUBE = 0.5
NODES = 41
SAMPLES = 1_000_000


def position(t):
    """Return the positions of a winding drive with varying speed, which is too fast in some bends."""
    s = 8 * t - 6 * np.sin(0.15 * t)
    return np.stack([s, 6 * np.sin(0.06 * s), 0.5 * np.cos(0.02 * s)], axis=-1)


def drive(count, h=1e-3):
    """Return a route with one segment for each second; both ends satisfy the limits."""
    t = np.arange(count + 1.0)
    before, here, after = position(t - h), position(t), position(t + h)
    slow = np.linalg.norm(after - before, axis=1) / (2 * h) < 0.95 * BOUNDS[1]
    calm = _lateral(here, before, after, h) < 0.5 * BOUNDS[2]
    fits = np.flatnonzero((slow & calm)[: -len(t) // 2 - 1 : -1])
    n = len(t) - int(fits[0])
    return qt.Route(t[:n], here[:n], ((after - before) / (2 * h))[:n], ((after - 2 * here + before) / h**2)[:n])


def _lateral(here, before, after, h):
    v, a = (after - before) / (2 * h), (after - 2 * here + before) / h**2
    return np.linalg.norm(np.cross(v, a), axis=1) / np.linalg.norm(v, axis=1)


def problem_of(route):
    """Return the parts of the route, and the arrays of the search."""
    given = setup.parts(route)
    joints = len(given.h) + 1
    fixed = np.zeros((joints, 3), bool)
    fixed[[0, -1]] = True
    found = setup.problem_of(given, NAMES, np.array(BOUNDS), np.full((joints, 2), TUBE), fixed, "nearest", False)
    return given, found


def sampled(route):
    """Return the largest relative violation of each limit at a million samples."""
    t = np.linspace(0, float(route.duration), SAMPLES)
    table = qt.evaluate(route, t, NAMES)
    return {name: float(np.max(table.values[name])) / bound - 1 for name, bound in zip(NAMES, BOUNDS, strict=True)}


def with_ipopt(problem, count, seconds):
    """Run IPOPT with limits at `NODES` instants of each segment; return variables, time and status."""
    import casadi as ca

    from benchmarks.route_in_casadi import MOVES, segment

    own = segment(problem, "near", "pace")
    ratio, near = own.duration / own.before, ca.reshape(own.given["near"], 6, 6)
    cost = ca.trace(own.change.T @ near @ own.change) + own.given["pace"] * (ratio - 1) ** 2
    rows = []
    for v, a, d in own.at_nodes(NODES):
        c = ca.cross(v, a)
        square, normal = ca.dot(v, v), ca.dot(c, c)
        rows += [normal / square**3 / BOUNDS[0] ** 2, square / BOUNDS[1] ** 2, normal / square / BOUNDS[2] ** 2]
        rows += [(d[0] ** 2 + d[1] ** 2) / TUBE**2, d[2] ** 2 / TUBE**2]
    one = ca.Function("one", [*own.variables, *own.given.values()], [cost, ca.vertcat(*rows), ratio])
    z = ca.MX.sym("z", MOVES, count + 1)
    constant = [x.reshape(-1, count) for x in own.data.values()]
    costs, limits, ratios = one.map(count)(z[:, :-1], z[:, 1:], *constant)
    free = problem.free.ravel()
    nlp = {"x": ca.vec(z), "f": ca.sum2(costs), "g": ca.vertcat(ca.vec(limits), ca.vec(ratios))}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-8, "ipopt.max_cpu_time": seconds}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    wide = np.where(free > 0, np.inf, 0.0)
    top = np.concatenate([np.ones(limits.numel()), np.full(count, 10.0)])
    bottom = np.concatenate([np.full(limits.numel(), -np.inf), np.full(count, 0.1)])
    start = time.process_time()
    found = solver(x0=np.zeros(free.size), lbx=-wide, ubx=wide, lbg=bottom, ubg=top)
    spent = time.process_time() - start
    values = np.array(found["x"]).reshape(problem.free.shape)
    return values, spent, f"{solver.stats()['return_status']}, {solver.stats()['iter_count']} steps"


def with_penalties(problem, seconds):
    """Minimise quadratic penalties at the nodes with L-BFGS, with weights up to 1e4; returns are as in `with_ipopt`."""
    from scipy.optimize import minimize

    free = np.flatnonzero(problem.free)

    @jax.jit
    def cost(x, weight):
        def value(x):
            z = jnp.zeros(problem.free.size).at[free].set(x).reshape(problem.free.shape)
            s = segments(problem, z)
            excess = (constraints.values(problem, s) - 1) * problem.used
            return objective(problem, s) + weight * jnp.sum(jnp.maximum(excess, 0) ** 2)

        return jax.value_and_grad(value)(x)

    x, count = np.zeros(free.size), 0
    cost(x, 1.0)[0].block_until_ready()
    start = time.process_time()

    def stop_in_time(_):
        if time.process_time() - start > seconds:
            raise StopIteration

    for weight in (1e1, 1e2, 1e3, 1e4):
        found = minimize(
            lambda x, weight=weight: tuple(map(np.asarray, cost(x, weight))),
            x,
            jac=True,
            method="L-BFGS-B",
            callback=stop_in_time,
            options={"maxiter": 5000, "maxfun": 10000},
        )
        x, count = found.x, count + found.nit
    spent = time.process_time() - start
    z = np.zeros(problem.free.size)
    z[free] = x
    text = f"{count} steps{', stopped' if spent > seconds else ''}"
    return z.reshape(problem.free.shape), spent, text


def timed(route, limits):
    """Return the tuned route and the processor time [s]."""
    start = time.process_time()
    best = qt.tune_route(route, limits, tube=TUBE)
    return best, time.process_time() - start


def report(name, route, given, problem, z, spent, text):
    """Print one line with objective, time and the violations at the samples."""
    judged = rounds.judge(route, given, qt.Limits(), np.full((len(given.h) + 1, 2), TUBE), problem, z)
    value = float(rounds.attained(problem, z))
    worst = ", ".join(f"{key} {x:+.1e}" for key, x in sampled(judged.route).items())
    print(f"{name}: objective {value:.8g}, {spent:.2f} s ({text}); largest violations: {worst}", flush=True)


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("segments", type=int, nargs="*", default=[50, 500, 5000])
    parser.add_argument("--compare", action="store_true")
    parser.add_argument("--seconds", type=float, default=600.0)
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    limits = qt.Limits(**dict(zip(NAMES, BOUNDS, strict=True)))
    for count in chosen.segments:
        route = drive(count)
        best, first = timed(route, limits)
        warm = min(timed(route, limits)[1] for _ in range(3))
        print(
            f"{route.segments} segments: first {first:.1f} s, warm {warm:.2f} s; "
            f"{best.iterations} steps, objective {float(best.objective):.8g}, proved {best.certificate.holds}",
            flush=True,
        )
        print("  largest violations:", ", ".join(f"{k} {v:+.1e}" for k, v in sampled(best.path).items()), flush=True)
        if chosen.compare:
            given, problem = problem_of(route)
            try:
                report("  IPOPT", route, given, problem, *with_ipopt(problem, route.segments, chosen.seconds))
            except ImportError:
                print("  IPOPT: CasADi is not installed")
            report("  L-BFGS on penalties", route, given, problem, *with_penalties(problem, chosen.seconds))


if __name__ == "__main__":
    main()
