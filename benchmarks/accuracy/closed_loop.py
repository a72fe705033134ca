"""Compare closed loops with their closed forms, and compute the settling times of the laws."""

import jax
import numpy as np
from tests.motion.rigs import Choice, ThreeAxis, random_gains
from tests.motion.simulation import test_simulate as tests

import qtraj as qt
from qtraj.motion import control

from .tables import table

DEFAULTS, TIGHT = {}, {"rtol": 1e-13, "atol": 1e-15}
TIMES = tests.TIMES


def deviations(times=TIMES):
    """Return deviations (n,) from SciPy's matrix exponential, by (law, gains), with default and tight tolerances."""
    program = ThreeAxis()
    at, found = program(0.0), {}
    for gains, (k1, k2) in zip(("scalar", "diagonal", "full"), random_gains(np.random.default_rng(9)), strict=True):
        k1, k2 = (k if np.ndim(k) == 2 else np.eye(4) * k for k in (k1, k2))
        laws = tuple(qt.AccelerationLaw(k1, k2, kind) for kind in tests.KINDS)  # equal shapes, so compiled once
        for index, kind in enumerate(tests.KINDS):
            x = control.error_quaternion(at, tests.START, kind)
            v = control.error_rate(at, tests.START, tests.RATE, kind)
            expected = tests.linear_response(k1, k2, x, v, np.zeros(4) if kind == "additive" else tests.IDENTITY)
            law = Choice(laws, jax.numpy.asarray(index))
            found[kind, gains] = [_deviation(program, law, expected, how) for how in (DEFAULTS, TIGHT)]
    return found


def loops():
    rows = [[kind, gains, *(float(d.max()) for d in pair)] for (kind, gains), pair in deviations().items()]
    law, program = qt.RateLaw(1.2), ThreeAxis()
    mu0 = control.error_quaternion(program(0.0), tests.START)
    expected = np.asarray(control.error_response(law, mu0, None, TIMES))
    rows.append(
        ["rate law", "scalar", *(float(_deviation(program, law, expected, h).max()) for h in (DEFAULTS, TIGHT))]
    )
    return table(["error", "gains", "at the defaults (rtol 1e-10)", "at rtol 1e-13"], rows)


def _deviation(program, law, expected, how):
    solution = qt.simulate(program, law, tests.START, tests.RATE, TIMES, **how)
    return np.abs(np.asarray(solution.error) - expected).max(axis=1)


def settling():
    """Tabulate the time to 1° and the peak acceleration of rest-to-rest slews at k = 1.

    The values of paper C's law are in closed form; SciPy computes those of the other laws.
    """
    names = ("`AccelerationLaw`", "quaternion feedback (Wie–Barba)", "geometric feedback", "logarithmic feedback")
    figures = [tests.exact_figures(np.radians(angle)) for angle in (90, 150, 179.99)]
    rows = [
        [name, *(f"{turn[law][0]:.4f} s, {turn[law][1]:.3f}" for turn in figures)] for law, name in enumerate(names)
    ]
    return table(["law", "90°", "150°", "179.99°"], rows)
