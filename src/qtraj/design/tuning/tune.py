"""Boundary velocities that meet limits: the path nearest to the given states, the fastest or the smoothest."""

import os

import equinox as eqx
import jax.numpy as jnp

from qtraj.design.tuning import verdict
from qtraj.design.tuning.augmented import FEASIBLE, Iterate, Progress, least_violation, solve
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.certify import certify, require_float64
from qtraj.design.limits import Limits
from qtraj.design.tuning.problem import Objective, Problem, pose
from qtraj.foundation import document
from qtraj.foundation.arrays import real_scalar
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.boundary import BoundaryState
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

AIM = 1 - 1e-8
"""Tuning aims at this part of each limit, so that round-off at a peak does not break the limit that was given."""


@storable
class Tuned(eqx.Module):
    """The outcome of `tune`.

    `path`, with its boundary states `start` and `end` (world axes); `objective`, the attained value in its own units;
    `certificate`, the findings on the given limits; `status`: "converged", "infeasible" or "not converged"; `result`:
    the same in words, with what to do; `iterations`: L-BFGS steps taken.
    """

    path: SpiralHelix
    start: BoundaryState
    end: BoundaryState
    objective: Scalar
    certificate: Certificate
    status: str = eqx.field(static=True)
    result: str = eqx.field(static=True)
    iterations: int = eqx.field(static=True)

    def __init__(
        self,
        path: SpiralHelix,
        start: BoundaryState,
        end: BoundaryState,
        objective: ArrayInput,
        certificate: Certificate,
        status: str,
        result: str,
        iterations: int,
    ):
        self.path, self.start, self.end = path, start, end
        self.objective, self.certificate = real_scalar(objective, "the objective"), certificate
        self.status, self.result, self.iterations = status, result, iterations

    @property
    def converged(self) -> bool:
        """Whether the tuning ended at a path that meets every limit and whose objective is stationary."""
        return self.status == "converged"

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the outcome to a TOML or JSON file, exactly; `qtraj.load` reads it."""
        document.save(self, file)


def tune(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: Objective = "nearest",
    motion: str = "uniform",
    duration: ArrayInput | None = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: ArrayInput | None = None,
    max_rounds: int = 60,
    progress: Progress | None = None,
) -> Tuned:
    """Tune the boundary velocities between two positions until `limits` hold on the whole path.

    `objective`: "nearest" (least change of the six cylindrical velocity components at the ends; for hermite motion
    also of the duration), "fastest" (the duration), "smoothest" (∫|r⃛|²dt at fixed duration), or a differentiable
    callable of a path. `motion`: "uniform" moves V_ρ, V_h at both ends and the one rate ω; "hermite" moves all six
    components and, unless the objective is "smoothest", the duration. `duration` [s]: T₀ of "hermite", and the held
    duration of "smoothest"; by default the turn over the rate of the given states, whose V_φ/ρ need not agree. The
    turn has the sense of V_φ at the start, a magnitude in (0, 2π), and `turns` whole turns besides; where it is known,
    `turn` [rad, signed] gives it instead. After every round `progress(round, objective over its scale, largest relative
    excess)` is called.

    The search is local and starts from the given states. Limits are held at the polished peaks of 65 cells of time,
    and then judged on the whole path: see `certify`.

    **Raises:** ValueError for input that makes no problem, or in float32. A problem without a solution is no error:
    its `status` is "infeasible" and its `result` says why and what would help.
    """
    problem = pose(start, end, limits, objective, motion, duration, turns, placement, turn)
    given = jnp.zeros(problem.size, problem.speed.dtype)
    require_float64(problem.path(given))
    aims = Limits(**{name: AIM * value for name, value in limits.given().items()})
    iterate, settled = solve(problem, aims, given, max_rounds, progress)
    if not settled:
        least = least_violation(problem, aims, iterate.z)
        if float(least.violation) > FEASIBLE:
            return _outcome("infeasible", problem, limits, start, end, least)
        iterate, settled = solve(problem, aims, least.z, max_rounds, progress)
    return _outcome("converged" if settled else "not converged", problem, limits, start, end, iterate)


def _outcome(
    status: str, problem: Problem, limits: Limits, start: BoundaryState, end: BoundaryState, last: Iterate
) -> Tuned:
    path = problem.path(last.z)
    certificate = certify(path, limits)
    if status == "converged" and not certificate.met:  # a peak narrower than the grid, or a gap in the trihedral
        status = "not converged"
    texts = {
        "converged": lambda: verdict.converged(certificate, last),
        "infeasible": lambda: verdict.infeasible(problem, limits, last, certificate),
        "not converged": lambda: verdict.not_converged(certificate, last),
    }
    return Tuned(
        path=path,
        start=BoundaryState(start.position, path.velocity(0.0)),
        end=BoundaryState(end.position, path.velocity(path.duration)),
        objective=problem.attained(last.z),
        certificate=certificate,
        status=status,
        result=texts[status]() + verdict.remark(path),
        iterations=int(last.steps),
    )
