"""Create a report as one HTML file that contains scripts, styles, plotly and data, and works offline.

All input is escaped: in HTML by `html.escape`, in the data by JSON without `<`, `>` and `&`. In addition, a content
security policy allows only the two scripts of the page, identified by their hashes, and forbids requests to servers.
"""

import base64
import hashlib
import json
from html import escape
from importlib.resources import files
from typing import Any

from qtraj.design.tuning.outcome import Tuned
from qtraj.viz.drawable import drawable
from qtraj.viz.report.attitudes import attitude_report, is_of_attitudes
from qtraj.viz.report.model import Report, Table
from qtraj.viz.report.paths import is_of_paths, path_report
from qtraj.viz.report.payload import payload

FIRST, LAST = ("path", "sample", "time", "record"), ("body", "world")
"""Dimensions that are moved to the front and to the back, in this order."""
SCRIPTS = (
    "theme.js",
    "motion.js",
    "arrows.js",
    "scene.js",
    "letters.js",
    "scene_layout.js",
    "flat.js",
    "plan.js",
    "panels.js",
    "values.js",
    "paper.js",
    "clock.js",
)
STYLES = ("report.css", "controls.css", "dark.css", "narrow.css", "paper.css")
JUMPS = "<!-- the tables whose rows move the time -->"
"""Where these tables are inserted in the stage."""
VERDICTS = {
    "proved": "good",
    "within": "good",
    "sampled": "fair",
    "active": "good",
    "broken": "bad",
    "undecided": "fair",
    "undefined": "bad",
}
"""Colour class of each status in a table; the text of the status contains the same information."""


def report_page(dataset: Any, tuned: Tuned | None = None) -> str:
    """Create the HTML of a report on paths, a slew, or a closed loop (extras `io` and `viz`).

    `dataset` is a dataset written by a command or returned by `qtraj.io.dataset.path_dataset`, a table, a solution, a
    path, a result of `tune` or `fit`, or the `to_xarray()` of one of these. `tuned` adds its certificate to the path
    named "after".

    **Raises:** ValueError if the input contains neither positions nor a quaternion over time; ModuleNotFoundError if
    plotly is missing.
    """
    return html(report_of(dataset, tuned))


def report_of(source: Any, tuned: Tuned | None = None) -> Report:
    """Create the report on a dataset or a result, as plain data."""
    tuned, dataset = source if isinstance(source, Tuned) else tuned, drawable(source)
    if any(size == 0 for size in dataset.sizes.values()):
        raise ValueError("a report needs data, but a dimension of the dataset is empty")
    ordered = dataset.transpose(*FIRST, ..., *LAST, missing_dims="ignore")
    if is_of_paths(ordered):
        return path_report(ordered, tuned)
    if is_of_attitudes(ordered):
        return attitude_report(ordered)
    raise ValueError(
        "a report needs position or quaternion over time, but the dataset contains "
        f"{', '.join(sorted(map(str, dataset.data_vars))) or 'no variables'}"
    )


def html(report: Report) -> str:
    """Return the complete page.

    **Raises:** ModuleNotFoundError if plotly is missing.
    """
    plotly, script, style = _plotly(), _script(), "\n".join(map(_beside, STYLES))
    jumps, others = ([x for x in report.tables if (x.jumps is not None) == beside] for beside in (True, False))
    hashes = " ".join(f"'sha256-{_digest(code)}'" for code in (plotly, script))
    policy = f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:"
    head = [
        '<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<link rel="icon" href="data:,">',
        f"<title>{escape(report.title)}</title>",
        f"<style>{style}</style>",
    ]
    body = [
        f"<header><h1>{escape(report.title)}</h1>{''.join(f'<p>{escape(text)}</p>' for text in report.facts)}</header>",
        *(f'<p class="note warning">Warning: {escape(text)}</p>' for text in report.warnings),
        *(f'<p class="note">{escape(text)}</p>' for text in report.notes),
        "<noscript><p class='note'>The figures need JavaScript; the tables below do not.</p></noscript>",
        _beside("stage.html").replace(JUMPS, "".join(map(_table, jumps))),
        f'<section class="tables">{"".join(map(_table, others))}</section>',
        f'<script type="application/json" id="data">{_json(payload(report))}</script>',
        f"<script>{plotly}</script>",
        f"<script>{script}</script>",
    ]
    top = ["<!DOCTYPE html>", '<html lang="en">', "<head>", *head, "</head>"]
    return "\n".join([*top, "<body>", *body, "</body>", "</html>", ""])


def _table(table: Table) -> str:
    head = f"<thead><tr>{_cells('th', table.header, table)}</tr></thead>" if any(table.header) else ""
    rows = "".join(f"<tr>{_row(k, row, table)}</tr>" for k, row in enumerate(table.rows))
    note = f'<p class="small">{escape(table.note)}</p>' if table.note else ""
    scrolls = "wide" if table.jumps is None else "wide long"
    grid = f'<div class="{scrolls}"><table>{head}<tbody>{rows}</tbody></table></div>'
    return f"<figure><h2>{escape(table.title)}</h2>{grid}{note}</figure>"


def _row(k: int, row: list[str], table: Table) -> str:
    """Return the cells of a row; with jumps, the first one is a button with the times to which it moves the clock."""
    if table.jumps is None:
        return _cells("td", row, table)
    name = escape(f"{table.header[0]} {row[0]}".strip(), quote=True)
    button = f'<button type="button" class="jump" data-times="{_json(table.jumps[k])}" aria-label="Go to {name}">'
    return f"<td>{button}{escape(row[0])}</button></td>" + _cells("td", row[1:], table, 1)


def _cells(tag: str, texts: list[str], table: Table, first: int = 0) -> str:
    columns = enumerate(texts, first)
    return "".join(f"<{tag}{_class(k, text, table)}>{escape(text)}</{tag}>" for k, text in columns)


def _class(column: int, text: str, table: Table) -> str:
    verdict = VERDICTS.get(text)
    number = column >= table.numbers and (text == "active" or verdict is None)
    classes = (["number"] if number else []) + ([verdict] if verdict else [])
    return f' class="{" ".join(classes)}"' if classes else ""


def _json(value: Any) -> str:
    """Encode `value` as JSON that is safe inside a script element."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _plotly() -> str:
    """Return the code of plotly.js, which is part of the Python package plotly."""
    try:
        from plotly.offline import get_plotlyjs
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError("a report needs plotly: pip install 'qtraj[viz]'", name="plotly") from error
    return _inline(get_plotlyjs())


def _script() -> str:
    """Return the scripts of the report, joined in one function scope."""
    return "\n".join(['"use strict";', "(() => {", *map(_beside, SCRIPTS), "})();"])


def _beside(name: str) -> str:
    return _inline((files("qtraj.viz.report") / name).read_text(encoding="utf-8"))


def _inline(code: str) -> str:
    """Return the code exactly as a browser reads it from the page, so that the hashes agree."""
    return code.replace("\r\n", "\n").replace("</script", "<\\/script")


def _digest(code: str) -> str:
    return base64.b64encode(hashlib.sha256(code.encode()).digest()).decode()
