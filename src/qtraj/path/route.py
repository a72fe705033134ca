"""Routes: a whole drive or flight as one path of polynomial segments."""

from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation.arrays import as_array, as_float, concrete, one_instant, real_vector, warn_if_coarse
from qtraj.foundation.document import storable, stored_as
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3
from qtraj.path import pieces, route_input, route_length, route_nearest
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route_nearest import Nearest

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

JOINED = 1e-6
"""[m] Routes can be joined if their ends agree to this, or to a few roundings of their coordinates."""


def _fields(route: Any) -> dict[str, Any]:
    """The stored fields of a route: its segments without the padding."""
    count = route.segments
    return {
        "starts": np.asarray(route.starts)[:count],
        "coefficients": np.asarray(route.coefficients)[:count],
        "duration": np.asarray(route.duration),
        "origin": np.asarray(route.origin),
    }


def _restored(starts: ArrayInput, coefficients: ArrayInput, duration: ArrayInput, origin: ArrayInput) -> "Route":
    return built(*(np.asarray(x, float) for x in (starts, coefficients, duration, origin)))


@stored_as(_fields, _restored)
@storable
class Route(AbstractHodograph, AbstractResult):
    """A path of polynomial segments between joints.

    `times` (n,) [s], increasing strictly; `position` [m], `velocity` [m/s], `acceleration` [m/s²] and, if given, `jerk`
    [m/s³] (n, 3): the states at the joints, world axes. The segments are quintics, and the route has a continuous
    acceleration (C²); with the jerk they are septics, and the jerk is continuous too (C³). Path time 0 is the first
    joint. `Route.from_piecewise` accepts splines of SciPy, of any continuity.

    Positions are stored relative to the first joint, so that large coordinates lose no digits. The segments are
    `starts` (rows,) [s] and `coefficients` (rows, terms, 3), ascending in the time since a segment's start [m s^-k],
    relative to `origin` (3,). Rows are padded to a power of two, with infinite starts, so that routes of similar length
    share executables and can be stacked. At a joint the later segment is used; outside [0, duration] the first and the
    last segment are extrapolated.

    **Raises:** ValueError for wrong shapes, values that are not finite, or times that do not increase strictly.
    """

    starts: Float[Array, " rows"]
    coefficients: Float[Array, "rows terms 3"]
    duration: Scalar
    origin: Vec3

    def __init__(
        self,
        times: ArrayInput,
        position: ArrayInput,
        velocity: ArrayInput,
        acceleration: ArrayInput,
        jerk: ArrayInput | None = None,
    ):
        orders = [position, velocity, acceleration, *([] if jerk is None else [jerk])]
        found = route_input.from_states(times, orders)
        self.starts, self.coefficients, self.duration, self.origin = found
        warn_if_coarse(self.origin, "the position of a route")

    def derivatives(self, t: ScalarLike, order: int) -> Float[Array, "{order}+1 3"]:
        """Position and derivatives up to `order` at one instant `t` [s]."""
        t = one_instant(t).astype(self.duration.dtype)
        i = self.index(t)
        rows = pieces.values(self.coefficients[i], t - self.starts[i], order)
        return jnp.stack([rows[0] + self.origin, *rows[1:]])

    def index(self, t: ScalarLike) -> Int[Array, ""]:
        """The index of the segment at `t` [s]; at a joint of the later one."""
        t = one_instant(t).astype(self.duration.dtype)
        return jnp.maximum(jnp.searchsorted(self.starts, t, side="right") - 1, 0)

    def nodes(self) -> Float[Array, " nodes"]:
        """The times of the joints, and of three instants inside each segment [s]; then the duration."""
        parts = jnp.asarray(np.arange(4) / 4, self.duration.dtype)
        h = pieces.durations(self.starts, self.duration)
        return (jnp.minimum(self.starts, self.duration)[:, None] + h[:, None] * parts[None]).ravel()

    @property
    def segments(self) -> int:
        """The number of segments.

        **Raises:** ValueError inside a trace, where it is unavailable.
        """
        return int(np.isfinite(_known(self.starts)).sum(axis=-1).max())

    @property
    def times(self) -> Float[Array, " n"]:
        """The times of the joints [s], from 0 to the duration.

        **Raises:** ValueError inside a trace, where their number is unavailable.
        """
        return as_array(np.append(_known(self.starts)[: self.segments], _known(self.duration)), self.starts.dtype)

    def joints(self, order: int = 2) -> Float[Array, "n {order}+1 3"]:
        """Position and derivatives up to `order` at all joints, world axes, on the later side."""
        starts, c = (_known(x)[: self.segments] for x in (self.starts, self.coefficients))
        first = np.stack(pieces.values(c, np.zeros(len(c), c.dtype), order), axis=1)
        last = np.stack(pieces.values(c[-1], _known(self.duration) - starts[-1], order))
        found = np.concatenate([first, last[None]])
        found[:, 0] += _known(self.origin)
        return as_array(found, c.dtype)

    def jumps(self, order: int = 2) -> Float[Array, "inner {order}+1 3"]:
        """The jumps of r and its derivatives at each inner joint: later segment minus earlier one."""
        h = self._durations()
        c = _known(self.coefficients)[: self.segments]
        ends = np.stack(pieces.values(c[:-1], h[:-1], order), axis=1)
        starts = np.stack(pieces.values(c[1:], np.zeros_like(h[1:]), order), axis=1)
        return as_array(starts - ends, c.dtype)

    def length(self) -> Scalar:
        """Arc length over the duration [m].

        By Gauss–Legendre quadrature in each segment. Its error is round-off, unless the speed is zero or nearly zero
        inside a segment: there it is about 1e-5 of that segment's length.
        """
        return route_length.total(self.starts, self.coefficients, self.duration)

    def arc_length(self, t: ScalarLike) -> Scalar:
        """Arc length from the start to the time `t` [s], 0 ≤ t ≤ duration, [m]; as accurate as `length`."""
        t = one_instant(t).astype(self.duration.dtype)
        return route_length.until(self.starts, self.coefficients, self.duration, t)

    def time_at(self, length: ScalarLike) -> Scalar:
        """The time [s] at which the arc length reaches `length` [m]; the earliest one if the route stands there.

        Lengths outside the range give the start or the end. Differentiable: dt/ds is the inverse of the speed.
        """
        s = one_instant(length).astype(self.duration.dtype)
        return route_length.inverse(self.starts, self.coefficients, self.duration, s)

    def nearest(self, point: ArrayInput) -> Nearest:
        """The time, position and distance of the route's nearest point to a `point` (3,), world axes.

        The search refines 16 parts of every segment by Newton's method; differentiable (envelope theorem).
        """
        local = real_vector(point, "the point", 3).astype(self.duration.dtype) - self.origin
        time, position, distance = route_nearest.nearest(self.starts, self.coefficients, self.duration, local)
        return Nearest(time, position + self.origin, distance)

    def segment(self, i: int) -> "Route":
        """Segment `i` as a route, exactly; negative indices count from the end.

        **Raises:** IndexError if there is no such segment.
        """
        count = self.segments
        if not -count <= i < count:
            raise IndexError(f"there are {count} segments, and none at {i}")
        i = i % count
        c = _known(self.coefficients)[i : i + 1]
        return built(np.zeros(1, c.dtype), c, self._durations()[i], _known(self.origin))

    def window(self, t0: ArrayInput, t1: ArrayInput) -> "Route":
        """The part from `t0` to `t1` [s], whose time 0 is `t0`; the same curve, joints included.

        **Raises:** ValueError if t0 ≥ t1 or the window is not within the route.
        """
        start, end, duration = (float(np.asarray(x)) for x in (t0, t1, _known(self.duration)))
        if not 0 <= start < end <= duration:
            raise ValueError(
                f"a window must lie within the route, from 0 to {duration:.9g} s, and end after it starts, "
                f"but {start:.9g} to {end:.9g} s was given"
            )
        starts, c = (_known(x)[: self.segments] for x in (self.starts, self.coefficients))
        first = int(np.searchsorted(starts, start, "right")) - 1
        last = int(np.searchsorted(starts, end, "left"))
        c, new = c[first:last].copy(), starts[first:last] - start
        c[:1] = pieces.shifted(c[:1], -new[:1])
        new[0] = 0.0
        return built(new, c, np.asarray(end - start, c.dtype), _known(self.origin))

    def reversed(self) -> "Route":
        """The same curve from its end to its start, with the same durations."""
        c = pieces.backwards(_known(self.coefficients)[: self.segments], self._durations())[::-1]
        starts = _known(self.duration) - _known(self.times)[:0:-1]
        return built(starts, c, _known(self.duration), _known(self.origin))

    def __add__(self, other: "Route") -> "Route":
        if not isinstance(other, Route):
            return NotImplemented
        start, end = _known(other.joints(0))[0, 0], _known(self.joints(0))[-1, 0]
        gap, size = float(np.linalg.norm(start - end)), float(np.max(np.abs(start)))
        if gap > max(JOINED, 16 * size * float(np.finfo(start.dtype).eps)):
            raise ValueError(
                f"the second route starts {gap:.6g} m from the end of the first, at {start.tolist()} after "
                f"{end.tolist()}: only routes whose ends agree can be joined"
            )
        degree = max(x.coefficients.shape[-2] for x in (self, other))
        parts = [_known(x.coefficients)[: x.segments] for x in (self, other)]
        parts = [np.pad(c, [(0, 0), (0, degree - c.shape[1]), (0, 0)]) for c in parts]
        parts[1][:, 0] += _known(other.origin) - _known(self.origin)
        first, duration = _known(self.starts)[: self.segments], _known(self.duration)
        starts = np.concatenate([first, duration + _known(other.starts)[: other.segments]])
        return built(starts, np.concatenate(parts), duration + _known(other.duration), _known(self.origin))

    @classmethod
    def from_piecewise(cls, spline: Any) -> "Route":
        """A spline of SciPy with values (3,), in time [s] and metres, as a route; its first breakpoint is time 0.

        PPoly and what derives from it (CubicSpline, PchipInterpolator, …), BSpline (make_interp_spline, …) and BPoly,
        up to degree 7, of any continuity. The coefficients of a PPoly are taken as they are; those of the others are
        converted by SciPy, which rounds.

        **Raises:** ValueError for another object, another shape of values or a higher degree.
        """
        return built(*route_input.from_piecewise(spline))

    @classmethod
    def from_path(cls, path: AbstractHodograph, tolerance: ArrayInput = 1e-3) -> "Route":
        """A polynomial path, such as a spiral-helix, as a route whose distance from it is at most `tolerance` [m].

        The distance is at equal times, and the bound is proved: septics with the path's position, velocity,
        acceleration and jerk at both ends of a segment of duration h differ from it by at most h⁸/(2⁸·8!)·max |r⁽⁸⁾|,
        which is bounded on each segment, including rounding.

        **Raises:** ValueError for a path without polynomials, or for a tolerance that is not positive, needs more than
        65536 segments, or is below the rounding of the coordinates.
        """
        return built(*route_input.from_path(path, tolerance))

    def to_ppoly(self) -> "PPoly":
        """The route as SciPy's PPoly in time [s], world axes [m]; the origin is added, which may round."""
        from scipy.interpolate import PPoly

        c = _known(self.coefficients)[: self.segments].astype(float)
        c[:, 0] += _known(self.origin)
        return PPoly(np.moveaxis(c, 0, 1)[::-1], np.asarray(self.times, float))

    def record(self) -> Record:
        """The exact segments over `segment`, with their coefficients over `power`.

        For samples call `qtraj.evaluate(route, times).to_xarray()`.
        """
        count = self.segments
        starts, c = np.asarray(self.starts)[..., :count], np.asarray(self.coefficients)[..., :count, :, :]
        meaning = "coefficients about the origin, world axes, that of (t − start)^k in m s^-k"
        variables = {
            "start": Quantity(starts, "s", "time at which a segment starts", ("segment",)),
            "coefficients": Quantity(c, "m", meaning, ("segment", "power", "world")),
            "duration": Quantity(self.duration, "s", "duration of the path"),
            "origin": Quantity(self.origin, "m", "the point that coefficients refer to, world axes", ("world",)),
        }
        degree = c.shape[-2] - 1
        shape = f"{count} segments of degree {degree}, {extent(self.duration, 's')}"
        return Record(f"{batch_prefix(self.duration.shape)}{shape}", variables, attributes={"frame": "world"})

    def _durations(self) -> np.ndarray:
        """The durations of the segments, known."""
        return np.diff(_known(self.times))


def built(starts: Any, c: Any, duration: Any, origin: Any) -> Route:
    """The route of segments as `pieces` has them, without padding."""
    if c.ndim != 3 or c.shape[2] != 3 or c.shape[0] != starts.shape[0] or c.shape[1] > pieces.TERMS[-1]:
        raise ValueError(
            f"the coefficients of a route must have shape (segments, terms, 3) with at most {pieces.TERMS[-1]} terms "
            f"and {starts.shape[0]} segments, but an array of shape {c.shape} was given"
        )
    route = object.__new__(Route)  # its own arguments are the states at the joints, which these segments need not share
    starts, c = pieces.padded(starts, c)
    for name, value in zip(
        ("starts", "coefficients", "duration", "origin"), (starts, c, duration, origin), strict=True
    ):
        object.__setattr__(route, name, as_float(value))
    return route


def _known(x: Any) -> np.ndarray:
    value = concrete(x)
    if value is None:
        raise ValueError(
            "this needs the numbers of a route, which are not known inside jit, grad or vmap. Cut, join and convert "
            "routes outside, and evaluate them inside."
        )
    return value
