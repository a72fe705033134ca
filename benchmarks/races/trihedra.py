"""Compare a user's own `jit(vmap(trihedral))` over many instants, and direct calls, with `qtraj.evaluate`."""

import time

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import DURATION
from . import Measured
from .evaluation import helix

FRAME_OUTPUTS = ("dcm", "quaternion", "speed", "curvature", "torsion", "rate", "angular_acceleration", "defined")


def calls(path, times):
    """Return the calls by name, all with the same instants."""
    over_times = lambda f: jax.jit(lambda path, times: jax.vmap(lambda t: f(path, t))(times))  # noqa: E731
    own = {
        "jit(vmap(trihedral))": over_times(qt.trihedral),
        "the same, upright": over_times(lambda path, t: qt.trihedral(path, t, qt.Upright())),
        "its quaternion alone": over_times(lambda path, t: qt.trihedral(path, t).quaternion()),
    }
    return {
        "evaluate": lambda: qt.evaluate(path, times).values,
        "evaluate, all outputs of a frame": lambda: qt.evaluate(path, times, FRAME_OUTPUTS).values,
        **{name: lambda f=f: f(path, times) for name, f in own.items()},
    }


def spent(call, repeats=1):
    """Return the wall time and the processor time [s] of one call."""
    wall, processor = time.perf_counter(), time.process_time()
    for _ in range(repeats):
        jax.block_until_ready(call())
    return (time.perf_counter() - wall) / repeats, (time.process_time() - processor) / repeats


def measure(quick):
    path, rounds, instants = helix("float64"), 3 if quick else 9, 10**5 if quick else 10**6
    runners = calls(path, jnp.linspace(0.0, DURATION, instants))
    found = {name: [] for name in runners}
    for k in range(rounds + 1):
        for name, call in runners.items():
            found[name] += [spent(call)] * (k > 0)  # the first call compiles
    medians = {name: np.median(np.array(times), axis=0) for name, times in found.items()}
    at = lambda: qt.trihedral(path, 0.3)  # noqa: E731
    at()
    medians["trihedral(path, t), a direct call"] = np.median([spent(at, 100) for _ in range(rounds)], axis=0)
    first = medians["evaluate"]
    rows = [
        {
            "call": name,
            "instants": 1 if "direct" in name else instants,
            "wall [ms]": 1e3 * wall,
            "processor [ms]": 1e3 * processor,
            "wall, over evaluate": "—" if "direct" in name else wall / first[0],
            "processor, over evaluate": "—" if "direct" in name else processor / first[1],
        }
        for name, (wall, processor) in medians.items()
    ]
    return Measured("Trihedra of one path by the user's own call, float64, medians", rows, {"rounds": rounds})
