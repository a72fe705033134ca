"""Define the result of `retime`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from qtraj.design.ellipse import Ellipse
from qtraj.design.proof.certificate import Certificate
from qtraj.design.timing.end_advice import missed_speeds
from qtraj.design.timing.gap_text import fastest_text
from qtraj.design.timing.sources import source
from qtraj.design.timing.steepness import friction_at_rest
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation import document
from qtraj.foundation.argument import require_type
from qtraj.foundation.arrays import as_code, as_float
from qtraj.foundation.codes import where_code
from qtraj.foundation.document import storable
from qtraj.foundation.drawing import draw
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record, require_concrete
from qtraj.foundation.result import batch_prefix, extent
from qtraj.foundation.types import ArrayInput
from qtraj.path.clearance_quantity import names_obstacle
from qtraj.path.quantity import quantity
from qtraj.path.vehicle import Vehicle
from qtraj.path.vehicle_data import vehicle_quantities

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FAILED_SEARCH = (ResultCode.not_finite, ResultCode.not_converged, ResultCode.limits_broken)
"""Codes of searches for which no timing may exist."""


@storable
class Retimed(AbstractOutcome):
    """The result of `retime` for one path or a batch (batch axes in front of every array).

    - `path`: the path with its fastest timing. `path.path` is the path as a function of its original parameter. If the
      path is a route, slow motion next to a stop is replaced by a stop, and creeping by an even progress.
    - `duration` [s]: the duration of `path`. Its derivatives are cheaper than those of `path.duration`.
    - `certificate`: the findings on all limits, for the whole path.
    - `usage` (limits, cells): the largest ratio of each limited quantity to its limit in each cell of `timing`; NaN for
      limits on the shape and obstacles, which no timing changes.
    - `speeds` (2,) [m/s]: the speeds at the start and at the end.
    - `wanted` (2,) [m/s]: the prescribed speeds at the start and at the end; NaN where free.
    - `code`: a `ResultCode`.
    - `iterations`: the number of steps of all searches.
    - `vehicle`: the vehicle of limits on friction or power, otherwise None.
    - `of_shape`: whether the original path is a `Shape`, whose parameter is a length [m] and not a time.
    - `gap`: the relative distance of the duration from the minimum over all timings. With `knots`, it is an upper
      bound, except for errors of sampling: the distance from a timing that ignores how limits couple speed and
      acceleration, infinite if the limits do not bound the acceleration. With cells that `retime` chooses: without a
      limit that couples speed and acceleration (acceleration, yaw and vertical acceleration, jerk, friction, power), it
      is an upper bound, except for errors of sampling: the distance from a timing that ignores the coupling. With such
      a limit it is the smaller one of this bound and of an estimate: the time gained if all cells are halved, and at
      least as much again for all further halvings. If halvings do not gain less and less, there is no estimate, and
      `gap` is the bound, which may be far too large. With a limit on jerk, power or an own quantity, the estimate is
      for the local minimum. NaN if the path or a limit was traced, if the duration was prescribed, or if a limit on the
      lateral acceleration by speed rises so steeply that faster speeds may be allowed again, which `retime` does not
      use.
    - `share`: the factor on the limits on accelerations with which the fastest timing has the prescribed duration; NaN
      if no duration was prescribed.
    - `braking_time` [s] and `braking_distance` [m]: if `start_speed` is higher than the limits allow, the time and the
      distance from which on every limit is satisfied; otherwise 0.
    - `bounds` (limits, cells): the limits in each cell of `timing`, if one of them changes along the way or depends on
      the speed.
    - `combined`: the limit on the combined acceleration, or None.
    """

    path: RetimedPath
    duration: Float[Any, "*batch"]
    certificate: Certificate
    usage: Float[Any, "*batch limits cells"]
    speeds: Float[Any, "*batch 2"]
    code: Int[Any, "*batch"]
    iterations: Int[Any, "*batch"]
    vehicle: Vehicle | None
    of_shape: bool = eqx.field(static=True)
    gap: Float[Any, "*batch"]
    share: Float[Any, "*batch"]
    braking_time: Float[Any, "*batch"]
    braking_distance: Float[Any, "*batch"]
    bounds: Float[Any, "*batch limits cells"] | None
    combined: Ellipse | None
    wanted: Float[Any, "*batch 2"]

    def __init__(
        self,
        path: RetimedPath,
        duration: ArrayInput,
        certificate: Certificate,
        usage: ArrayInput,
        speeds: ArrayInput,
        code: ArrayInput,
        iterations: ArrayInput,
        vehicle: Vehicle | None = None,
        of_shape: bool = False,
        gap: ArrayInput = np.nan,
        share: ArrayInput = np.nan,
        braking_time: ArrayInput = 0.0,
        braking_distance: ArrayInput = 0.0,
        bounds: ArrayInput | None = None,
        combined: Ellipse | None = None,
        wanted: ArrayInput = (np.nan, np.nan),
    ):
        self.path, self.certificate, self.vehicle, self.of_shape = path, certificate, vehicle, bool(of_shape)
        self.duration, self.usage, self.speeds = as_float(duration), as_float(usage), as_float(speeds)
        self.gap, self.share = as_float(gap), as_float(share)
        self.braking_time, self.braking_distance = as_float(braking_time), as_float(braking_distance)
        self.combined, self.wanted = combined, as_float(wanted)
        self.bounds = None if bounds is None else as_float(bounds)
        self.code, self.iterations = (as_code(x, self.duration) for x in (code, iterations))

    @property
    def timing(self) -> Timing:
        """The relation between the parameter of the original path and time."""
        return self.path.timing

    @property
    def timing_names(self) -> tuple[str, ...]:
        """The names of the limits that depend on the timing; those on the shape and on obstacles follow them."""
        names = self.certificate.names
        return tuple(name for name in names if not (names_obstacle(name) or quantity(name).of_shape))

    def intervals(self, name: str, part: float = 0.99) -> list[tuple[float, float]]:
        """Return the time intervals (start, end) [s] in which a quantity reaches at least `part` times its limit.

        An interval consists of whole cells of the timing.

        **Raises:** ValueError for the result of a batch, and for a limit that was not given or that no timing changes.
        """
        if self.code.ndim:
            raise ValueError("intervals are available for the result of one path, but this is the result of a batch")
        if name not in self.certificate.names:
            raise ValueError(f"no limit on {name!r} was given; the limits are {', '.join(self.certificate.names)}")
        if name not in self.timing_names:
            raise ValueError(f"the limit on {name!r} does not depend on the timing, so it has no time intervals")
        near = np.asarray(self.usage)[self.certificate.names.index(name)] >= part
        edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
        times = np.asarray(self.timing.times)
        return [(float(times[a]), float(times[b])) for a, b in edges.reshape(-1, 2)]

    def plot(self, title: str = "") -> Figure:
        """Plot the speed along the path and the limits that bound it (needs the extra `viz`).

        **Raises:** ModuleNotFoundError if matplotlib is not installed. ValueError for the result of a batch.
        """
        return draw("retimed_plot", self, title)

    @property
    def converged(self) -> Any:
        """Whether the search found the fastest timing with these knots, and this timing satisfies every limit.

        While the vehicle brakes from a `start_speed` above the limits, it need not satisfy them. Inside a trace, the
        result is an array.
        """
        return where_code(self.code, lambda code: code < ResultCode.max_steps_reached)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result for one path, with advice."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        time = float(np.asarray(self.duration)[at])
        if code == ResultCode.successful:
            gap, share = float(np.asarray(self.gap)[at]), float(np.asarray(self.share)[at])
            if not np.isnan(share):
                return (
                    f"converged: the timing takes {time:.6g} s as prescribed, with at most {100 * share:.3g} % of the "
                    "limits on accelerations, and every limit is proved to be satisfied on the whole path."
                )
            return f"converged: {fastest_text(time, gap)}, and every limit is proved to be satisfied on the whole path."
        if code == ResultCode.end_speed_not_reached:
            wanted, speeds = (np.asarray(x)[at] for x in (self.wanted, self.speeds))
            prescribed = not np.isnan(np.asarray(self.share)[at])
            return missed_speeds(wanted, speeds, self.certificate.names, time if prescribed else None) or code.text
        if code == ResultCode.starts_above_limits:
            when, where = (float(np.asarray(x)[at]) for x in (self.braking_time, self.braking_distance))
            proved = "satisfied at all samples" if source(self.path.path) is None else "proved to be satisfied"
            before = "; ".join(x.statement for x in self.certificate.findings(at) if not x.met)
            limits = "limits on the longitudinal acceleration and the jerk allow"
            if "jerk" not in self.certificate.names:
                limits = "limit on the longitudinal acceleration allows"
            return (
                f"converged: the fastest timing takes {time:.6g} s. start_speed is higher than the limits allow, so "
                f"the vehicle first brakes as strongly as the {limits}. From t = {when:.4g} s ({where:.4g} m) on, "
                f"every limit is {proved}. Before: {before}."
            )
        if code in FAILED_SEARCH and (steep := self._too_steep(at)):
            return steep
        gap = float(np.asarray(self.gap)[at])
        if code == ResultCode.not_converged and np.isfinite(gap) and np.isfinite(time):
            return (
                f"the search stopped before it reached the tolerance: the minimum duration may be up to "
                f"{100 * gap:.2g} % shorter than {time:.6g} s. Try a larger tolerance, or more knots if they were given"
                f"{'' if self.of_shape else ', or a path whose parameter is more even, as of a Shape'}. The limits on "
                f"this timing: {self.certificate.explain(at)}"
            )
        if code == ResultCode.not_converged:
            return (
                "the search stopped before it converged. The returned timing may be slower than necessary. Try another "
                f"tolerance, or other limits. The limits on this timing: {self.certificate.explain(at)}"
            )
        if code == ResultCode.not_finite and np.isfinite(np.asarray(self.timing.coefficients)[at]).all():
            return (
                "the search failed: the squared speed is not positive between two knots, so the duration is NaN. Try "
                "another tolerance, or add a limit on the acceleration, which keeps the timing smooth near a stop."
            )
        sides = [quantity(name).base for name in self.certificate.names if quantity(name).lower]
        if code == ResultCode.not_finite and sides:
            return (
                f"the search failed, probably because the lower bound on {' or '.join(sides)} contradicts another "
                "limit or the speeds at the ends: relax one of them."
            )
        if code == ResultCode.not_finite:
            return (
                "the search failed, and the timing contains NaN. Check that path, limits and speeds are finite. With a "
                "limit on friction or power, a slope or a bank may be too steep for the tyres or the engine: raise the "
                "limit, or check the path."
            )
        if code == int(np.asarray(self.certificate.code)[at]):  # the text of the certificate names the limits
            return self.certificate.explain(at)
        return code.text

    def _too_steep(self, at: tuple[int, ...]) -> str:
        """Return a text if the limit on friction is too low for a slope or a bank, otherwise an empty one."""
        if at or self.vehicle is None or "friction" not in self.certificate.names:
            return ""
        knots = np.asarray(self.timing.knots)
        u = np.concatenate([knots, 0.5 * (knots[1:] + knots[:-1])])
        needed, place = friction_at_rest(self.path.path, self.vehicle, u)
        limit = float(np.asarray(self.certificate.limits)[self.certificate.names.index("friction")])
        if not needed > limit:
            return ""
        where = ", ".join(f"{x:.4g}" for x in np.round(place, 6) + 0.0)
        if np.isinf(needed):
            return (
                f"no timing was found. A slow vehicle would fall off the road: at ({where}) m, only a high speed "
                "keeps it there. Raise the limits on speed and friction, pass a vehicle with more friction, or change "
                "the path."
            )
        return (
            f"no timing was found. The road is too steep or banked to drive it slowly: at ({where}) m, gravity alone "
            f"needs {needed:.4g} of the available friction, but the limit is {limit:.4g}. Raise the limit on friction "
            "above the former value, pass a vehicle with more friction, or change the path."
        )

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file, without loss of precision; `qtraj.load` reads it."""
        document.save(self, file)

    def record(self) -> Record:
        """Return the duration, the end speeds, the timing and the certificate as labelled quantities."""
        findings = self.certificate.record()
        variables = {
            "duration": Quantity(self.duration, "s", "minimum duration along the path"),
            "end_speeds": Quantity(self.speeds, "m s-1", "speed at the start and at the end", ("end",)),
            "cell_time": Quantity(self.timing.times, "s", "times of the timing's knots", ("knot",)),
            "cell_parameter": Quantity(
                self.timing.knots,
                "m" if self.of_shape else "s",
                "parameters of the knots on the original path",
                ("knot",),
            ),
            "usage": Quantity(self.usage, "1", "largest ratio of a quantity to its limit in a cell", ("limit", "cell")),
            "code": Quantity(self.code, "1", "result code of the search"),
            "iterations": Quantity(self.iterations, "1", "number of steps of all searches"),
            "share": Quantity(self.share, "1", "factor on the limits on accelerations for a prescribed duration"),
            "braking_time": Quantity(self.braking_time, "s", "time from which on every limit is satisfied"),
            "braking_distance": Quantity(self.braking_distance, "m", "distance from which on every limit is satisfied"),
            "gap": Quantity(self.gap, "1", "estimated relative distance of the duration from the minimum"),
            **vehicle_quantities(self.vehicle),
            **findings.variables,
        }
        summary = f"{batch_prefix(self.code.shape, 'paths')}{extent(self.duration, 's')}; {self.certificate.summary}"
        labels = {"end": ["start", "end"]}
        return Record(summary, variables, findings.coordinates, findings.attributes, labels)


def require_one(timed: Retimed) -> None:
    """Raise a ValueError if the argument `timed` is not the result for one path with concrete values."""
    require_type(timed, Retimed, "timed", "a Retimed, the result of qtraj.retime")
    require_concrete(timed)
    if timed.code.ndim:
        raise ValueError(f"the result for one path was expected, but a batch of shape {timed.code.shape} was given")
