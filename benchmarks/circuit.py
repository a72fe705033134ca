"""Find the fastest lap of a circuit in a tube about its centre line, with `tune_route` and with IPOPT.

`python -m benchmarks.circuit` uses a circuit with straights, a chicane and a hairpin (776 m, 80 segments; see
`SECTIONS`). The search starts from a slow lap along the centre line. It minimises the lap time within limits on speed,
lateral and longitudinal acceleration, and within `TUBE` on either side. IPOPT (through CasADi, if installed) solves the
same problem from the same start: quintics between the joints, the same variables, the first joint equal to the last
one, limits at `NODES` instants of each segment, and exact derivatives. IPOPT first minimises the duration alone, and
then the objective of `tune_route`, which contains a small jerk term. Each run has at most `STEPS` steps. The limits of
the laps are checked at a million samples.

The lap along the centre line is the second of three laps that `retime` computes together, so neither its start speed
nor its end speed is prescribed. The fastest lap is retimed in the same way, which shows how much faster its line can be
driven. Times are processor times.
"""

import argparse
import time

import jax
import numpy as np

import qtraj as qt
from qtraj.design.tuning_route import many_starts, rounds, setup
from qtraj.design.tuning_route.problem import JERK
from qtraj.design.tuning_route.tube import Displacement
from qtraj.design.tuning_route.tune_route import _solution

LIMITS = {"speed": 40.0, "lateral_acceleration": 9.0, "longitudinal_acceleration": 5.0}
TUBE, SLOW, COUNT = 3.0, 5.0, 80
NODES, STEPS, SAMPLES, KNOTS = 21, 300, 1_000_000, 1024

SECTIONS = (
    (0, 0),
    (70, 90),
    (60, 0),
    (90, 110),
    (50, 0),
    (32, -55),
    (32, 55),
    (90, 0),
    (62, 180),
    (80, 0),
    (75, -110),
    (0, 0),
    (75, 90),
)
"""Lengths [m] and angles [°] of straights and bends. The two straights without a length are at right angles and close
the circuit. The curvature of a bend is proportional to sin²."""

STRAIGHTS = (0, 11)


def followed(sections, parts=400):
    """Return arc length, position (n, 2), heading and curvature along sections."""
    q = np.linspace(0, 1, 2 * parts + 1)
    s, heading, x, bent = [0.0], [0.0], [np.zeros(2)], [0.0]
    for length, angle in sections:
        turn = np.radians(angle)
        all_headings = heading[-1] + turn * (q - np.sin(2 * np.pi * q) / (2 * np.pi))
        along = np.stack([np.cos(all_headings), np.sin(all_headings)], axis=-1)
        steps = (along[:-2:2] + 4 * along[1::2] + along[2::2]) * length / (6 * parts)
        if length:
            x.extend(x[-1] + np.cumsum(steps, axis=0))
            s.extend(s[-1] + q[2::2] * length)
            heading.extend(all_headings[2::2])
            bent.extend(turn / length * (1 - np.cos(2 * np.pi * q[2::2])))
    return tuple(np.array(a) for a in (s, x, heading, bent))


def closed_sections():
    """Return the sections, with the lengths of both straights that close the circuit."""
    sections = [list(section) for section in SECTIONS]
    gap = followed(sections)[1][-1]
    sections[STRAIGHTS[0]][0], sections[STRAIGHTS[1]][0] = -gap[0], gap[1]
    return sections


def centre_line(count=COUNT, speed=SLOW):
    """Return the centre line at a low constant speed, with `count` segments of equal length."""
    s, x, heading, bent = followed(closed_sections())
    at = np.linspace(0, s[-1], count + 1)
    heading, bent = (np.interp(at, s, a) for a in (heading, bent))
    along = np.stack([np.cos(heading), np.sin(heading), 0 * at], axis=1)
    left = np.stack([-np.sin(heading), np.cos(heading), 0 * at], axis=1)
    position = np.stack([np.interp(at, s, x[:, 0]), np.interp(at, s, x[:, 1]), 0 * at], axis=1)
    position[-1] = position[0]
    return qt.Route(at / speed, position, speed * along, (speed**2 * bent)[:, None] * left)


def retimed_lap(route, limits):
    """Return the time [s] of the second of three laps, whether all limits are proved, and the processor time [s]."""
    start = time.process_time()
    timed = qt.retime(route + route + route, limits, knots=KNOTS)
    once = float(route.duration)
    lap = float(timed.timing.time(2 * once)) - float(timed.timing.time(once))
    return lap, bool(timed.certificate.holds), time.process_time() - start


def fastest_along_sections(parts=4000):
    """Return the minimum lap time along the centre line, from the curvature, by forward and backward passes."""
    s, _, _, bent = followed(closed_sections(), parts)
    s, first = np.unique(s, return_index=True)
    top = LIMITS["lateral_acceleration"] / np.maximum(np.abs(bent[first]), 1e-9)
    square, gain = np.minimum(top, LIMITS["speed"] ** 2), 2 * LIMITS["longitudinal_acceleration"] * np.diff(s)
    for _ in range(2):
        for k in range(len(gain)):
            square[k + 1] = min(square[k + 1], square[k] + gain[k])
        for k in range(len(gain), 0, -1):
            square[k - 1] = min(square[k - 1], square[k] + gain[k - 1])
        square[[0, -1]] = min(square[0], square[-1])
    speed = np.sqrt(square)
    return float(np.sum(2 * np.diff(s) / (speed[1:] + speed[:-1])))


def problem_of(route, tube=TUBE):
    """Return the segments of the route, and the arrays of the last search."""
    limits = qt.Limits(**LIMITS)
    one = many_starts.many(1, "interior_point", limits)
    found = _solution(route, limits, tuple(LIMITS), tube, "fastest", None, True, 300, None, one)
    return setup.parts(route, closed=True), found.problem


def with_ipopt(problem, count, weight, tube=TUBE):
    """Run IPOPT; return variables, time and status. `weight` multiplies the integral of the squared jerk."""
    import casadi as ca

    from benchmarks.route_in_casadi import MOVES, segment

    own, rows = segment(problem), []
    for v, a, d in own.at_nodes(NODES):
        square, normal = ca.dot(v, v), ca.cross(v, a)
        rows += [square / LIMITS["speed"] ** 2, ca.dot(normal, normal) / square / LIMITS["lateral_acceleration"] ** 2]
        rows += [ca.dot(v, a) ** 2 / square / LIMITS["longitudinal_acceleration"] ** 2]
        rows += [(d[0] ** 2 + d[1] ** 2) / tube**2, d[2] ** 2 / tube**2]
    h, y = own.duration, own.ends + own.change
    cost = h + weight * h**-5 * ca.sumsqr(ca.DM(JERK) @ y)
    one = ca.Function("one", [*own.variables, *own.given.values()], [cost, ca.vertcat(*rows), h / own.before])
    x = ca.MX.sym("x", MOVES, count)
    late = ca.MX.sym("late")
    last = ca.vertcat(x[:9, 0], late)
    constant = [a.reshape(-1, count) for a in own.data.values()]
    costs, limits, ratios = one.map(count)(x, ca.horzcat(x[:, 1:], last), *constant)
    free = np.append(problem.free[:count].ravel(), 1.0)
    nlp = {"x": ca.vertcat(ca.vec(x), late), "f": ca.sum2(costs), "g": ca.vertcat(ca.vec(limits), ca.vec(ratios))}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.tol": 1e-7, "ipopt.max_iter": STEPS}
    solver = ca.nlpsol("solver", "ipopt", nlp, options)
    wide = np.where(free > 0, np.inf, 0.0)
    top = np.concatenate([np.ones(limits.numel()), np.full(count, setup.LONGEST)])
    bottom = np.concatenate([np.full(limits.numel(), -np.inf), np.full(count, setup.SHORTEST)])
    start = time.process_time()
    found = solver(x0=np.zeros(free.size), lbx=-wide, ubx=wide, lbg=bottom, ubg=top)
    spent = time.process_time() - start
    best = np.array(found["x"]).ravel()
    values = np.append(best[:-1], [*best[:9], best[-1]]).reshape(problem.free.shape)
    return values, spent, f"{solver.stats()['return_status']}, {solver.stats()['iter_count']} steps"


def violations(path, given, tube=TUBE):
    """Return the largest relative violations: limits at a million samples, and the tube at 1025 samples per segment."""
    t = np.linspace(0, float(path.duration), SAMPLES)
    table = qt.evaluate(path, t, tuple(LIMITS))
    found = {name: float(np.max(table.values[name])) / bound - 1 for name, bound in LIMITS.items()}
    count = len(given.h)
    away = Displacement(np.asarray(path.coefficients)[:count], np.diff(np.asarray(path.times)), given.c, given.h)
    return found | {"tube": float(away.largest(1025).max()) / tube - 1}


def report(name, path, given, text):
    """Print the lap time and the violations."""
    worst = ", ".join(f"{key} {x:+.1e}" for key, x in violations(path, given).items())
    print(f"{name}: {float(path.duration):.6f} s ({text})\n  largest violations: {worst}", flush=True)


def tuned(route, limits):
    """Return the fastest lap and the processor time [s]."""
    start = time.process_time()
    best = qt.tune_route(route, limits, tube=TUBE, objective="fastest", closed=True)
    return best, time.process_time() - start


def main():
    """Print lap times, violations and run times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("segments", type=int, nargs="?", default=COUNT)
    chosen = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    limits, route = qt.Limits(**LIMITS), centre_line(chosen.segments)
    centre, proved, spent = retimed_lap(route, limits)
    print(f"{route.segments} segments, {float(route.length()):.1f} m; at {SLOW} m/s {float(route.duration):.1f} s")
    print(f"centre line by retime: {centre:.6f} s (proved {proved}; {spent:.2f} s)", flush=True)
    centre = fastest_along_sections()
    print(f"centre line, minimum without smoothness of the timing: {centre:.6f} s", flush=True)
    best, first = tuned(route, limits)
    warm = min(tuned(route, limits)[1] for _ in range(3))
    given, problem = problem_of(route)
    text = f"{int(best.iterations)} steps, first {first:.2f} s, warm {warm:.2f} s; {best.result}"
    report("tune_route", best.path, given, text)
    ours = float(best.path.duration)
    again, proved, _ = retimed_lap(best.path, limits)
    print(f"  the same line by retime: {again:.6f} s, {again / ours - 1:+.3%} (proved {proved})", flush=True)
    for name, weight in (("duration", 0.0), ("objective of the search", float(problem.jerk[0]))):
        try:
            z, spent, text = with_ipopt(problem, route.segments, weight)
        except ImportError:
            return print("IPOPT: CasADi is not installed")
        judged = rounds.judge(route, given, qt.Limits(), np.full((route.segments + 1, 2), TUBE), problem, z)
        report(f"IPOPT, {name}", judged.route, given, f"{text}, {spent:.2f} s")
        theirs = float(judged.route.duration)
        print(
            f"  lap time of tune_route: {ours / theirs - 1:+.3%}; gain on the centre line: {(centre - ours):.4f} s",
            end="",
        )
        print(f" against {centre - theirs:.4f} s, {(centre - ours) / (centre - theirs) - 1:+.3%}", flush=True)
    return None


if __name__ == "__main__":
    main()
