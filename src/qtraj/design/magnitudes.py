"""The magnitudes that limits bound, at one instant and at their largest over a path."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.peaks import largest
from qtraj.foundation.types import Scalar, ScalarLike
from qtraj.path.components import Triple, cross, dot
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.invariants import Jets, rotating_components
from qtraj.path.placement import Placement
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

PER_TIME = {name: unit.count("/s") + unit.count("/s²") for name, unit in UNITS.items()}  # "/s²" holds a "/s", too
"""The power of 1/s in each unit: a path run through in half the time has 2 to this power times the magnitude."""

CELLS = 1025
"""Cells of time in which peaks are sought."""


def quantity(name: str, value: float) -> str:
    """A value of one magnitude with its unit, in words."""
    return f"{value:.6g} {UNITS[name]}".rstrip()


def netcdf_unit(name: str) -> str:
    """The unit of one magnitude as netCDF writes it: "m s-2" for "m/s²"; "1" for a number, or an unknown name."""
    written = {"1/m": "m-1", "m/s": "m s-1", "m/s²": "m s-2", "rad/s": "rad s-1", "rad/s²": "rad s-2"}
    return written.get(UNITS.get(name, ""), "1")


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
    if isinstance(path, SpiralHelix):
        return squared_of_spiral(name, path.jets(t, order), path.duration, path.placement)
    return jnp.asarray(
        formula(moving_components(path, t, order), lambda: (0, 0, 1), path.duration), path.duration.dtype
    )


def squared_of_spiral(name: str, jets: Jets, duration: Scalar, placement: Placement | None) -> Scalar:
    """As `squared`, from the Taylor coefficients of ρ, φ and h there: up to `order_of(name)`."""
    r, formula = rotating_components(*jets), _SQUARES[name][1]
    return jnp.asarray(formula(r, lambda: _upwards(placement, jets[1][0]), duration), duration.dtype)


def order_of(name: str) -> int:
    """The highest derivative that a magnitude needs."""
    return _SQUARES[name][0]


def magnitude(path: AbstractHodograph, t: ScalarLike, name: str) -> Scalar:
    """One limited magnitude at one instant, in its limit's unit; infinite where it grows without bound."""
    square = squared(path, t, name)
    positive = square > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square, 1.0)), 0.0)


Derivatives = list[Triple]
Upwards = Callable[[], Triple]
"""What gives the world's vertical in the basis of the derivatives."""


def _curvature(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    area, speed = _area_and_speed(r)
    return _over(area, speed**3)


def _torsion(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    area = cross(r[1], r[2])
    return _over(dot(area, r[3]) ** 2, dot(area, area) ** 2)


def _speed(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    return dot(r[1], r[1])


def _acceleration(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    return dot(r[2], r[2])


def _lateral(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    return _over(*_area_and_speed(r))


def _longitudinal(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    return _over(dot(r[1], r[2]) ** 2, dot(r[1], r[1]))


def _slope(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    vertical = up()
    rise = dot(r[1], vertical)
    x, y, z = (v - rise * u for v, u in zip(r[1], vertical, strict=True))
    return _over(rise**2, x**2 + y**2 + z**2)


def _angular_rate(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    area, speed = _area_and_speed(r)
    return speed * _torsion(r, up, duration) + _over(area, speed**2)


def _angular_acceleration(r: Derivatives, up: Upwards, duration: Scalar) -> ScalarLike:
    acceleration = Natural().trihedral(_stacked(r, duration), duration).acceleration
    return acceleration @ acceleration


_SQUARES: dict[str, tuple[int, Callable[[Derivatives, Upwards, Scalar], ScalarLike]]] = {
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


def _area_and_speed(r: Derivatives) -> tuple[ScalarLike, ScalarLike]:
    """N and S."""
    area = cross(r[1], r[2])
    return dot(area, area), dot(r[1], r[1])


def _over(part: ScalarLike, whole: ScalarLike) -> ScalarLike:
    """part/whole; 0/0 is 0, and anything else over 0 is infinite, with zero gradient there."""
    part, whole = jnp.asarray(part), jnp.asarray(whole)
    positive = whole > 0
    ratio = part / jnp.where(positive, whole, 1.0)
    return jnp.where(positive, ratio, jnp.where(part > 0, jnp.inf, 0.0))


def _upwards(placement: Placement | None, azimuth: ScalarLike) -> Triple:
    """The world's vertical in the rotating basis at one azimuth."""
    if placement is None:
        return (0, 0, 1)
    zero = jnp.zeros_like(azimuth)
    x, y, z = placement.to_local(jnp.stack([zero, zero, jnp.ones_like(zero)]))
    cos, sin = jnp.cos(azimuth), jnp.sin(azimuth)
    return (x * cos + y * sin, y * cos - x * sin, z)


def moving_components(path: AbstractHodograph, t: ScalarLike, order: int) -> Derivatives:
    """Derivatives in a basis of the path's own choice, by components."""
    if isinstance(path, SpiralHelix):
        return path.rotating_components(t, order)
    return [(row[0], row[1], row[2]) for row in path.derivatives(t, order)]


def moving_derivatives(path: AbstractHodograph, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
    """Derivatives in a basis of the path's own choice."""
    return _stacked(moving_components(path, t, order), path.duration)


def _stacked(r: Derivatives, like: Scalar) -> Float[Array, "n 3"]:
    return jnp.stack([jnp.stack([jnp.asarray(x, like.dtype) for x in row]) for row in r])
