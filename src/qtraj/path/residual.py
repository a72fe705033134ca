"""How well a path follows a recorded track."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_array, as_float, concrete
from qtraj.foundation.document import storable
from qtraj.foundation.exported.kept import kept
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, extent, in_lanes
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.spiral_helix import SpiralHelix
from qtraj.path.track import STANDING, Track, known_elapsed

OVERHANG = 1e-6
"""A track may outlast the path it is compared with by this part of the path's duration: rounding, no more."""

MEANINGS = {
    "horizontal_rms": ("m", "root mean square of the horizontal distance"),
    "vertical_rms": ("m", "root mean square of the vertical distance"),
    "distance_rms": ("m", "root mean square of the distance"),
    "maximum": ("m", "largest distance"),
    "turn": ("rad", "turn of the recorded direction of travel, left positive"),
    "samples": ("1", "samples compared"),
    "velocity_rms": ("m s-1", "root mean square of the difference of velocities"),
    "direction_rms": ("rad", "root mean square of the angle between recorded velocity and tangent"),
    "radius_min": ("m", "least radius at the samples"),
    "radius_max": ("m", "largest radius at the samples"),
    "converged": ("1", "whether the fit converged"),
}
"""Unit and meaning of every number."""


@storable
class Residual(AbstractResult):
    """A recorded track against a path, over all samples; RMS is the root of the mean square.

    `horizontal_rms`, `vertical_rms`, `distance_rms` and `maximum` [m]: horizontal, vertical and spatial distance
    between the recorded position and the path at the same time. `velocity_rms` [m/s], and `direction_rms` [rad], the
    angle between the recorded velocity and the path's tangent at samples that move: None without recorded velocities.
    `turn` [rad] is that of the recorded direction of travel, left positive (the angle about the axis is `path.turn`).
    `radius_min`, `radius_max` [m]: ρ at the samples, None for a path other than a spiral-helix. `converged` and
    `message` tell how a fit ended.
    """

    horizontal_rms: Scalar
    vertical_rms: Scalar
    distance_rms: Scalar
    maximum: Scalar
    turn: Scalar
    samples: Int[Array, ""]
    velocity_rms: Scalar | None
    direction_rms: Scalar | None
    radius_min: Scalar | None
    radius_max: Scalar | None
    converged: Bool[Array, ""]
    message: str = eqx.field(static=True)

    def __init__(
        self,
        horizontal_rms: ArrayInput,
        vertical_rms: ArrayInput,
        distance_rms: ArrayInput,
        maximum: ArrayInput,
        turn: ArrayInput,
        samples: ArrayInput,
        velocity_rms: ArrayInput | None = None,
        direction_rms: ArrayInput | None = None,
        radius_min: ArrayInput | None = None,
        radius_max: ArrayInput | None = None,
        converged: ArrayInput = True,
        message: str = "",
    ):
        self.horizontal_rms = as_float(horizontal_rms)
        self.vertical_rms = as_float(vertical_rms)
        self.distance_rms = as_float(distance_rms)
        self.maximum = as_float(maximum)
        self.turn = as_float(turn)
        self.samples = as_array(samples, int)
        self.velocity_rms = _optional(velocity_rms)
        self.direction_rms = _optional(direction_rms)
        self.radius_min = _optional(radius_min)
        self.radius_max = _optional(radius_max)
        self.converged = as_array(converged, bool)
        self.message = message

    def record(self) -> Record:
        """The fields that are known."""
        quantities = {name: Quantity(getattr(self, name), unit, text) for name, (unit, text) in MEANINGS.items()}
        variables = {name: q for name, q in quantities.items() if q.values is not None}
        variables["message"] = Quantity(np.broadcast_to(self.message, self.samples.shape), "", "how the fit ended")
        rms = f"{extent(self.horizontal_rms, 'm')} horizontal, {extent(self.vertical_rms, 'm')} vertical"
        summary = f"{in_lanes(self.samples.shape)}RMS {rms}, largest {extent(self.maximum, 'm')}"
        return Record(f"{summary}, {extent(self.samples)} samples", variables, attributes={"frame": "world"})


def compare(path: AbstractHodograph, track: Track, converged: bool = True, message: str = "") -> Residual:
    """The residual of `path` against `track`, whose first sample is at path time 0.

    Differentiable in the path.

    **Raises:** ValueError where the track lasts longer than the path.
    """
    _require_covered(path, track)
    times = as_array(known_elapsed(track), path.duration.dtype)
    return Residual(
        **_measures(path, times, track.positions, track.velocities),
        turn=track.turn,
        samples=times.shape[0],
        converged=converged,
        message=message,
    )


@kept()
def _measures(
    path: AbstractHodograph,
    times: Float[Array, " n"],
    positions: Float[Array, "n 3"],
    velocities: Float[Array, "n 3"] | None,
) -> dict[str, Any]:
    states = jax.vmap(lambda t: path.derivatives(t, 1))(times)
    offset = states[:, 0] - positions.astype(states.dtype)
    distances = jax.vmap(norm)(offset)
    radius = _radius(path, times)
    recorded = None if velocities is None else velocities.astype(states.dtype)
    return {
        "horizontal_rms": _rms(jax.vmap(norm)(offset[:, :2])),
        "vertical_rms": _rms(offset[:, 2]),
        "distance_rms": _rms(distances),
        "maximum": jnp.max(distances),
        "velocity_rms": None if recorded is None else _rms(jax.vmap(norm)(states[:, 1] - recorded)),
        "direction_rms": None if recorded is None else _direction_rms(states[:, 1], recorded),
        "radius_min": None if radius is None else jnp.min(radius),
        "radius_max": None if radius is None else jnp.max(radius),
    }


def _radius(path: AbstractHodograph, times: Float[Array, " n"]) -> Float[Array, " n"] | None:
    if not isinstance(path, SpiralHelix):
        return None
    return jax.vmap(lambda t: path.rotating_derivatives(t, 0)[0, 0])(times)


def _direction_rms(velocities: Float[Array, "n 3"], recorded: Float[Array, "n 3"]) -> Scalar:
    """RMS angle between tangent and recorded velocity over the samples that move (0 where none does)."""
    speeds = jax.vmap(norm)(recorded)
    moving = (speeds > STANDING * jnp.max(speeds)) & (jax.vmap(norm)(velocities) > 0)

    def angle(a: Float[Array, "3"], b: Float[Array, "3"], counts: Bool[Array, ""]) -> Scalar:
        along = jnp.where(counts, a @ b, 1.0)
        across = jnp.where(counts, jnp.cross(a, b), 0.0)
        return jnp.arctan2(norm(across), along)

    angles = jax.vmap(angle)(velocities, recorded, moving)
    count = jnp.maximum(jnp.sum(moving), 1).astype(angles.dtype)
    return norm(angles) / jnp.sqrt(count)


def _rms(x: Float[Array, " n"]) -> Scalar:
    return norm(x) / x.shape[0] ** 0.5


def _optional(x: ArrayInput | None) -> Scalar | None:
    return None if x is None else as_float(x)


def _require_covered(path: AbstractHodograph, track: Track) -> None:
    available, wanted = concrete(path.duration), known_elapsed(track)[-1]
    if available is None:
        return
    if wanted > float(available) * (1 + OVERHANG):
        raise ValueError(
            f"the track lasts {wanted:.9g} s, but the path only {float(available):.9g} s: "
            "compare with the window of the track that the path covers, track.window(t0, t1)."
        )
