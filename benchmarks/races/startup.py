"""Measure whole processes: imports, and `qtraj tune` compared with a process that only uses the same libraries once.

Wall time is what a user waits for. The user and system time of the process and its children is more reliable on a
shared machine. The commands alternate.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np

from . import Measured

BARE = (
    "import jax; jax.config.update('jax_enable_x64', True); import diffrax, optax; import jax.numpy as jnp; "
    "print(jax.jit(lambda x: jnp.sum(jnp.sin(x)))(jnp.arange(9.0)))"
)
ALL = "import qtraj as qt; [getattr(qt, name) for name in qt.__all__]"
TUNE = "import sys; sys.argv[1:] = {arguments}; from qtraj.cli.main import main; main()"
PLAIN = (
    "import sys; from types import SimpleNamespace; "
    "sys.modules['qtraj.viz.figures'] = SimpleNamespace(tuning_figure=id, save=lambda figure, file: file.touch()); "
)
"""Code that runs first and replaces figures by empty files."""


def spent(code, folder):
    """Return the processor time and the wall time [s] of one process."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("XLA_", "JAX_"))}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-c", code]
    subprocess.run(command, env=environment | {"XDG_CACHE_HOME": folder}, check=True, stdout=subprocess.DEVNULL)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - start
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, wall


def measure(quick):
    with tempfile.TemporaryDirectory() as folder:
        tune = TUNE.format(arguments=["tune", "--out", os.path.join(folder, "out")])
        first = spent(tune, folder)
        codes = {
            "import equinox": "import equinox",
            "import qtraj": "import qtraj",
            "import qtraj, and every public name": ALL,
            "bare: jax, diffrax, optax, one compiled function": BARE,
            "qtraj tune, warm": tune,
            "qtraj tune, warm, without its figure": PLAIN + tune,
        }
        times = {name: [] for name in codes}
        for _ in range(2 if quick else 6):
            for name, code in codes.items():
                times[name].append(spent(code, folder))
    times["qtraj tune, the first run"] = [first]
    rows, bases = [], ("import equinox", "bare: jax, diffrax, optax, one compiled function")
    medians = {name: np.median(np.asarray(runs), axis=0) for name, runs in times.items()}
    for name, (processor, wall) in medians.items():
        base = bases[1] if "tune" in name or "bare" in name else bases[0]
        least = np.min(np.asarray(times[name]), axis=0)
        row = {"process": name, "wall [s]": float(wall), "minimum wall [s]": float(least[1])}
        row |= {"processor [s]": float(processor), "relative to": base.partition(":")[0]}
        ratios = {"wall ratio": float(wall / medians[base][1]), "processor ratio": float(processor / medians[base][0])}
        rows.append(row | ratios)
    return Measured("Start-up: whole processes", rows, {"runs": len(times["import qtraj"])})
