"""Define the upright frame of a vehicle on a route with stops and reversals.

A path has no tangent at zero speed, and the tangent changes its sign when the vehicle starts to reverse. Therefore a
stop is an interval in which the speed is at most a threshold, and during a stop heading and pitch are polynomials in
time. The polynomials connect the values and rates before the stop to constants, and the constants to the values and
rates after the stop. If the direction of the velocity changes by more than 90° over the stop, the vehicle switches
between forward motion and reverse. In reverse, the forward axis is opposite to the tangent.
"""

from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra.polynomial import taylor_terms
from qtraj.algebra.vector import cross
from qtraj.foundation.arrays import as_float, concrete, real_scalar, real_vector
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, Vec3
from qtraj.path import headings, pieces
from qtraj.path.components import Triple, add_vectors, scaled, select
from qtraj.path.frame_axes import UPRIGHT
from qtraj.path.frame_components import Basis, FrameComponents, triple
from qtraj.path.frenet import Invariants
from qtraj.path.headings import level
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.stops import Segments, fastest, stops
from qtraj.path.trihedral import AbstractFrame, Natural, Trihedral, Upright, from_rows
from qtraj.path.vehicle import Vehicle

ZERO_SPEED = 1e-9
"""Speed, divided by the largest speed, below which rounding errors determine the direction of the velocity."""


@storable
class Driving(AbstractFrame):
    """The upright frame of a vehicle on a route with stops and reversals, created by `Driving.along(route)`.

    The frame equals `Upright` while the vehicle moves forwards. In reverse, x is opposite to the velocity. At a stop,
    heading and pitch change from the last direction to the next direction with continuous first and second derivatives,
    and `defined` is true, although the path has no tangent.

    Each row of the arrays is a time interval. `starts` (rows,) [s] are the start times. `signs` (rows,) are 1 for
    forward motion, −1 for reverse and 0 for a stop. `angles` (rows, 2, 6) contain, for a stop, the six ascending
    coefficients of heading and of pitch [rad] as polynomials in the time since the start of the row; for other rows
    they are not used. Rows with infinite start times are padding. `up` (3,) is the vertical in world axes.
    """

    starts: Float[Array, " rows"]
    signs: Float[Array, " rows"]
    angles: Float[Array, "rows 2 6"]
    up: Vec3
    supports_numpy: ClassVar[bool] = True

    def __repr__(self) -> str:
        return shown(self, starts="s", angles="rad")

    def __init__(self, starts: ArrayInput, signs: ArrayInput, angles: ArrayInput, up: ArrayInput = (0.0, 0.0, 1.0)):
        self.starts, self.signs, self.angles = as_float(starts), as_float(signs), as_float(angles)
        self.up = real_vector(up, "the up direction of a driving frame", 3)
        rows = self.starts.shape[-1:]
        if self.signs.shape[-1:] != rows or self.angles.shape[-3:] != (*rows, 2, 6):
            raise ValueError(
                f"a driving frame with starts of shape {rows} needs signs of shape {rows} and angles of shape "
                f"{(*rows, 2, 6)}, but {self.signs.shape} and {self.angles.shape} were given. Use Driving.along(route)."
            )

    @property
    def name(self) -> str:
        """The name 'upright', because the axes are the axes of the upright frame."""
        return UPRIGHT

    @classmethod
    def along(
        cls, route: AbstractHodograph, up: ArrayInput = (0.0, 0.0, 1.0), hold_below: ArrayInput | None = None
    ) -> "Driving":
        """Create the frame of a vehicle on `route`, a `Route` or a retimed one, on which it initially moves forwards.

        `hold_below` [m/s] is the speed threshold of a stop, by default 1 % of the largest speed.

        **Raises:** ValueError if `route` is not a single path of these kinds with concrete values, `up` is zero, or
        `hold_below` is not positive and finite.
        """
        motion = _motion_of(route)
        threshold = None
        if hold_below is not None:
            threshold = float(np.asarray(real_scalar(hold_below, "hold_below")))
            if not 0 < threshold < np.inf:
                raise ValueError(f"hold_below must be positive [m/s], but {threshold} was given")
        upright = Upright(up)
        rows = headings.along(motion, np.asarray(upright.up, float), threshold)
        n_padding = pieces.padded_size(len(rows.starts)) - len(rows.starts)
        starts = np.append(rows.starts, np.full(n_padding, np.inf))
        signs = np.append(rows.signs, np.zeros(n_padding))
        return cls(starts, signs, np.concatenate([rows.angles, np.zeros((n_padding, 2, 6))]), upright.up)

    def trihedral(self, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral of `Upright`; the rows of `r` are the position and its first four time derivatives."""
        return Upright(self.up).trihedral(r, span)

    def at(self, t: Scalar, r: Float[Array, "5 3"], span: Scalar) -> Trihedral:
        """Return the trihedral at `t` [s]; x is opposite to the tangent in reverse, and follows `angles` at a stop."""
        return from_rows(self, t, r, span)

    def components_at(self, t: Array, i: Invariants, basis: Basis, span: Array) -> FrameComponents:
        """Return the frame in components at the times `t` [s]."""
        dtype = i.S.dtype
        row = xp.maximum(xp.searchsorted(self.starts, t.astype(self.starts.dtype), side="right") - 1, 0)
        sign = self.signs[row].astype(dtype)
        held = self._held(t.astype(dtype), self.starts[row].astype(dtype), self.angles[row].astype(dtype))
        directions = [
            select(sign == 0, basis.local(v), scaled(own, sign)) for v, own in zip(held, i.r[1:4], strict=True)
        ]
        upright = Upright(self.up)
        return upright.components(Invariants([i.r[0], *directions, i.r[4]]), basis, span)

    def _held(self, t: Array, start: Array, angles: Float[Array, "*times 2 6"]) -> tuple[Triple, Triple, Triple]:
        """Return the first three derivatives of a fictitious motion at unit speed with the heading and pitch of a stop.

        The rows of `angles` are the ascending coefficients of heading and pitch in the time since `start`. Let h be the
        heading, p the pitch, and e(h) the horizontal unit vector at h. The velocity is cos p·e(h) + sin p·up.
        """
        up = Upright(self.up).unit_up(t.dtype)
        reference = level(up)
        forward, left = triple(reference), triple(cross(up, reference))
        elapsed = xp.where(xp.isfinite(start), t - start, 0.0)
        (h, h1, h2), (p, p1, p2) = (
            taylor_terms([angles[..., k, n] for n in range(angles.shape[-1])], elapsed, 2) for k in (0, 1)
        )
        h2, p2 = 2 * h2, 2 * p2  # Taylor coefficients to derivatives
        ahead = _combined(forward, xp.cos(h), left, xp.sin(h))
        aside = _combined(left, xp.cos(h), forward, -xp.sin(h))
        cos, sin = xp.cos(p), xp.sin(p)
        # The components along e(h), e'(h) and up of the velocity and its first two derivatives; e'' = −e.
        rows = (
            (cos, 0.0 * cos, sin),
            (-sin * p1, cos * h1, cos * p1),
            (-sin * p2 - cos * (p1**2 + h1**2), cos * h2 - 2 * sin * p1 * h1, cos * p2 - sin * p1**2),
        )
        vertical = triple(up)
        first, second, third = (
            add_vectors(_combined(ahead, row[0], aside, row[1]), scaled(vertical, row[2])) for row in rows
        )
        return first, second, third


def _combined(a: Triple, x: Array, b: Triple, y: Array) -> Triple:
    """Return x·a + y·b."""
    return add_vectors(scaled(a, x), scaled(b, y))


def default_frame(path: AbstractHodograph) -> AbstractFrame:
    """Return `Driving` for a route with stops, `Upright` for any other route, and `Natural` for any other path.

    The same applies to retimed routes. For a traced route or a batch of routes, the result is always `Upright`.
    """
    if not isinstance(getattr(path, "path", path), Route):
        return Natural()
    if path.driven() is None:
        return Upright()
    frame = Driving.along(path)
    return frame if np.any(np.asarray(frame.signs)[np.isfinite(np.asarray(frame.starts))] <= 0) else Upright()


def require_moving(path: AbstractHodograph) -> None:
    """Raise a ValueError if `path` is a concrete route that stops, because it has no tangent at the stop."""
    motion = path.driven()
    stop_intervals = [] if motion is None else stops(motion, ZERO_SPEED * fastest(motion))
    if stop_intervals:
        raise ValueError(
            f"the route stops at t = {stop_intervals[0][0]:.4g} s, where it has no tangent, so a rotation-minimizing "
            "frame is not defined there. Use route.window(t0, t1) between stops, or the frame Driving.along(route)."
        )


def require_one_direction(path: AbstractHodograph, vehicle: Vehicle | None) -> None:
    """Raise a ValueError for a concrete route that reverses on a road that depends on the direction of motion.

    In reverse the same road has the opposite bank angle, and the opposite direction to the left.
    """
    bank: Any = None if vehicle is None else concrete(vehicle.bank)
    if vehicle is not None and vehicle.road is not None and vehicle.road.bank is not None:
        bank = max(vehicle.road.bank, key=abs)
    turns = vehicle is not None and vehicle.has_left
    if bank is None or not (np.any(bank) or turns) or path.driven() is None:
        return
    frame = Driving.along(path)
    reverse = np.flatnonzero(np.asarray(frame.signs) < 0)
    if reverse.size:
        name, given, instead = "bank", f"bank angle of the road, {np.asarray(bank).tolist()} rad,", "with bank=0"
        if turns:
            name, given, instead = "left", "direction of the road to the left", "without Road(left=...)"
        raise ValueError(
            f"the route reverses at t = {float(frame.starts[reverse[0]]):.4g} s, but the {given} is relative to the "
            "direction of motion and would change sign there. Use route.window(t0, t1) for each direction, with the "
            f"opposite {name} in reverse, or a vehicle {instead}."
        )


def segments_of(route: Route) -> Segments:
    """Return the segments of one route in float64, without padding.

    **Raises:** ValueError for any other path, or a batch of routes.
    """
    found = route.driven() if isinstance(route, Route) else None
    if found is None:
        raise ValueError(f"one Route was expected, but {_kind(route)} was given")
    return found


def _motion_of(path: AbstractHodograph) -> Any:
    found = path.driven() if isinstance(path, AbstractHodograph) else None
    if found is None:
        raise ValueError(f"one Route, or a retimed Route, was expected, but {_kind(path)} was given")
    return found


def _kind(path: Any) -> str:
    return "a batch of routes" if isinstance(path, Route) else f"a {type(path).__name__}"
