"""How one path differs from another: boundary velocities, duration and length, headings, heights, distance."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.boundary import BoundaryState, cylindrical
from qtraj.path.deviation import max_deviation
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

COMPONENTS = ("V_rho", "V_phi", "V_h")
"""Cylindrical components of a velocity: away from the axis, about it, along it."""
PATHS, ENDS = ("before", "after"), ("start", "end")
SAMPLES = 513
"""Instants of each path at which they are compared."""
FAR = 3.0
"""A path that is this many times as long as the one before, in metres or in seconds, was hardly meant."""
SLOWER = "takes {:.3g} times the time"


class PathChange(AbstractResult):
    """What distinguishes the path `after` from the path `before`.

    Over the two paths: `velocities` (2, 2, 3) [m/s], cylindrical components V_ρ, V_φ, V_h at start and end; `durations`
    (2,) [s], `mean_rates` (2,) [rad/s] about the axis, `lengths` (2,) [m]. Of the path after against the path before:
    `headings` (2,) [rad], how far the direction of travel at start and end turns to the left, NaN where there is none;
    `lowest` and `highest` [m], how far the lowest and the highest point move up; `deviation` [m], the largest distance
    of its points from the path before, whose `size` [m] is the diagonal of the box about it. `given` (2, 3) [m/s] are
    the velocities that were asked for, where they are known.
    """

    velocities: Float[Array, "2 2 3"]
    durations: Float[Array, 2]
    mean_rates: Float[Array, 2]
    lengths: Float[Array, 2]
    headings: Float[Array, 2]
    lowest: Scalar
    highest: Scalar
    deviation: Scalar
    size: Scalar
    given: Float[Array, "2 3"] | None = None

    @property
    def warning(self) -> str | None:
        """What to say where the path after is far longer or slower, or leaves the path before by more than its size."""
        found = []
        for values, what, unit in ((self.lengths, "is {:.3g} times as long", "m"), (self.durations, SLOWER, "s")):
            was, now = np.asarray(values).tolist()
            if now > FAR * was:
                found.append(f"{what.format(now / was)} ({now:.4g} {unit}, before {was:.4g} {unit})")
        if self.deviation > self.size:
            found.append(
                f"leaves the path before by {self.deviation:.3g} m, more than that one's size of {self.size:.3g} m"
            )
        if not found:
            return None
        return f"The path after {' and '.join(filter(None, [', '.join(found[:-1]), found[-1]]))}."

    @property
    def text(self) -> str:
        """The changes of heading and height in words."""
        start, end = (_sideways(turn) for turn in np.asarray(self.headings).tolist())
        low, high = (round(float(change), 2) + 0.0 for change in (self.lowest, self.highest))
        return (
            f"Its heading turns {start} at A and {end} at B; its lowest point moves by {low:+.2f} m, its highest by "
            f"{high:+.2f} m."
        )

    def record(self) -> Record:
        """Both paths over `path`, their ends over `end`, and the differences."""
        known = {
            "velocity": Quantity(
                self.velocities, "m s-1", "boundary velocity, cylindrical", ("path", "end", "cylindrical")
            ),
            "duration": Quantity(self.durations, "s", "duration", ("path",)),
            "mean_rate": Quantity(self.mean_rates, "rad s-1", "mean rate about the axis", ("path",)),
            "length": Quantity(self.lengths, "m", "length", ("path",)),
            "heading_change": Quantity(self.headings, "rad", "turn of the direction of travel, to the left", ("end",)),
            "lowest_change": Quantity(self.lowest, "m", "how far the lowest point moves up"),
            "highest_change": Quantity(self.highest, "m", "how far the highest point moves up"),
            "deviation": Quantity(self.deviation, "m", "largest distance of the path after from the path before"),
            "size": Quantity(self.size, "m", "diagonal of the box about the path before"),
            "given_velocity": Quantity(self.given, "m s-1", "velocity asked for, cylindrical", ("end", "cylindrical")),
        }
        variables = {name: quantity for name, quantity in known.items() if quantity.values is not None}
        coordinates = {
            "path": Quantity(np.array(PATHS), "", "which path", ("path",)),
            "end": Quantity(np.array(ENDS), "", "which end", ("end",)),
            "cylindrical": Quantity(np.array(COMPONENTS), "", "component about the axis", ("cylindrical",)),
        }
        longer, slower = (float(values[1] - values[0]) for values in (self.lengths, self.durations))
        summary = f"{longer:+.6g} m, {slower:+.6g} s, {float(self.deviation):.6g} m apart at most"
        return Record(summary, variables, coordinates, {"frame": "world"})


def compare_paths(
    before: SpiralHelix, after: SpiralHelix, given: tuple[BoundaryState, BoundaryState] | None = None
) -> PathChange:
    """How the path `after`, such as a tuned one, differs from the path `before`.

    Both are compared at 513 instants, equally spaced in their own times. `given`: the boundary states that were asked
    for, whose velocities are kept beside those of the paths.
    """
    was, now = sampled(before), sampled(after)
    placements = (before.placement, after.placement)
    velocities = [
        [_components(state, placement) for state in sampled.ends]
        for sampled, placement in zip((was, now), placements, strict=True)
    ]
    durations = jnp.stack([before.duration, after.duration])
    turns = jnp.stack([was.turn, now.turn])
    heights = np.asarray(was.positions)[:, 2], np.asarray(now.positions)[:, 2]
    return PathChange(
        velocities=jnp.asarray(velocities),
        durations=durations,
        mean_rates=turns / durations,
        lengths=jnp.stack([was.length, now.length]),
        headings=jnp.stack([_turned(was.velocities[k], now.velocities[k]) for k in (0, -1)]),
        lowest=jnp.asarray(heights[1].min() - heights[0].min()),
        highest=jnp.asarray(heights[1].max() - heights[0].max()),
        deviation=jnp.asarray(max_deviation(np.asarray(now.positions), np.asarray(was.positions))),
        size=jnp.linalg.norm(jnp.ptp(was.positions, axis=0)),
        given=None if given is None else jnp.stack([_components(state, before.placement) for state in given]),
    )


class Sampled(NamedTuple):
    """A path at 513 instants: positions [m] and velocities [m/s]; its turn about the axis [rad] and length [m]."""

    positions: Float[Array, "n 3"]
    velocities: Float[Array, "n 3"]
    turn: Scalar
    length: Scalar

    @property
    def ends(self) -> tuple[BoundaryState, BoundaryState]:
        """The boundary states, world axes."""
        first, last = (BoundaryState(self.positions[k], self.velocities[k]) for k in (0, -1))
        return first, last


@eqx.filter_jit
def sampled(path: SpiralHelix) -> Sampled:
    """A path at equally spaced instants, both ends included."""
    times = jnp.linspace(0.0, 1.0, SAMPLES) * path.duration
    states = jax.vmap(lambda t: path.derivatives(t, 1))(times)
    return Sampled(states[:, 0], states[:, 1], path.turn, path.length())


def _components(state: BoundaryState, placement: Placement | None) -> Vec3:
    return cylindrical(state, placement).velocity


def _turned(before: Vec3, after: Vec3) -> Any:
    """The angle from one horizontal direction to another, left positive; NaN where one is none."""
    (x, y), (u, v) = before[:2], after[:2]
    exists = jnp.hypot(x, y) * jnp.hypot(u, v) > 0
    return jnp.where(exists, jnp.arctan2(x * v - y * u, x * u + y * v), jnp.nan)


def _sideways(turn: float) -> str:
    if math.isnan(turn):
        return "by an angle that does not exist"
    degrees = round(math.degrees(turn), 1)
    return "by 0.0°" if degrees == 0 else f"{abs(degrees):.1f}° to the {'left' if degrees > 0 else 'right'}"
