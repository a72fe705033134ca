"""Compare two paths by boundary velocities, durations, lengths, headings, heights and distance."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.vector import norm
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import part
from qtraj.foundation.namespace import in_numpy, in_numpy_or_jit, is_host, xp
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.boundary import BoundaryState, cylindrical
from qtraj.path.deviation import max_deviation
from qtraj.path.placement import Placement
from qtraj.path.spiral_helix import SpiralHelix

COMPONENTS = ("V_rho", "V_phi", "V_h")
"""Cylindrical components of a velocity: away from the axis, about the axis, and along the axis."""
SYMBOLS = ("V_ρ", "V_φ", "V_h")
PATHS, ENDS = ("before", "after"), ("start", "end")
SAMPLES = 513
"""Number of sampled instants of each path."""
MAX_RATIO = 3.0
"""A tuned path has a `warning` if its length or duration is more than this multiple of the original value."""
SLOWER = "takes {:.3g} times as long"


class PathChange(AbstractResult):
    """Differences between an original path, `before`, and a tuned path, `after`.

    The following arrays have one entry for each path, original and tuned:

    - `velocities` (2, 2, 3) [m/s]; the axes are the path, the end (start, end) and the component: V_ρ away from the
      axis, V_φ about the axis, and V_h along the axis.
    - `durations` (2,) [s], `lengths` (2,) [m], and `mean_rates` (2,) [rad/s] about the axis.

    The following values compare the tuned path with the original path:

    - `headings` (2,) [rad]: the changes of the direction of travel at the start and the end, positive to the left; NaN
      if a direction is undefined.
    - `lowest`, `highest` [m]: the changes in height of the lowest and the highest point.
    - `deviation` [m]: the largest distance of a point of the tuned path from the original path.

    `size` [m] is the diagonal of the bounding box of the original path. `given` (2, 3) [m/s], or None, are the
    requested boundary velocities, with the rows start and end and the columns V_ρ, V_φ and V_h.
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
        """A warning if the tuned path is much longer or slower, or deviates by more than `size`; otherwise None.

        Much longer or slower means that the length or the duration is more than three times the original value.
        """
        texts = []
        for values, what, unit in (
            (self.lengths, "is longer by a factor of {:.3g}", "m"),
            (self.durations, SLOWER, "s"),
        ):
            was, now = np.asarray(values).tolist()
            if now > MAX_RATIO * was:
                texts.append(f"{what.format(now / was)} ({now:.4g} {unit} instead of {was:.4g} {unit})")
        if float(self.deviation) > float(self.size):
            texts.append(
                f"deviates from the original path by {self.deviation:.3g} m, more than the size of that path, "
                f"{self.size:.3g} m"
            )
        if not texts:
            return None
        return f"The tuned path {' and '.join(filter(None, [', '.join(texts[:-1]), texts[-1]]))}."

    @property
    def text(self) -> str:
        """A description of the changes of the direction of travel and of the height."""
        start, end = (_in_words(turn) for turn in np.asarray(self.headings).tolist())
        low, high = (round(float(change), 2) + 0.0 for change in (self.lowest, self.highest))
        return (
            f"The direction of travel changes {start} at A and {end} at B; the minimum height changes by {low:+.2f} m "
            f"and the maximum height by {high:+.2f} m."
        )

    @property
    def given_text(self) -> str | None:
        """A description of the requested boundary velocities if they differ from the original path, otherwise None."""
        if self.given is None or np.allclose(self.given, np.asarray(self.velocities)[0], rtol=1e-6, atol=1e-6):
            return None
        start, end = (", ".join(f"{v:.4f}" for v in state) for state in np.asarray(self.given))
        return f"The specified states have (V_ρ, V_φ, V_h) = ({start}) m/s at A and ({end}) m/s at B."

    def sentences(self) -> list[str]:
        """Return sentences: a legend of `rows`, `given_text` unless it is None, the deviation, and `text`."""
        legend = "A: start, B: end. V_ρ, V_φ and V_h: away from, about and along the axis."
        deviation = f"The tuned path deviates from the original path by at most {float(self.deviation):.3g} m."
        return [legend, *filter(None, [self.given_text]), deviation, self.text]

    def rows(self) -> list[list[tuple[str, str, str, str, str]]]:
        """Return rows of texts (name, value before, value after, change, unit), in two groups.

        The first group contains the boundary velocities. The second group contains the duration, the mean rate about
        the axis and the length.
        """
        pairs = np.moveaxis(np.asarray(self.velocities), 0, -1).tolist()
        velocities = [
            _row(f"{symbol} at {letter}", pair, "m/s")
            for letter, of_end in zip("AB", pairs, strict=True)
            for symbol, pair in zip(SYMBOLS, of_end, strict=True)
        ]
        whole = (
            ("duration", self.durations, "s"),
            ("mean rate", self.mean_rates, "rad/s"),
            ("length", self.lengths, "m"),
        )
        return [velocities, [_row(name, values, unit) for name, values, unit in whole]]

    def record(self) -> Record:
        """Return labelled arrays over the dimensions `path` (both paths) and `end` (both ends), and the differences."""
        quantities = {
            "velocity": Quantity(
                self.velocities, "m s-1", "boundary velocity, cylindrical", ("path", "end", "cylindrical")
            ),
            "duration": Quantity(self.durations, "s", "duration", ("path",)),
            "mean_rate": Quantity(self.mean_rates, "rad s-1", "mean rate about the axis", ("path",)),
            "length": Quantity(self.lengths, "m", "length", ("path",)),
            "heading_change": Quantity(
                self.headings, "rad", "change of the direction of travel, positive to the left", ("end",)
            ),
            "lowest_change": Quantity(self.lowest, "m", "change in height of the lowest point"),
            "highest_change": Quantity(self.highest, "m", "change in height of the highest point"),
            "deviation": Quantity(self.deviation, "m", "largest distance of the tuned path from the original path"),
            "size": Quantity(self.size, "m", "diagonal of the bounding box of the original path"),
            "given_velocity": Quantity(self.given, "m s-1", "requested velocity, cylindrical", ("end", "cylindrical")),
        }
        variables = {name: quantity for name, quantity in quantities.items() if quantity.values is not None}
        coordinates = {
            "path": Quantity(np.array(PATHS), "", "original path (before) or tuned path (after)", ("path",)),
            "end": Quantity(np.array(ENDS), "", "end of the path", ("end",)),
            "cylindrical": Quantity(np.array(COMPONENTS), "", "component about the axis", ("cylindrical",)),
        }
        longer, slower = (float(np.diff(np.asarray(values))[0]) for values in (self.lengths, self.durations))
        summary = f"{longer:+.6g} m, {slower:+.6g} s, {float(self.deviation):.6g} m maximum deviation"
        return Record(summary, variables, coordinates, {"frame": "world"})


@in_numpy
def compare_paths(
    before: SpiralHelix, after: SpiralHelix, given: tuple[BoundaryState, BoundaryState] | None = None
) -> PathChange:
    """Compare the original path `before` with the path `after`, for example a tuned path.

    Each path is sampled at 513 equally spaced instants over its duration. `given` are the requested boundary states;
    the result contains their velocities.
    """
    require_type(before, SpiralHelix, "before", "a SpiralHelix")
    require_type(after, SpiralHelix, "after", "a SpiralHelix")
    was, now = sampled(before), sampled(after)
    pairs = ((was, before.placement), (now, after.placement))
    velocities = [[_components(state, placement) for state in samples.ends] for samples, placement in pairs]
    durations = xp.stack([before.duration, after.duration])
    turns = xp.stack([was.turn, now.turn])
    heights = np.asarray(was.positions)[:, 2], np.asarray(now.positions)[:, 2]
    return PathChange(
        velocities=xp.stack([xp.stack(ends) for ends in velocities]),
        durations=durations,
        mean_rates=turns / durations,
        lengths=xp.stack([was.length, now.length]),
        headings=xp.stack([_heading_change(was.velocities[k], now.velocities[k]) for k in (0, -1)]),
        lowest=xp.asarray(heights[1].min() - heights[0].min()),
        highest=xp.asarray(heights[1].max() - heights[0].max()),
        deviation=xp.asarray(max_deviation(np.asarray(now.positions), np.asarray(was.positions))),
        size=norm(xp.ptp(was.positions, axis=0)),
        given=None if given is None else xp.stack([_components(state, before.placement) for state in given]),
    )


class Sampled(NamedTuple):
    """Positions [m] and velocities [m/s] of a path at 513 instants, its turn about the axis [rad] and length [m]."""

    positions: Float[Array, "n 3"]
    velocities: Float[Array, "n 3"]
    turn: Scalar
    length: Scalar

    @property
    def ends(self) -> tuple[BoundaryState, BoundaryState]:
        """The boundary states at both ends, in world axes."""
        first, last = (BoundaryState(_row_of(self.positions, k), _row_of(self.velocities, k)) for k in (0, -1))
        return first, last


@in_numpy_or_jit
def sampled(path: SpiralHelix) -> Sampled:
    """Sample a path at equally spaced instants, both ends included."""
    times: Any = np.linspace(0.0, 1.0, SAMPLES).astype(path.duration.dtype) * path.duration
    positions, velocities = path.sampled(times, 1)
    return Sampled(positions, velocities, path.turn, path.length())


def _row_of(rows: Float[Array, "n 3"], k: int) -> Vec3:
    """Return one row; nothing is compiled for a concrete JAX array."""
    return rows[k] if is_host(rows) else part(rows, k)


def _components(state: BoundaryState, placement: Placement | None) -> Vec3:
    return cylindrical(state, placement).velocity


def _heading_change(before: Vec3, after: Vec3) -> Any:
    """Return the change [rad] of the horizontal direction between two vectors (3,), positive to the left.

    The result is NaN if one of the vectors is vertical or zero.
    """
    (x, y), (u, v) = before[:2], after[:2]
    exists = xp.hypot(x, y) * xp.hypot(u, v) > 0
    return xp.where(exists, xp.arctan2(x * v - y * u, x * u + y * v), xp.nan)


def _row(name: str, values: Any, unit: str) -> tuple[str, str, str, str, str]:
    before, after = np.asarray(values).tolist()
    was, now, change = (round(x, 4) + 0.0 for x in (before, after, after - before))  # avoids -0.0000
    return name, f"{was:.4f}", f"{now:.4f}", f"{change:+.4f}", unit


def _in_words(turn: float) -> str:
    """Describe a change of direction `turn` [rad], positive to the left, in words and degrees."""
    if math.isnan(turn):
        return "by an undefined angle"
    degrees = round(math.degrees(turn), 1)
    return "by 0.0°" if degrees == 0 else f"by {abs(degrees):.1f}° to the {'left' if degrees > 0 else 'right'}"
