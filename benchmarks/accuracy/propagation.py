"""Measure the propagation of a known rate: two coning tables, the orders, and diffrax with as many evaluations."""

import diffrax
import numpy as np
from tests.motion.propagation import test_propagate as tests
from tests.motion.propagation.coning import FAST, SLOW

import qtraj as qt

from ..coning import Batch, with_equal_steps_of_diffrax
from .tables import table

METHODS = {
    "Magnus 4": qt.Magnus(4),
    "Magnus 6": qt.Magnus(6),
    "Gauss–Legendre 4": qt.GaussLegendre(4),
    "Gauss–Legendre 8": qt.GaussLegendre(8),
}
SOLVERS = {"diffrax Tsit5": (diffrax.Tsit5(), 6), "diffrax Dopri8": (diffrax.Dopri8(), 13)}
"""The methods, with their numbers of evaluations per step."""


def coning():
    return _errors(SLOW, 10.0, (48, 96, 192, 384, 768))


def fast_coning():
    return _errors(FAST, 10.3, (192, 768, 3072))


def orders():
    """Tabulate log₂ of the ratio of the errors with n and with 2n steps; n is as large as round-off allows."""
    rows = []
    for name, method in {
        **METHODS,
        "Gauss–Legendre 1": qt.GaussLegendre(1),
        "Gauss–Legendre 2": qt.GaussLegendre(2),
    }.items():
        steps = ORDER_STEPS[method.order]
        errors = tests.final_errors(FAST, 10.3, method, [len(method.nodes) * n for n in (steps, 2 * steps)])
        rows.append([name, method.order, f"{np.log2(errors[0] / errors[1]):.2f}"])
    return table(["method", "order", "measured"], sorted(rows, key=lambda row: row[1]))


ORDER_STEPS = {2: 2000, 4: 800, 6: 400, 8: 120, 16: 18}


def _errors(motion, end, evaluations):
    rows = [[name, *map(float, tests.final_errors(motion, end, m, evaluations))] for name, m in METHODS.items()]
    batch = Batch(np.array([float(motion.angle)]), np.array([float(motion.speed)]), end)
    for name, (solver, each) in SOLVERS.items():
        run = with_equal_steps_of_diffrax(batch, solver)
        rows.append([name, *(batch.error(run(float(count // each))) for count in evaluations)])
    return table(["evaluations of ω", *map(str, evaluations)], rows)
