"""Compare `tune` with SciPy's SLSQP and IPOPT: the table of `python -m benchmarks.tuning`, for fewer problems."""

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
        "Random problems with a curvature limit; 'solved' and 'best of all' use all starts; the time is for one start, "
        "for qtraj amortised over a batch of all problems"
    )
    return Measured(title, rows, {"problems": problems})
