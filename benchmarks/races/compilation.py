"""Compile time, apart from all other figures: the first call of each program, and the second."""

import jax.numpy as jnp
import numpy as np

import qtraj as qt

from ..evaluation.reference import DURATION
from ..race import seconds
from . import Found
from .evaluation import helix

INSTANTS = 12_345
"""A number that nothing else here uses, so that nothing is compiled yet."""


def cases():
    path, times = helix("float64"), jnp.linspace(0.0, DURATION, INSTANTS)
    limits = qt.Limits(curvature=0.06)
    start, end = path.state(0.0), path.state(DURATION)
    turn = lambda t: jnp.stack([0.1 * jnp.cos(t), 0.2 * jnp.sin(t), 0.3 + 0 * t])  # noqa: E731
    first = np.array([1.0, 0.0, 0.0, 0.0])
    return {
        "evaluate": lambda: qt.evaluate(path, times),
        'evaluate, reduce="max"': lambda: qt.evaluate(path, times, reduce="max"),
        "certify": lambda: qt.certify(path, limits),
        "tune": lambda: qt.tune(start, end, limits),
        "propagate": lambda: qt.propagate(turn, first, np.linspace(0.0, 7.0, 11)),
    }


def measure(quick):
    rows = []
    for name, call in cases().items():
        first, second = seconds(call), seconds(call)
        rows.append({"call": name, "first [s]": first, "second [s]": second})
    return Found("First call (traced and compiled) and second call, no compilation cache", rows, {})
