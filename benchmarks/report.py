"""Write the tables and figures of docs/performance.md from a results file:  python -m benchmarks.report [FILE]"""

import argparse
import json
from pathlib import Path

import numpy as np

from .accuracy.tables import put, table

DOCS = Path(__file__).parents[1] / "docs"
DOCUMENT = DOCS / "performance.md"
RESULTS = Path(__file__).with_name("results") / "cpu.json"
DIGITS = 3


def body(race):
    """Return the table of a benchmark, with date, machine and command."""
    rows = race["rows"]
    made, machine = race["made"], race["made"]["machine"]
    settings = ", ".join(f"{key}: {text(value)}" for key, value in race["settings"].items() if key != "curves")
    before = machine.get("load_before")
    load = "" if before is None else f", system load before the run {before:g}"
    title = f"{race['title']} ({settings})" if settings else race["title"]
    remark = (
        f"{title}. `{made['command']}`, {made['date']}: {made['device']}, {machine['processor']}, "
        f"{machine['cores']} cores{load}, jax {machine['versions']['jax']}."
    )
    return table(list(rows[0]), [[text(cell) for cell in row.values()] for row in rows]) + f"\n\n{remark}"


def text(cell):
    """Format a float with a few significant digits; convert other values with `str`."""
    if not isinstance(cell, float):
        return str(cell)
    if cell == 0 or not np.isfinite(cell):
        return f"{cell:g}"
    if not 1e-3 <= abs(cell) < 1e5:
        return f"{cell:.1e}"
    return np.format_float_positional(float(f"{cell:.{DIGITS}g}"), trim="-")


def printed(results):
    """Return all tables as text."""
    return "\n".join(f"\n{name}\n{body(race)}" for name, race in results["races"].items())


def written(document, results):
    """Return the document with the tables of these results between its markers."""
    for name, race in results["races"].items():
        document = put(document, name, body(race))
    return document


def write(results):
    """Insert the tables into the document, and write the figures to the folder of the docs."""
    from .figures import draw

    DOCUMENT.write_text(written(DOCUMENT.read_text(encoding="utf-8"), results), encoding="utf-8")
    draw(results, DOCS / "figures")


def main():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.report", description=__doc__)
    parser.add_argument("file", nargs="?", type=Path, default=RESULTS)
    write(json.loads(parser.parse_args().file.read_text(encoding="utf-8")))


if __name__ == "__main__":
    main()
