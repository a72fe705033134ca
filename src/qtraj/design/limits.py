"""Limits on a path, and how far a path keeps from them."""

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.algebra import polynomial
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path.hodograph import AbstractHodograph
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
        quantities = magnitudes(path, t)
        return {name: quantities[name] for name in self.given()}

    def margins(self, path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
        """Limit less magnitude at one instant `t` [s], by name: negative where the limit is broken."""
        limits = self.given()
        return {name: limits[name] - value for name, value in self.values(path, t).items()}


def magnitudes(path: AbstractHodograph, t: ScalarLike) -> dict[str, Scalar]:
    """Every magnitude that can be limited, at one instant; computed in the rotating basis where the path has one."""
    r, up = _moving_derivatives(path, t)
    trihedral = Natural().trihedral(r, path.duration)
    speed, curvature = trihedral.speed, trihedral.curvature
    moving = speed > 0
    rise = r[1] @ up
    run = norm(r[1] - rise * up)
    return {
        "curvature": curvature,
        "torsion": jnp.abs(trihedral.torsion),
        "speed": speed,
        "acceleration": norm(r[2]),
        "lateral_acceleration": curvature * speed**2,
        "longitudinal_acceleration": jnp.abs(r[1] @ r[2]) / jnp.where(moving, speed, 1.0),
        "slope": jnp.where(run > 0, jnp.abs(rise) / jnp.where(run > 0, run, 1.0), jnp.inf),
        "angular_rate": norm(trihedral.rate),
        "angular_acceleration": norm(trihedral.acceleration),
    }


def _moving_derivatives(path: AbstractHodograph, t: ScalarLike) -> tuple[Float[Array, "5 3"], Vec3]:
    """Derivatives in a basis of the path's own choice, and the world's vertical in that basis."""
    if not isinstance(path, SpiralHelix):
        r = path.derivatives(t, 4)
        return r, jnp.zeros_like(r[0]).at[2].set(1.0)
    r = path.rotating_derivatives(t, 4)
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
