"""The outcome of a tuning in words: what was met, what binds, and, where nothing helps, why and what would."""

import jax
import jax.numpy as jnp

from qtraj.algebra import polynomial
from qtraj.design.tuning import augmented
from qtraj.design.tuning.augmented import FEASIBLE, Iterate
from qtraj.design.proof.certificate import Certificate
from qtraj.design.limits import Limits
from qtraj.design.magnitudes import quantity
from qtraj.design.tuning.problem import Problem
from qtraj.path.spiral_helix import SpiralHelix

RELAXED = 1e6
"""A limit times this limits nothing."""

RADII = 257
"""Instants at which the radius is looked at."""


def converged(certificate: Certificate, last: Iterate) -> str:
    """What to say of a tuning that met every limit."""
    known = "proved on the whole path" if certificate.holds else "met, some as far as refined sampling shows"
    lines = [f"converged in {int(last.steps)} steps: every limit is {known}."]
    lines += [f"{name} binds: {certificate.describe(name)}." for name in certificate.binding]
    if not certificate.binding:
        lines.append("No limit binds: the path is the best one without them.")
    return " ".join(lines)


def not_converged(certificate: Certificate, last: Iterate) -> str:
    """What to say of a search that stopped early, although the limits can be met or nearly so."""
    unmet = certificate.unmet
    found = "; ".join(f"{name} is {certificate.status[name]}: {certificate.describe(name)}" for name in unmet)
    state = found or "every limit is met, but the objective may not be at its least"
    return (
        f"not converged after {int(last.steps)} steps: {state} (gradient {float(last.gradient):.2g}). "
        "Try a larger max_rounds, other starting velocities, or wider limits."
    )


def remark(path: SpiralHelix) -> str:
    """What else should be known of a path: whether it runs through its own axis, where the radius is negative."""
    times = path.duration * jnp.linspace(0.0, 1.0, RADII, dtype=path.duration.dtype)
    radii = jax.vmap(lambda t: polynomial.evaluate(path.radius, t))(times)
    least = int(jnp.argmin(radii))
    if radii[least] > 0:
        return ""
    return (
        f" Mind: the path runs through its own axis (the radius is {float(radii[least]):.4g} m at t = "
        f"{float(times[least]):.4g} s). An axis farther away, or other boundary velocities, avoid that."
    )


def infeasible(problem: Problem, limits: Limits, least: Iterate, certificate: Certificate) -> str:
    """What to say where no boundary velocities near the given ones meet the limits."""
    broken = certificate.unmet
    lines = [f"infeasible: no boundary velocities of {problem.motion} motion were found that meet the limits."]
    for name in broken:
        _, _, limit = certificate.worst[name]
        alone = _least_alone(problem, limits, least, name)
        if alone > 1 + FEASIBLE:
            lines.append(
                f"{name} cannot be met between these positions: even alone the least peak found is "
                f"{quantity(name, alone * limit)} ({certificate.describe(name)})."
            )
        else:
            lines.append(f"{name} can be met alone, but not with the others ({certificate.describe(name)}).")
    lines.append("What would help: " + "; ".join(_remedies(problem, certificate, broken)) + ".")
    return " ".join(lines)


def _least_alone(problem: Problem, limits: Limits, least: Iterate, name: str) -> float:
    """The least peak of one quantity over its limit, found with every other limit relaxed."""
    # Relaxed and not left out: the problem keeps its structure, so nothing is compiled again.
    alone = {other: value if other == name else RELAXED * value for other, value in limits.given().items()}
    excess = float(augmented.least_violation(problem, Limits(**alone), least.z).violation)
    return (1 + 2 * excess) ** 0.5


def _remedies(problem: Problem, certificate: Certificate, broken: list[str]) -> list[str]:
    remedies = []
    for name in broken:
        _, value, _ = certificate.worst[name]
        remedies.append(f"raise {name} to {quantity(name, 1.0001 * value)}")
    if problem.motion == "uniform":
        remedies.append("take motion='hermite', whose angle need not turn uniformly")
    if problem.holds_duration:
        remedies.append("give a longer duration, which this objective holds fixed")
    remedies.append("move the boundary positions, or the axis (placement), so that the turn is wider")
    return remedies
