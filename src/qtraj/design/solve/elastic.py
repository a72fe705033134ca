"""Elastic constraints of the interior-point method, which find out which limits contradict each other.

Inequalities with a finite price ρ are *elastic* (Nocedal and Wright, chapter 18.5): they may be violated by e ≥ 0 at
the cost ρ·e. Then g − e + s = 0, and the multipliers of s and e, which sum to ρ, satisfy λ s = μ and (ρ − λ) e = μ.
"""

from typing import Any

import numpy as np

from qtraj.design.solve.iterate import Iterate, Step
from qtraj.design.solve.program import Linear, PerConstraint, Program, Solver


def relaxed(program: Program, at: Iterate, left: PerConstraint, least: float, mu: float) -> Iterate:
    """Return an iterate of elastic constraints whose slacks minus violations are what is `left` of the margins."""
    excess = np.where(np.isfinite(program.price), np.maximum(-left, 0.0) + least, 0.0)
    slacks = np.where(np.isfinite(program.price), left + excess, np.maximum(left, least))
    return at._replace(slacks=slacks, multipliers=np.minimum(mu / slacks, 0.5 * program.price), excess=excess)


def stiffness(program: Program, at: Iterate) -> PerConstraint:
    """Return the changes of the multipliers for changes of the constraints, at constant complementarity."""
    if at.excess is None:
        return at.multipliers / at.slacks
    return 1.0 / (at.slacks / at.multipliers + at.excess / (program.price - at.multipliers))


def gaps_of(at: Iterate, values: PerConstraint) -> PerConstraint:
    """Return the residuals of the constraints with slacks."""
    gaps = values - at.margins + at.slacks
    return gaps if at.excess is None else gaps - at.excess


def closed(
    program: Program, gaps: PerConstraint, slacks: PerConstraint, excess: PerConstraint
) -> tuple[PerConstraint, PerConstraint]:
    """Return slacks and violations of elastic constraints, of which one is increased by `gaps`.

    A merit function with a penalty on these residuals would have to weigh them more than the prices, and its steps
    would be short.
    """
    own = np.where(np.isfinite(program.price), gaps, 0.0)
    return slacks + np.maximum(-own, 0.0), excess + np.maximum(own, 0.0)


def elastic_newton(at: Iterate, linear: Linear, mu: float, solver: Solver) -> Step | None:
    """Return the Newton step of a problem with elastic constraints, or None if it is not finite."""
    price: Any = linear.program.price
    excess: Any = at.excess
    elastic, other = np.isfinite(price), price - at.multipliers
    stiff = stiffness(linear.program, at)
    less = np.where(elastic, mu / other - excess, 0.0)
    shift = gaps_of(at, linear.values) + mu / at.multipliers - at.slacks - less
    right = -(linear.gradient + linear.pulled(at.multipliers + stiff * shift))
    dz = solver(right)
    curvature = float(np.sum(dz * right))
    dz = linear.completed(dz)
    multipliers = stiff * (linear.pushed(dz) + shift)
    slacks = mu / at.multipliers - at.slacks - at.slacks / at.multipliers * multipliers
    more = np.where(elastic, less + excess / other * multipliers, 0.0)
    slope = float(np.sum(linear.gradient * dz) - mu * np.sum(slacks / at.slacks))
    slope += float(np.sum((more * (price - mu / excess))[elastic]))
    return Step(dz, slacks, multipliers, slope, curvature, more) if np.isfinite(slope + curvature) else None


def barrier(program: Program, mu: float, slacks: PerConstraint, excess: PerConstraint | None) -> float:
    """Return the barrier terms of slacks and violations, and the cost of the violations."""
    found = -mu * float(np.sum(np.log(slacks)))
    if excess is None:
        return found
    elastic = np.isfinite(program.price)
    own = excess[elastic]
    return found + float(np.sum(program.price[elastic] * own) - mu * np.sum(np.log(own)))
