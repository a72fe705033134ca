"""Compute the speed along a retimed path, and the limit that bounds the speed at each point of the path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.ellipse import Ellipse
from qtraj.design.samples_at_rest import mended, stops_of
from qtraj.design.timing.constraints import UPPER
from qtraj.design.timing.outcome import Retimed, require_one
from qtraj.design.timing.road import coefficients
from qtraj.design.timing.road_cells import at_parameters_of
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.drawing import draw
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult
from qtraj.foundation.suggestion import suggestion
from qtraj.foundation.types import Scalar
from qtraj.path.distances import distances_at
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.road_parameters import RoadParameters
from qtraj.path.vehicle import Vehicle
from qtraj.path.vehicle_data import vehicle_quantities

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PER_CELL, REACHED, STILL = 4, 0.99, 1e-12
"""Number of samples in each cell of the timing; a limit is reached if the quantity is at least this fraction of it, and
a speed counts as zero below this fraction of the highest speed."""
ORDER = 3  # the highest order of a derivative of the path in a limit


class SpeedProfile(AbstractResult):
    """The speed along a retimed path against time and distance, with the limits that bound it.

    At n instants, and for the k limits of the retiming in the order of `names`:

    - `times` (n,) [s], `parameter` (n,) [s] on the original path, `distance` (n,) [m] travelled.
    - `speed` (n,) [m/s] and `tangential` (n,) [m/s²], the signed acceleration along the path.
    - `speed_bound` (n,) [m/s]: the highest speed at which the limits on speed, lateral acceleration, acceleration,
      rates of rotation and friction (of the lateral force alone) are satisfied at constant speed; infinite where none
      of these limits bounds the speed. The other limits reduce the speed further. A limit that depends on the speed has
      its value at the speed of the timing.
    - `values` (k, n): the limited quantities, in the units of their limits, and `bounds` (k, n), the limits.

    For the m cells of the timing:

    - `cell_distance` (m + 1,) [m]: the distances from the start of the path to the ends of the cells.
    - `usage` (k, m): the largest ratio of each quantity to its limit.
    - `active` (m,): the index of the limit with the largest usage, if this usage is at least 0.99; otherwise −1.

    For the whole path:

    - `limits` (k,), in the units of `values`; for a limit that changes along the way, its value where it matters most.
    - `shares` (k,): the fraction of the distance on which the quantity reaches at least 99 % of its limit.
      Several limits may be reached at the same point.
    - `durations` (2,) [s] of the original and of the retimed path; the first one is NaN for a shape.
    - `stops` (s, 2) [s]: the time intervals at rest; for a start or an end at rest, the interval has zero length.
    - `stop_distance` (s,) [m]: the distances at which the vehicle is at rest.
    - `vehicle`: the vehicle of the limits, or None.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    times: Float[Array, " n"]
    parameter: Float[Array, " n"]
    distance: Float[Array, " n"]
    speed: Float[Array, " n"]
    tangential: Float[Array, " n"]
    speed_bound: Float[Array, " n"]
    values: Float[Array, "k n"]
    bounds: Float[Array, "k n"]
    cell_distance: Float[Array, " m+1"]
    usage: Float[Array, "k m"]
    active: Int[Array, " m"]
    limits: Float[Array, " k"]
    shares: Float[Array, " k"]
    durations: Float[Array, " 2"]
    stops: Float[Array, "s 2"]
    stop_distance: Float[Array, " s"]
    vehicle: Vehicle | None = None

    def share(self, name: str) -> float:
        """Return the fraction of the distance on which the limit with this name is reached.

        **Raises:** ValueError if the path was not timed with this limit.
        """
        if name not in self.names:
            known = suggestion(str(name), self.names, "limits of this timing")
            raise ValueError(f"the path was timed without a limit {name!r}: {known}")
        return float(self.shares[self.names.index(name)])

    def record(self) -> Record:
        """Return the samples, cells, limits and stops with the dimensions `time`, `cell`, `limit` and `stop`."""
        of_shape = np.isnan(np.asarray(self.durations)[..., 0]).any()
        time, limit, unit = ("time",), ("limit",), "m" if of_shape else "s"
        variables = {
            "parameter": Quantity(self.parameter, unit, "parameter of the original path", time),
            "distance": Quantity(self.distance, "m", "distance travelled", time),
            "speed": Quantity(self.speed, "m s-1", "speed", time),
            "tangential_acceleration": Quantity(
                self.tangential, "m s-2", "acceleration along the path, negative when braking", time
            ),
            "speed_bound": Quantity(
                self.speed_bound, "m s-1", "highest speed that the limits allow at constant speed", time
            ),
            **{
                quantity(name).variable: Quantity(values, quantity(name).unit, quantity(name).meaning, time)
                for name, values in zip(self.names, self.values, strict=True)
                if name != "speed"
            },
            "cell_distance": Quantity(self.cell_distance, "m", "distances of the ends of the cells", ("knot",)),
            "usage": Quantity(self.usage, "1", "largest ratio of a quantity to its limit in a cell", ("limit", "cell")),
            "active_limit": Quantity(self.active, "1", "index of the limit that is reached, or -1", ("cell",)),
            "bound": Quantity(self.limits, "", "the limit, in limit_unit", limit),
            "bound_along": Quantity(self.bounds, "", "the limit along the path, in limit_unit", ("limit", "time")),
            "share": Quantity(self.shares, "1", "fraction of the distance on which the limit is reached", limit),
            "duration": Quantity(self.durations, "s", "duration", ("path",)),
            "stop_time": Quantity(self.stops, "s", "time interval at rest", ("stop", "end")),
            "stop_distance": Quantity(self.stop_distance, "m", "distance at which the vehicle is at rest", ("stop",)),
            **vehicle_quantities(self.vehicle),
        }
        units = np.array([quantity(name).unit for name in self.names], dtype=str)
        coordinates = {
            "time": Quantity(self.times, "s", "time from the start of the path", time),
            "limit": Quantity(np.array(self.names, dtype=str), "", "limited quantity", limit),
            "limit_unit": Quantity(units, "", "unit of the limit", limit),
        }
        labels = {"path": ["before", "after"], "end": ["start", "end"]}
        return Record(self._summary(), variables, coordinates, {"frame": "natural"}, labels)

    def _summary(self) -> str:
        before, after = np.asarray(self.durations).tolist()
        instead = "" if np.isnan(before) else f" instead of {before:.6g} s"
        reached = (f"{name} {100 * share:.3g} %" for name, share in zip(self.names, self.shares.tolist(), strict=True))
        return f"{float(self.distance[-1]):.6g} m in {after:.6g} s{instead}; {', '.join(reached)}"

    def plot(self, title: str = "") -> Figure:
        """Plot the speed against the distance, coloured by the active limit, and each limited acceleration and jerk.

        The method needs the extra `viz`.

        **Raises:** ModuleNotFoundError, naming the extra, if matplotlib is missing.
        """
        return draw("speed_profile_plot", self, title)


def speed_profile(timed: Retimed) -> SpeedProfile:
    """Compute the speed along a retimed path, and the limits that bound it, at four points of each cell of its timing.

    **Raises:** ValueError for anything else than one result of `retime`, for a batch of results, or for traced values.
    """
    if not isinstance(timed, Retimed):
        raise ValueError(
            f"timed must be a Retimed, the result of qtraj.retime, but {described(timed)} was given. "
            "Pass qtraj.retime(path, limits)."
        )
    require_one(timed)
    names, timing = timed.timing_names, timed.timing
    limits = np.asarray(timed.certificate.limits)[: len(names)]
    bounds = _bounds(timed, limits)
    knots, rest = np.asarray(timing.knots), timing.rest
    parameter = _places(knots, rest)
    vehicle = at_parameters_of(timed.vehicle, timed.path.path, parameter)
    distance = distances_at(timed.path.path, parameter)
    own = as_array(parameter, float), as_array(bounds, float)
    found = jax.tree.map(np.array, _sampled(timed.path, own, names, vehicle, timed.combined))
    still = found.speed <= STILL * found.speed.max()
    standing = still & (np.append(still[1:], False) | np.append(False, still[:-1]))
    values = np.stack([mended(x, still, standing, name in UPPER) for x, name in zip(found.values, names, strict=True)])
    ends = distance[::PER_CELL]
    usage = np.asarray(timed.usage)[: len(names)]
    largest = usage.argmax(axis=0)
    active: Any = np.where(usage.max(axis=0) >= REACHED, largest, -1)
    shares = np.sum(np.diff(ends) * (usage >= REACHED), axis=1) / distance[-1]
    stops, places = stops_of(found.times, distance, still)
    return SpeedProfile(
        names,
        times=as_float(found.times),
        parameter=as_float(parameter),
        distance=as_float(distance),
        speed=as_float(np.where(still, 0.0, found.speed)),
        tangential=as_float(mended(found.tangential, still, standing, False)),
        speed_bound=as_float(_bound(found, names, bounds)),
        values=as_float(values),
        bounds=as_float(bounds),
        cell_distance=as_float(ends),
        usage=as_float(usage),
        active=active.astype(np.int32),
        limits=as_float(limits),
        shares=as_float(shares),
        durations=as_float([np.nan if timed.of_shape else float(timed.path.path.duration), float(timing.duration)]),
        stops=as_float(stops),
        stop_distance=as_float(places),
        vehicle=timed.vehicle,
    )


class _Samples(NamedTuple):
    """Samples of a retimed path; `unit_values` and `unit_speed` are values of the original path at the same places.

    `grip` is 1/u̇² (u: path parameter) at the largest u̇² for which the lateral force alone satisfies a friction limit.
    """

    times: Any
    speed: Any
    tangential: Any
    values: Any
    unit_values: Any
    unit_speed: Any
    grip: Any


def _places(knots: Float[np.ndarray, " m+1"], rest: tuple[bool, bool]) -> Float[np.ndarray, " n"]:
    """Return the parameters [s] of the samples; in a cell at an end at rest, they are denser towards this end."""
    z = np.tile(np.arange(PER_CELL) / PER_CELL, (len(knots) - 1, 1))
    if rest[0]:
        z[0] = z[0] ** 2
    if rest[1]:
        z[-1] = z[-1] * (2 - z[-1])
    return np.append((knots[:-1, None] + np.diff(knots)[:, None] * z).ravel(), knots[-1])


@eqx.filter_jit
def _sampled(
    path: RetimedPath,
    at: tuple[Float[Array, " n"], Float[Array, "k n"]],
    names: tuple[str, ...],
    vehicle: RoadParameters | None,
    combined: Ellipse | None,
) -> _Samples:
    def sample(u: Scalar, limits: Float[Array, " k"], vehicle: RoadParameters | None) -> _Samples:
        t = path.timing.time(u)
        i, own = (_invariants(x, at, vehicle) for x, at in ((path, t), (path.path, u)))
        of_unit = jnp.array([quantity(name).value(own) for name in _bounding(names)], u.dtype)
        speed = jnp.sqrt(i.S)
        each = {name: jnp.asarray(quantity(name).value(i)) for name in names if name != COMBINED}
        if combined is not None:
            each[COMBINED] = combined.usage(i.B / speed, quantity("lateral_acceleration").value(i), speed)
        values = jnp.stack([each[name] for name in names])
        unit_speed, grip = jnp.sqrt(own.S), 0.0 * own.S
        if vehicle is not None:
            bounds: Any = dict(zip(names, limits, strict=True))
            ahead, second = (jnp.stack(x) for x in own.r[1:3])
            half = jnp.asarray(0.5, u.dtype)
            grip = coefficients(ahead / unit_speed, tuple(second), unit_speed, half, vehicle, bounds).upper
        return _Samples(t, speed, i.B / speed, values, of_unit, unit_speed, grip)

    found = jax.vmap(sample, (0, 1, None if vehicle is None else 0))(*at, vehicle)
    return found._replace(values=found.values.T, unit_values=found.unit_values.T)


def _invariants(path: Any, t: Scalar, vehicle: RoadParameters | None) -> Invariants:
    return Invariants([(row[0], row[1], row[2]) for row in path.derivatives(t, ORDER)], vehicle=vehicle)


def _bounding(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the quantities that are proportional to a power of a constant speed; the acceleration is then lateral."""
    return tuple("lateral_acceleration" if n == "acceleration" else n for n in names if _is_power(n))


def _is_power(name: str) -> bool:
    return name in UPPER or name == "acceleration"


def _bounds(timed: Retimed, limits: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k n"]:
    """Return the limits at the samples: those of the cell that follows, and at the end those of the last cell."""
    constant = np.repeat(limits[:, None], np.shape(timed.timing.coefficients)[0], axis=1)
    given = constant if timed.bounds is None else np.asarray(timed.bounds)[: len(limits)]
    each = np.repeat(given, PER_CELL, axis=1)
    return np.append(each, given[:, -1:], axis=1)


def _bound(found: _Samples, names: tuple[str, ...], limits: Float[np.ndarray, "k n"]) -> Float[np.ndarray, " n"]:
    """Return the lowest constant speed [m/s] at which a limit is reached.

    Each quantity is proportional to a power of the speed.
    """
    own = [limit for name, limit in zip(names, limits, strict=True) if _is_power(name)]
    bounded = (found.grip > 0) & (found.unit_speed > 0)
    lowest = np.where(bounded, found.unit_speed * np.where(bounded, found.grip, 1.0) ** -0.5, np.inf)
    for name, limit, signed in zip(_bounding(names), own, found.unit_values, strict=True):
        if name == "speed":
            lowest = np.minimum(lowest, limit)
            continue
        value = quantity(name).side * signed
        known = np.isfinite(value) & (value > 0) & (found.unit_speed > 0)
        with np.errstate(over="ignore"):  # an infinite bound is none
            bound = (abs(limit) / np.where(known, value, 1.0)) ** (1 / quantity(name).per_time) * found.unit_speed
        lowest = np.minimum(lowest, np.where(known, bound, np.inf))
    return lowest
