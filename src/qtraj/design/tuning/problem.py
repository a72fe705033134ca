"""The tuning problem: its variables, the path as a function of the variables, and the objective."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import rotation
from qtraj.design.tuning.motions.motion import HEADINGS, AbstractMotion
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.design.tuning.objectives.smoothest import Smoothest
from qtraj.foundation.types import Scalar, ScalarLike, Vec3
from qtraj.path.boundary import BoundaryState, Cylindrical, azimuth_difference, cylindrical
from qtraj.path.boundary_problem import directed_turn, polynomials
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.vehicle import RoadParameters

DURATION = "duration"

Variables = Float[Array, " n"]


class Problem(eqx.Module):
    """A tuning problem, whose variables z are dimensionless changes of boundary velocities and of the duration.

    z contains the changes of the velocity components that the motion names, in units of `speed`, and then ln(T/T₀),
    where T₀ is the initial duration. The logarithm keeps the duration T positive and the sense of rotation unchanged. z
    does not contain ln(T/T₀) if the objective fixes the duration. All variables are zero for the initial states.
    """

    start: Cylindrical
    end: Cylindrical
    turn: Scalar
    duration: Scalar  # T₀ [s]
    speed: Scalar  # V_ref [m/s]
    scale: Scalar  # magnitude of the objective
    placement: Placement
    axes: Float[Array, "3 3"]  # rotation from the axes of the placement to world axes
    weights: Float[Array, " 7"]  # of the squared changes of VELOCITIES and of the duration, in "nearest"
    heading_fixed: Float[Array, " 2"]  # 1 for a fixed heading, otherwise 0; start and end
    motion: AbstractMotion
    objective: AbstractObjective
    road: RoadParameters | None = None  # of the vehicle, if a limit needs one

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the variables, in the order of z."""
        return variable_names(self.motion, self.objective)

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.names)

    def path(self, z: Variables) -> SpiralHelix:
        """Return the path for the variables `z`."""
        duration = self.time(z)
        va, vb = self.velocities(z, duration)
        return SpiralHelix(*self._between(va, vb, duration), duration, self.placement)

    @property
    def ends(self) -> tuple[Vec3, Vec3]:
        """The coordinates (ρ, φ, h) at both ends."""
        a, b = self.start, self.end
        first, last = (a.radius, a.azimuth, a.height), (b.radius, a.azimuth + self.turn, b.height)
        return jnp.stack(first), jnp.stack(last)

    def slopes(self, z: Variables) -> tuple[Float[Array, "2 3"], Scalar]:
        """Return the derivatives of ρ, φ and h with respect to u = t/T at both ends, and ln T; T is the duration."""
        return _slopes(self, z)

    def time(self, z: Variables) -> Scalar:
        """Return the duration [s] of the path for the variables `z`."""
        return self.duration if self.objective.fixes_duration else self.duration * jnp.exp(z[-1])

    def velocities(self, z: Variables, duration: Scalar) -> Float[Array, "2 3"]:
        """Return the cylindrical velocities [m/s] at both ends."""
        return _velocities(self, z, duration)

    @property
    def initial_velocities(self) -> Float[Array, "2 3"]:
        """The cylindrical velocities [m/s] of the initial states."""
        return jnp.stack([self.start.velocity, self.end.velocity])

    def without_objective(self) -> "Problem":
        """Return the same problem with an objective that is cheap and smooth."""
        return dataclasses.replace(self, objective=Smoothest() if self.objective.fixes_duration else Nearest())

    def cost(self, z: Variables) -> Scalar:
        """Return the objective divided by its scale."""
        return self.objective.value(self, z) / self.scale

    def _between(self, va: Vec3, vb: Vec3, duration: Scalar) -> tuple[Array, Array, Array]:
        a = dataclasses.replace(self.start, velocity=va)
        b = dataclasses.replace(self.end, velocity=vb)
        return polynomials(a, b, self.turn, duration, uniform=self.motion.is_uniform)


@jax.jit  # traced once for each shape, not at each call
def _slopes(problem: Problem, z: Variables) -> tuple[Float[Array, "2 3"], Scalar]:
    duration = problem.time(z)
    radii = jnp.stack([problem.start.radius, problem.end.radius])[:, None]
    slopes = duration * _velocities(problem, z, duration) / jnp.where(np.asarray([[False, True, False]]), radii, 1.0)
    logarithm = jnp.log(problem.duration)
    return slopes, logarithm if problem.objective.fixes_duration else logarithm + z[-1]


@jax.jit
def _velocities(problem: Problem, z: Variables, duration: Scalar) -> Float[Array, "2 3"]:
    """Return the velocities at both ends; where the heading is fixed, V_ρ follows from V_φ."""
    a, b = problem.start, problem.end
    changes = problem.speed * (z if problem.objective.fixes_duration else z[:-1])
    velocities = jnp.stack(problem.motion.boundary_velocities(a, b, changes, problem.turn, duration))
    outward, angular = (problem.initial_velocities[:, k : k + 1] for k in (0, 1))
    radial = outward / jnp.where(angular == 0, 1.0, angular) * velocities[:, 1:2]
    replaced = (problem.heading_fixed > 0)[:, None] & np.asarray([[True, False, False]])
    return jnp.where(replaced, radial, velocities)


def variable_names(motion: AbstractMotion, objective: AbstractObjective) -> tuple[str, ...]:
    """Return the names of the variables, in the order of z."""
    return motion.velocities if objective.fixes_duration else (*motion.velocities, DURATION)


def pose(
    start: BoundaryState,
    end: BoundaryState,
    objective: AbstractObjective,
    motion: AbstractMotion,
    duration: ScalarLike | None,
    turns: int,
    placement: Placement | None,
    turn: ScalarLike | None = None,
    weights: Float[Array, " 7"] | None = None,
    fixed: Sequence[str] = (),
    road: RoadParameters | None = None,
) -> Problem:
    """Return the tuning problem between two states, for arguments that passed `require_choices` and may be traced."""
    placement = Placement() if placement is None else placement
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    angle = directed_turn(a, b, turns) if turn is None else _nearest_turn(a, b, turn)
    speed = jnp.sqrt((start.velocity @ start.velocity + end.velocity @ end.velocity) / 2)
    problem = Problem(
        start=a,
        end=b,
        turn=angle,
        duration=motion.duration(a, b, angle) if duration is None else jnp.asarray(duration, speed.dtype),
        speed=speed,
        scale=jnp.ones_like(speed),
        placement=placement,
        axes=rotation.to_dcm(placement.orientation).T,
        weights=jnp.ones(7, speed.dtype) if weights is None else weights,
        heading_fixed=jnp.asarray([float(name in fixed) for name in HEADINGS], speed.dtype),
        motion=motion,
        objective=objective,
        road=road,
    )
    return dataclasses.replace(problem, scale=objective.scale(problem))


def _nearest_turn(a: Cylindrical, b: Cylindrical, turn: ScalarLike) -> Scalar:
    """Return the signed turn [rad] between the azimuths of `a` and `b` that is closest to the user's turn."""
    short = azimuth_difference(a, b)
    return short + 2 * jnp.pi * jnp.round((turn - short) / (2 * jnp.pi))
