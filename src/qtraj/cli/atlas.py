"""Implement `qtraj atlas`, which tunes a path over two keys of its scenario and finds what is feasible."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch
from qtraj.foundation.units import with_unit
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.foundation.folder import Writer
    from qtraj.scenario.atlas import AtlasTask
    from qtraj.scenario.reader import ScenarioFile
    from qtraj.sweeps.atlas.outcome import Atlas

    Atlases = dict[float | None, Atlas]


@terminal.command(
    "qtraj atlas  (the built-in scenario)",
    "qtraj atlas corner.toml --out results --report",
)
def atlas(
    watch: Watch,
    scenario: Path | None = terminal.scenario_argument("atlas"),
    report: bool = typer.Option(False, "--report", help="Also write report.html, a page for the browser."),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Find which values of two keys of a scenario are feasible, with the border to a tolerance.

    The scenario is a scenario of `qtraj tune` with a table `atlas`, which names two keys and their ranges. The command
    tunes the path at the corners of coarse cells, and divides the cells along the border of the feasible region. It
    writes the points and the border (atlas.nc), the whole result (atlas.json) and a figure (atlas.png, atlas.svg).

    A third key, the table `atlas.z`, has a list of values. For each of them, the command computes an atlas with files
    of its own (atlas_1.nc, …), and writes report.html, in which a slider selects the value. The exit code is 1 if no
    point is feasible, or if a border could not be followed to the tolerance.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "atlas", track or {})
    watch.say("constructing the path")
    task = KINDS["atlas"].build(loaded)
    found = _computed(task, loaded, watch)
    failed = not all(bool(x.successful) for x in found.values())
    failed |= not any({"feasible", "sampled"} & x.shares.keys() for x in found.values())
    watch.say("drawing")
    writers = {name: write for k, x in enumerate(found) for name, write in _files(task, found[x], x, k, loaded).items()}
    if report or task.part.z is not None:
        writers["report.html"] = partial(_write_report, task, found, loaded.scenario.name or "")
    content = _content(task, found) | {"purpose": loaded.scenario.purpose}
    return Outcome(content, _text(task, found, content["purpose"]), loaded, failed, writers)


def _computed(task: "AtlasTask", loaded: "ScenarioFile[Any]", watch: Watch) -> "Atlases":
    """Return the atlas for each value of the third key, or for None if there is no third key."""
    values = [None] if task.part.z is None else task.part.z.values
    found: Atlases = {}
    for k, value in enumerate(values):
        watch.say("tuning" if value is None else f"tuning, atlas {k + 1} of {len(values)}")
        with naming(f"{loaded.file}: "):
            found[value] = task.computed(watch.tuning, value)
    return found


def _third(task: "AtlasTask", value: float | None) -> str:
    """Return a value of the third key as text, such as "start.speed = 5 m/s"; "" without a third key."""
    part = task.part.z
    return "" if part is None or value is None else f"{part.key} = {with_unit(value, part.unit())}"


def _files(
    task: "AtlasTask", found: "Atlas", value: float | None, number: int, loaded: "ScenarioFile[Any]"
) -> "dict[str, Writer]":
    """Return the writers of the dataset, the result and the figure of one atlas."""
    from qtraj.foundation.record import to_dataset
    from qtraj.viz.atlas_figure import atlas_figure  # imported after the computation, because matplotlib is slow
    from qtraj.viz.result_files import documents, figure, netcdf

    third, stem = _third(task, value), "atlas" if value is None else f"atlas_{number + 1}"
    about = {"type": "Atlas", **loaded.provenance(), "result": found.result, **({"third_key": third} if third else {})}
    title = ": ".join(filter(None, (loaded.scenario.name, third)))
    return {
        **netcdf(f"{stem}.nc", to_dataset(found.record(), about)),
        **documents({f"{stem}.json": found}),
        **figure(stem, atlas_figure(found, title=title)),
    }


def _write_report(task: "AtlasTask", found: "Atlases", title: str, file: Path) -> None:
    from qtraj.viz.atlas_report import atlas_page

    part = task.part.z
    name, unit = ("", "1") if part is None else (part.key, part.unit())
    page = atlas_page({x or 0.0: atlas for x, atlas in found.items()}, name, unit, title)
    file.write_text(page, encoding="utf-8", newline="\n")


def _content(task: "AtlasTask", found: "Atlases") -> dict[str, Any]:
    """Return the atlases as JSON types."""
    first = next(iter(found.values()))
    axes = {
        name: {"key": axis.name, "range": [axis.low, axis.high], "tolerance": axis.tolerance, "unit": axis.unit}
        for name, axis in (("x", first.x_axis), ("y", first.y_axis))
    }
    each = [
        {
            "shares": x.shares,
            "limits": _limit_counts(x),
            "border": [line.tolist() for line in x.border],
            "evaluations": x.evaluations,
            "result": x.result,
        }
        for x in found.values()
    ]
    part = task.part.z
    if part is None:
        return {"axes": axes, **each[0]}
    axes["z"] = {"key": part.key, "values": list(part.values), "unit": part.unit()}
    return {"axes": axes, "atlases": [{"value": value, **x} for value, x in zip(found, each, strict=True)]}


def _limit_counts(found: "Atlas") -> dict[str, int]:
    """Return the number of infeasible points at which each limit, or each combination of limits, is met first."""
    limits = found.first_limit[found.status == "infeasible"].tolist()
    return {name: limits.count(name) for name in sorted(set(limits))}


def _text(task: "AtlasTask", found: "Atlases", purpose: dict[str, str]) -> list[layout.Part]:
    """Return the axes, the limits and the results as text."""
    first = next(iter(found.values()))
    axes = [(axis.label, f"{axis.low:.6g} … {axis.high:.6g}") for axis in (first.x_axis, first.y_axis)]
    counts = [_limit_counts(x) for x in found.values()]
    names = sorted({name for x in counts for name in x})
    limits = [(name.replace("_", " "), str(sum(x.get(name, 0) for x in counts))) for name in names]
    results: list[layout.Part] = []
    for value, x in found.items():
        results += [layout.heading(_third(task, value) or "Result"), x.result]
    return [
        layout.facts("Axes", axes),
        *([layout.facts("Infeasible points, by the limits that are met first", limits)] if limits else []),
        *(f"{name}: {text}" for name, text in purpose.items()),
        *results,
    ]
