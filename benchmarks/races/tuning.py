"""`tune` against SciPy's SLSQP and IPOPT: the table that `python -m benchmarks.tuning` prints, on fewer problems."""

import subprocess
import sys

from . import Measured


def measure(quick):
    problems = 3 if quick else 20
    command = [sys.executable, "-m", "benchmarks.tuning", "--problems", str(problems), "--batch", "0"]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [line.strip("| ") for line in run.stdout.splitlines() if line.startswith("|")]
    header, _, *body = ([cell.strip() for cell in line.split("|")] for line in lines)
    rows = [dict(zip(header, cells, strict=True)) for cells in body]
    title = (
        "Boundary velocities within a curvature limit, random problems; solved and best of all: with all starts; time: "
        "of one start, qtraj's amortised over a batch of all problems"
    )
    return Measured(title, rows, {"problems": problems})
