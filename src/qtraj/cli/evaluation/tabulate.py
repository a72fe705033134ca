"""The table of `evaluate`: as plain data, on the terminal, and as CSV."""

import math
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from qtraj._version import __version__
from qtraj.batch.table import Table
from qtraj.cli.content import finite
from qtraj.cli.layout import MOST_ROWS, heading, numbers_table, print_files, print_scenario
from qtraj.cli.tuning.report import print_fit
from qtraj.path.quantities import DESCRIPTIONS
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
        heading(console, title)
        console.print(numbers_table(columns, block, dict.fromkeys(FRAME_ONLY, defined)))
    if len(defined) > MOST_ROWS:
        console.print(
            Text(f"… : {len(defined) - MOST_ROWS} instants left out; --out DIR writes, --json prints them all")
        )
    if missing := int(np.sum(~defined)):
        console.print(Text(f"- : the natural trihedral does not exist (no motion or no bend) at {missing} instants"))
    print_files(console, content["files"])
