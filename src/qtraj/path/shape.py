"""Define shapes: regular curves without times, such as centre lines and sequences of waypoints."""

from __future__ import annotations

import os
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.bounded import BoundedPolynomial, decide
from qtraj.algebra.surd import Claim
from qtraj.foundation import document
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import as_float, is_traced, real_scalar, require_positive
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.size_text import length_text
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.joined_ends import first_difference
from qtraj.path.route import Route, from_segments
from qtraj.path.route_input import from_piecewise
from qtraj.path.shape_points import Points, checked_widths, prepared

DEGREE = 5

SLOWEST = 2.0**-10
"""A curve counts as regular if |r'| is everywhere larger than this fraction of its mean."""

SAMPLES = 16
"""Number of samples of each segment in the search for the cusp that a message names."""


@storable
class Shape(AbstractResult):
    """A regular curve without times: a centre line, a road of a map, waypoints or a tool path.

    `route`: the curve as a `Route` whose parameter is not a time. `Shape.through` uses the chord length [m]: the sum of
    the distances between the points, so |r'| is about 1 and the joints are the points. `widths` (n, 2) [m]: the
    horizontal distances from the n joints to the right and to the left edge, or None. `closed`: whether the end of the
    curve is its start; then the last joint is the first one.

    `certify` accepts a shape with limits on curvature, sharpness, torsion and slope, `retime` computes its fastest
    timing, and `tune_route` the fastest route within its widths.

    **Raises:** ValueError for a route that is not proved to be regular (|r'| > 0 everywhere, so there is no cusp and no
    stop), a closed curve whose ends differ in position, direction or curvature, and wrong widths.
    """

    route: Route
    widths: Float[Array, "n 2"] | None
    closed: bool = eqx.field(static=True)

    def __init__(self, route: Route, widths: ArrayInput | None = None, closed: bool = False):
        require_type(route, Route, "route", "a Route; for points use qtraj.Shape.through(points)")
        if route.duration.ndim or is_traced(route):
            raise ValueError("a shape needs one route with concrete values: create it outside jit, grad and vmap")
        if route.progress is not None:
            raise ValueError(
                "a shape has no stops, but this route stops: create the shape from points along it, with "
                "qtraj.Shape.through(points)"
            )
        self.route, self.closed = route, bool(closed)
        own = None if widths is None else checked_widths(widths, route.segments + 1)
        self.widths = None if own is None else as_float(own)
        _require_regular(route)
        if self.closed:
            _require_joined(route, own)

    @classmethod
    def through(
        cls,
        points: ArrayInput,
        closed: bool | None = None,
        tolerance: float | None = None,
        widths: ArrayInput | None = None,
    ) -> Shape:
        """Return a smooth curve through points in the order of travel.

        The curve is a quintic spline over the chord length. Its first four derivatives are continuous, also at the seam
        of a closed curve. At the ends of an open curve, the third and fourth derivatives are zero.

        Args:
            points: (n, 3) [m], or (n, 2) for z = 0. A point that repeats its predecessor is merged with it, with a
                UserWarning.
            closed: Whether the last point is followed by the first one. By default, a curve is closed if the last point
                repeats the first one, or if it is at most two spacings away, and the curve turns by at most 60° there.
            tolerance: [m], the RMS distance of the points from the curve, for noisy points. By default, the curve
                passes through all points.
            widths: (n, 2) [m], the horizontal distances from each point to the right and to the left edge.

        Returns:
            The shape. With a tolerance, it has fewer joints than points, and the widths are interpolated at them.

        Raises:
            ValueError: For points of a wrong shape or with numbers that are not finite, fewer than two different
                points (three, if closed), a tolerance that is not positive, a curve with a cusp, and wrong widths.

        Example:
            >>> angle = np.linspace(0, 2 * np.pi, 100, endpoint=False)
            >>> shape = Shape.through(50.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
            >>> shape.closed, round(float(shape.length), 6)
            (True, 314.159265)
        """
        given = prepared(points, widths, closed)
        chord = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(given.positions, axis=0), axis=1)))
        origin = given.positions[0]
        local = given._replace(positions=given.positions - origin)
        spline = _interpolated(local, chord) if tolerance is None else _smoothed(local, chord, tolerance)
        starts, c, duration, offset = from_piecewise(spline)
        joints = np.append(starts, duration)
        own = None if given.widths is None else _interpolated_widths(joints, chord, given.widths)
        return cls(from_segments(starts, c, duration, origin + offset), own, given.closed)

    @property
    def length(self) -> Scalar:
        """The arc length [m]; for a closed curve, that of one lap."""
        return self.route.length()

    @property
    def points(self) -> Float[Array, "n 3"]:
        """The positions (n, 3) [m] of the joints."""
        return self.route.joints(0)[:, 0]

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the shape to a TOML or JSON file without loss of precision; `qtraj.load` reads it."""
        document.save(self, file)

    def record(self) -> Record:
        """Return the joints with their positions and widths."""
        at = Quantity(self.route.times, "m", "parameter of the joints; for points, the chord length", ("joint",))
        variables = {
            "position": Quantity(self.points, "m", "positions of the joints", ("joint", "world")),
            "length": Quantity(self.length, "m", "arc length of the curve"),
        }
        if self.widths is not None:
            meaning = "horizontal distances to the right and to the left edge"
            variables["widths"] = Quantity(self.widths, "m", meaning, ("joint", "side"))
        sides = Quantity(np.array(["right", "left"]), "", "side of the curve", ("side",))
        coordinates = {"parameter": at} | ({} if self.widths is None else {"side": sides})
        kind = "closed" if self.closed else "open"
        wide = "" if self.widths is None else ", with widths"
        text = f"{kind}, {length_text(float(self.length))}, {self.route.segments} segments{wide}"
        return Record(text, variables, coordinates, {"frame": "world", "closed": str(self.closed)})


def _interpolated(given: Points, chord: Float[np.ndarray, " n"]) -> Any:
    from scipy.interpolate import make_interp_spline

    if len(chord) == 2:
        return make_interp_spline(chord, given.positions, k=1)
    if given.closed:
        return make_interp_spline(chord, given.positions, k=DEGREE, bc_type="periodic")
    free: Any = [(3, np.zeros(3)), (4, np.zeros(3))]
    return make_interp_spline(chord, given.positions, k=DEGREE, bc_type=(free, free))


def _smoothed(given: Points, chord: Float[np.ndarray, " n"], tolerance: float) -> Any:
    """Return the smoothing spline with few knots whose points have this RMS distance."""
    from scipy.interpolate import BSpline, splprep

    limit = real_scalar(tolerance, "the tolerance of a shape")
    require_positive(limit, "the tolerance of a shape", "m")
    if len(chord) <= DEGREE:
        raise ValueError(
            f"a shape with a tolerance needs at least {DEGREE + 1} points, but {len(chord)} were given: omit tolerance="
        )
    largest = len(chord) * float(limit) ** 2
    (knots, c, degree), _ = splprep(given.positions.T, u=chord, k=DEGREE, s=largest, per=given.closed, quiet=True)
    return BSpline(knots, np.stack(c, axis=1), degree)


def _interpolated_widths(joints: np.ndarray, chord: np.ndarray, widths: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(joints, chord, column) for column in widths.T], axis=1)


def _require_regular(route: Route) -> None:
    """Raise a ValueError if |r'| is not proved to be larger than a small fraction of its mean, by interval arithmetic.

    The proof bounds the Bernstein coefficients of |r'|² on each segment, with bounds on the rounding errors.
    """
    count = route.segments
    h = np.diff(np.asarray(route.times, float))
    rows = [
        BoundedPolynomial(np.asarray(x, float).T * h ** np.arange(x.shape[1])[:, None], k=8).derivative()
        for x in np.moveaxis(np.asarray(route.coefficients)[:count], 2, 0)
    ]
    least = SLOWEST * float(route.length()) / float(route.duration) * h
    square = rows[0] * rows[0] + rows[1] * rows[1] + rows[2] * rows[2]
    found = decide(Claim(square - BoundedPolynomial.constant(least**2)), count)
    if not found.proved.all():
        at: Any = np.linspace(0.0, float(route.duration), 1 + SAMPLES * count)
        slowest = int(np.argmin(np.linalg.norm(route.sampled(at, 1)[1], axis=1)))
        place = ", ".join(f"{x:.6g}" for x in np.round(np.asarray(route.position(at[slowest])), 6) + 0.0)
        raise ValueError(
            f"the curve has a cusp, or almost one, at ({place}) m, near joint {slowest // SAMPLES}: the points reverse "
            "there. Remove the points that lead back, or divide the curve there into two shapes."
        )


def _require_joined(route: Route, widths: np.ndarray | None) -> None:
    """Raise a ValueError if the ends of a closed curve differ."""
    order = first_difference(np.asarray(route.joints(2), float), float(route.duration))
    if order is not None:
        what = ("position", "direction", "curvature")[order]
        raise ValueError(
            f"a closed shape must end as it starts, but the {what} at its ends differs: create it with "
            "qtraj.Shape.through(points, closed=True), or pass closed=False"
        )
    if widths is not None and not np.allclose(widths[0], widths[-1], rtol=1e-9, atol=0):
        raise ValueError(
            f"the first and the last joint of a closed shape are the same, but have the widths {widths[0].tolist()} "
            f"and {widths[-1].tolist()} m: pass equal widths"
        )
