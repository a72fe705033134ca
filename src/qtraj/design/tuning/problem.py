"""The tuning problem: which numbers may move, the path they make, and what is asked of it."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
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

DURATION = "duration"

Variables = Float[Array, " n"]


class Problem(eqx.Module):
    """Boundary velocities and the duration as dimensionless variables z, zero at the initial states.

    The velocities that the motion names, counted in units of `speed` from the initial ones, then ln T/T₀, which keeps
    the sense of rotation and the duration positive. The last variable is left out where the objective holds the
    duration.
    """

    start: Cylindrical
    end: Cylindrical
    turn: Scalar
    duration: Scalar  # T₀ [s]
    speed: Scalar  # V_ref [m/s]
    scale: Scalar  # the size of the objective
    placement: Placement
    axes: Float[Array, "3 3"]  # from the axes of the placement to the world's
    weights: Float[Array, " 7"]  # of the squared changes in "nearest": of VELOCITIES, and of the duration
    headed: Float[Array, " 2"]  # 1 where the heading is fixed, at the start and at the end, and 0 where not
    motion: AbstractMotion
    objective: AbstractObjective

    @property
    def names(self) -> tuple[str, ...]:
        """The variables, in their order in z."""
        return variable_names(self.motion, self.objective)

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.names)

    def path(self, z: Variables) -> SpiralHelix:
        """The path of these variables."""
        duration = self.time(z)
        return SpiralHelix(*self._between(*self.velocities(z, duration), duration), duration, self.placement)

    @property
    def ends(self) -> tuple[Vec3, Vec3]:
        """(ρ, φ, h) at both ends."""
        a, b = self.start, self.end
        first, last = (a.radius, a.azimuth, a.height), (b.radius, a.azimuth + self.turn, b.height)
        return jnp.stack(first), jnp.stack(last)

    def slopes(self, z: Variables) -> tuple[Float[Array, "2 3"], Scalar]:
        """The derivatives of ρ, φ and h in the fraction of the duration T [s] at both ends, and ln T."""
        duration = self.time(z)
        angular = jnp.asarray([[False, True, False]])
        radii = jnp.stack([self.start.radius, self.end.radius])[:, None]
        both = duration * jnp.stack(self.velocities(z, duration)) / jnp.where(angular, radii, 1.0)
        logarithm = jnp.log(self.duration)
        return both, logarithm if self.objective.holds_duration else logarithm + z[-1]

    def time(self, z: Variables) -> Scalar:
        """The duration [s] of the path of these variables."""
        return self.duration if self.objective.holds_duration else self.duration * jnp.exp(z[-1])

    def velocities(self, z: Variables, duration: Scalar) -> tuple[Vec3, Vec3]:
        """The cylindrical velocities [m/s] at both ends."""
        changes = self.speed * (z if self.objective.holds_duration else z[:-1])
        va, vb = self.motion.boundary_velocities(self.start, self.end, changes, self.turn, duration)
        return self._headed(va, self.start, self.headed[0]), self._headed(vb, self.end, self.headed[1])

    def without_objective(self) -> "Problem":
        """The same variables and path, with an objective that is cheap and smooth."""
        return dataclasses.replace(self, objective=Smoothest() if self.objective.holds_duration else Nearest())

    def cost(self, z: Variables) -> Scalar:
        """The objective over its scale."""
        return self.objective.value(self, z) / self.scale

    @staticmethod
    def _headed(velocity: Vec3, given: Cylindrical, headed: Scalar) -> Vec3:
        """A velocity whose V_ρ keeps the given heading, where that is fixed."""
        outwards, across = given.velocity[0], given.velocity[1]
        kept = outwards / jnp.where(across == 0, 1.0, across) * velocity[1]
        return jnp.where(jnp.asarray([True, False, False]) & (headed > 0), kept, velocity)

    def _between(self, va: Vec3, vb: Vec3, duration: Scalar) -> tuple[Array, Array, Array]:
        a = dataclasses.replace(self.start, velocity=va)
        b = dataclasses.replace(self.end, velocity=vb)
        return polynomials(a, b, self.turn, duration, uniform=self.motion.is_uniform)


def variable_names(motion: AbstractMotion, objective: AbstractObjective) -> tuple[str, ...]:
    """The variables of a motion, in their order in z."""
    return motion.velocities if objective.holds_duration else (*motion.velocities, DURATION)


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
) -> Problem:
    """The tuning problem between two states, of choices that `checks` has accepted; it can be traced."""
    placement = Placement() if placement is None else placement
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    angle = directed_turn(a, b, turns) if turn is None else _next_turn(a, b, turn)
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
        headed=jnp.asarray([float(name in fixed) for name in HEADINGS], speed.dtype),
        motion=motion,
        objective=objective,
    )
    return dataclasses.replace(problem, scale=objective.scale(problem))


def _next_turn(a: Cylindrical, b: Cylindrical, given: ScalarLike) -> Scalar:
    """The signed turn [rad] nearest to a given one that leads from azimuth to azimuth."""
    short = azimuth_difference(a, b)
    return short + 2 * jnp.pi * jnp.round((given - short) / (2 * jnp.pi))
