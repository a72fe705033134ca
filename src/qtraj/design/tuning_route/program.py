"""Present the problem of a route to the interior-point method: constraints in one array, values and derivatives."""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.solve import chain
from qtraj.design.solve.program import PerConstraint, Shift, Solver, Variables
from qtraj.design.tuning_route import assembly, circuit, margins
from qtraj.design.tuning_route.assembly import Local
from qtraj.design.tuning_route.constraints import Expansion, bounds, expand, order_of, values
from qtraj.design.tuning_route.problem import RouteProblem, Segments, joined, moved, objective, segments

PART, CACHED = 64, 25_000
"""The largest numbers of segments and of second derivatives at the nodes that are computed at once.

Their arrays fit into the cache of the processor, and their memory is reused.
"""


class RouteProgram:
    """The problem of a route: minimise the objective under the constraints values ≤ margins.

    `price` contains the prices of violations of the constraints, which are infinite unless limits may be violated;
    None if none may be.
    """

    def __init__(self, problem: RouteProblem, price: float | None = None):
        """Store the problem and the arrays that do not depend on the variables; `price` is that of limits."""
        self.problem = problem
        self.turns = assembly.frames(problem)
        self.moving = np.flatnonzero(problem.moving)
        self.at_nodes = np.count_nonzero(problem.used)
        at_each = (3 * (order_of(problem.names) + 1 - problem.first) + problem.on_duration) ** 2
        at_each *= problem.used.shape[1]
        size = min(PART, CACHED // at_each)
        every = np.arange(len(problem.moving))
        groups = [every[k] for k in problem.groups()]
        chosen = [group[k : k + size] for group in groups for k in range(0, len(group), size)]
        self.parts = [(k, problem.part(k)) for k in chosen]
        self.groups = [(k, problem.part(k)) for k in groups]
        self.price: Any = None
        if price is not None:
            nodes = np.full(problem.used.shape, np.inf)
            nodes[:-2] = price
            self.price = self.flat(nodes, np.full((2, len(problem.moving)), np.inf))

    @property
    def full(self) -> PerConstraint:
        """The margins without any reduction: 1 for the constraints at the nodes, 0 for the bounds on durations."""
        return self.flat(np.ones(self.problem.used.shape), np.zeros((2, len(self.problem.moving))))

    def flat(self, nodes: Float[np.ndarray, "constraints nodes n"], of_bounds: Float[np.ndarray, "2 n"]) -> Any:
        """Return the numbers that belong to used constraints."""
        return np.concatenate([nodes[self.problem.used], of_bounds[:, self.moving].ravel()])

    def spread(self, x: PerConstraint) -> tuple[np.ndarray, np.ndarray]:
        """Return arrays for the constraints at the nodes and for the bounds; unused constraints have zeros."""
        nodes, of_bounds = np.zeros(self.problem.used.shape), np.zeros((2, len(self.problem.moving)))
        nodes[self.problem.used] = x[: self.at_nodes]
        of_bounds[:, self.moving] = x[self.at_nodes :].reshape(2, -1)
        return nodes, of_bounds

    def evaluate(self, z: Variables) -> tuple[float, PerConstraint]:
        """Return the objective and the values of the constraints."""
        s = segments(self.problem, z)
        found = values(self.problem, s, parts=self.groups)
        return float(objective(self.problem, s)), self.flat(found, bounds(self.problem, s))

    def linearise(self, z: Variables, multipliers: PerConstraint, stiffness: PerConstraint) -> "Linear":
        """Return values and derivatives; the matrix is ∇²(f + Σ multiplier·g) + Σ stiffness·∇g ∇gᵀ."""
        return Linear(self, z, multipliers, stiffness)

    def refreshed(self, z: Variables, previous: PerConstraint) -> PerConstraint:
        """Return margins that account for larger values between the nodes (see `margins`)."""
        s = segments(self.problem, z)
        found = [margins.largest_near(part, s.part(k), previous.max()) for k, part in self.parts]
        own, largest = joined(self.problem, found, [k for k, _ in self.parts])
        nodes = margins.margins(self.problem, own, largest, previous.max())
        return self.flat(nodes, np.zeros((2, nodes.shape[2])))


class Linear:
    """The values and derivatives of a `RouteProgram` at one point.

    `values` are the values of the constraints, `gradient` is the gradient of the `objective`, `residual` the gradient
    of the Lagrangian, and `matrix` the block-tridiagonal matrix of the Newton steps.
    """

    def __init__(self, program: RouteProgram, z: Variables, multipliers: PerConstraint, stiffness: PerConstraint):
        """Compute the derivatives for the multipliers of the constraints and their stiffness."""
        self.program, problem = program, program.problem
        self.segments = s = segments(problem, z)
        weights, steep = program.spread(multipliers), program.spread(stiffness)
        found = []
        for k, part in program.parts:
            found.append(_expanded(part, s.part(k), *([x[..., k] for x in pair] for pair in (weights, steep))))
        expansions, alone, first, rows = zip(*found, strict=True)
        chosen = [k for k, _ in program.parts]
        self.expansion: Expansion = joined(problem, list(expansions), chosen)
        self.values = program.flat(self.expansion.values, bounds(problem, s))
        self.objective = float(objective(problem, s))
        self.gradient, self.residual = (self._of_variables(joined(problem, list(x), chosen)) for x in (alone, first))
        rows = joined(problem, [np.moveaxis(x, 0, -1) for x in rows], chosen)
        self.matrix = assembly.hessian(problem, program.turns, np.moveaxis(rows, -1, 0))

    def _of_variables(self, first: Local) -> Variables:
        return assembly.gradient(self.program.problem, self.program.turns, self.segments, first)

    def pulled(self, weights: PerConstraint) -> Variables:
        """Return the gradient of a weighted sum of the constraints."""
        program, spread = self.program, self.program.spread(weights)
        found = [
            assembly.constraints_first(
                part, self.segments.part(k), self.expansion.part(k), *(x[..., k] for x in spread)
            )
            for k, part in program.groups
        ]
        return self._of_variables(joined(program.problem, found))

    def pushed(self, dz: Variables) -> PerConstraint:
        """Return the changes of the linearised constraints for a change of the variables."""
        problem, s = self.program.problem, self.segments
        change: Segments = assembly.changed_ends(problem, s, *moved(problem, dz))
        found = [assembly.pushed(part, self.expansion.part(k), change.part(k)) for k, part in self.program.groups]
        return self.program.flat(*joined(problem, found))

    def solver(self, shift: Shift = 0.0, indefinite: bool = False) -> Solver | None:
        """Return a function that solves systems with the matrix, or None if the matrix is not positive definite.

        `shift`, one number or one for each joint, is added to the diagonal entries of free variables. With
        `indefinite`, the result is None only for a singular matrix.
        """
        return self._shifted(shift).solver(indefinite)

    def indefinite_group(self, shift: Shift) -> int | None:
        """Return the joint where the factorisation of the shifted matrix fails; None if it is positive definite."""
        return self._shifted(shift).indefinite_block()

    def _shifted(self, shift: Shift) -> chain.Chain:
        if not np.any(shift):
            return self.matrix
        free = self.program.problem.free
        return self.matrix.shifted(np.broadcast_to(shift, len(free))[:, None] * free)

    def completed(self, dz: Variables) -> Variables:
        """Return a solution with the variables that repeat others."""
        return circuit.repeated(self.program.problem, dz)


def _expanded(
    problem: RouteProblem, s: Segments, weights: list[np.ndarray], stiffness: list[np.ndarray]
) -> tuple[Expansion, Local, Local, np.ndarray]:
    """Return the derivatives of some segments.

    They are the expansion of the constraints, the gradients of the objective and of the Lagrangian, and the matrix of
    the Newton steps with respect to the states and times at both ends.
    """
    expansion, curvature = expand(problem, s, weights[0], stiffness[0])
    alone = assembly.objective_first(problem, s)
    first = _sum(alone, assembly.constraints_first(problem, s, expansion, *weights))
    second = assembly.constraints_second(problem, expansion, curvature, weights[0], *stiffness)
    second = _sum(assembly.objective_second(problem, s), second)
    return expansion, alone, first, assembly.segment_hessian(problem, s, first, second)


def _sum(one: Any, other: Any) -> Any:
    """Return the sum of two tuples of arrays of the same class, `Local` or `LocalSecond`; None is zero."""
    pairs = zip(one, other, strict=True)
    return type(one)(*(y if x is None else x if y is None else x + y for x, y in pairs))
