"""Compare the peak memory with the prediction, each case in its own process.

The measurement is the peak resident memory after a large call minus that after a small call. The prediction is the
memory of 18 results and one time per instant; with `reduce`, the memory of the times and one reordered copy of them.
"""

import resource
import subprocess
import sys
from pathlib import Path

from . import Measured

SMALL = 300_000
CASES = (("stored", 10**7), ("max", 10**7), ("max", 10**8))
NUMBERS = {"stored": 19, "max": 2}
"""Number of 8-byte values per instant."""


def peak_mb(how, instants):
    """Return by how much a large call increases the peak resident memory of this process [MB]."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    import qtraj as qt

    from ..evaluation.reference import DURATION
    from .evaluation import helix

    def call(count):
        times = jnp.linspace(0.0, DURATION, count)
        jax.block_until_ready(qt.evaluate(helix("float64"), times, reduce=None if how == "stored" else how))
        return _largest_mb()

    before = call(SMALL)
    return call(instants) - before


def _largest_mb():
    """Return the peak resident memory [MB]; on Linux, `getrusage` would return a value inherited from the parent."""
    status = Path("/proc/self/status")
    if not status.exists():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 * 1.048576
    line = next(line for line in status.read_text(encoding="ascii").splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) * 1.024e-3


def measure(quick):
    rows = []
    for how, instants in CASES[:1] if quick else CASES:
        command = [sys.executable, "-m", "benchmarks.races.memory", how, str(instants)]
        run = subprocess.run(command, capture_output=True, text=True, check=True)
        measured, predicted = float(run.stdout), NUMBERS[how] * 8e-6 * (instants - SMALL)
        rows.append(
            {
                "": "stored" if how == "stored" else f'reduce="{how}"',
                "instants": f"10^{len(str(instants)) - 1}",
                "predicted [MB]": round(predicted),
                "measured [MB]": round(measured),
                "measured / predicted": measured / predicted,
            }
        )
    return Measured("Growth of the peak resident memory", rows, {"relative to a call with": f"{SMALL} instants"})


if __name__ == "__main__":
    print(peak_mb(sys.argv[1], int(sys.argv[2])))
