"""Certificates of routes, with findings for the whole route and for each segment, and the intervals of violation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.certificate import Certificate, Finding
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import extent
from qtraj.foundation.types import ArrayInput


@storable
class RouteCertificate(AbstractOutcome):
    """The findings on the limits of a route, as `certify(route, limits)` returns them.

    - `whole`: the `Certificate` of the route, with the worst finding of all segments for each limit.
    - `segments`: a batch of certificates, one for each segment; their times are measured from the start of the route.
    - `starts` (segments,) [s]: the start times of the segments.
    - `broken` (k, 2) [s]: the intervals of violation; `broken_limits` (k,) are the indices of the violated limits. Both
      are None for a certificate from inside `jit` or `vmap`, where their number is unknown.
    """

    whole: Certificate
    segments: Certificate
    starts: Float[Array, " segments"]
    broken: Float[Array, "k 2"] | None
    broken_limits: Int[Array, " k"] | None

    def __init__(
        self,
        whole: Certificate,
        segments: Certificate,
        starts: ArrayInput,
        broken: ArrayInput | None = (),
        broken_limits: ArrayInput | None = (),
    ):
        self.whole, self.segments, self.starts = whole, segments, as_float(starts)
        self.broken = self.broken_limits = None
        if broken is not None:
            self.broken = as_float(np.reshape(np.asarray(broken, float), (-1, 2)))
            self.broken_limits = as_array(np.reshape(np.asarray(broken_limits, int), -1), int)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the limits."""
        return self.whole.names

    @property
    def status(self) -> dict[str, Any]:
        """The status of each limit on the whole route, by name."""
        return self.whole.status

    @property
    def worst(self) -> dict[str, tuple[Any, Any, Any]]:
        """The tuple (time [s], value, limit) for the worst value of each quantity, by name."""
        return self.whole.worst

    @property
    def holds(self) -> bool:
        """Whether every limit is proved to be satisfied on every segment."""
        return self.whole.holds

    @property
    def met(self) -> bool:
        """Whether every limit is satisfied, by proof or by refined sampling."""
        return self.whole.met

    @property
    def unmet(self) -> list[str]:
        """Names of the limits that are not known to be satisfied."""
        return self.whole.unmet

    @property
    def active(self) -> list[str]:
        """Names of the active limits, which are satisfied with a relative margin of at most 1e-6."""
        return self.whole.active

    def margin(self, name: str) -> Any:
        """Return the distance of the worst value from the limit; negative if the limit is violated."""
        return self.whole.margin(name)

    def margins(self, name: str) -> Float[np.ndarray, " segments"]:
        """Return the margin of each segment; NaN if the quantity is undefined in the segment."""
        return np.asarray(self.segments.margin(name))

    def intervals(self, name: str) -> list[tuple[float, float]]:
        """Return the intervals (start, end) [s] in which a limit is violated, in order.

        An interval starts and ends where the quantity crosses the limit, or at an end of a segment. In each segment
        that violates the limit, the crossings are located by repeated subdivision between 65 equally spaced instants
        and the instant of the worst value.

        **Raises:** ValueError for a certificate from inside `jit` or `vmap`.
        """
        if self.broken is None:
            raise ValueError(
                "the intervals of violation are not computed inside jit and vmap: call certify(path, limits) outside"
            )
        k = self.names.index(name)
        intervals = np.asarray(self.broken)[np.asarray(self.broken_limits) == k]
        return [(float(a), float(b)) for a, b in intervals]

    def describe(self, name: str) -> str:
        """Describe the worst value of one quantity on the route, and its limit."""
        return self.whole.describe(name)

    def findings(self, at: tuple[int, ...] = ()) -> Sequence[Finding]:
        """Return the finding on each limit, for the whole route or, if `at` is (i,), for segment i."""
        return self.segments.findings(at) if at else self.whole.findings()

    @property
    def code(self) -> Int[Array, ""]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """The `ResultCode` of the whole route, from its worst finding."""
        return self.whole.code

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result."""
        return self.whole.explain(at)

    def record(self) -> Record:
        """Return the findings for the route and for each segment (prefix `segment_`), and the intervals (`broken_`)."""
        whole, parts = self.whole.record(), self.segments.record()
        variables = dict(whole.variables)
        for name in ("status", "worst_value", "worst_time"):
            variables[f"segment_{name}"] = parts.variables[name]._replace(axes=("segment", "limit"))
        variables["segment_start"] = Quantity(self.starts, "s", "time at which a segment starts", ("segment",))
        if self.broken is not None and len(self.broken):
            names = np.array(self.names, dtype=str)[np.asarray(self.broken_limits)]
            variables["broken_limit"] = Quantity(names, "", "the limit that is violated in the interval", ("interval",))
            for k, name in enumerate(("start", "end")):
                variables[f"broken_{name}"] = Quantity(self.broken[:, k], "s", f"{name} of the interval", ("interval",))
        count = 0 if self.broken is None else len(self.broken)
        where = f"; {extent(count)} intervals with a violated limit" if count else ""
        summary = f"{len(self.starts)} segments: {self.whole.summary}{where}"
        return Record(summary, variables, whole.coordinates, whole.attributes)

    def __str__(self) -> str:
        lines = [str(self.whole)]
        for name in self.names if self.broken is not None else ():
            spans = self.intervals(name)
            if spans:
                listed = ", ".join(f"{a:.4g} to {b:.4g} s" for a, b in spans[:5])
                more = f" and {len(spans) - 5} more" if len(spans) > 5 else ""
                lines.append(f"the limit on {name} is violated from {listed}{more}")
        return "\n".join(lines)
