"""Read scenario files; an error is one message with the file, the key, its value, and the expected value."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from qtraj.design.along import Along
from qtraj.design.by_speed import SIDES, BySpeed
from qtraj.foundation.model_fault import explain, unknown_keys
from qtraj.io.input_file import InputFile, read_input, with_track
from qtraj.io.shape.shape_file import ShapeRead
from qtraj.io.track.limit_columns import LimitColumn
from qtraj.scenario import KINDS

S = TypeVar("S", bound=BaseModel | None)


@dataclass(frozen=True)
class ScenarioFile(Generic[S]):
    """A scenario and its file; for a saved object and a shape, the scenario is None.

    `hash`: as in `InputFile`. `warnings`: messages about renamed keys. `line`: a curve without times in the file.
    """

    file: Path
    scenario: S
    hash: str
    warnings: tuple[str, ...] = ()
    line: ShapeRead | None = None

    def beside(self, name: str) -> Path:
        """Return the path of the file with this name, relative to the folder of the scenario."""
        return self.file.parent / name

    def about(self) -> dict[str, str | None]:
        """Return file and hash of the scenario, its name and description, and the source of its recording."""
        names = {name: getattr(self.scenario, name, None) for name in ("name", "description")}
        names["source"] = getattr(getattr(self.scenario, "track", None), "source", None)
        return {"file": str(self.file), "sha256": self.hash} | {k: v and v.strip() for k, v in names.items()}

    def provenance(self) -> dict[str, str]:
        """Return the attributes of a dataset that describe its origin."""
        about = self.about()
        facts = {"title": about["name"], "recording": about["source"], "scenario_sha256": about["sha256"]}
        return {name: text for name, text in facts.items() if text} | {"scenario_file": self.file.name}


def read_scenario(
    file: Path | str | None, kind: str, track: Mapping[str, Any] = MappingProxyType({})
) -> ScenarioFile[Any]:
    """Read the scenario in a file, or the built-in scenario of its kind if `file` is None.

    `track` replaces keys of the table [track], or adds them.

    **Raises:** The errors of `read_input` and `scenario_in`.
    """
    return scenario_in(with_track(read_input(KINDS[kind].embedded if file is None else Path(file)), track), kind)


def scenario_in(
    given: InputFile,
    kind: str,
    limits: Mapping[str, Any] = MappingProxyType({}),
    recording: bool = False,
    others: Iterable[str] = KINDS,
) -> ScenarioFile[Any]:
    """Return the scenario in a file that was read; `limits` replace limits of the scenario, or are added to them.

    `kind`: the name of a kind in `qtraj.scenario.KINDS`. `recording`: whether a recording is allowed. `others`: other
    kinds; if the keys of the file fit one of these kinds better, the error message names its commands.

    **Raises:** ValueError if the file is not a valid scenario of this kind: the message names the file and either the
    key with its value and the expected value, or the command that reads such a file.
    """
    entry, file = KINDS[kind], given.file
    if given.is_saved or given.is_recording > recording:
        raise ValueError(f"{file}: {_other_content(given)}")
    data = copy.deepcopy(given.data)
    renamed = {old: new for old, new in entry.renamed.items() if _rename(data, old.split("."), new)}
    if limits and isinstance(own := data.setdefault("limits", {}), dict):
        own |= {name: _as_key(value) for name, value in limits.items()}
    try:
        scenario = entry.model.model_validate(data)
    except ValidationError as error:
        nearest = nearest_kind(data, (kind, *others))
        if nearest != kind:
            raise ValueError(f"{file}: this is a scenario for {KINDS[nearest].title}") from None
        text = explain(error, entry.model)
        for old, new in renamed.items():
            text = text.replace(new, old)  # show the names in the user's file
        raise ValueError(f"{file}: {text}") from None
    return ScenarioFile(file, scenario, given.hash, tuple(f"{file}: '{o}' is now '{n}'" for o, n in renamed.items()))


def _as_key(limit: Any) -> Any:
    """Return a limit in the form of a scenario."""
    if isinstance(limit, LimitColumn):
        return {name: x for name, x in limit._asdict().items() if x is not None}
    if isinstance(limit, Along):
        steps = zip(np.asarray(limit.distance).tolist(), np.asarray(limit.values).tolist(), strict=True)
        return [{"from": s} | _present("value", x) for s, x in steps]
    if isinstance(limit, BySpeed):
        values = np.asarray(limit.values).T.tolist()
        columns = zip(SIDES, values, strict=True) if limit.kind == "sides" else [(limit.kind, values)]
        return {"speeds": np.asarray(limit.speeds).tolist(), **dict(columns)}
    if not isinstance(limit, tuple):
        return limit
    return {name: value for name, value in zip(("min", "max"), limit, strict=True) if value is not None}


def _present(name: str, value: Any) -> dict[str, Any]:
    """Return a number or a pair under its key, without missing numbers."""
    if not isinstance(value, list):
        return {} if np.isnan(value) else {name: value}
    sides = {side: x for side, x in zip(("min", "max"), value, strict=True) if not np.isnan(x)}
    return {name: sides} if sides else {}


def _other_content(given: InputFile) -> str:
    """Return the message for a recording or a saved object that was passed instead of a scenario."""
    name = given.file.name
    if given.is_recording:
        return (
            "this is a recording, not a scenario: `qtraj route` and `qtraj retime` read recordings; for other "
            f'commands, write a .toml file with file = "{name}" under [track], and with [limits]'
        )
    return (
        f"this is a saved {given.data['type']}, not a scenario: `qtraj evaluate` and `qtraj retime` read saved "
        f"paths; to tune a path, write a scenario with path = '{name}' and [limits]; to simulate a program, write "
        f"a scenario with file = '{name}' in [program]"
    )


def _rename(data: Any, old: Sequence[str], new: str) -> bool:
    """Rename a key within its table unless the new key exists too; return whether the key was renamed."""
    *tables, last = old
    new = new.rpartition(".")[2]
    for name in tables:
        data = data.get(name) if isinstance(data, dict) else None
    if not isinstance(data, dict) or last not in data or new in data:
        return False
    data[new] = data.pop(last)
    return True


def nearest_kind(data: Mapping[str, Any], kinds: Iterable[str]) -> str:
    """Return the kind of scenario with the fewest unknown keys in `data`; the first such kind if there are several."""
    return min(kinds, key=lambda kind: _count_unknown(data, KINDS[kind].model))


def _count_unknown(data: Mapping[str, Any], model: type[BaseModel]) -> int:
    try:
        model.model_validate(data)
    except ValidationError as error:
        return unknown_keys(error)
    return 0
