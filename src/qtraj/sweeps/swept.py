"""The result of a sweep: its store, its failed points, and the summaries of its outputs."""

from __future__ import annotations  # so that `help` shows short names

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from qtraj.foundation.extras import require_package
from qtraj.sweeps.metadata import STATUS, STATUS_OUTPUT
from qtraj.sweeps.outputs import OK, STATUSES
from qtraj.sweeps.shards import Plan
from qtraj.sweeps.summaries import Summary, combined

if TYPE_CHECKING:
    import xarray

MOST_ERRORS = 3
"""Number of errors of shards in a text."""


@dataclass(frozen=True)
class ShardError:
    """A shard that could not be computed: its first point, the first point after it, and the text of the error.

    `parameters` are those of its first point.
    """

    first: int
    stop: int
    parameters: dict[str, Any]
    text: str

    def __str__(self) -> str:
        values = ", ".join(f"{name} = {value:.6g}" for name, value in self.parameters.items())
        return f"points {self.first} to {self.stop - 1} (from {values}): {self.text}"


@dataclass(frozen=True)
class Swept:
    """The result of `sweep`; the values of the points stay in the store.

    - `folder`: the store, which `xarray.open_zarr` reads.
    - `points`: the number of points; `done`: the number of points that were computed, now or earlier.
    - `errors`: for each shard that could not be computed, its points with their parameters, and the error.
    - `count_failed`: the number of points that were computed and failed.
    """

    folder: Path
    points: int
    done: int
    count_failed: int
    errors: tuple[ShardError, ...]
    plan: Plan = field(repr=False)

    def __repr__(self) -> str:
        return f"Swept({self.result.rstrip('.')} in {self.folder})"

    @property
    def successful(self) -> bool:
        """Whether all points were computed; some of them may have failed."""
        return self.done == self.points

    @property
    def result(self) -> str:
        """What was computed, as text, with advice."""
        text = f"{self.done} of {self.points} points were computed, of which {self.count_failed} failed"
        if not self.errors:
            return f"{text}."
        causes = "; ".join(map(str, self.errors[:MOST_ERRORS]))
        more = f"; and {len(self.errors) - MOST_ERRORS} more" if len(self.errors) > MOST_ERRORS else ""
        return f"{text}. {len(self.errors)} shards raised an error: {causes}{more}. Run the sweep again to retry them."

    @property
    def failed(self) -> dict[str, np.ndarray]:
        """The points that failed: their numbers as `point`, their parameters, their `status`, and the `text` of errors.

        The text is empty for points that did not raise an error, and for all but the first points of a shard that did.
        """
        rows: dict[str, list[Any]] = {name: [] for name in ("point", *self.plan.rows.names, "status", "text")}
        for k, entry in self.plan.store.entries(self.plan.fingerprint):
            if entry["failed"]:
                for name, values in self._failed_in(k, dict(entry["texts"])).items():
                    rows[name].extend(values)
        return {name: np.asarray(values) for name, values in rows.items()}

    @property
    def status_counts(self) -> dict[str, int]:
        """The number of computed points with each status that occurs."""
        counts = np.zeros(len(STATUSES), int)
        for k, _ in self.plan.store.entries(self.plan.fingerprint):
            counts += np.bincount(self.plan.store.read_chunk(STATUS, k, STATUS_OUTPUT), minlength=len(STATUSES))
        return {name: int(count) for name, count in zip(STATUSES, counts, strict=True) if count}

    def values_of(self, name: str) -> Iterator[np.ndarray]:
        """Yield the values of an output at the successful points, shard by shard.

        **Raises:** ValueError for an unknown output, and if the points were not kept.
        """
        if not self.plan.keep:
            raise ValueError("the values of points were not stored: pass keep=True to the sweep")
        if name not in self.plan.schema:
            known = ", ".join(self.plan.schema)
            raise ValueError(f"there is no output {name!r}; the outputs are {known}")
        for k, _ in self.plan.store.entries(self.plan.fingerprint):
            good = self.plan.store.read_chunk(STATUS, k, STATUS_OUTPUT) == OK
            yield self.plan.store.read_chunk(name, k, self.plan.schema[name])[good]

    @cached_property
    def summary(self) -> dict[str, Summary]:
        """The mean, the extreme values and their points, and the histogram of each output, at successful points."""
        entries = (entry for _, entry in self.plan.store.entries(self.plan.fingerprint))
        shapes = {name: output.shape for name, output in self.plan.schema.items()}
        return combined(entries, shapes, self.plan.histograms)

    def parameters(self, point: int) -> dict[str, Any]:
        """Return the parameters of one point by its number.

        **Raises:** ValueError if there is no such point.
        """
        if not 0 <= point < self.points:
            raise ValueError(f"the points have the numbers 0 to {self.points - 1}, but {point} was given")
        return self.plan.rows.point(int(point))

    @property
    def attributes(self) -> dict[str, Any]:
        """The attributes of the store, such as its provenance.

        **Raises:** ModuleNotFoundError with the extra to install, if zarr is missing.
        """
        require_package("zarr", "reading a store", "sweep")
        import zarr  # imported here, because it delays the import of qtraj

        return dict(zarr.open_group(self.folder, mode="r").attrs)

    def to_xarray(self, grid: bool = False) -> xarray.Dataset:
        """Open the store as a dataset, whose values are read when they are used (extra `sweep`).

        The dimension `point` has the parameters as coordinates. With `grid=True`, which loads all values, each
        parameter is a dimension of its own.

        **Raises:** ModuleNotFoundError with the extra to install, if xarray is missing; ValueError for `grid=True` if
        the sweep has random parameters or columns.
        """
        require_package("xarray", "a labelled dataset", "sweep")
        import xarray

        dataset = xarray.open_zarr(self.folder, chunks=None)
        return self._on_grid(dataset) if grid else dataset

    def _failed_in(self, k: int, texts: dict[int, str]) -> dict[str, Any]:
        start, stop = self.plan.store.span(k)
        status = self.plan.store.read_chunk(STATUS, k, STATUS_OUTPUT)
        at = np.flatnonzero(status != OK)
        points = {name: values[at] for name, values in self.plan.rows.at(start, stop).items()}
        meanings = [STATUSES[code] for code in status[at]]
        return {"point": start + at, **points, "status": meanings, "text": [texts.get(int(k), "") for k in start + at]}

    def _on_grid(self, dataset: xarray.Dataset) -> xarray.Dataset:
        rows = self.plan.rows
        if rows.samples != 1 or not self.plan.keep:
            raise ValueError("grid=True needs a sweep over grids only, whose points were kept: omit it")
        import xarray

        loaded = dataset.load()
        grids = {name: (name, values, loaded[name].attrs) for name, values in rows.grids.items()}
        kept = {name: x for name, x in loaded.variables.items() if name not in grids}
        shaped = {
            name: ((*rows.grids, *x.dims[1:]), x.values.reshape(*rows.shape, *x.shape[1:]), x.attrs)
            for name, x in kept.items()
        }
        attributes = {name: x for name, x in loaded.attrs.items() if name != "coordinates"}
        return xarray.Dataset(shaped, grids, attributes)
