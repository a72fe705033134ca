"""A sweep as one page for the browser: statuses, extreme values with their points, histograms, failures, provenance."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from qtraj._version import __version__
from qtraj.sweeps.summaries import Summary
from qtraj.sweeps.swept import Swept

BARS, WIDTH, HEIGHT = 48, 480, 120
"""Number of bars of a histogram, and the size of its picture."""

CONSTANT = 1e-9
"""An output whose relative range is below this value has no histogram."""

MOST = 20
"""Number of failed points and of failed shards that are listed."""


def write_sweep_report(swept: Swept, file: Path, title: str = "") -> None:
    """Write the report of a sweep as an HTML file that needs no other file and no connection."""
    file.write_text(sweep_page(swept, title), encoding="utf-8")


def sweep_page(swept: Swept, title: str = "") -> str:
    """Return the report of a sweep as HTML."""
    styles = resources.files("qtraj.viz.report")
    css = "\n".join((styles / name).read_text(encoding="utf-8") for name in ("report.css", "dark.css"))
    heading = escape(title or "Sweep")
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{heading}</title>\n'
        f"<style>\n{css}\nsvg rect {{ fill: var(--accent); }}\n</style>\n<body>\n"
        f"<header><h1>{heading}</h1><p>{escape(swept.result)}</p></header>\n{''.join(_sections(swept))}</body>\n</html>\n"
    )


def _sections(swept: Swept) -> Iterator[str]:
    rows = swept.plan.rows
    grids = [(name, len(values), f"{values[0]:.6g}", f"{values[-1]:.6g}") for name, values in rows.grids.items()]
    others = [(name, "random, of a column or dependent", "", "") for name in rows.names if name not in rows.grids]
    yield _table("Parameters", ("parameter", "values", "first", "last"), [*grids, *others])
    counts = [(name.replace("_", " "), count) for name, count in swept.status_counts.items()]
    yield _table("Points by status", ("status", "points"), counts)
    scalars = {name: x for name, x in swept.summary.items() if x.mean.ndim == 0}
    yield _table(
        "Outputs at successful points",
        ("output", "mean", "smallest", "at", "largest", "at"),
        [(name, _number(x.mean), *_extremes(swept, x)) for name, x in scalars.items()],
    )
    if arrays := [name for name in swept.summary if name not in scalars]:
        yield f'<p class="small">Not shown, because their values are arrays: {escape(", ".join(arrays))}.</p>\n'
    for name, x in scalars.items():
        if (histogram := _histogram(swept, name, x)) is not None:
            yield f"<section><h2>{escape(name)}</h2>{_picture(*histogram)}</section>\n"
    if swept.count_failed:
        yield _table("Failed points", ("point", "status", "parameters", "error"), _failed(swept))
    if swept.errors:
        shards = [(f"{x.first} to {x.stop - 1}", _values(x.parameters), x.text) for x in swept.errors[:MOST]]
        yield _table("Shards that raised an error", ("points", "first parameters", "error"), shards)
    about = [(str(name).replace("_", " "), _text(x)) for name, x in swept.attributes.items()]
    yield _table("Provenance", ("", ""), [*about, ("store", swept.folder.name), ("report", f"qtraj {__version__}")])


def _extremes(swept: Swept, x: Summary) -> Iterator[str]:
    for value, point in ((x.minimum, x.minimum_point), (x.maximum, x.maximum_point)):
        yield _number(value)
        yield f"point {int(point)}: {_values(swept.parameters(int(point)))}"


def _failed(swept: Swept) -> Iterator[Sequence[Any]]:
    failed = swept.failed
    for k in range(min(len(failed["point"]), MOST)):
        own = {name: failed[name][k] for name in swept.plan.rows.names}
        yield failed["point"][k], failed["status"][k].replace("_", " "), _values(own), failed["text"][k]


def _histogram(swept: Swept, name: str, x: Summary) -> tuple[np.ndarray, float, float] | None:
    """Return the counts of values in bins of equal width, and their bounds; None for an almost constant output."""
    if x.histogram is not None and x.bounds is not None:
        inside = x.histogram[1:-1]
        counts = np.array([part.sum() for part in np.array_split(inside, min(BARS, len(inside)))])
        return counts, *x.bounds
    low, high = float(x.minimum), float(x.maximum)
    if not swept.plan.keep or not np.isfinite([low, high]).all() or not high - low > CONSTANT * abs(high):
        return None
    counts = sum(np.histogram(values, BARS, (low, high))[0] for values in swept.values_of(name))
    return np.asarray(counts), low, high


def _picture(counts: np.ndarray, low: float, high: float) -> str:
    """Return a histogram as SVG, with its bounds as text."""
    width, largest = WIDTH / len(counts), max(int(counts.max()), 1)
    bars = "".join(
        f'<rect x="{k * width:.2f}" y="{HEIGHT * (1 - n / largest):.2f}" width="{0.9 * width:.2f}" '
        f'height="{HEIGHT * n / largest:.2f}"><title>{n}</title></rect>'
        for k, n in enumerate(counts.tolist())
    )
    label = f"from {low:.6g} to {high:.6g}; the highest bar has {largest} points"
    picture = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" role="img" aria-label="{label}">{bars}</svg>'
    return f'{picture}<p class="small">{label}</p>'


def _table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(f"<tr>{''.join(f'<td>{escape(str(x))}</td>' for x in row)}</tr>\n" for row in rows)
    table = f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f"<section><h2>{escape(title)}</h2>{table}</section>\n"


def _values(parameters: dict[str, Any]) -> str:
    return ", ".join(f"{name} = {_number(x)}" for name, x in parameters.items())


def _number(x: Any) -> str:
    return f"{float(x):.6g}"


def _text(x: Any) -> str:
    return x if isinstance(x, str) else json.dumps(x)
