"""Create the report on paths: trihedra, limited quantities, rates, attitude."""

from collections.abc import Sequence

import numpy as np
import xarray

from qtraj.design.tuning.outcome import Tuned
from qtraj.io.dataset import bounded_values, limited_variables, limits_along, limits_of
from qtraj.path.frame_axes import AXES, NATURAL, THRUST_ALIGNED, UPRIGHT, FrameAxes
from qtraj.path.quantity import TITLES as QUANTITY_TITLES
from qtraj.viz.map_colours import map_colours
from qtraj.viz.report.along import match
from qtraj.viz.report.angles import heading_pitch_roll
from qtraj.viz.report.frames import cosines
from qtraj.viz.report.model import Arrow, Body, Panel, Report, Series, sentence, unit, words
from qtraj.viz.report.path_tables import path_tables
from qtraj.viz.report.ranges import without_near_one
from qtraj.viz.report.turns import turn_table
from qtraj.viz.style import AXIS_COLOURS, COLOURS, COMPONENTS, SPARE, STYLES, SUBSCRIPTS, body_axes, title

ALWAYS = ("speed", "curvature", "lateral_acceleration")
"""Variables that have a panel in every report on paths, if the dataset contains them."""
OF_FRAME = {NATURAL: "angular_rate", UPRIGHT: "yaw_rate"}
"""Variables with a panel for one frame only, because they describe its motion."""
MAX_PATHS = 8
"""Maximum number of paths that are drawn, because more paths could not be distinguished."""
ONLY, ALONE = "path", "#0072B2"
"""Name and colour of a single path."""
DASHES = {"w": "dash", "x": "solid", "y": "dashdot", "z": "dot"}
AXIS_DASHES, LIMIT_COLOUR = ("solid", "dash", "dashdot"), "#1A1A1A"
"""Line styles of the body axes x, y, z."""
SYMBOL_OF = {"rate": "ω", "angular_acceleration": "ε"}
CHANGED = {"before", "after"}
"""The names of a path before and after a tuning or retiming."""
ANGLES = ("heading", "pitch", "roll")
TITLES = {
    "rate": "rate of the frame, body axes",
    "angular_acceleration": "angular acceleration of the frame, body axes",
    "quaternion": "quaternion, body to world",
}


def is_of_paths(dataset: xarray.Dataset) -> bool:
    """Return whether a dataset contains positions over time, like the results of `path_dataset` and `evaluate`."""
    if not {"position", "time"} <= set(map(str, dataset.variables)):
        return False
    sizes = [
        size for dim, size in zip(dataset["position"].dims, dataset["position"].shape, strict=True) if dim != "path"
    ]
    return len(sizes) == 2 and sizes[1] == 3 and dataset["time"].shape[-1:] == (sizes[0],)


def path_report(dataset: xarray.Dataset, tuned: Tuned | None = None) -> Report:
    """Create the report on the paths of a dataset, with the last path selected; `tuned` adds its certificate.

    **Raises:** ValueError if the attitude is missing.
    """
    if not {"dcm", "quaternion"} & set(dataset.data_vars):
        raise ValueError(
            "a report needs the attitude along the path, but the dataset contains neither quaternion nor dcm"
        )
    paths, frame = separate(dataset), body_axes(dataset)
    drawn = dict(list(paths.items())[:MAX_PATHS])
    notes = [sentence(str(dataset.attrs["tuning_warning"]))] if "tuning_warning" in dataset.attrs else []
    notes += [f"{len(drawn)} of {len(paths)} paths are shown."] if len(drawn) < len(paths) else []
    bodies = [_body(name, k, path) for k, (name, path) in enumerate(drawn.items())]
    turns = turn_table(drawn)
    recorded = dataset["recorded_position"].values if "recorded_position" in dataset else None
    return Report(
        title=title(dataset) or "Path",
        kind="path",
        facts=_facts(dataset),
        arrows=[Arrow(*about) for about in zip(frame.symbols, frame.names, AXIS_COLOURS, strict=True)],
        bodies=bodies,
        panels=_panels(bodies, list(drawn.values()), frame),
        tables=[*path_tables(dataset, drawn, tuned), *([turns] if turns.rows else [])],
        recorded=recorded,
        colours=map_colours(paths[bodies[0].name]) if len(bodies) == 1 and "curvature" in dataset else None,
        notes=notes,
        warnings=[sentence(words(str(dataset.attrs["fit_warning"])))] if "fit_warning" in dataset.attrs else [],
    )


def separate(dataset: xarray.Dataset) -> dict[str, xarray.Dataset]:
    """Return the dataset of each path, by the name of the path."""
    if "path" not in dataset.dims:
        return {ONLY: dataset}
    labels = dataset["path"].values if "path" in dataset.coords else np.arange(dataset.sizes["path"]) + 1
    return {str(label): dataset.isel(path=k) for k, label in enumerate(labels)}


def _facts(dataset: xarray.Dataset) -> list[str]:
    notes = dataset.attrs
    results = ("retiming_result", "tuning_result", "route_result")
    facts = [sentence(words(str(notes[name]))) for name in results if name in notes]
    if "tuning_objective" in notes:
        facts.append(f"Objective '{notes['tuning_objective']}', motion '{notes.get('tuning_motion', '')}'.")
    return facts


def _body(name: str, k: int, path: xarray.Dataset) -> Body:
    axes = path["dcm"].values if "dcm" in path else cosines(path["quaternion"].values)
    if "defined" in path:
        axes = np.where(path["defined"].values.astype(bool)[:, None, None], axes, np.nan)
    dash = "solid" if STYLES.get(name, "solid") == "solid" else "dash"
    colour = ALONE if name == ONLY else COLOURS.get(name, SPARE[k % len(SPARE)])
    return Body(name, path["time"].values, path["position"].values, axes, colour, dash)


def _panels(bodies: list[Body], paths: list[xarray.Dataset], frame: FrameAxes) -> list[Panel]:
    """Create the panels: limited and other quantities show every path, components only the selected path."""
    first = paths[0]
    limited = limited_variables(first)
    own = [name for kind, name in OF_FRAME.items() if frame == AXES[kind]]
    others = [name for name in (*ALWAYS, *own) if name in first and name not in limited]
    panels = [_magnitude(name, bodies, paths) for name in (*limited, *others)] + _lateral(bodies)
    for name, symbol in SYMBOL_OF.items():
        if name in first:
            labels = [f"{symbol} {letter}" for letter in frame.symbols]
            panels.append(_components(name, list(zip(labels, AXIS_COLOURS, AXIS_DASHES, strict=True)), paths))
    if "quaternion" in first:
        lines = [(f"λ{SUBSCRIPTS[label]}", colour, DASHES[label]) for label, colour in COMPONENTS.items()]
        panels.append(_components("quaternion", lines, paths))
    if frame in (AXES[UPRIGHT], AXES[THRUST_ALIGNED]):
        panels += _angles(bodies)
    return panels


def _angles(bodies: list[Body]) -> list[Panel]:
    """Create the panels of heading, pitch and roll of the selected path, for an upright or thrust-aligned frame."""
    angles_of_bodies = [heading_pitch_roll(body.axes) for body in bodies]

    def lines(columns: Sequence[int]) -> list[Series]:
        return [
            Series(ANGLES[c], k, angles[:, c], AXIS_COLOURS[c], AXIS_DASHES[c], follows=True)
            for k, angles in enumerate(angles_of_bodies)
            for c in columns
        ]

    return [
        Panel("heading, from x towards y", "°", lines([0])),
        Panel("pitch (nose up), roll (left side up)", "°", lines([1, 2])),
    ]


def _magnitude(name: str, bodies: list[Body], paths: list[xarray.Dataset]) -> Panel:
    notes = paths[0][name].attrs
    series = [
        Series(body.name, k, bounded_values(name, path[name].values), body.colour, body.dash)
        for k, (body, path) in enumerate(zip(bodies, paths, strict=True))
    ]
    limits = [(limit, f"limit {limit:.4g}") for limit in limits_of(paths[0][name])]
    for own in limits_along(paths[0], name):
        lines = (np.where(np.isfinite(path[own].values), path[own].values, np.nan) for path in paths)
        series += [Series("limit", k, values, LIMIT_COLOUR, "dot", reference=True) for k, values in enumerate(lines)]
    return Panel(QUANTITY_TITLES.get(name, name.replace("_", " ")), unit(notes.get("units", "")), series, limits)


def _lateral(bodies: list[Body]) -> list[Panel]:
    """Create the panel of the lateral distance of the path "after" from the path "before", along the way."""
    at = {body.name: (k, body.position) for k, body in enumerate(bodies)}
    if CHANGED - at.keys():
        return []
    (_, before), (k, after) = at["before"], at["after"]
    if before is None or after is None:
        return []
    line = Series("after, left of before", k, match(after, before).lateral, COLOURS["after"])
    return [Panel("lateral distance of after from before, left positive", "m", [line], along=True)]


def _components(name: str, lines: list[tuple[str, str, str]], paths: list[xarray.Dataset]) -> Panel:
    """Create a panel with the components of one variable, for the selected path."""
    series, shown = [], [_where_defined(path, path[name].values) for path in paths]
    for k, values in enumerate(shown):
        for column, (symbol, colour, dash) in enumerate(lines):
            series.append(Series(symbol, k, values[:, column], colour, dash, follows=True))
    span, note = None, ""
    if name == "quaternion":
        span, note = without_near_one(np.concatenate(shown), [line[0] for line in lines])
    return Panel(TITLES[name], unit(paths[0][name].attrs.get("units", "")), series, shown=span, note=note)


def _where_defined(path: xarray.Dataset, values: np.ndarray) -> np.ndarray:
    if "defined" not in path:
        return values.astype(float)
    return np.where(path["defined"].values.astype(bool)[:, None], values, np.nan)
