"""Solve tuning problems with IPOPT; path and curvature are CasADi expressions, with CasADi's derivatives."""

from functools import cache

import casadi
import numpy as np

from benchmarks.tuning.slsqp import INSTANTS, Solved, functions, refined_peak
from qtraj.design.tuning.problem import Problem

PARAMETERS = 13  # ρ, h, V_ρ, V_φ, V_h at both ends, the turn, T₀ and V_ref
OPTIONS = {
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11, "constr_viol_tol": 1e-11, "max_iter": 300},
}


@cache
def _solver(added: int) -> casadi.Function:
    """Create the solver; z are the variables of qtraj, and the parameters are data, limit and additional instants."""
    z, data, limit, more = (casadi.SX.sym(n, k) for n, k in (("z", 5), ("p", PARAMETERS), ("k", 1), ("u", added)))
    rho_a, rho_b, h_a, h_b, va_r, va_p, va_h, vb_r, vb_p, vb_h, turn, t0, speed = casadi.vertsplit(data)
    period = t0 * casadi.exp(z[4])
    rate = turn / period
    wa = (va_r + speed * z[0], rate * rho_a, va_h + speed * z[1])
    wb = (vb_r + speed * z[2], rate * rho_b, vb_h + speed * z[3])
    changes = [a - b for a, b in zip((*wa, *wb), (va_r, va_p, va_h, vb_r, vb_p, vb_h), strict=True)]
    cost = sum(c**2 for c in changes) / speed**2
    rho, h = _cubic(rho_a, rho_b, wa[0], wb[0], period), _cubic(h_a, h_b, wa[2], wb[2], period)
    fractions = [*np.linspace(0.0, 1.0, INSTANTS), *casadi.vertsplit(more)]
    rows = [0.5 * (_curvature_squared(rho, h, rate, u * period) / limit**2 - 1) for u in fractions]
    nlp = {"x": z, "p": casadi.vertcat(data, limit, more), "f": cost, "g": casadi.vertcat(*rows)}
    return casadi.nlpsol("tuning", "ipopt", nlp, OPTIONS)


def solve(problem: Problem, limit: float, start: np.ndarray, added: np.ndarray) -> Solved:
    """Run IPOPT once from one start."""
    a, b = problem.start, problem.end
    data = [a.radius, b.radius, a.height, b.height, *a.velocity, *b.velocity, problem.turn, problem.duration]
    parameters = np.asarray([*map(float, data), float(problem.speed), limit, *added])
    found = _solver(len(added))(x0=start, p=parameters, ubg=0.0, lbg=-np.inf)
    z = np.asarray(found["x"]).ravel()
    z = np.where(np.isfinite(z), z, start)
    # IPOPT's cost is not always the cost of the returned point, for example after a failed evaluation.
    cost = float(functions(problem, limit, added, z)[0])
    return Solved(z, cost, float(refined_peak(problem, limit, z)[1]))


def _cubic(a: casadi.SX, b: casadi.SX, va: casadi.SX, vb: casadi.SX, period: casadi.SX) -> tuple[casadi.SX, ...]:
    return (
        a,
        va,
        3 * (b - a) / period**2 - (vb + 2 * va) / period,
        -2 * (b - a) / period**3 + (vb + va) / period**2,
    )


def _curvature_squared(rho: tuple, h: tuple, rate: casadi.SX, t: casadi.SX) -> casadi.SX:
    r = rho[0] + t * (rho[1] + t * (rho[2] + t * rho[3]))
    r1, r2 = rho[1] + t * (2 * rho[2] + 3 * t * rho[3]), 2 * rho[2] + 6 * t * rho[3]
    h1, h2 = h[1] + t * (2 * h[2] + 3 * t * h[3]), 2 * h[2] + 6 * t * h[3]
    v, a = (r1, r * rate, h1), (r2 - r * rate**2, 2 * r1 * rate, h2)
    c = (v[1] * a[2] - v[2] * a[1], v[2] * a[0] - v[0] * a[2], v[0] * a[1] - v[1] * a[0])
    return sum(x**2 for x in c) / sum(x**2 for x in v) ** 3
