"""Compare evaluation with the copy bandwidth of the device: one path, and many paths with 10³ instants each.

On a GPU the goal is 70 % of the bandwidth of a compiled copy of a large array, counting reads and writes.
"""

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import DURATION
from ..race import race
from . import Measured
from .evaluation import INSTANTS, helix

AIM = 0.7
CHANNELS = 18


def copy_rate(megabytes, rounds):
    """Return the bytes per second that a compiled copy reads and writes."""
    given = jnp.ones(megabytes * 125_000, jnp.float64)
    copy = jax.jit(lambda x: x + 1)
    spent = race({"copy": lambda: copy(given)}, rounds)["copy"]
    return 2 * given.nbytes / float(np.median(spent))


def measure(quick):
    on_cpu = jax.default_backend() == "cpu"
    paths, rounds = (10**2 if quick else 10**3 if on_cpu else 10**5), (3 if quick else 7)
    rate = copy_rate(100 if quick else 800 if on_cpu else 4000, rounds)
    rows = []
    for kind in ("float64", "float32"):
        one = helix(kind)
        radii = np.linspace(1.0, 1.1, paths).astype(kind)
        many = jax.vmap(lambda c, one=one: qt.SpiralHelix(one.radius * c, one.angle, one.height, one.duration))(radii)
        for label, path, count, instants in (
            ("one path", one, 1, 10**5 if quick else INSTANTS),
            (f"{paths} paths × 1000 instants", many, paths, 1000),
        ):
            times = jnp.linspace(0.0, DURATION, instants).astype(kind)
            spent = race({"": lambda path=path, times=times: qt.evaluate(path, times)}, rounds)[""]
            median, size = float(np.median(spent)), np.dtype(kind).itemsize
            bytes_moved = (CHANNELS * count * instants + instants) * size
            part = bytes_moved / median / rate
            row = {"": f"{label}, {kind}", "time [ms]": 1e3 * median, "GB/s": bytes_moved / median * 1e-9}
            aim = "for GPUs" if on_cpu else "met" if part >= AIM else "missed"
            rows.append(row | {"fraction of copy bandwidth": part, f"goal {AIM:.0%}": aim})
    settings = {"device": str(jax.devices()[0]), "copy [GB/s]": rate * 1e-9}
    title = "Bytes written and read per second, compared with a compiled copy on the same device"
    return Measured(title, rows, settings)
