"""Define routes, which represent a whole drive or flight as one path of polynomial segments."""

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import as_float, is_traced, like, one_instant, real_vector, warn_if_coarse
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.methods import method
from qtraj.foundation.namespace import in_numpy, xp
from qtraj.foundation.record import Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path import pieces, progress, route_input, route_length, route_nearest, route_parts, route_record
from qtraj.path.hodograph import AbstractHodograph, require_order
from qtraj.path.nearest import Nearest
from qtraj.path.route_parts import known
from qtraj.path.stops import Segments

if TYPE_CHECKING:
    from scipy.interpolate import PPoly


def _fields(route: Any) -> dict[str, Any]:
    """Return the stored fields of a route, which are its segments without padding."""
    rows = {name: getattr(route, name) for name in ("starts", "coefficients", "progress")}
    kept = {name: np.asarray(x)[: route.segments] for name, x in rows.items() if x is not None}
    return kept | {"duration": np.asarray(route.duration), "origin": np.asarray(route.origin)}


def _restored(
    starts: ArrayInput,
    coefficients: ArrayInput,
    duration: ArrayInput,
    origin: ArrayInput,
    progress: ArrayInput | None = None,
) -> "Route":
    own = None if progress is None else np.asarray(progress, float)
    given = [np.asarray(x, float) for x in (starts, coefficients, duration, origin)]
    return from_segments(*given, own=own)


@stored_as(_fields, _restored)
@storable
class Route(AbstractHodograph, AbstractResult):
    """A path that consists of polynomial segments between joints.

    `times` (n,) [s] must increase strictly. `position` [m], `velocity` [m/s], `acceleration` [m/s²] and, optionally,
    `jerk` [m/s³], each (n, 3), are the states at the joints in world axes. Without jerk the segments are quintics, and
    the acceleration of the route is continuous (C²). With jerk they are septics, and the jerk is continuous, too (C³).
    The time of the path is 0 at the first joint. `Route.from_piecewise` accepts SciPy splines of any continuity.

    The segments are represented by `starts` (rows,) [s] and `coefficients` (rows, terms, 3). Coefficient k, of the k-th
    power of the time since the start of the segment, is in m s^-k. Positions are stored relative to `origin` (3,) [m],
    here the position of the first joint, so that large coordinates lose no digits. Rows are padded to a power of two,
    with infinite starts, so that routes of similar length share executables and can be stacked. At a joint the later
    segment is used. Outside [0, duration] the first and the last segment are extrapolated.

    `progress` (rows, 4) is None, or, for a drive with stops, the cubic w of each segment. A segment is then R(w), where
    R is the curve with these coefficients and w is a cubic in the time since the start of the segment, with w(t) = t
    except next to stops. At a stop the derivative of w is zero, but R has a direction and a curvature. `fit_route`
    creates such segments, and segments next to each other may share a curve.

    **Raises:** ValueError for wrong shapes, values that are not finite, or times that do not increase strictly.
    """

    starts: Float[Array, " rows"]
    coefficients: Float[Array, "rows terms 3"]
    duration: Scalar
    origin: Vec3
    progress: Float[Array, "rows 4"] | None
    supports_numpy: ClassVar[bool] = True

    def __init__(
        self,
        times: ArrayInput,
        position: ArrayInput,
        velocity: ArrayInput,
        acceleration: ArrayInput,
        jerk: ArrayInput | None = None,
    ):
        orders = [position, velocity, acceleration, *([] if jerk is None else [jerk])]
        self.starts, self.coefficients, self.duration, self.origin = route_input.from_states(times, orders)
        self.progress = None
        warn_if_coarse(position, "the position of a route")

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Return position and derivatives up to `order` at one instant `t` [s]; row k in [m s^-k]."""
        require_order(order)
        return _derivatives(self, one_instant(t).astype(self.duration.dtype), order)

    def sampled(self, t: Float[Array, " n"], order: int) -> list[Float[Array, "n 3"]]:
        """Return r and its time derivatives up to `order`, each (n, 3), at instants `t` (n,), in world axes."""
        i = pieces.index(self.starts, t)
        c, s = self.coefficients[i], t - self.starts[i]
        own = self.progress
        rows = pieces.values(c, s, order) if own is None else progress.values(c, own[i], s, order)
        return [rows[0] + self.origin.reshape((1,) * t.ndim + (3,)), *rows[1:]]

    def span(self, t: Array) -> Array:
        """Return the durations [s] of the segments at the times `t`."""
        return pieces.durations(self.starts, self.duration)[pieces.index(self.starts, t)]

    def driven(self) -> Segments | None:
        """Return the segments of a single concrete route, for the frame `Driving`."""
        return None if self.duration.ndim or is_traced(self) else self._segments().in_double()

    def index(self, t: ScalarLike) -> Int[Array, ""]:
        """Return the index of the segment at the time `t` [s]; at a joint, the index of the later segment."""
        return pieces.index(self.starts, one_instant(t).astype(self.duration.dtype))

    def nodes(self) -> Float[Array, " nodes"]:
        """Return the times [s] of the joints and of three instants in each segment; padding repeats the duration."""
        return pieces.nodes(self.starts, self.duration)

    @property
    def segments(self) -> int:
        """The number of segments.

        **Raises:** ValueError inside a trace, where the number is unknown.
        """
        return int(np.isfinite(known(self.starts)).sum(axis=-1).max())

    @property
    def times(self) -> Float[Array, " n"]:
        """The times [s] of the joints, from 0 to the duration.

        **Raises:** ValueError inside a trace, where their number is unknown.
        """
        return like(np.append(known(self.starts)[: self.segments], known(self.duration)), self.starts)

    def joints(self, order: int = 2) -> Float[Array, "n {order}+1 3"]:
        """Return position and derivatives up to `order` at all joints; at inner joints the later segment is used."""
        s = self._segments()
        first = s.rows(s.starts, order)
        last = s.rows(np.asarray([known(self.duration)]), order)
        states = np.concatenate([np.stack(x, axis=1) for x in (first, last)])
        states[:, 0] += known(self.origin)
        return like(states, self.coefficients)

    def jumps(self, order: int = 2) -> Float[Array, "inner {order}+1 3"]:
        """Return the jumps of r and its derivatives at each inner joint (value after minus value before the joint)."""
        s = self._segments()
        after, before = (np.stack(s.rows(s.starts[1:], order, side), axis=1) for side in ("right", "left"))
        return like(after - before, self.coefficients)

    def in_time(self) -> Float[Array, "rows terms 3"]:
        """Return the coefficients of the segments as polynomials in the time since the start of the segment."""
        return self.coefficients if self.progress is None else progress.in_time(self.coefficients, self.progress)

    def _segments(self) -> Segments:
        """Return the segments without padding, in NumPy.

        **Raises:** ValueError inside a trace.
        """
        count = self.segments
        own = None if self.progress is None else known(self.progress)[:count]
        starts, c = (known(x)[:count] for x in (self.starts, self.coefficients))
        return Segments(starts, c, np.diff(np.append(starts, known(self.duration))), own, known(self.origin))

    def length(self) -> Scalar:
        """Return the arc length [m] over the duration.

        The method is Gauss–Legendre quadrature in each segment. The error is only round-off, except where the speed is
        zero or nearly zero inside a segment: there it is about 1e-5 of the length of the segment.
        """
        return route_length.total(self.starts, self.in_time(), self.duration)

    def arc_length(self, t: ScalarLike) -> Scalar:
        """Return the arc length [m] from the start to the time `t` [s], 0 ≤ t ≤ duration, as accurately as `length`."""
        t = one_instant(t).astype(self.duration.dtype)
        return route_length.until(self.starts, self.in_time(), self.duration, t)

    def time_at(self, length: ScalarLike) -> Scalar:
        """Return the time [s] at which the arc length reaches `length` [m]; at a stop, the start of the stop.

        For lengths outside the range, the result is the time of the start or the end. Where the speed is not zero, the
        result is differentiable; its derivative dt/ds is the inverse of the speed.
        """
        s = one_instant(length).astype(self.duration.dtype)
        return route_length.inverse(self.starts, self.in_time(), self.duration, s)

    def nearest(self, point: ArrayInput) -> Nearest:
        """Find the point on the route nearest to `point` (3,) [m], and its time, position and distance; world axes.

        Every segment is sampled at 17 instants, and the nearest sample of each segment is refined by Newton's method.
        First derivatives of time, position and distance are exact.
        """
        local = real_vector(point, "the point", 3).astype(self.duration.dtype) - self.origin
        time, position, distance = route_nearest.nearest(self.starts, self.in_time(), self.duration, local)
        return Nearest(time, position + self.origin, distance)

    @property
    def stops(self) -> Float[np.ndarray, "k 2"]:
        """The intervals (start, end) [s] in which the vehicle is at rest."""
        return route_parts.rests(self._segments())

    @property
    def legs(self) -> list["Route"]:
        """The drives between the stops, in order, as routes."""
        edges = [0.0, *self.stops.ravel().tolist(), float(known(self.duration))]
        return [self.window(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]

    def segment(self, i: int) -> "Route":
        """Return segment `i` as a route, without rounding; negative indices count from the end.

        **Raises:** IndexError if the segment does not exist.
        """
        count = self.segments
        if not -count <= i < count:
            raise IndexError(f"segment {i} does not exist: the route has {count} segments")
        return from_segments(*route_parts.one(self._segments(), i % count, known(self.origin)))

    def window(self, t0: ArrayInput, t1: ArrayInput) -> "Route":
        """Return the interval from `t0` to `t1` [s] as a route that starts at time 0; joints inside it are kept.

        **Raises:** ValueError if t0 ≥ t1 or the window is not within the route.
        """
        given = known(self.duration), known(self.origin)
        return from_segments(*route_parts.window(self._segments(), t0, t1, *given))

    def reversed(self) -> "Route":
        """Return the same curve in the opposite direction, with the same durations of the segments."""
        return from_segments(*route_parts.backwards(self._segments(), known(self.duration), known(self.origin)))

    def __add__(self, other: "Route") -> "Route":
        if not isinstance(other, Route):
            return NotImplemented
        origins = known(self.origin), known(other.origin)
        return from_segments(*route_parts.joined(self._segments(), other._segments(), origins))

    @classmethod
    def from_piecewise(cls, spline: Any) -> "Route":
        """Convert a SciPy spline with values (3,) [m] over time [s] to a route; its first breakpoint becomes time 0.

        The spline may be a PPoly or a subclass (CubicSpline, PchipInterpolator, …), a BSpline (make_interp_spline, …)
        or a BPoly, up to degree 7 and of any continuity. The coefficients of a PPoly are copied. SciPy converts the
        other classes with rounding errors.

        **Raises:** ValueError for any other object, for values that are not real, finite and of shape (3,), for
        breakpoints that do not increase, or for a higher degree.
        """
        return from_segments(*route_input.from_piecewise(spline))

    @classmethod
    def from_path(cls, path: AbstractHodograph, tolerance: ArrayInput = 1e-3) -> "Route":
        """Approximate a polynomial path, such as a spiral-helix, by a route within `tolerance` [m].

        The distance is measured at equal times, and its bound is proved. A septic that has the position, velocity,
        acceleration and jerk of the path at both ends of a segment of duration h differs from the path by at most
        h⁸/(2⁸·8!)·max |r⁽⁸⁾|. The bound on this maximum on each segment includes rounding errors.

        **Raises:** ValueError for a path that is not polynomial, for a batch of paths, or for a tolerance that is not
        positive, requires more than 65536 segments, or is below the rounding error of the coordinates.
        """
        return from_segments(*route_input.from_path(path, tolerance))

    def to_ppoly(self) -> "PPoly":
        """Convert the route to SciPy's PPoly over time [s], in world axes [m]; the addition of `origin` is rounded."""
        from scipy.interpolate import PPoly

        c = np.array(known(self.in_time())[: self.segments], float)
        c[:, 0] += known(self.origin)
        return PPoly(np.moveaxis(c, 0, 1)[::-1], np.asarray(self.times, float))

    def record(self) -> Record:
        """Return the exact segments over the dimension `segment`, with their coefficients over `power`.

        To sample the route, call `qtraj.evaluate(route, times).to_xarray()`.
        """
        return route_record.record(self, self.segments)


@in_numpy
def _derivatives(route: Route, t: Scalar, order: int) -> Float[Array, "{order}+1 3"]:
    return xp.stack(method(route, "sampled")(t, order))


def from_segments(starts: Any, c: Any, duration: Any, origin: Any, own: Any = None) -> Route:
    """Create a route from unpadded segments: starts (n,), coefficients (n, terms, 3), duration and origin.

    `own` (n, 4) is the progress of the segments, or None.
    """
    if c.ndim != 3 or c.shape[2] != 3 or c.shape[0] != starts.shape[0] or c.shape[1] > pieces.TERMS[-1]:
        raise ValueError(
            f"the coefficients must have shape ({starts.shape[0]}, terms, 3), one row per segment, with at most "
            f"{pieces.TERMS[-1]} terms, but an array of shape {c.shape} was given"
        )
    if own is not None and own.shape != (starts.shape[0], progress.TERMS):
        raise ValueError(f"the progress must have shape ({starts.shape[0]}, {progress.TERMS}), not {own.shape}")
    route = object.__new__(Route)  # `Route()` requires joint states, but segments may be discontinuous at the joints
    padded = pieces.padded(starts, c)
    more = padded[0].shape[0] - starts.shape[0]
    own = None if own is None else pieces.arithmetic(own).pad(own, [(0, more), (0, 0)])
    fields = {"starts": padded[0], "coefficients": padded[1], "duration": duration, "origin": origin}
    for name, value in fields.items():
        object.__setattr__(route, name, as_float(value))
    object.__setattr__(route, "progress", None if own is None else as_float(own))
    return route
