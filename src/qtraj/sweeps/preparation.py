"""Prepare a sweep: read its arguments, open its store, and learn the outputs of its function from a few points."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from qtraj.foundation.argument import described, require_whole
from qtraj.sweeps.identity import Identity, fingerprint, identity
from qtraj.sweeps.metadata import attributes_of, write_metadata
from qtraj.sweeps.names import require_distinct, require_name
from qtraj.sweeps.outputs import FATAL, Schema, WrongOutputError, schema_of
from qtraj.sweeps.parameters import description, require_known, rows_of
from qtraj.sweeps.results import NoValidPointError
from qtraj.sweeps.rows import Rows
from qtraj.sweeps.shards import Plan
from qtraj.sweeps.store import Store
from qtraj.sweeps.summaries import Histogram

BATCH, SINGLE = 16384, 1024
"""Default numbers of points of a shard, for batches and for single points."""

SMALLEST = 16
"""Default smallest number of points of a batch."""

FEWEST_SHARDS = 32
"""Number of shards of a small sweep, for a balanced load."""

MOST_SHARDS = 10**6
"""Maximum number of shards."""

TRIALS = 32
"""Number of points, spread over the sweep, at which the function is tried to learn its outputs."""


class Request(NamedTuple):
    """The arguments of `sweep` that determine its store."""

    function: Callable[..., Any]
    parameters: Mapping[str, Any]
    samples: int | None = None
    design: str = "random"
    seed: int = 0
    batch: bool | None = None
    shard: int | None = None
    keep: bool = True
    histograms: Mapping[str, Sequence[float]] = {}
    units: Mapping[str, str] | None = None

    @property
    def is_batch(self) -> bool:
        """Whether the function computes many points at once."""
        return bool(getattr(self.function, "batch", False)) if self.batch is None else self.batch


@dataclass(frozen=True)
class Prepared:
    """A store with the rows of its sweep, the arrays that they need in files, and the identity without its outputs."""

    store: Store
    rows: Rows
    arrays: Mapping[str, np.ndarray]
    identity: Identity
    histograms: Mapping[str, Histogram]


def store_of(request: Request, folder: Path) -> Prepared:
    """Read the arguments of a sweep, and create its folder.

    **Raises:** ValueError for invalid arguments; OSError if the folder cannot be created.
    """
    if not callable(request.function):
        raise ValueError(f"function must be callable, but {described(request.function)} was given")
    rows, arrays = rows_of(request.parameters, request.samples, request.design, request.seed, folder / ".sweep/columns")
    size = _shard_size(request, rows.count)
    store = Store(folder, rows.count, size)
    histograms = {name: _histogram(name, bounds) for name, bounds in request.histograms.items()}
    settings = {
        "the seed": request.seed,
        "the number of samples": rows.samples,
        "the design of the samples": rows.design,
        "the number of points of a shard": size,
        "the argument 'batch'": request.is_batch,
        "the argument 'keep'": request.keep,
        "the argument 'histograms'": {name: tuple(x) for name, x in sorted(histograms.items())},
    }
    own = identity(request.function, description(rows, arrays), settings)
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: a folder for the store was expected, but this is a file")
    if folder.is_dir() and not store.own.exists() and any(folder.iterdir()):
        raise ValueError(f"{folder}: this folder contains other files: pass a new folder")
    store.own.mkdir(parents=True, exist_ok=True)
    return Prepared(store, rows, arrays, own, histograms)


def plan_of(request: Request, prepared: Prepared) -> Plan:
    """Open the store, learn the outputs if they are not known yet, and return the plan; requires the lock.

    **Raises:** ValueError if the store contains another sweep, or the function fails at all points that are tried.
    """
    store, rows = prepared.store, prepared.rows
    store.open(prepared.identity, prepared.arrays)
    known = store.schema()
    schema = _learned(request.function, request.is_batch, rows) if known is None else known
    require_known(prepared.histograms, tuple(schema), "the histogram of")
    units = {name: unit for name, unit in _units(request).items() if name in (*schema, *rows.names)}
    own = prepared.identity | {"the argument 'units'": str(dict(sorted(units.items())))}
    store.claim(own)
    mark, x64 = fingerprint(own), bool(jax.config.read("jax_enable_x64"))
    plan = Plan(store, rows, request.function, request.is_batch, schema, mark, x64, request.keep, prepared.histograms)
    if known is None:
        names = rows.names if request.keep else ()
        write_metadata(store, plan.arrays, names, attributes_of((*schema, *rows.names), units), {"sweep": mark})
        store.write_schema(schema)
    return plan


def _learned(function: Callable[..., Any], batch: bool, rows: Rows) -> Schema:
    """Return the outputs of a function from the first of some points at which it succeeds."""
    first: BaseException | None = None
    for number in dict.fromkeys(np.linspace(0, rows.count - 1, TRIALS).astype(int).tolist()):
        points = rows.at(number, number + 1)
        try:
            given: Any = points if batch else {name: values[0].item() for name, values in points.items()}
            schema = schema_of(function(dict(given)), 1 if batch else None)
        except (WrongOutputError, *FATAL):
            raise
        except Exception as error:
            first = first or error
            continue
        return _checked(schema, rows)
    if isinstance(first, NoValidPointError):
        values = ", ".join(f"{name} = {value:.9g}" for name, value in rows.point(0).items())
        raise ValueError(f"none of the points that were tried is valid; at the first, {values}: {first}") from first
    raise ValueError(
        f"the function raises an error at all of the first points; at the first, {rows.point(0)}, it is "
        f"{type(first).__name__}: {first}"
    ) from first


def _checked(schema: Schema, rows: Rows) -> Schema:
    if not schema:
        raise WrongOutputError("the function returns no output except 'failed'")
    for name in schema:
        if name in rows.names:
            raise WrongOutputError(f"the output '{name}' has the name of a parameter: return it under another name")
        require_name(name, "an output")
    require_distinct((*rows.names, *schema))
    return schema


def _shard_size(request: Request, points: int) -> int:
    if request.shard is not None:
        require_whole(request.shard, "shard", 1)
        size = min(request.shard, points)
    else:
        usual = getattr(request.function, "shard", BATCH if request.is_batch else SINGLE)
        size = min(usual, max(SMALLEST if request.is_batch else 1, -(-points // FEWEST_SHARDS)))
    if points > MOST_SHARDS * size:
        raise ValueError(
            f"{points} points in shards of {size} are {-(-points // size)} shards, but a store has at most "
            f"{MOST_SHARDS}: pass a larger shard"
        )
    return size


def _histogram(name: str, bounds: Any) -> Histogram:
    with contextlib.suppress(TypeError, ValueError):
        histogram = Histogram(*bounds)
        low, high, bins = float(histogram.low), float(histogram.high), int(histogram.bins)
        if np.isfinite((low, high)).all() and low < high and bins > 0:
            return Histogram(low, high, bins)
    raise ValueError(
        f"the histogram of '{name}' must be (low, high) or (low, high, bins), with low < high, but "
        f"{described(bounds)} was given"
    )


def _units(request: Request) -> Mapping[str, str]:
    return getattr(request.function, "units", {}) if request.units is None else request.units
