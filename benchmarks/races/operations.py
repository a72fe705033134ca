"""Measure the amount of compilation: count the StableHLO operations that successive calls compile.

Rows with the same "process" are calls in one process, in this order, without the persistent cache. The counts
are exact, even on a busy machine.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import jax.numpy as jnp

import qtraj as qt

from . import Measured
from .compilation import ENVIRONMENT

OPERATION = re.compile(r"\b(?:stablehlo|chlo)\.[a-z_]+")
START = ([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = ([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
TWO = {"curvature": 0.048, "lateral_acceleration": 2.2}
OTHERS = {"speed": 12.0, "jerk": 20.0, "yaw_rate": 1.0}
TWELVE = (
    TWO
    | OTHERS
    | {
        "torsion": 1.0,
        "acceleration": 20.0,
        "longitudinal_acceleration": 10.0,
        "slope": 1.0,
        "angular_rate": 2.0,
        "angular_acceleration": 5.0,
        "yaw_acceleration": 5.0,
    }
)


def tune(limits, motion="uniform", count=None):
    start, end = qt.BoundaryState(*START), qt.BoundaryState(*END)
    if count is not None:
        start = jax.tree.map(lambda x: jnp.stack([x] * count), start)
    return lambda: qt.tune(start, end, qt.Limits(**limits), motion=motion)


def drive():
    """Tune with limits that need a vehicle; the executable also serves all other limits."""
    limits = qt.Limits(friction=0.42, power=58e3, vehicle=qt.Vehicle(12e3, None, 6.0, 0.007, (0.6, 0.5), 0.05))
    return lambda: qt.tune(qt.BoundaryState(*START), qt.BoundaryState(*END), limits)


def certify():
    path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35], [1.0, 0.4, 0.05, -0.01], 4.5)
    return lambda: qt.certify(path, qt.Limits(**TWELVE))


def retime(limits, knots=256):
    path = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35], [1.0, 0.4, 0.05, -0.01], 4.5)
    return lambda: qt.retime(path, qt.Limits(**limits), start_speed=0.0, knots=knots)


TIMED = {"speed": 12.0, "lateral_acceleration": 2.2, "longitudinal_acceleration": 1.5}

PROCESSES = {
    "uniform": {
        "tune, uniform, two limits": lambda: tune(TWO),
        "three others": lambda: tune(OTHERS),
        "all twelve": lambda: tune(TWELVE),
        "a batch of 10": lambda: tune(TWO, count=10),
        "a batch of 12": lambda: tune(TWO, count=12),
    },
    "hermite": {"tune, hermite, two limits": lambda: tune(TWO, "hermite")},
    "vehicle": {"tune, uniform, friction and power": drive},
    "certify": {"certify, twelve limits": certify},
    "retime": {
        "retime, three limits": lambda: retime(TIMED),
        "with a limit on the jerk": lambda: retime(TIMED | {"jerk": 2.0}),
    },
}


def measure(quick):
    rows = []
    for process in ("certify",) if quick else PROCESSES:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "benchmarks.races.operations", process]
            environment = os.environ | ENVIRONMENT | {"JAX_DUMP_IR_TO": folder}
            run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
            for call, files in json.loads(run.stdout):
                counts = [len(OPERATION.findall((Path(folder) / file).read_text(encoding="utf-8"))) for file in files]
                rows.append({"process": process, "call": call, "operations": sum(counts), "executables": len(counts)})
    return Measured("StableHLO operations that a call compiles", rows, {})


def compiled(process):
    """Return the files of the executables that each call of a process compiles."""
    folder, found = Path(os.environ["JAX_DUMP_IR_TO"]), []
    for name, case in PROCESSES[process].items():
        call = case()
        before = {file.name for file in folder.glob("*.mlir")}
        jax.block_until_ready(call())
        found.append((name, sorted({file.name for file in folder.glob("*.mlir")} - before)))
    return found


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(json.dumps(compiled(sys.argv[1])))
