"""The table of `evaluate`: as plain data, on the terminal, and as CSV."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from qtraj._version import __version__
from qtraj.batch.table import DESCRIPTIONS, Table
from qtraj.cli.content import finite
from qtraj.cli.report import column_table, print_files, print_fit, print_scenario
from qtraj.path.spiral_helix import SpiralHelix

OUTPUTS = ("position", "velocity", "acceleration", "speed", "curvature", "torsion", "quaternion", "rate", "defined")

HEADERS = {
    "time": ["time [s]"],
    "position": ["x [m]", "y [m]", "z [m]"],
    "velocity": ["vx [m/s]", "vy [m/s]", "vz [m/s]"],
    "acceleration": ["ax [m/s²]", "ay [m/s²]", "az [m/s²]"],
    "speed": ["speed [m/s]"],
    "curvature": ["curvature [1/m]"],
    "torsion": ["torsion [1/m]"],
    "quaternion": ["qw", "qx", "qy", "qz"],
    "rate": ["rate_x [rad/s]", "rate_y [rad/s]", "rate_z [rad/s]"],
}
"""Columns of the CSV file; `qtraj.read_track` knows those of time, position, velocity and attitude by these names."""

MOTION = {"time": ["t"], "position": ["x", "y", "z"], "speed": ["speed"], "curvature": ["κ"], "torsion": ["χ"]}
ATTITUDE = {"time": ["t"], "quaternion": ["λ0", "λ1", "λ2", "λ3"], "rate": ["ω_τ", "ω_n", "ω_b"]}
BLOCKS = (
    ("t [s], position [m], speed [m/s], curvature κ and torsion χ [1/m]", MOTION),
    ("t [s], quaternion λ (body to world) and rate ω of the trihedral [rad/s]", ATTITUDE),
)
"""The columns do not fit 80 characters side by side: two tables."""

MOST_ROWS = 100
"""A longer table shows its first and last rows alone."""

FRAME_ONLY = ("torsion", "quaternion", "rate")
"""What does not exist where the natural trihedral does not."""


def table_content(
    path: SpiralHelix, table: Table, scenario: dict[str, Any], fit: dict[str, Any] | None
) -> dict[str, Any]:
    """The table of a path, of JSON's types only."""
    names = ("time", *OUTPUTS)
    content = {
        "qtraj": __version__,
        "command": "evaluate",
        "scenario": scenario,
        "fit": fit,
        "path": {"duration": float(path.duration), "length": float(path.length()), "turn": float(path.turn)},
        "units": {"time": "s"} | {name: DESCRIPTIONS[name][0] for name in OUTPUTS},
        "columns": {name: np.asarray(getattr(table, name)).tolist() for name in names},
        "files": [],
    }
    return finite(content)


def print_table(console: Console, content: dict[str, Any]) -> None:
    """Both blocks of columns, with what is known about the path before them."""
    print_scenario(console, content["scenario"])
    path = content["path"]
    turn = f"{math.degrees(path['turn']):.2f}° about the axis"
    console.print(Text(f"Path: {path['duration']:.4f} s, {path['length']:.4f} m, {turn}"))
    if content["fit"] is not None:
        print_fit(console, content["fit"])
    columns = {name: np.array(values, dtype=float) for name, values in content["columns"].items()}
    defined = columns["defined"].astype(bool)
    for title, block in BLOCKS:
        console.print()
        console.print(Text(title, style="bold"))
        console.print(_block(columns, block, defined))
    if len(defined) > MOST_ROWS:
        console.print(
            Text(f"… : {len(defined) - MOST_ROWS} instants left out; --out DIR writes, --json prints them all")
        )
    if missing := int(np.sum(~defined)):
        console.print(Text(f"- : the natural trihedral does not exist (no motion or no bend) at {missing} instants"))
    print_files(console, content["files"])


def write_csv(table: Table, file: Path) -> None:
    """Every column with its unit, floats exactly."""
    columns = [np.asarray(getattr(table, name)).reshape(len(table.time), -1) for name in HEADERS]
    header = ",".join(name for names in HEADERS.values() for name in names)
    rows = (",".join(map(repr, row)) for row in np.concatenate(columns, axis=1).tolist())
    file.write_text("\n".join([header, *rows, ""]), encoding="utf-8")


def _block(columns: dict[str, np.ndarray], block: dict[str, list[str]], defined: np.ndarray) -> RichTable:
    cells: list[list[str]] = []
    for name in block:
        values = columns[name].reshape(len(defined), -1).T
        here = defined if name in FRAME_ONLY else np.ones_like(defined)
        cells += [_texts(column, here) for column in values]
    table = column_table(*[header for headers in block.values() for header in headers])
    rows = list(zip(*cells, strict=True))
    if len(rows) > MOST_ROWS:
        rows = [*rows[: MOST_ROWS // 2], tuple("…" for _ in rows[0]), *rows[-(MOST_ROWS // 2) :]]
    for row in rows:
        table.add_row(*row)
    return table


def _texts(values: np.ndarray, defined: np.ndarray) -> list[str]:
    """One column with as many decimals as tell its values apart, six at most."""
    known = values[defined & np.isfinite(values)]
    size = float(np.abs(known).max(initial=0.0))
    spread = float(np.ptp(known)) if known.size else 0.0
    before_point = 1 + max(0, _magnitude(size))
    decimals = min(max(4 - _magnitude(spread or size), 0), 6, max(10 - before_point, 0))
    return [
        f"{round(float(v), decimals) + 0.0:.{decimals}f}" if ok and np.isfinite(v) else "-"
        for v, ok in zip(values, defined, strict=True)
    ]


def _magnitude(x: float) -> int:
    return math.floor(math.log10(x)) if x > 0 else 0
