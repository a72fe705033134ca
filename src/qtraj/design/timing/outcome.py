"""The result of a retiming."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.proof.certificate import Certificate
from qtraj.design.timing.timing import RetimedPath, Timing
from qtraj.foundation.arrays import as_array, as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode, concrete_codes
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, extent
from qtraj.foundation.types import ArrayInput


@storable
class Retimed(AbstractOutcome):
    """The result of `retime`, of one path or of many (batch axes in front of every array).

    `path`, the same curve driven by its fastest timing, a hodograph like any other; `duration` [s], which is
    differentiable in the path and the limits; `certificate`, what is known of the limits on the whole of it; `usage`
    (limits, cells), the largest part of each limit of the certificate that is used in each cell of `timing`; `speeds`
    (2,) [m/s] at the start and at the end; `code`, a `ResultCode`; `iterations`, the steps of all searches.
    """

    path: RetimedPath
    duration: Float[Array, "*batch"]
    certificate: Certificate
    usage: Float[Array, "*batch limits cells"]
    speeds: Float[Array, "*batch 2"]
    code: Int[Array, "*batch"]
    iterations: Int[Array, "*batch"]

    def __init__(
        self,
        path: RetimedPath,
        duration: ArrayInput,
        certificate: Certificate,
        usage: ArrayInput,
        speeds: ArrayInput,
        code: ArrayInput,
        iterations: ArrayInput,
    ):
        self.path, self.certificate = path, certificate
        self.duration, self.usage, self.speeds = as_float(duration), as_float(usage), as_float(speeds)
        self.code, self.iterations = as_array(code, jnp.int32), as_array(iterations, jnp.int32)

    @property
    def timing(self) -> Timing:
        """The relation of the path's own parameter and time."""
        return self.path.timing

    def intervals(self, name: str, part: float = 0.99) -> list[tuple[float, float]]:
        """The intervals of time (start, end) [s] in whose cells at least `part` of a limit is used, for one path.

        **Raises:** ValueError for a batch, or for a limit that was not given.
        """
        if self.code.ndim:
            raise ValueError("the intervals of one path were asked for, but this is the result for a batch")
        if name not in self.certificate.names:
            raise ValueError(f"no limit on {name!r} was given; the limits are {', '.join(self.certificate.names)}")
        near = np.asarray(self.usage)[self.certificate.names.index(name)] >= part
        edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]])))
        times = np.asarray(self.timing.times)
        return [(float(times[a]), float(times[b])) for a, b in edges.reshape(-1, 2)]

    @property
    def converged(self) -> Any:
        """Whether the timing is the fastest there is with these knots, and satisfies every limit."""
        good = concrete_codes(self) < ResultCode.max_steps_reached
        return good.item() if good.ndim == 0 else good

    def explain(self, at: tuple[int, ...]) -> str:
        """How the search for one path ended, and what to do."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        time = float(np.asarray(self.duration)[at])
        if code == ResultCode.successful:
            return f"converged: the fastest timing takes {time:.6g} s, and every limit is proved on the whole path."
        if code == ResultCode.end_speed_not_reached:
            start, end = np.asarray(self.speeds)[at]
            return f"{code.text} The fastest timing has {start:.4g} m/s at the start and {end:.4g} m/s at the end."
        if code == ResultCode.not_converged:
            return (
                "the search stopped before it found the fastest timing. The timing returned may be slower than "
                f"necessary. Try more knots, or other limits. The limits on this timing: {self.certificate.explain(at)}"
            )
        if code == int(np.asarray(self.certificate.code)[at]):  # names the limits
            return self.certificate.explain(at)
        return code.text

    def record(self) -> Record:
        """Duration, end speeds and the certificate."""
        findings = self.certificate.record()
        variables = {
            "duration": Quantity(self.duration, "s", "least time along the path"),
            "end_speeds": Quantity(self.speeds, "m s-1", "speed at the start and at the end", ("end",)),
            "cell_time": Quantity(self.timing.times, "s", "times of the timing's knots", ("knot",)),
            "cell_parameter": Quantity(self.timing.knots, "s", "their parameters on the given path", ("knot",)),
            "usage": Quantity(self.usage, "1", "largest used part of each limit in a cell", ("limit", "cell")),
            "code": Quantity(self.code, "1", "how the search ended, as a number"),
            "iterations": Quantity(self.iterations, "1", "steps of all searches"),
            **findings.variables,
        }
        summary = f"{batch_prefix(self.code.shape, 'paths')}{extent(self.duration, 's')}; {self.certificate.summary}"
        labels = {"end": ["start", "end"]}
        return Record(summary, variables, findings.coordinates, findings.attributes, labels)
