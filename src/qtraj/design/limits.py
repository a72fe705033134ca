"""Limits on a path, and how far a path keeps from them."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.design.peaks import largest
from qtraj.foundation.arrays import as_float, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import invariants
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.trihedral import Natural

UNITS = {
    "curvature": "1/m",
    "torsion": "1/m",
    "speed": "m/s",
    "acceleration": "m/s²",
    "lateral_acceleration": "m/s²",
    "longitudinal_acceleration": "m/s²",
    "slope": "",
    "angular_rate": "rad/s",
    "angular_acceleration": "rad/s²",
}
"""The unit of each limit; their order here is the order everywhere."""


CELLS = 1025
"""Cells of time in which peaks are sought."""


@storable
class Limits(eqx.Module):
    """Upper bounds on magnitudes along a path; None leaves a quantity free.

    `curvature`, `torsion` [1/m]; `speed` [m/s]; `acceleration` |r̈|, `lateral_acceleration` |ṙ×r̈|/|ṙ|,
    `longitudinal_acceleration` |ṙ·r̈|/|ṙ| [m/s²]; `slope` rise over run against the world's z axis [-];
    `angular_rate` [rad/s] and `angular_acceleration` [rad/s²] of the natural trihedral.

    **Raises:** ValueError for a limit that is not a positive finite number.
    """

    curvature: Scalar | None
    torsion: Scalar | None
    speed: Scalar | None
    acceleration: Scalar | None
    lateral_acceleration: Scalar | None
    longitudinal_acceleration: Scalar | None
    slope: Scalar | None
    angular_rate: Scalar | None
    angular_acceleration: Scalar | None

    def __init__(
        self,
        curvature: ArrayInput | None = None,
        torsion: ArrayInput | None = None,
        speed: ArrayInput | None = None,
        acceleration: ArrayInput | None = None,
        lateral_acceleration: ArrayInput | None = None,
        longitudinal_acceleration: ArrayInput | None = None,
        slope: ArrayInput | None = None,
        angular_rate: ArrayInput | None = None,
        angular_acceleration: ArrayInput | None = None,
    ):
        self.curvature = _limit(curvature, "curvature")
        self.torsion = _limit(torsion, "torsion")
        self.speed = _limit(speed, "speed")
        self.acceleration = _limit(acceleration, "acceleration")
        self.lateral_acceleration = _limit(lateral_acceleration, "lateral_acceleration")
        self.longitudinal_acceleration = _limit(longitudinal_acceleration, "longitudinal_acceleration")
        self.slope = _limit(slope, "slope")
        self.angular_rate = _limit(angular_rate, "angular_rate")
        self.angular_acceleration = _limit(angular_acceleration, "angular_acceleration")

    def given(self) -> dict[str, Scalar]:
        """The limits that are set, by name."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return {name: value for name, value in values.items() if value is not None}

    def values(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """The limited magnitudes of `path` at one instant `t` [s], by name, each in its limit's unit."""
        return {name: magnitude(path, t, name) for name in self.given()}

    def margins(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """Limit less magnitude at one instant `t` [s], by name: negative where the limit is broken."""
        limits = self.given()
        return {name: limits[name] - value for name, value in self.values(path, t).items()}


def quantity(name: str, value: float) -> str:
    """A value of one magnitude with its unit, in words."""
    return f"{value:.6g} {UNITS[name]}".rstrip()


def peak(path: AbstractHodograph, name: str) -> tuple[Scalar, Scalar]:
    """Time [s] and size of the largest value of one magnitude (a field of `Limits`) over the whole path.

    Sought in 1025 cells of time by Newton's method; differentiable in the path (envelope theorem).

    **Raises:** ValueError for an unknown name.
    """
    if name not in UNITS:
        raise ValueError(f"unknown magnitude {name!r}; known are {', '.join(UNITS)}")
    return largest(lambda path, t: magnitude(path, t, name), path, CELLS)


def squared(path: AbstractHodograph, t: ScalarLike, name: str) -> Scalar:
    """The square of one limited magnitude at one instant: a ratio of polynomials in t for a spiral-helix."""
    order, formula = _SQUARES[name]
    r, up = moving_derivatives(path, t, order)
    return formula(r, up, path.duration)


def magnitude(path: AbstractHodograph, t: ScalarLike, name: str) -> Scalar:
    """One limited magnitude at one instant, in its limit's unit; infinite where it grows without bound."""
    square = squared(path, t, name)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


Derivatives = Float[Array, "n 3"]


def _curvature(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    area, speed = _area_and_speed(r)
    return _over(area, speed**3)


def _torsion(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    of = invariants(r[1], r[2], r[3])
    return _over(of.T**2, of.N**2)


def _speed(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    return r[1] @ r[1]


def _acceleration(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    return r[2] @ r[2]


def _lateral(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    return _over(*_area_and_speed(r))


def _longitudinal(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    return _over((r[1] @ r[2]) ** 2, r[1] @ r[1])


def _slope(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    rise = r[1] @ up
    run = r[1] - rise * up
    return _over(rise**2, run @ run)


def _angular_rate(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    of = invariants(r[1], r[2], r[3])
    return of.S * _over(of.T**2, of.N**2) + _over(of.N, of.S**2)


def _angular_acceleration(r: Derivatives, up: Vec3, duration: Scalar) -> Scalar:
    acceleration = Natural().trihedral(r, duration).acceleration
    return acceleration @ acceleration


_SQUARES: dict[str, tuple[int, Callable[[Derivatives, Vec3, Scalar], Scalar]]] = {
    "curvature": (2, _curvature),
    "torsion": (3, _torsion),
    "speed": (1, _speed),
    "acceleration": (2, _acceleration),
    "lateral_acceleration": (2, _lateral),
    "longitudinal_acceleration": (2, _longitudinal),
    "slope": (1, _slope),
    "angular_rate": (3, _angular_rate),
    "angular_acceleration": (4, _angular_acceleration),
}
"""Of each magnitude: the highest derivative it needs, and its square."""


def _area_and_speed(r: Derivatives) -> tuple[Scalar, Scalar]:
    """N and S alone, for what needs no third derivative."""
    of = invariants(r[1], r[2], jnp.zeros_like(r[1]))
    return of.N, of.S


def _over(part: Scalar, whole: Scalar) -> Scalar:
    """part/whole; 0/0 is 0, and anything else over 0 is infinite, with zero gradient there."""
    positive = whole > 0
    ratio = part / jnp.where(positive, whole, 1.0)
    return jnp.where(positive, ratio, jnp.where(part > 0, jnp.inf, 0.0))


def moving_derivatives(path: AbstractHodograph, t: ScalarLike, order: int) -> tuple[Float[Array, "{order}+1 3"], Vec3]:
    """Derivatives in a basis of the path's own choice, and the world's vertical in that basis."""
    if not isinstance(path, SpiralHelix):
        r = path.derivatives(t, order)
        return r, jnp.zeros_like(r[0]).at[2].set(1.0)
    r = path.rotating_derivatives(t, order)
    vertical = jnp.zeros_like(r[0]).at[2].set(1.0)
    if path.placement is None:
        return r, vertical
    x, y, z = path.placement.to_local(vertical)
    phi = polynomial.evaluate(path.angle, t)
    cos, sin = jnp.cos(phi), jnp.sin(phi)
    return r, jnp.stack([x * cos + y * sin, y * cos - x * sin, z])


def _limit(value: ArrayInput | None, name: str) -> Scalar | None:
    if value is None:
        return None
    try:
        limit = as_float(value)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"the limit {name} must be a number [{UNITS[name] or '-'}], but {value!r} was given"
        ) from error
    if limit.ndim != 0:
        raise ValueError(f"the limit {name} must be one number, but an array of shape {limit.shape} was given")
    require_positive(limit, f"the limit {name}", UNITS[name] or "-")
    return limit
