"""The tuning problem: which numbers may move, the path they make, and what is asked of it."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.limits import Limits
from qtraj.foundation.arrays import real_scalar, require_positive
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
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

LARGEST_CHANGE, LARGEST_LOGARITHM = 100.0, 5.0
"""How far a velocity may move, in reference speeds, and the logarithm of a rate or duration."""

TURN_TOLERANCE = 1e-6
"""[rad] A given turn may miss the azimuth of the end by this much."""

JERK_NODES = 16  # Gauss–Legendre, exact for |r⃛|² of cubics with a cubic angle (degree 18 ≤ 31)


class Problem(eqx.Module):
    """Boundary velocities (and the rate or the duration) as dimensionless variables z, zero at the given states.

    Uniform: [V_ρA, V_hA, V_ρB, V_hB] and ln ω. Hermite: all six components and ln T. Velocities are counted in units
    of `speed` from the given ones; the logarithms keep the sense of rotation and the duration positive. The last
    variable is left out where the duration is held.
    """

    start: Cylindrical
    end: Cylindrical
    turn: Scalar
    duration: Scalar  # T₀ of hermite, or the start value turn/ω₀ of uniform
    speed: Scalar  # V_ref [m/s]
    scale: Scalar  # the size of the objective, so that the solver sees numbers near one
    placement: Placement | None
    motion: str = eqx.field(static=True)
    objective: Objective
    holds_duration: bool = eqx.field(static=True)

    @property
    def size(self) -> int:
        """Number of variables."""
        return (4 if self.motion == "uniform" else 6) + (0 if self.holds_duration else 1)

    def path(self, z: Variables) -> SpiralHelix:
        """The path of these variables."""
        duration = self.duration if self.holds_duration else self.duration * jnp.exp(z[-1])
        va, vb = self._velocities(z, duration)
        a = dataclasses.replace(self.start, velocity=va)
        b = dataclasses.replace(self.end, velocity=vb)
        radius, angle, height = polynomials(a, b, self.turn, duration, uniform=self.motion == "uniform")
        return SpiralHelix(radius, angle, height, duration, self.placement)

    def cost(self, z: Variables) -> Scalar:
        """The objective over its scale."""
        return self.attained(z) / self.scale

    def attained(self, z: Variables) -> Scalar:
        """The objective in its own units."""
        path = self.path(z)
        if self.objective == "nearest":
            return self._distance(z, path)
        if self.objective == "fastest":
            return path.duration
        if self.objective == "smoothest":
            return integrated_squared_jerk(path)
        return jnp.asarray(self.objective(path))  # type: ignore[operator]

    def _velocities(self, z: Variables, duration: Scalar) -> tuple[Vec3, Vec3]:
        a, b, v = self.start.velocity, self.end.velocity, self.speed
        if self.motion == "hermite":
            return a + v * z[:3], b + v * z[3:6]
        rate = self.turn / duration
        va = jnp.stack([a[0] + v * z[0], rate * self.start.radius, a[2] + v * z[1]])
        vb = jnp.stack([b[0] + v * z[2], rate * self.end.radius, b[2] + v * z[3]])
        return va, vb

    def _distance(self, z: Variables, path: SpiralHelix) -> Scalar:
        va, vb = self._velocities(z, path.duration)
        changes = jnp.concatenate([va - self.start.velocity, vb - self.end.velocity])
        total = changes @ changes
        if self.motion == "hermite":
            total = total + ((path.duration - self.duration) / self.duration * self.speed) ** 2
        return total


def integrated_squared_jerk(path: SpiralHelix) -> Scalar:
    """∫|r⃛|²dt over the path [m² s⁻⁵], exact for cubic ρ, h and an angle up to cubic."""
    nodes, weights = np.polynomial.legendre.leggauss(JERK_NODES)
    t = path.duration * jnp.asarray((nodes + 1) / 2, path.duration.dtype)
    jerks = jax.vmap(lambda t: path.rotating_derivatives(t, 3)[3])(t)
    return path.duration / 2 * (jnp.asarray(weights, t.dtype) @ jnp.sum(jerks**2, axis=-1))


def pose(
    start: BoundaryState,
    end: BoundaryState,
    limits: Limits,
    objective: Objective,
    motion: str,
    duration: ArrayInput | None,
    turns: int,
    placement: Placement | None,
    turn: ArrayInput | None = None,
) -> Problem:
    """The tuning problem between two states.

    **Raises:** ValueError for input that makes no problem, saying what was given and what to do.
    """
    _require_choices(limits, objective, motion)
    if start.acceleration is not None or end.acceleration is not None:
        raise ValueError("tuning moves the boundary velocities and cannot keep given accelerations: leave them out")
    a, b = cylindrical(start, placement), cylindrical(end, placement)
    angle = directed_turn(a, b, turns) if turn is None else _given_turn(a, b, turn)
    _require_turn(a, b, angle, sense_is_known=turn is not None)
    speed = jnp.sqrt((start.velocity @ start.velocity + end.velocity @ end.velocity) / 2)
    own = _own_duration(a, b, angle, motion) if duration is None else real_scalar(duration, "the duration")
    require_positive(own, "the duration", "s")
    held = objective == "smoothest"
    if duration is not None and motion == "uniform" and not held:
        raise ValueError(
            "a duration was given, but uniform motion lasts as long as its rate says, and the rate is tuned. Leave it "
            "out, or take motion='hermite' or objective='smoothest', which hold or weigh a duration."
        )
    problem = Problem(
        a, b, angle, own.astype(speed.dtype), speed, jnp.ones_like(speed), placement, motion, objective, held
    )
    return dataclasses.replace(problem, scale=_scale(problem))


def _require_choices(limits: Limits, objective: Objective, motion: str) -> None:
    if not isinstance(limits, Limits):
        raise ValueError(f"limits must be a Limits, such as Limits(curvature=0.05), but {limits!r} was given")
    given = limits.given()
    if motion not in MOTIONS:
        raise ValueError(f"motion must be {' or '.join(map(repr, MOTIONS))}, but {motion!r} was given")
    if isinstance(objective, str) and objective not in OBJECTIVES:
        raise ValueError(
            f"objective must be one of {', '.join(map(repr, OBJECTIVES))} or a callable of a path, "
            f"but {objective!r} was given"
        )
    if not given:
        raise ValueError("no limit was given, so there is nothing to tune for: set at least one field of Limits")
    if objective == "fastest" and not any(name in BOUNDING for name in given):
        raise ValueError(
            f"nothing bounds the fastest path: the given limits ({', '.join(given)}) allow any speed. "
            f"Give one of {', '.join(BOUNDING)}."
        )


def _given_turn(a: Cylindrical, b: Cylindrical, turn: ArrayInput) -> Scalar:
    """The signed turn [rad] next to a given one that leads from azimuth to azimuth."""
    given = real_scalar(turn, "the turn").astype(a.radius.dtype)
    short = azimuth_difference(a, b)
    exact = short + 2 * jnp.pi * jnp.round((given - short) / (2 * jnp.pi))
    if abs(float(exact - given)) > TURN_TOLERANCE:
        raise ValueError(
            f"a turn of {float(given):.9g} rad does not lead from the start's azimuth to the end's: "
            f"the nearest that does is {float(exact):.9g} rad"
        )
    return exact


def _require_turn(a: Cylindrical, b: Cylindrical, turn: Scalar, sense_is_known: bool) -> None:
    if float(a.velocity[1]) == 0 and not sense_is_known:
        raise ValueError(
            "V_phi at the start is 0, so the sense of rotation is unknown. Give the start a velocity about the axis, "
            "or a placement whose axis lies elsewhere."
        )
    if float(a.radius) == 0 or float(b.radius) == 0:
        raise ValueError("a boundary position lies on the axis (radius 0): give a placement whose axis lies elsewhere")
    if float(turn) == 0:
        raise ValueError("the start and the end have the same azimuth: pass turns=1 for one whole turn")


def _own_duration(a: Cylindrical, b: Cylindrical, turn: Scalar, motion: str) -> Scalar:
    """turn over the rate that the given states have: the nearest one of uniform motion, or the mean of the two."""
    if motion == "uniform":
        rate = (a.radius * a.velocity[1] + b.radius * b.velocity[1]) / (a.radius**2 + b.radius**2)
    else:
        rate = (a.rate + b.rate) / 2
    if float(rate) * float(turn) <= 0:
        raise ValueError(
            f"the given states turn in opposite senses (V_phi/rho is {float(a.rate):.6g} rad/s at the start and "
            f"{float(b.rate):.6g} at the end), so they have no common duration: give the end a velocity in the sense "
            "of the start's, or take motion='hermite' with a duration."
        )
    return turn / rate


def _scale(problem: Problem) -> Scalar:
    """The objective's size: V_ref², T₀, or its value at the given states."""
    if problem.objective == "nearest":
        return problem.speed**2
    if problem.objective == "fastest":
        return problem.duration
    size = jnp.abs(problem.attained(jnp.zeros(problem.size, problem.speed.dtype)))
    if size.ndim != 0:
        raise ValueError(f"the objective must be one number, but it is an array of shape {size.shape}")
    if not jnp.isfinite(size):
        raise ValueError(f"the objective is {float(size)} at the given boundary states: it must be finite there")
    return jnp.where(size > 0, size, 1.0)
