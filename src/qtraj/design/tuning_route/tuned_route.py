"""Define the result of `tune_route`."""

from __future__ import annotations

import os

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from qtraj.design.proof.certificate import PROVED
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.foundation import document
from qtraj.foundation.arrays import as_array, as_float, is_traced
from qtraj.foundation.codes import where_code
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import FAILURES, AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import extent
from qtraj.foundation.types import ArrayInput, Scalar
from qtraj.path.route import Route


@storable
class TunedRoute(AbstractOutcome):
    """The result of `tune_route`.

    - `path`: the tuned `Route`, with the same number of joints as the original route; changed segments are quintics.
    - `certificate`: the findings on the limits, on the whole route and on each segment.
    - `distance` (segments, 2) [m]: the largest horizontal and vertical distance from the original route at 65 instants
      of each segment. `within` (segments,): whether both are proved to be at most the half-widths of the tube.
    - `displacement` (n, 3) [m]: the change of the joints' positions, world axes.
    - `delay` [s]: the change of the duration.
    - `kept` (segments,): whether a segment touches a stop and is not changed.
    - `objective`: the attained value, in the unit given in `tune_route`. `iterations`: the number of steps of all
      searches. `advice`: if the limits contradict each other, a change with which they do not.
    """

    path: Route
    certificate: RouteCertificate
    objective: Scalar
    distance: Float[Array, "segments 2"]
    within: Bool[Array, " segments"]
    displacement: Float[Array, "n 3"]
    delay: Scalar
    kept: Bool[Array, " segments"]
    code: Int[Array, ""]
    iterations: Int[Array, ""]
    advice: str = eqx.field(static=True)

    def __init__(
        self,
        path: Route,
        certificate: RouteCertificate,
        objective: ArrayInput,
        distance: ArrayInput,
        within: ArrayInput,
        displacement: ArrayInput,
        delay: ArrayInput = 0.0,
        kept: ArrayInput = (),
        code: ArrayInput = ResultCode.successful,
        iterations: ArrayInput = 0,
        advice: str = "",
    ):
        self.path, self.certificate, self.objective = path, certificate, as_float(objective)
        if not is_traced(distance):  # from a document, or a search outside jit and vmap
            distance, within, kept = np.reshape(np.asarray(distance, float), (-1, 2)), np.ravel(within), np.ravel(kept)
            kept = kept if kept.size else np.zeros(within.size, bool)
        self.distance, self.within = as_float(distance), as_array(within, bool)
        self.displacement, self.delay = as_float(displacement), as_float(delay)
        self.kept = as_array(kept, bool)
        self.code, self.iterations = as_array(code, np.int32), as_array(iterations, np.int32)
        self.advice = advice

    @property
    def converged(self) -> bool:
        """Whether every limit and the tube are proved on every segment that may change, at a local optimum."""
        return where_code(self.code, lambda code: (code < FAILURES) & (code != ResultCode.not_optimal))

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe what is proved and where a proof is missing, with advice; `at` is the index in a batch."""
        if at:
            return jax.tree.map(lambda x: np.asarray(x)[at], self).explain(())
        code = ResultCode(int(np.asarray(self.code)))
        away = np.asarray(self.distance).max(axis=0, initial=0.0)
        success = "every limit is proved to be satisfied on every segment."
        texts = [code.text if code != ResultCode.successful else success]
        open_ = self.unproved()
        if open_:
            texts.append(f"Not proved: {'; '.join(open_)}.")
        if self.advice:
            texts.append(self.advice)
        texts.append(
            f"The route moves by at most {away[0]:.3g} m horizontally and {away[1]:.3g} m vertically, and its duration "
            f"changes by {float(self.delay):+.3g} s."
        )
        return " ".join(texts)

    def unproved(self) -> list[str]:
        """Describe the limits that are not proved to be satisfied: the number of segments and the worst value."""
        parts, found = self.certificate.segments, []
        codes = np.asarray(parts.codes)
        for k, name in enumerate(self.certificate.names):
            count = int(np.sum(codes[:, k] != PROVED))
            if count:
                kept = int(np.sum((codes[:, k] != PROVED) & np.asarray(self.kept)))
                stops = f", {kept} of them at stops" if kept else ""
                found.append(f"{name} on {count} segments{stops} ({self.certificate.describe(name)})")
        if not np.asarray(self.within).all():
            found.append(f"the tube on {int(np.sum(~np.asarray(self.within)))} segments")
        return found

    def record(self) -> Record:
        """Return the route, the findings, distances and displacements as labelled quantities."""
        path, findings = self.path.record(), self.certificate.record()
        name = ResultCode(int(np.asarray(self.code))).name
        variables = {
            "objective": Quantity(self.objective, "", "attained value; the unit depends on the objective"),
            "outcome": Quantity(np.asarray(name, dtype=str), "", "result of the tuning"),
            "code": Quantity(self.code, "1", "result code of the tuning"),
            "iterations": Quantity(self.iterations, "1", "number of steps of all searches"),
            "delay": Quantity(self.delay, "s", "change of the duration"),
            "distance": Quantity(
                self.distance, "m", "largest distance from the original route on a segment", ("segment", "direction")
            ),
            "within": Quantity(self.within, "1", "whether a segment is proved to stay within the tube", ("segment",)),
            "kept": Quantity(self.kept, "1", "whether a segment touches a stop and is not changed", ("segment",)),
            "displacement": Quantity(
                self.displacement, "m", "change of the positions of the joints, world axes", ("joint", "world")
            ),
            **findings.variables,
            **path.variables,
        }
        directions = np.array(["horizontal", "vertical"])
        coordinates = {
            "direction": Quantity(directions, "", "direction of a distance", ("direction",)),
            **findings.coordinates,
        }
        steps = extent(self.iterations)
        summary = f"{name}, objective {extent(self.objective)}, {steps} steps; {findings.summary}"
        return Record(summary, variables, coordinates, findings.attributes)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the result to a TOML or JSON file, without loss of precision; `qtraj.load` reads it."""
        document.save(self, file)

    def __str__(self) -> str:
        return f"{self.result}\n{self.certificate}"
