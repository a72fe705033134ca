"""Measure reverse mode: compare the value and gradient of a scalar loss with the value alone, in time and memory."""

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import ANGLE, DURATION, HEIGHT, RADIUS
from ..race import race
from . import Measured

NAMES = ("position", "velocity", "acceleration", "quaternion", "curvature", "torsion", "rate")


def stored(path, times):
    table = qt.evaluate(path, times)
    return sum(jnp.sum(getattr(table, name) ** 2) for name in NAMES)


def reduced(path, times, how):
    return sum(jnp.sum(x**2) for x in qt.evaluate(path, times, reduce=how).values.values())


LOSSES = {
    "squares of all outputs, stored": stored,
    "their means": lambda path, times: reduced(path, times, "mean"),
    "the mean curvature": lambda path, times: qt.evaluate(path, times, ["curvature"], reduce="mean")["curvature"],
    "the mean of one rate": lambda path, times: qt.evaluate(path, times, ["rate"], reduce="mean")["rate"][2],
    "their maxima": lambda path, times: reduced(path, times, "max"),
}


def compiled(name, instants):
    """Return compiled functions of the path coefficients: the value, and the value with its gradient."""

    def loss(numbers, times):
        return LOSSES[name](qt.SpiralHelix(*numbers, DURATION), times)

    numbers = tuple(jnp.asarray(x, float) for x in (RADIUS, ANGLE, HEIGHT))
    given = (numbers, jnp.linspace(0.0, DURATION, instants))
    return given, [jax.jit(f).lower(*given).compile() for f in (loss, jax.value_and_grad(loss))]


def measure(quick):
    instants, rows = (10**5 if quick else 10**6), []
    for name in LOSSES:
        given, (value, both) = compiled(name, instants)
        spent = race({"value": lambda: value(*given), "both": lambda: both(*given)}, 3 if quick else 9)  # noqa: B023
        medians = {key: float(np.median(times)) for key, times in spent.items()}
        temporary = [x.memory_analysis().temp_size_in_bytes * 1e-6 for x in (value, both)]
        rows.append(
            {
                "loss": name,
                "value [ms]": 1e3 * medians["value"],
                "value and gradient [ms]": 1e3 * medians["both"],
                "ratio": medians["both"] / medians["value"],
                "temporary memory, value and gradient [MB]": round(temporary[1], 1),
                "temporary memory, value only [MB]": round(temporary[0], 1),
            }
        )
    return Measured("Reverse mode, float64, both compiled", rows, {"instants": instants})
