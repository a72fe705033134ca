"""Tune routes around obstacles with `tune_route` and with IPOPT, on the same random problems.

`python -m benchmarks.obstacles_in_casadi` solves 20 problems: a winding road of ten segments, one to three masts near
its middle, and a car of two discs, with limits on speed, lateral acceleration and curvature. IPOPT (through CasADi) has
the same variables, objective and tube, exact derivatives, and all constraints at `NODES` instants of each segment. It
starts on every combination of sides of the masts. Because its solutions enter the masts between these instants, which
makes their objectives smaller, they are refined with the masts at `DENSE` instants. The results of `tune_route` are
compared with the refined solutions on the same sides, and with the best one. `certify` shows what the solutions of
IPOPT violate. Times are processor times.
"""

import argparse
import itertools
import time
from typing import NamedTuple

import casadi as ca
import numpy as np

import qtraj as qt
from benchmarks.route_in_casadi import MOVES, segment
from qtraj.design.tuning_route import rounds, setup

BOUNDS = {"speed": 7.0, "lateral_acceleration": 2.5, "curvature": 0.2}
BODY = ((-1.3, 1.1), (1.3, 1.1))
TUBE = (4.0, 0.05)
SEGMENTS, PACE = 10, 5.0
NODES, DENSE = 11, 51
STEPS = 300
SAMPLES = 2001
WIDTH = 6.0
"""Length [m] along the road over which a start of IPOPT is shifted to one side of a mast."""


class Case(NamedTuple):
    """A route, and the masts beside it: positions (k, 2), radii (k,) and shifts to the left of the road (k,) [m]."""

    route: qt.Route
    places: np.ndarray
    radii: np.ndarray
    aside: np.ndarray

    @property
    def limits(self):
        masts = [qt.Cylinder([*p, 0.0], [0, 0, 1], r) for p, r in zip(self.places, self.radii, strict=True)]
        return qt.Limits(**BOUNDS, keep_out=masts, body=BODY)


class Solution(NamedTuple):
    """A solution of IPOPT: its route, objective [m²], sides of the masts, variables and processor time [s]."""

    route: qt.Route
    objective: float
    sides: tuple[int, ...]
    z: np.ndarray
    seconds: float


def case(seed):
    """Return a random problem; both ends of the road are clear."""
    rng = np.random.default_rng(seed)
    height, length, phase = rng.uniform(1.0, 3.0), rng.uniform(60.0, 110.0), rng.uniform(0, 2 * np.pi)
    wave = 2 * np.pi / length
    x = np.linspace(0.0, 2 * PACE * SEGMENTS, SEGMENTS + 1)
    angle, zero = wave * x + phase, np.zeros(len(x))
    position = np.stack([x, height * np.sin(angle), zero], axis=1)
    velocity = PACE * np.stack([zero + 1.0, height * wave * np.cos(angle), zero], axis=1)
    acceleration = PACE**2 * np.stack([zero, -height * wave**2 * np.sin(angle), zero], axis=1)
    route = qt.Route(x / PACE, position, velocity, acceleration)
    count = rng.integers(1, 4)
    along = np.sort(rng.uniform(20.0, 80.0, count))
    aside, radii = rng.uniform(-1.2, 1.2, count), rng.uniform(0.3, 1.2, count)
    t = along / PACE
    r, v = np.asarray(route.sampled(t, 1))
    left = np.stack([-v[:, 1], v[:, 0]], axis=1) / np.linalg.norm(v[:, :2], axis=1)[:, None]
    return Case(route, r[:, :2] + aside[:, None] * left, radii, aside)


def sides_of(route, places):
    """Return 1 for each mast that the route passes on its left, and −1 for the others."""
    t = np.linspace(0.0, float(route.duration), SAMPLES)
    r, v = np.asarray(route.sampled(t, 1))
    found = []
    for place in places:
        away = place - r[:, :2]
        k = np.argmin(np.sum(away**2, axis=1))
        found.append(1 if v[k, 0] * away[k, 1] - v[k, 1] * away[k, 0] < 0 else -1)
    return tuple(found)


def posed(own):
    """Return the parts of the route and the arrays of the problem, without the masts."""
    given = setup.parts(own.route)
    fixed = np.zeros((SEGMENTS + 1, 3), bool)
    fixed[[0, -1]] = True
    bounds, tube = np.array([*BOUNDS.values()]), np.tile(TUBE, (SEGMENTS + 1, 1))
    return given, setup.problem_of(given, tuple(BOUNDS), bounds, tube, fixed, "nearest", False)


def solver_of(own, problem, dense):
    """Return IPOPT's solver with its bounds; the masts are imposed at `dense` instants of each segment."""
    part = segment(problem, "near", "pace", "origins")
    ratio, near = part.duration / part.before, ca.reshape(part.given["near"], 6, 6)
    cost = ca.trace(part.change.T @ near @ part.change) + part.given["pace"] * (ratio - 1) ** 2
    rows = []
    for v, a, d in part.at_nodes(NODES):
        square, normal = ca.dot(v, v), ca.dot(ca.cross(v, a), ca.cross(v, a))
        rows += [square / BOUNDS["speed"] ** 2, normal / square / BOUNDS["lateral_acceleration"] ** 2]
        rows += [normal / square**3 / BOUNDS["curvature"] ** 2]
        rows += [(d[0] ** 2 + d[1] ** 2) / TUBE[0] ** 2, d[2] ** 2 / TUBE[1] ** 2]
    for (v, _, _), r in zip(part.at_nodes(dense), part.positions(dense), strict=True):
        square = ca.dot(v, v)
        for offset, radius in BODY:
            disc = (r + offset * v / ca.sqrt(square))[:2]
            for place, own_radius in zip(own.places, own.radii, strict=True):
                away = (disc - ca.DM(place).T) / (own_radius + radius)
                rows.append(2 - ca.dot(away, away))
    one = ca.Function("one", [*part.variables, *part.given.values()], [cost, ca.vertcat(*rows), ratio])
    z = ca.MX.sym("z", MOVES, SEGMENTS + 1)
    constant = [x.reshape(-1, SEGMENTS) for x in part.data.values()]
    costs, limits, ratios = one.map(SEGMENTS)(z[:, :-1], z[:, 1:], *constant)
    nlp = {"x": ca.vec(z), "f": ca.sum2(costs), "g": ca.vertcat(ca.vec(limits), ca.vec(ratios))}
    options = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "ipopt.tol": 1e-8}
    options["ipopt.max_iter"] = STEPS
    wide = np.where(problem.free.ravel(), np.inf, 0.0)
    top = np.concatenate([np.ones(limits.numel()), np.full(SEGMENTS, setup.LONGEST)])
    bottom = np.concatenate([np.full(limits.numel(), -np.inf), np.full(SEGMENTS, setup.SHORTEST)])
    return ca.nlpsol("solver", "ipopt", nlp, options), {"lbx": -wide, "ubx": wide, "lbg": bottom, "ubg": top}


def start(own, problem, sides):
    """Return variables with which the road is shifted to the given sides of the masts."""
    x, z = np.asarray(own.route.times) * PACE, np.zeros(problem.free.shape)
    reach = own.aside + np.array(sides) * (own.radii + BODY[0][1] + 0.2)
    along = np.array([x[0] + PACE * _time_at(own.route, place) for place in own.places])
    for shift, centre in zip(reach, along, strict=True):
        z[:, 1] += shift * np.exp(-(((x - centre) / WIDTH) ** 2)) / problem.scale[1]
    return np.where(problem.free, z, 0.0)


def _time_at(route, place):
    t = np.linspace(0.0, float(route.duration), SAMPLES)
    r = np.asarray(route.sampled(t, 0))[0]
    return t[np.argmin(np.sum((r[:, :2] - place) ** 2, axis=1))]


def with_ipopt(own, sides):
    """Return the solutions of IPOPT and the number of starts; the best solution is the first one.

    The first list contains those with the masts at `NODES` instants. The best one of them, and the best one on the
    given sides, are the starts of those in the second list, with the masts at `DENSE` instants.
    """
    given, problem = posed(own)
    problem = problem._replace(origins=given.states[:-1, 0].T + np.asarray(own.route.origin)[:, None])
    starts = [start(own, problem, choice) for choice in itertools.product((1, -1), repeat=len(own.radii))]
    coarse = _solutions(own, given, problem, NODES, starts)
    chosen = {x.sides: x.z for x in [*(x for x in coarse if x.sides == sides)][:1] + coarse[:1]}
    return coarse, _solutions(own, given, problem, DENSE, chosen.values()), len(starts)


def _solutions(own, given, problem, instants, starts):
    solver, bounds = solver_of(own, problem, instants)
    found, widths = [], np.tile(TUBE, (SEGMENTS + 1, 1))
    for begin in starts:
        begun = time.process_time()
        x = solver(x0=begin.ravel(), **bounds)["x"]
        spent = time.process_time() - begun
        if solver.stats()["success"]:
            z = np.array(x).reshape(problem.free.shape)
            route = rounds.judge(own.route, given, qt.Limits(), widths, problem, z).route
            found.append(Solution(route, float(rounds.attained(problem, z)), sides_of(route, own.places), z, spent))
    return sorted(found, key=lambda x: x.objective)


def broken(own, solution):
    """Return the largest depth [m] inside a mast and the largest relative violation of a limit, as `certify` finds."""
    certificate = qt.certify(solution.route, own.limits)
    depth, above = 0.0, 0.0
    for name, status in certificate.status.items():
        if status == "broken":
            _, value, limit = certificate.worst[name]
            depth, above = (max(depth, -value), above) if name not in BOUNDS else (depth, max(above, value / limit - 1))
    return depth, above


class Row(NamedTuple):
    """The comparison for one problem.

    `same`, `best`: the relative excess of the objective of `tune_route` over that of IPOPT with `DENSE` instants, on
    the same sides and on any sides. `coarse` is that for IPOPT with `NODES` instants, on the same sides. `depth` [m]
    and `above` are what the best solution for `NODES` instants violates, and `dense_depth` what the other one does.
    """

    masts: int
    status: str
    objective: float
    seconds: float
    same: float
    best: float
    coarse: float
    solved: int
    starts: int
    ipopt_seconds: float
    depth: float
    above: float
    dense_depth: float


def compared(own):
    """Return the comparison for one problem."""
    begun = time.process_time()
    best = qt.tune_route(own.route, own.limits, tube=TUBE)
    seconds = time.process_time() - begun
    value, sides = float(best.objective), sides_of(best.path, own.places)
    coarse, dense, starts = with_ipopt(own, sides)

    def excess(found):
        return value / found[0].objective - 1 if found else np.nan

    same, same_coarse = ([x for x in found if x.sides == sides] for found in (dense, coarse))
    depth, above = broken(own, coarse[0]) if coarse else (np.nan, np.nan)
    return Row(
        len(own.radii),
        "proved" if best.certificate.holds else "not proved",
        value,
        seconds,
        excess(same),
        excess(dense),
        excess(same_coarse),
        len(coarse),
        starts,
        sum(x.seconds for x in coarse),
        depth,
        above,
        broken(own, dense[0])[0] if dense else np.nan,
    )


def shown(seed, row):
    """Return the line of one problem."""
    return (
        f"{seed:3d}: {row.masts} masts, {row.status}, objective {row.objective:.6g} m², {row.seconds:.2f} s; same "
        f"sides {row.same:+.3%}, any sides {row.best:+.3%}, {NODES} instants {row.coarse:+.3%}; IPOPT {row.solved} of "
        f"{row.starts} starts, {row.ipopt_seconds:.2f} s, enters by {1e3 * row.depth:.2g} mm ({DENSE} instants: "
        f"{1e3 * row.dense_depth:.2g} mm), limits {row.above:+.1e}"
    )


def main():
    """Print one line for each problem, and a summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first problem")
    chosen = parser.parse_args()
    rows = []
    for seed in range(chosen.first, chosen.first + chosen.problems):
        rows.append(row := compared(case(seed)))
        print(shown(seed, row), flush=True)
    table = {name: np.array(x) for name, x in zip(Row._fields, zip(*rows, strict=True), strict=True)}
    print(f"proved: {np.sum(table['status'] == 'proved')} of {len(rows)}")
    texts = {"same": "the same sides", "best": "any sides", "coarse": f"the same sides, {NODES} instants"}
    for name, text in texts.items():
        known = table[name][np.isfinite(table[name])]
        print(
            f"objective against IPOPT on {text}, {known.size} problems: median {np.median(known):+.4%}, "
            f"largest {known.max():+.4%}, smallest {known.min():+.4%}"
        )
    for name, count in (("depth", NODES), ("dense_depth", DENSE)):
        depths = 1e3 * table[name][np.isfinite(table[name])]
        print(
            f"best solutions of IPOPT with {count} instants: {np.sum(depths > 0)} of {depths.size} enter a mast, "
            f"median {np.median(depths):.2g} mm, at most {depths.max():.2g} mm"
        )
    print(f"processor time: tune_route {table['seconds'].sum():.1f} s, IPOPT {table['ipopt_seconds'].sum():.1f} s")


if __name__ == "__main__":
    main()
