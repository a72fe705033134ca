"""Implement `qtraj atlas`, which tunes a path over two keys of its scenario and finds what is feasible."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtraj.cli import layout, terminal
from qtraj.cli.terminal import Outcome
from qtraj.foundation.naming import naming
from qtraj.foundation.progress_bar import Watch
from qtraj.scenario import KINDS

if TYPE_CHECKING:
    from qtraj.sweeps.atlas.outcome import Atlas


@terminal.command(
    "qtraj atlas  (the built-in scenario)",
    "qtraj atlas corner.toml --out results",
)
def atlas(
    watch: Watch,
    scenario: Path | None = terminal.scenario_argument("atlas"),
    track: dict[str, Any] | None = None,
) -> Outcome:
    """Find which values of two keys of a scenario are feasible, with the border to a tolerance.

    The scenario is a scenario of `qtraj tune` with a table `atlas`, which names two keys and their ranges. The command
    tunes the path at the corners of coarse cells, and divides the cells along the border of the feasible region. It
    writes the points and the border (atlas.nc), the whole result (atlas.json) and a figure (atlas.png, atlas.svg). The
    exit code is 1 if no point is feasible, or if the border could not be followed to the tolerance.
    """
    watch.say("reading")
    # Imported here, so that --help does not wait for pydantic and xarray.
    from qtraj.foundation.record import to_dataset
    from qtraj.scenario.reader import read_scenario

    loaded = read_scenario(scenario, "atlas", track or {})
    watch.say("constructing the path")
    task = KINDS["atlas"].build(loaded)
    watch.say("tuning")
    with naming(f"{loaded.file}: "):
        found = task.computed(watch.tuning)
    watch.say("drawing")
    from qtraj.viz.atlas_figure import atlas_figure  # imported after the computation, because matplotlib is slow
    from qtraj.viz.result_files import documents, figure, netcdf

    about = loaded.provenance() | {"result": found.result}
    writers = {
        **netcdf("atlas.nc", to_dataset(found.record(), {"type": "Atlas", **about})),
        **documents({"atlas.json": found}),
        **figure("atlas", atlas_figure(found, title=loaded.scenario.name or "")),
    }
    failed = not bool(found.successful) or not {"feasible", "sampled"} & found.shares.keys()
    content = _content(found) | {"purpose": loaded.scenario.purpose}
    return Outcome(content, _text(found, content), loaded, failed, writers)


def _content(found: "Atlas") -> dict[str, Any]:
    """Return the atlas as JSON types."""
    return {
        "axes": {
            name: {"key": axis.name, "range": [axis.low, axis.high], "tolerance": axis.tolerance, "unit": axis.unit}
            for name, axis in (("x", found.x_axis), ("y", found.y_axis))
        },
        "shares": found.shares,
        "limits": _limit_counts(found),
        "border": [line.tolist() for line in found.border],
        "evaluations": found.evaluations,
        "result": found.result,
    }


def _limit_counts(found: "Atlas") -> dict[str, int]:
    """Return the number of infeasible points at which each limit, or each combination of limits, is met first."""
    limits = found.first_limit[found.status == "infeasible"].tolist()
    return {name: limits.count(name) for name in sorted(set(limits))}


def _text(found: "Atlas", content: dict[str, Any]) -> list[layout.Part]:
    """Return the axes, the limits and the result as text."""
    axes = [(axis.label, f"{axis.low:.6g} … {axis.high:.6g}") for axis in (found.x_axis, found.y_axis)]
    limits = [(name.replace("_", " "), str(count)) for name, count in content["limits"].items()]
    return [
        layout.facts("Axes", axes),
        *([layout.facts("Infeasible points, by the limits that are met first", limits)] if limits else []),
        *(f"{name}: {text}" for name, text in content["purpose"].items()),
        layout.heading("Result"),
        found.result,
    ]
