"""Compare "sqp" with first steps of `optax.adam(1e-2)`: the table of `python -m benchmarks.tuning.first_steps`."""

import subprocess
import sys

from . import Measured


def measure(quick):
    problems = 20 if quick else 1000
    command = [sys.executable, "-m", "benchmarks.tuning.first_steps", "--problems", str(problems)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [line.strip("| ") for line in run.stdout.splitlines() if line.startswith("|")]
    header, _, *body = ([cell.strip() for cell in line.split("|")] for line in lines)
    rows = [dict(zip(header, cells, strict=True)) for cells in body]
    title = (
        "Random problems with a curvature limit, with certificates, without compilation; adam is `optax.adam(1e-2)`, "
        "finished by sqp; objectives are compared up to 1e-6"
    )
    return Measured(title, rows, {"problems": problems})
