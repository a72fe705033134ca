"""Build the function and the parameters of a sweep from a scenario with a table [sweep]."""

import copy
import dataclasses
import functools
import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from qtraj.foundation.naming import naming
from qtraj.io.input_file import InputFile, read_input
from qtraj.path.quantity import QUANTITIES
from qtraj.scenario import KINDS, sweep_batch, sweep_runs
from qtraj.scenario.path import PathTask
from qtraj.scenario.reader import ScenarioFile, nearest_kind, scenario_in
from qtraj.scenario.sweep_part import SweepPart
from qtraj.sweeps import results

KIND_OF = {
    "tune": "path",
    "certify": "path",
    "evaluate": "path",
    "retime": "path",
    "route": "route",
    "simulate": "loop",
}
"""The kind of scenario that each run reads."""

DEFAULTS = {"path": "tune", "route": "route", "loop": "simulate"}
"""The run of each kind of scenario, unless the scenario has another one."""

SHARDS = {"evaluate": 4096, "certify": 4096, "tune": 512, "retime": 64, "route": 16, "simulate": 1024}
"""Number of points of a shard."""

FEW = 8
"""Fewer points are read one by one."""

AXES = ("x", "y", "z")
UNITS = {"start.speed": "m s-1", "end.speed": "m s-1", **{f"limits.{n}": q.unit for n, q in QUANTITIES.items()}}
"""Units of parameters."""


class SweepTask(NamedTuple):
    """The function and the parameters of a sweep, and the other arguments of `qtraj.sweep`."""

    loaded: ScenarioFile[Any]
    function: "ScenarioFunction"
    parameters: dict[str, Any]
    options: dict[str, Any]


@dataclass(frozen=True)
class ScenarioFunction:
    """A function of a batch of points that runs a scenario with the values of its parameters.

    `data`: the keys of the scenario. `contents`: digests of all files that it names. `file`: its own file, which is not
    part of the identity of a sweep, so that a folder may move.
    """

    data: Mapping[str, Any]
    kind: str
    run: str
    options: Mapping[str, Any]
    contents: Mapping[str, str]
    file: Path = field(compare=False)
    batch: ClassVar[bool] = True

    @property
    def shard(self) -> int:
        """The number of points of a shard."""
        return SHARDS[self.run]

    @property
    def units(self) -> dict[str, str]:
        """The units of parameters and outputs."""
        return {**UNITS, **results.UNITS, **{name: q.unit for name, q in QUANTITIES.items()}}

    def __call__(self, points: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Return the outputs of all points; points that are no valid scenario fail.

        **Raises:** NoValidPointError with the message of the first point, if no point is valid.
        """
        whole = self._together(points)
        if whole is None:
            return self._one_by_one(points)
        try:
            outputs = sweep_runs.together(self.run, whole, **self.options)
        except ValueError:  # the messages are those of single points
            return self._one_by_one(points)
        if whole.rows.all():
            return outputs
        try:
            others = self._one_by_one({name: values[~whole.rows] for name, values in points.items()})
        except results.NoValidPointError:
            return results.spread(outputs, np.flatnonzero(whole.rows).tolist(), len(whole.rows))
        return results.merged(outputs, others, whole.rows)

    def _one_by_one(self, points: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Return the outputs of all points, of which each is read as a scenario."""
        rows = [*zip(*(values.tolist() for values in points.values()), strict=True)]
        tasks = results.valid(lambda row: self.task(dict(zip(points, row, strict=True))), dict(enumerate(rows)))
        run = functools.partial(sweep_runs.RUNS[self.run], **self.options)
        return results.computed(run, tasks, len(rows))

    def _together(self, points: Mapping[str, np.ndarray]) -> sweep_batch.Together | None:
        """Return the points that can be computed as one batch, without reading each of them; None if there are none."""
        if self.run not in sweep_runs.TOGETHER or not sweep_batch.supports(points):
            return None
        rows = sweep_batch.valid_rows(points)
        if rows.sum() < FEW:
            return None
        first = int(np.argmax(rows))
        try:
            loaded, data = self._read({name: values[first].item() for name, values in points.items()})
            return sweep_batch.together(loaded.scenario, _built(self, loaded, data), points, rows)
        except ValueError:
            return None

    def task(self, point: Mapping[str, Any]) -> Any:
        """Return the task of one point.

        **Raises:** ValueError, which names the scenario, if its values are not valid.
        """
        return _built(self, *self._read(point))

    def _read(self, point: Mapping[str, Any]) -> tuple[ScenarioFile[Any], dict[str, Any]]:
        data: Any = copy.deepcopy(dict(self.data))
        with naming(f"{self.file}: "):
            for name, value in point.items():
                _set(data, name.split("."), value)
        return scenario_in(InputFile(self.file, "", data), self.kind), data


def read_sweep(file: Path) -> SweepTask:
    """Read a scenario with a table [sweep].

    **Raises:** OSError if a file cannot be read; ValueError, which names the file, if it is not such a scenario, or if
    the values of its first point are not valid.
    """
    given = read_input(file)
    table = given.data.get("sweep")
    if given.is_saved or given.is_recording or not isinstance(table, dict):
        raise ValueError(
            f"{file}: a scenario with a table [sweep] was expected, such as limits.curvature = {{from = 0.05, to = "
            "0.2, steps = 16} in [sweep]"
        )
    own = {name: value for name, value in given.data.items() if name != "sweep"}
    kind = KIND_OF.get(str(table.get("run"))) or nearest_kind(own, DEFAULTS)
    loaded = scenario_in(given, kind)
    part: SweepPart = loaded.scenario.sweep
    run = part.run or DEFAULTS[kind]
    options = {"outputs": tuple(part.outputs), "reduce": part.reduce} if run == "evaluate" else {}
    plain = {name: value for name, value in own.items() if name not in ("name", "description", "purpose")}
    function = ScenarioFunction(plain, kind, run, options, dict(_contents(plain, file.parent)), file.absolute())
    with naming(f"{file}: "):
        parameters = part.parameters(loaded.beside)
    arguments = {
        "samples": part.samples,
        "design": part.design,
        "seed": part.seed,
        "shard": part.shard,
        "keep": part.keep,
        "histograms": part.histograms,
    }
    return SweepTask(loaded, function, parameters, arguments)


def _set(data: dict[str, Any], path: list[str], value: Any) -> None:
    """Set a key of a scenario to the value of a parameter.

    **Raises:** ValueError if the key cannot have a value of its own.
    """
    *tables, last = path
    table: Any = data
    for name in tables:
        inner = table.setdefault(name, {}) if isinstance(table, dict) else None
        if not isinstance(inner, dict | list):
            raise ValueError(f"the parameter '{'.'.join(path)}' is no key, because '{name}' is no table")
        table = inner
    if isinstance(table, list):
        if last not in AXES or len(table) != len(AXES):
            raise ValueError(f"the parameter '{'.'.join(path)}' must end with x, y or z, a component of a vector")
        table[AXES.index(last)] = value
    elif last == "speed" and tables in (["start"], ["end"]):
        _set_speed(table, path, value)
    else:
        table[last] = value


def _set_speed(state: dict[str, Any], path: list[str], speed: float) -> None:
    velocity = state.get("velocity")
    length = np.linalg.norm(np.asarray(velocity, float)) if isinstance(velocity, list) else 0.0
    if not length > 0:
        raise ValueError(f"the parameter '{'.'.join(path)}' scales a velocity, which is missing or zero")
    state["velocity"] = (np.asarray(velocity, float) * (speed / length)).tolist()


_LAID: dict[str, PathTask] = {}
"""Paths by the keys of their scenario without limits: a recording is fitted once for all limits."""

MOST_LAID = 64


def _built(function: ScenarioFunction, loaded: ScenarioFile[Any], data: Mapping[str, Any]) -> Any:
    build = KINDS[function.kind].build
    if function.kind != "path" or "track" not in data:
        return build(loaded)
    rest = {name: value for name, value in data.items() if name not in ("limits", "retime")}
    known = repr((function.file, function.contents, rest))
    if known not in _LAID:
        if len(_LAID) >= MOST_LAID:
            _LAID.clear()
        _LAID[known] = build(loaded)
        return _LAID[known]
    task = _LAID[known]
    along = None if task.fitted is None else task.fitted.path
    return dataclasses.replace(task, limits=loaded.scenario.all_limits(loaded.beside, task.recording, along))


def _contents(value: Any, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield the names of files in the keys of a scenario, and the digests of their contents."""
    if isinstance(value, Mapping | list):
        for inner in value.values() if isinstance(value, Mapping) else value:
            yield from _contents(inner, folder)
    elif isinstance(value, str) and len(value) < 256 and "\n" not in value and (folder / value).is_file():
        yield value, hashlib.sha256((folder / value).read_bytes()).hexdigest()
