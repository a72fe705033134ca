"""The tuning problem: which numbers may move, the path they make, and what is asked of it."""

import dataclasses
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar, ScalarLike, Vec3
from qtraj.path.boundary import BoundaryState, Cylindrical, azimuth_difference, cylindrical
from qtraj.path.boundary_problem import directed_turn, polynomials
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

MOTIONS = ("uniform", "hermite")
OBJECTIVES = ("nearest", "fastest", "smoothest")

BOUNDING = ("speed", "acceleration", "lateral_acceleration", "angular_rate")
"""Limits of which a fastest path needs one, not to arrive at once."""

Objective = str | Callable[[AbstractHodograph], Scalar]
Variables = Float[Array, " n"]

COMPONENTS = ("V_rho", "V_phi", "V_h")
ENDS = ("start", "end")
VELOCITIES = tuple(f"{end}.{component}" for end in ENDS for component in COMPONENTS)

DURATION = "duration"

JERK_NODES = 16  # Gauss–Legendre, exact for |r⃛|² of cubics with a cubic angle (degree 18 ≤ 31)


class Course(NamedTuple):
    """A path of the problem: its polynomials in the fraction of the duration, and the duration [s]."""

    radius: Float[Array, " n_radius"]
    angle: Float[Array, " n_angle"]
    height: Float[Array, " n_height"]
    duration: Scalar


class Problem(eqx.Module):
    """Boundary velocities (and the rate or the duration) as dimensionless variables z, zero at the given states.

    Uniform: [V_ρA, V_hA, V_ρB, V_hB] and ln T/T₀. Hermite: all six components and ln T/T₀. Velocities are counted in
    units of `speed` from the given ones; the logarithm keeps the sense of rotation and the duration positive. The
    last variable is left out where the duration is held.
    """

    start: Cylindrical
    end: Cylindrical
    turn: Scalar
    duration: Scalar  # T₀ of hermite, or the start value turn/ω₀ of uniform
    speed: Scalar  # V_ref [m/s]
    scale: Scalar  # the size of the objective, so that the solver sees numbers near one
    placement: Placement | None
    weights: Float[Array, " 7"]  # of the squared changes in "nearest": of VELOCITIES, and of the duration
    motion: str = eqx.field(static=True)
    objective: Objective = eqx.field(static=True)
    holds_duration: bool = eqx.field(static=True)

    @property
    def names(self) -> tuple[str, ...]:
        """The variables, in their order in z."""
        return variable_names(self.motion, self.holds_duration)

    @property
    def size(self) -> int:
        """Number of variables."""
        return len(self.names)

    def path(self, z: Variables) -> SpiralHelix:
        """The path of these variables."""
        duration = self.time(z)
        return self._between(*self._velocities(z, duration), duration)

    def course(self, z: Variables) -> Course:
        """What the path of these variables consists of; limits are formed from it, and objectives from `path`."""
        duration = self.time(z)
        va, vb = self._velocities(z, duration)
        unit = self._between(va * duration, vb * duration, jnp.ones_like(duration))
        return Course(unit.radius, unit.angle, unit.height, duration)

    def time(self, z: Variables) -> Scalar:
        """The duration [s] of the path of these variables."""
        return self.duration if self.holds_duration else self.duration * jnp.exp(z[-1])

    def without_objective(self) -> "Problem":
        """The same variables and path, with an objective that is cheap and smooth."""
        plain = "smoothest" if self.holds_duration else "nearest"
        return dataclasses.replace(self, objective=plain)

    def cost(self, z: Variables) -> Scalar:
        """The objective over its scale."""
        return self.attained(z) / self.scale

    def attained(self, z: Variables) -> Scalar:
        """The objective in its own units."""
        if self.objective == "nearest":
            return self._distance(z)
        if self.objective == "fastest":
            return self.time(z)
        if self.objective == "smoothest":
            return integrated_squared_jerk(self.path(z))
        return jnp.asarray(self.objective(self.path(z)))  # type: ignore[operator]

    def _velocities(self, z: Variables, duration: Scalar) -> tuple[Vec3, Vec3]:
        a, b, v = self.start.velocity, self.end.velocity, self.speed
        if self.motion == "hermite":
            return a + v * z[:3], b + v * z[3:6]
        rate = self.turn / duration
        va = jnp.stack([a[0] + v * z[0], rate * self.start.radius, a[2] + v * z[1]])
        vb = jnp.stack([b[0] + v * z[2], rate * self.end.radius, b[2] + v * z[3]])
        return va, vb

    def _between(self, va: Vec3, vb: Vec3, duration: Scalar) -> SpiralHelix:
        a = dataclasses.replace(self.start, velocity=va)
        b = dataclasses.replace(self.end, velocity=vb)
        radius, angle, height = polynomials(a, b, self.turn, duration, uniform=self.motion == "uniform")
        return SpiralHelix(radius, angle, height, duration, self.placement)

    def _distance(self, z: Variables) -> Scalar:
        duration = self.time(z)
        va, vb = self._velocities(z, duration)
        changes = jnp.concatenate([va - self.start.velocity, vb - self.end.velocity])
        total = self.weights[:6] @ changes**2
        if self.motion == "hermite":
            total = total + self.weights[6] * ((duration - self.duration) / self.duration * self.speed) ** 2
        return total


def variable_names(motion: str, holds_duration: bool) -> tuple[str, ...]:
    """The variables of a motion, in their order in z."""
    free = VELOCITIES if motion == "hermite" else tuple(v for v in VELOCITIES if not v.endswith(COMPONENTS[1]))
    return free if holds_duration else (*free, DURATION)


def integrated_squared_jerk(path: SpiralHelix) -> Scalar:
    """∫|r⃛|²dt over the path [m² s⁻⁵], exact for cubic ρ, h and an angle up to cubic."""
    nodes, weights = np.polynomial.legendre.leggauss(JERK_NODES)
    t = path.duration * jnp.asarray((nodes + 1) / 2, path.duration.dtype)
    jerks = jax.vmap(lambda t: path.rotating_derivatives(t, 3)[3])(t)
    return path.duration / 2 * (jnp.asarray(weights, t.dtype) @ jnp.sum(jerks**2, axis=-1))


def pose(
    start: BoundaryState,
    end: BoundaryState,
    objective: Objective,
    motion: str,
    duration: ScalarLike | None,
    turns: int,
    placement: Placement | None,
    turn: ScalarLike | None = None,
    weights: Float[Array, " 7"] | None = None,
) -> Problem:
    """The tuning problem between two states, of choices that `checks` has found good; it can be traced."""
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    angle = directed_turn(a, b, turns) if turn is None else _next_turn(a, b, turn)
    speed = jnp.sqrt((start.velocity @ start.velocity + end.velocity @ end.velocity) / 2)
    problem = Problem(
        start=a,
        end=b,
        turn=angle,
        duration=_own_duration(a, b, angle, motion) if duration is None else jnp.asarray(duration, speed.dtype),
        speed=speed,
        scale=jnp.ones_like(speed),
        placement=placement,
        weights=jnp.ones(7, speed.dtype) if weights is None else weights,
        motion=motion,
        objective=objective,
        holds_duration=objective == "smoothest",
    )
    return dataclasses.replace(problem, scale=_scale(problem))


def _next_turn(a: Cylindrical, b: Cylindrical, given: ScalarLike) -> Scalar:
    """The signed turn [rad] next to a given one that leads from azimuth to azimuth."""
    short = azimuth_difference(a, b)
    return short + 2 * jnp.pi * jnp.round((given - short) / (2 * jnp.pi))


def _own_duration(a: Cylindrical, b: Cylindrical, turn: Scalar, motion: str) -> Scalar:
    """turn over the rate that the given states have: the nearest one of uniform motion, or the mean of the two."""
    if motion == "uniform":
        rate = (a.radius * a.velocity[1] + b.radius * b.velocity[1]) / (a.radius**2 + b.radius**2)
    else:
        rate = (a.rate + b.rate) / 2
    return turn / rate


def _scale(problem: Problem) -> Scalar:
    """The objective's size: V_ref², T₀, or its value at the given states."""
    if problem.objective == "nearest":
        heaviest = jnp.max(problem.weights)
        return problem.speed**2 * jnp.where(heaviest > 0, heaviest, 1.0)
    if problem.objective == "fastest":
        return problem.duration
    size = jnp.abs(problem.attained(jnp.zeros(problem.size, problem.speed.dtype)))
    if size.ndim != 0:
        raise ValueError(f"the objective must be one number, but it is an array of shape {size.shape}")
    return jnp.where(size == 0, 1.0, size)
