"""Measure the compile time: compare the first and the second call of each function.

Each function runs in its own process without the persistent cache, so no compiled code is shared.
"""

import json
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import DURATION
from ..race import seconds
from . import Measured
from .evaluation import helix

INSTANTS = 12_345
NAMES = ("evaluate", 'evaluate, reduce="max"', "certify", "tune", "propagate")
ENVIRONMENT = {"JAX_ENABLE_COMPILATION_CACHE": "false", "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
"""Settings without a cache; on a GPU, the memory is shared with the process of the benchmarks."""


def cases():
    path, times = helix("float64"), jnp.linspace(0.0, DURATION, INSTANTS)
    limits = qt.Limits(curvature=0.06)
    start, end = path.state(0.0), path.state(DURATION)
    turn = lambda t: jnp.stack([0.1 * jnp.cos(t), 0.2 * jnp.sin(t), 0.3 + 0 * t])  # noqa: E731
    first = np.array([1.0, 0.0, 0.0, 0.0])
    calls = (
        lambda: qt.evaluate(path, times),
        lambda: qt.evaluate(path, times, reduce="max"),
        lambda: qt.certify(path, limits),
        lambda: qt.tune(start, end, limits),
        lambda: qt.propagate(turn, first, np.linspace(0.0, 7.0, 11)),
    )
    return dict(zip(NAMES, calls, strict=True))


def measure(quick):
    rows = []
    for name in NAMES:
        command = [sys.executable, "-m", "benchmarks.races.compilation", name]
        run = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | ENVIRONMENT)
        first, second = json.loads(run.stdout)
        rows.append({"call": name, "first [s]": first, "second [s]": second})
    title = "First call (traced and compiled) and second call, each in a fresh process, no compilation cache"
    return Measured(title, rows, {})


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    call = cases()[sys.argv[1]]
    print(json.dumps([seconds(call), seconds(call)]))
