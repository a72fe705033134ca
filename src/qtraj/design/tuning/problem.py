"""The tuning problem: its variables, the path as a function of the variables, and the objective."""

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.algebra.jets import exp, replaced
from qtraj.design.tuning import ends
from qtraj.design.tuning.clearances import Clearances
from qtraj.design.tuning.motions.motion import HEADINGS, AbstractMotion, Velocities
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.objectives.smoothest import Smoothest
from qtraj.foundation.arrays import is_traced
from qtraj.path.boundary import BoundaryState, Cylindrical
from qtraj.path.boundary_problem import whole_turns
from qtraj.path.placement import Placement
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.spiral_helix import SpiralHelix

DURATION = "duration"


@contextmanager
def broadcasting() -> Iterator[None]:
    """Let JAX broadcast arrays as NumPy does, because the formulas of this package serve both."""
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        yield


Variables = Any
"""The variables z of one problem or of a batch: n numbers, arrays or jets, as a sequence or as an array (n, *batch)."""


class Formulas:
    """The formulas of a tuning problem, for `Problem` and for its copy in `plain`.

    They are arithmetic: the variables may be numbers, arrays or jets, and all arrays may have batch axes.
    """

    start: Any
    end: Any
    turn: Any
    duration: Any
    speed: Any
    scale: Any
    offset: Any
    weights: Any
    heading_fixed: Any
    vertical: Any
    placement: Any
    road: Any
    clearances: Clearances | None
    motion: AbstractMotion
    objective: AbstractObjective

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the variables, in the order of z."""
        return variable_names(self.motion, self.objective)

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.names)

    @property
    def noise(self) -> Any:
        """The rounding error of the cost due to a constant in a user's objective."""
        return 10 * np.finfo(float).eps * abs(self.offset / self.scale)

    @property
    def zero(self) -> list[Any]:
        """The variables of the initial states."""
        return [0.0 * self.duration] * self.size

    def time(self, z: Variables) -> Any:
        """Return the duration [s] of the path for the variables `z`."""
        return self.duration if self.objective.fixes_duration else exp(z[-1]) * self.duration

    def velocities(self, z: Variables, duration: Any) -> Velocities:
        """Return the cylindrical velocities [m/s] at both ends; where the heading is fixed, V_ρ follows from V_φ."""
        changes = [z[k] * self.speed for k in range(len(self.motion.velocities))]
        both = self.motion.boundary_velocities(self.start, self.end, changes, self.turn, duration)
        tuned = []
        for k, state in enumerate((self.start, self.end)):
            fixed, angular = self.heading_fixed[..., k], state.velocity[..., 1]
            ratio = fixed * state.velocity[..., 0] / replaced(angular, ~((angular > 0) | (angular < 0)), 1.0)
            radial, along, up = both[k]
            tuned.append((radial * (1 - fixed) + along * ratio, along, up))
        return tuned[0], tuned[1]

    def slopes(self, z: Variables) -> Velocities:
        """Return the derivatives of ρ, φ and h at both ends with respect to u = t/T, where T is the duration."""
        duration = self.time(z)
        results = []
        for state, (radial, along, up) in zip((self.start, self.end), self.velocities(z, duration), strict=True):
            results.append((radial * duration, along * duration * (1 / state.radius), up * duration))
        return results[0], results[1]

    def cubics(self, z: Variables) -> tuple[list[Any], list[Any], list[Any]]:
        """Return the ascending coefficients of ρ, φ and h in u = t/T; φ has two coefficients in uniform motion."""
        first, last = self.slopes(z)
        a, b = self.start, self.end
        radius = _cubic(a.radius, b.radius - a.radius, first[0], last[0])
        angle = [a.azimuth, self.turn]
        if not self.motion.is_uniform:
            angle = _cubic(a.azimuth, self.turn, first[1], last[1])
        return radius, angle, _cubic(a.height, b.height - a.height, first[2], last[2])

    def cost(self, z: Variables) -> Any:
        """Return the objective divided by its scale; for a user's objective, 1 plus its scaled change from `offset`."""
        # A bound method of a Module is slow.
        value = type(self.objective).value(self.objective, self, z)
        if self.objective.is_formula:
            return value * (1 / self.scale)
        # Optimisers have tolerances relative to the cost; with the 1, these have a meaning.
        return (value - self.offset) * (1 / self.scale) + 1.0


class Problem(Formulas, eqx.Module):
    """A tuning problem, whose variables z are dimensionless changes of boundary velocities and of the duration.

    z contains the changes of the velocity components that the motion names, in units of `speed`, and then ln(T/T₀),
    where T₀ is the initial duration. The logarithm keeps the duration T positive and the sense of rotation unchanged. z
    does not contain ln(T/T₀) if the objective fixes the duration. All variables are zero for the initial states.

    The arrays belong to NumPy or JAX and may have leading batch axes.
    """

    start: Cylindrical
    end: Cylindrical
    turn: Any  # [rad]
    duration: Any  # T₀ [s]
    speed: Any  # V_ref [m/s]
    scale: Any  # unit of the objective
    offset: Any  # a user's objective at the start of a search (see `rescaling`), otherwise 0
    placement: Placement
    vertical: Float[Any, "*batch 3"]  # the world's z axis in the axes of the placement
    weights: Float[Any, "*batch 7"]  # of the squared changes of VELOCITIES and of the duration, in "nearest"
    heading_fixed: Float[Any, "*batch 2"]  # 1 for a fixed heading, otherwise 0; start and end
    motion: AbstractMotion
    objective: AbstractObjective
    road: RoadParameters | None = None  # of the vehicle, if a limit needs one
    clearances: Clearances | None = eqx.field(static=True, default=None)  # of the body from obstacles

    def path(self, z: Variables) -> SpiralHelix:
        """Return the path for the variables `z`; a batch of paths for a batch."""
        with broadcasting():
            return self._path(z)

    def _path(self, z: Variables) -> SpiralHelix:
        duration = self.time(z)
        cubics = [[c / duration**k for k, c in enumerate(cubic)] for cubic in self.cubics(z)]
        xp: Any = jnp if any(isinstance(x, jax.Array) for x in (duration, *cubics[0])) else np
        radius, angle, height = (xp.stack(xp.broadcast_arrays(*c), axis=-1) for c in cubics)
        example = SpiralHelix([1.0], [0.0], [0.0], 1.0, Placement())
        fields = (radius, angle, height, duration, self.placement, 0.0 * duration)
        return eqx.tree_at(
            lambda p: (p.radius, p.angle, p.height, p.duration, p.placement, p.mismatch), example, fields
        )

    def world_velocities(self, z: Variables) -> tuple[Any, Any]:
        """Return the velocities (*batch, 3) at both ends in world axes [m/s]."""
        first, last = self.velocities(z, self.time(z))
        xp: Any = jnp if any(isinstance(x, jax.Array) for x in (*first, *last)) else np
        orientation = self.placement.orientation
        return ends.in_world(self.start, first, orientation, xp), ends.in_world(self.end, last, orientation, xp)

    def without_objective(self) -> "Problem":
        """Return the same problem with an objective that is cheap and smooth."""
        return dataclasses.replace(self, objective=Smoothest() if self.objective.fixes_duration else Nearest())


def plain(problem: Problem) -> Formulas:
    """Return a copy of the formulas' data without the slow attributes of equinox modules."""
    copy = Formulas()
    copy.__dict__.update({f.name: getattr(problem, f.name) for f in dataclasses.fields(problem)})
    for name in ("start", "end"):
        state = getattr(problem, name)
        copy.__dict__[name] = SimpleNamespace(**{f.name: getattr(state, f.name) for f in dataclasses.fields(state)})
    return copy


def _cubic(first: Any, difference: Any, slope: Any, last_slope: Any) -> list[Any]:
    """Return the ascending coefficients of the cubic with a first value, a difference, and slopes at both ends."""
    total = slope + last_slope
    return [first, slope, 3 * difference - (total + slope), total - 2 * difference]


def variable_names(motion: AbstractMotion, objective: AbstractObjective) -> tuple[str, ...]:
    """Return the names of the variables, in the order of z."""
    return motion.velocities if objective.fixes_duration else (*motion.velocities, DURATION)


def pose(
    start: BoundaryState,
    end: BoundaryState,
    objective: AbstractObjective,
    motion: AbstractMotion,
    duration: Any = None,
    turns: int = 0,
    placement: Placement | None = None,
    turn: Any = None,
    weights: Float[Any, " 7"] | None = None,
    fixed: Sequence[str] = (),
    road: RoadParameters | None = None,
    clearances: Clearances | None = None,
) -> Problem:
    """Return the tuning problem between two states, or a batch of them, for arguments that passed `require_choices`.

    The problem has NumPy arrays if all arguments have concrete values.

    **Raises:** ValueError if `turns` is negative or not an integer.
    """
    if whole_turns(turns) < 0:
        raise ValueError(
            "turns is the number of additional whole turns in the direction of V_phi and must be 0 or more, but "
            f"{turns} was given"
        )
    placement = Placement() if placement is None else placement
    xp: Any = np
    if is_traced(start, end, duration, placement, turn, weights, road, objective):
        xp = jnp
    data = (start, end, duration, placement, turn, road, np.ones(7) if weights is None else weights)
    start, end, duration, placed, turn, road, weights = jax.tree.map(lambda x: xp.asarray(x, float), data)
    batch = start.position.shape[:-1]
    placed = jax.tree.map(lambda x: xp.broadcast_to(x, (*batch, x.shape[-1])), placed)
    own = placed.origin, placed.orientation, xp
    a, b = (ends.cylindrical(state.position, state.velocity, *own) for state in (start, end))
    angle = ends.signed_turn(a, b, turns, turn, xp)
    speed = xp.sqrt((start.velocity**2 + end.velocity**2).sum(axis=-1) / 2)
    headings = np.asarray([float(name in fixed) for name in HEADINGS])
    objective = jax.tree.map(lambda x: xp.broadcast_to(x, (*batch, *np.shape(x))), objective)
    problem = Problem(
        start=a,
        end=b,
        turn=angle,
        duration=motion.duration(a, b, angle) if duration is None else xp.broadcast_to(duration, batch),
        speed=speed,
        scale=xp.ones_like(speed),
        offset=xp.zeros_like(speed),
        placement=placed,
        vertical=ends.vertical(placed.orientation, xp),
        weights=xp.broadcast_to(weights, (*batch, 7)),
        heading_fixed=xp.broadcast_to(xp.asarray(headings), (*batch, 2)),
        motion=motion,
        objective=objective,
        road=None if road is None else road.each(lambda x: xp.broadcast_to(x, batch)),
        clearances=clearances,
    )
    return dataclasses.replace(problem, scale=objective.scale(problem))
