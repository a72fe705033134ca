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
from qtraj.path.channel import CHANNELS
from qtraj.path.frame_axes import MINIMIZING, NATURAL, THRUST_ALIGNED, UPRIGHT, axes_of
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
}
"""Columns of the CSV file, besides those of the frame.

`qtraj.read_track` knows those of time, position, velocity and attitude by these names."""

MOTION = {"time": ["t"], "position": ["x", "y", "z"], "speed": ["speed"], "curvature": ["κ"], "torsion": ["χ"]}
MISSING = {
    NATURAL: "the natural trihedral does not exist (no motion or no bend)",
    UPRIGHT: "the upright frame does not exist (no motion, or straight up or down)",
    THRUST_ALIGNED: "the thrust-aligned frame does not exist (no motion, free fall, or thrust along the velocity)",
    MINIMIZING: "the rotation-minimizing frame does not exist (no motion)",
}
"""What a dash in a table means."""


def table_content(
    path: SpiralHelix, table: Table, bends: np.ndarray, scenario: dict[str, Any], fit: dict[str, Any] | None
) -> dict[str, Any]:
    """The table of a path, of JSON's types only; `bends` (n,) is where it has a torsion."""
    names = [name for name in CHANNELS if name in table.values]
    content = {
        "qtraj": __version__,
        "command": "evaluate",
        "scenario": scenario,
        "fit": fit,
        "frame": table.frame,
        "path": {"duration": float(path.duration), "length": float(path.length()), "turn": float(path.turn)},
        "units": {"time": "s"} | {name: CHANNELS[name].unit for name in names},
        "columns": {name: np.asarray(getattr(table, name)).tolist() for name in ("time", *names)},
        "bends": bends.tolist(),
        "files": [],
    }
    return finite(content)


def _blocks(frame: str) -> tuple[tuple[str, dict[str, list[str]]], ...]:
    """Titles and columns of two tables: side by side they would not fit 80 characters."""
    rates = [f"ω_{symbol}" for symbol in axes_of(frame).symbols]
    attitude = {"time": ["t"], "quaternion": ["λ0", "λ1", "λ2", "λ3"], "rate": rates}
    return (
        ("t [s], position [m], speed [m/s], curvature κ and torsion χ [1/m]", MOTION),
        (f"t [s], quaternion λ and rate ω [rad/s] of the {frame} frame", attitude),
    )


def print_table(console: Console, content: dict[str, Any]) -> None:
    """Both blocks of columns, with what is known about the path before them."""
    print_scenario(console, content["scenario"])
    path = content["path"]
    turn = f"{math.degrees(path['turn']):.2f}° about the axis"
    console.print(Text(f"Path: {path['duration']:.4f} s, {path['length']:.4f} m, {turn}"))
    if content["fit"] is not None:
        print_fit(console, content["fit"])
    columns = {name: np.array(values, dtype=float) for name, values in content["columns"].items()}
    defined, frame = columns["defined"].astype(bool), content["frame"]
    exists = {"torsion": np.array(content["bends"], dtype=bool), "quaternion": defined, "rate": defined}
    for title, block in _blocks(frame):
        heading(console, title)
        console.print(numbers_table(columns, block, exists))
    if len(defined) > MOST_ROWS:
        console.print(
            Text(f"… : {len(defined) - MOST_ROWS} instants left out; --out DIR writes, --json prints them all")
        )
    if missing := int(np.sum(~defined)):
        console.print(Text(f"- : {MISSING[frame]} at {missing} instants"))
    print_files(console, content["files"])
