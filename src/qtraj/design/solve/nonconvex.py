"""Minimise an objective under inequalities by a primal-dual interior-point method.

The inequalities g(z) ≤ 0 are written as g(z) + s = 0 with slacks s. A logarithmic barrier with the parameter μ → 0
keeps the slacks positive (Nocedal and Wright, *Numerical Optimization*, chapter 19; Wächter and Biegler,
*Math. Program.* 106, 2006, sections 2 and 3). Second derivatives are exact. If the matrix is not positive definite, a
multiple of the identity or of a part of it is added (see `positive_shift`). A line search on the merit function
f − μΣ ln s + ν Σ|g + s|, with the objective f and the penalty ν, ensures progress.

Some constraints may be elastic (see `elastic`). The inequalities are values(z) ≤ margins. The problem enters only
through the methods of `Program` and `Linear`, so the structure of its matrix does not matter here.
"""

from dataclasses import replace

import numpy as np

from qtraj.design.solve.elastic import barrier, closed, elastic_newton, gaps_of, relaxed, stiffness
from qtraj.design.solve.iterate import Iterate, Rules, Search, Step
from qtraj.design.solve.positive_shift import MOST_SHIFT, positive_shift
from qtraj.design.solve.program import Linear, PerConstraint, Program, Shift, Solver, Variables

TOLERANCE = 1e-7
"""The search ends if no residual of the optimality conditions is larger than this."""

LEAST_SLACK = 0.1
"""Lower bound on the initial slacks."""

TRIALS = 14
"""Maximum number of step sizes, each half of the previous one."""

CORRECTED = range(2, 6)
"""Trials after which a rejected step is corrected for the curvature of the constraints. A step that becomes acceptable
sooner does not need it."""

SUFFICIENT = 1e-4

CAP = 1e10
"""Multipliers stay within this factor of μ/s, the barrier parameter divided by the slack."""

RENEWED, RENEWALS = 1e-2, 60
"""Margins are updated if the barrier parameter is below `RENEWED`, at most `RENEWALS` times. The search does not
end before the margins have converged, because otherwise another search would be needed."""

FREE = 8
"""After this number of updates margins may only decrease, so that they converge."""

HARMLESS = 0.5
"""A margin may change by this fraction of the slack without an effect on the barrier parameter."""

LAG = 0.1
"""The barrier parameter does not become smaller than this fraction of the largest change of a margin."""

SETTLED, NEAR = 5e-6, 0.1
"""Margins are not updated again if the barrier parameter has its final value, and if all margins of constraints with
slacks below `NEAR` change by at most `SETTLED`."""


HOPELESS, APART = 1e4, 1e-2
"""Multipliers above the first number mean that the constraints contradict each other, if a constraint is still violated
by more than the second number; those of solvable problems are about a hundred times smaller."""

REACHED = 60
"""With convex matrices (see `Rules`), no constraint is violated by more than `APART` after this number of steps, or the
constraints seem to contradict each other. Such searches need 10 to 35 steps."""


def start(program: Program, z: Variables, factor: PerConstraint | float, mu: float) -> Iterate:
    """Return the first iterate; slacks are computed from the constraints, and multipliers from the slacks.

    The full margins are multiplied by `factor`.
    """
    margins = program.full * factor
    left = margins - program.evaluate(z)[1]
    if program.price is None:
        slacks = np.maximum(left, LEAST_SLACK)
        return Iterate(z, slacks, mu / slacks, margins)
    return relaxed(program, Iterate(z, left, left, margins), left, LEAST_SLACK, mu)


def restarted(program: Program, at: Iterate, mu: float) -> Iterate:
    """Return an iterate with slacks and multipliers for a larger barrier parameter.

    With tiny slacks, the steps would be too short.
    """
    left = at.margins - program.evaluate(at.z)[1]
    if program.price is not None:
        return relaxed(program, at, left, mu, mu)
    slacks = np.maximum(left, mu / np.maximum(at.multipliers, 1e-3))
    return at._replace(slacks=slacks, multipliers=mu / slacks)


def solve(program: Program, search: Search, rules: Rules, most: int) -> Search:
    """Continue a search, decreasing the barrier parameter, in at most `most` steps."""
    with np.errstate(all="ignore"):  # a failed search ends with NaN
        while not (search.done or search.stuck or search.hopeless) and search.steps < most:
            search = _iteration(program, search, rules)
    return search


def linearised(program: Program, at: Iterate) -> Linear:
    """Return the values and derivatives at an iterate."""
    return program.linearise(at.z, at.multipliers, stiffness(program, at))


def residual(at: Iterate, linear: Linear, mu: float) -> float:
    """Return the largest residual of the optimality conditions for the barrier parameter `mu`."""
    scale = max(float(np.mean(at.multipliers)), 1.0)
    products = _size(at.slacks * at.multipliers - mu)
    if at.excess is not None:
        elastic = np.isfinite(linear.program.price)
        products = max(products, _size((at.excess * (linear.program.price - at.multipliers) - mu)[elastic]))
    return max(_size(linear.residual) / scale, _size(gaps_of(at, linear.values)), products / scale)


def newton(at: Iterate, linear: Linear, mu: float, shift: Shift = 0.0, indefinite: bool = False) -> Step | None:
    """Return the Newton step for the barrier parameter `mu`, or None if the matrix is not positive definite.

    `shift` is added to the diagonal of the matrix. With `indefinite`, the result is None only for a singular matrix.
    """
    solver = linear.solver(shift, indefinite)
    if solver is None:
        return None
    if at.excess is not None:
        return elastic_newton(at, linear, mu, solver)
    gaps = gaps_of(at, linear.values)
    right = -(linear.gradient + linear.pulled((mu + at.multipliers * gaps) / at.slacks))
    dz = solver(right)
    curvature = float(np.sum(dz * right))
    dz = linear.completed(dz)
    slacks = -gaps - linear.pushed(dz)
    multipliers = (mu - at.multipliers * slacks) / at.slacks - at.multipliers
    slope = float(np.sum(linear.gradient * dz) - mu * np.sum(slacks / at.slacks))
    return Step(dz, slacks, multipliers, slope, curvature) if np.isfinite(slope + curvature) else None


def longest(values: PerConstraint, changes: PerConstraint, keep: float) -> float:
    """Return the largest step size, at most 1, that reduces no positive value by more than the fraction `keep`."""
    return min(1.0, keep / max(float(np.max(-changes / values, initial=0.0)), keep))


def _size(x: np.ndarray) -> float:
    return float(np.max(np.abs(x)))


def _iteration(program: Program, search: Search, rules: Rules) -> Search:
    """Return the state after one step."""
    linear = linearised(program, search.at)
    search = _assessed(program, search, linear, rules)
    if search.done:
        return search
    step = newton(search.at, linear, search.mu)
    shift: Shift = 0.0
    if step is None and np.max(np.abs(gaps_of(search.at, linear.values))) > APART:
        search = replace(search, indefinite=True)
        if rules.convex:
            if search.steps >= REACHED and not search.renewals:
                return replace(search, hopeless=True)
            linear = _convex(program, search.at)
            step = newton(search.at, linear, search.mu)
    if step is None:
        shift = positive_shift(linear, search.shift, search.mu)
        step = newton(search.at, linear, search.mu, shift)
        while step is None and (level := float(np.max(shift))) < MOST_SHIFT:  # the solution was not finite
            shift = 8.0 * level
            step = newton(search.at, linear, search.mu, shift)
    search = replace(search, shift=shift)
    return replace(search, stuck=True) if step is None else _stepped(program, search, linear, step, rules)


def _assessed(program: Program, search: Search, linear: Linear, rules: Rules) -> Search:
    """Return the search with its error, and with the margins and the barrier parameter of the next step."""
    at, mu = search.at, search.mu
    last = mu <= rules.least
    error = residual(at, linear, 0.0)
    search = replace(search, error=error, done=last and error <= max(TOLERANCE, 10 * rules.least))
    if not residual(at, linear, mu) <= 10 * mu:
        return search
    search = replace(search, mu=max(rules.least, min(0.2 * mu, mu**1.5)))
    if mu >= RENEWED or search.renewals >= RENEWALS:
        return search
    margins = program.refreshed(at.z, at.margins) * rules.factor
    if search.renewals >= FREE:
        margins = np.minimum(margins, at.margins)
    changes = np.abs(margins - at.margins)
    if last and np.max(changes, initial=0.0, where=at.slacks < NEAR) <= max(SETTLED, rules.least):
        return replace(search, renewals=RENEWALS)
    # New margins change the constraints by up to `jump`; with much smaller slacks the next step would be too short.
    # A constraint with a much larger slack is not affected, and must not delay the others.
    jump = float(np.max(changes, initial=0.0, where=changes > HARMLESS * at.slacks))
    mu = max(search.mu, min(LAG * jump, mu))
    return replace(search, at=at._replace(margins=margins), mu=mu, renewals=search.renewals + 1, done=False)


def _convex(program: Program, at: Iterate) -> Linear:
    """Return the derivatives at an iterate, with a matrix without the second derivatives of the constraints.

    They grow with the multipliers, and so would a shift that outweighs them; a large shift makes the steps short, and
    short steps towards constraints that are violated by much make the multipliers grow.
    """
    return program.linearise(at.z, np.zeros_like(at.multipliers), stiffness(program, at))


def _stepped(program: Program, search: Search, linear: Linear, step: Step, rules: Rules) -> Search:
    """Return the search after the longest step, of those tried, that reduces the merit function enough."""
    at, mu = search.at, search.mu
    gaps = gaps_of(at, linear.values)
    gap = float(np.sum(np.abs(gaps)))
    if at.excess is None and np.max(at.multipliers) > HOPELESS and np.max(np.abs(gaps)) > APART:
        search = replace(search, hopeless=True)
    penalty = search.penalty
    if gap > 1e-14:
        penalty = max(penalty, (step.slope + 0.5 * step.curvature) / (0.9 * gap))
    search = replace(search, penalty=penalty)
    initial = linear.objective + barrier(program, mu, at.slacks, at.excess) + penalty * gap
    slope, keep = step.slope - penalty * gap, max(0.99, 1.0 - mu)
    bounded = rules.inside and at.excess is None and bool(np.all(linear.values <= program.full))
    part = longest(at.slacks, step.slacks, keep)
    if step.excess is not None:
        elastic, before = np.isfinite(program.price), np.asarray(at.excess)
        part = min(part, longest(before[elastic], step.excess[elastic], keep))
    solver = None
    for k in range(TRIALS):
        z, slacks, excess, merit = _trial(program, search, step, gaps, part, bounded)
        most = initial + SUFFICIENT * part * slope + 1e-13 * abs(initial)
        if np.isfinite(merit) and merit <= most:
            break
        if excess is None and k in CORRECTED and (solver := solver or linear.solver(search.shift)):
            own = _corrected(program, search, step, linear, solver, part)
            if longest(at.slacks, own.slacks, keep) == 1.0:
                z, slacks, excess, merit = _trial(program, search, own, gaps, 1.0, bounded)
                if np.isfinite(merit) and merit <= most:
                    break
        part *= 0.5
    else:
        return replace(search, stuck=True)
    dual = longest(at.multipliers, step.multipliers, keep)
    if excess is not None:
        dual = min(dual, longest(program.price - at.multipliers, -step.multipliers, keep))
    multipliers = np.clip(at.multipliers + dual * step.multipliers, mu / (CAP * slacks), CAP * mu / slacks)
    return replace(search, at=Iterate(z, slacks, multipliers, at.margins, excess), steps=search.steps + 1)


def _corrected(program: Program, search: Search, step: Step, linear: Linear, solver: Solver, part: float) -> Step:
    """Return a part of a step with a correction for the curvature of the constraints.

    Along curved constraints, the merit function rejects good steps because of the squares of the step in the
    constraints (Maratos' effect; Nocedal and Wright, section 18.3). The correction is the Newton step for the residuals
    after the step alone.
    """
    at = search.at
    z, slacks = part * step.z, part * step.slacks
    residuals = program.evaluate(at.z + z)[1] - at.margins + at.slacks + slacks
    dz = linear.completed(solver(-linear.pulled(at.multipliers / at.slacks * residuals)))
    return step._replace(z=z + dz, slacks=slacks - residuals - linear.pushed(dz))


def _trial(
    program: Program, search: Search, step: Step, gaps: PerConstraint, part: float, bounded: bool
) -> tuple[Variables, PerConstraint, PerConstraint | None, float]:
    """Return the variables, slacks and violations after a part of a step, and the merit function there.

    `gaps` are the residuals of the constraints before the step. With `bounded`, the merit function is infinite where
    the constraints with full margins are violated.
    """
    at, mu, penalty = search.at, search.mu, search.penalty
    z, slacks = at.z + part * step.z, at.slacks + part * step.slacks
    excess = None if step.excess is None else np.asarray(at.excess) + part * step.excess
    objective, values = program.evaluate(z)
    if bounded and not np.all(values <= program.full):
        return z, slacks, excess, np.inf
    above = values - at.margins - (0.0 if excess is None else excess)
    # Set the slack s of a clearly satisfied constraint to −g, so that |g + s| is zero in the merit function.
    slacks = np.where(-above > np.maximum(mu / penalty, 0.01 * at.slacks), -above, slacks)
    if excess is not None:
        slacks, excess = closed(program, above + slacks - (1 - part) * gaps, slacks, excess)
        above = values - at.margins - excess
    gap = float(np.sum(np.abs(above + slacks)))
    return z, slacks, excess, objective + barrier(program, mu, slacks, excess) + penalty * gap
