"""Check programs and profiles: slews, random profiles, and frames along the reference paths."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from tests.motion.profiles import test_brute_force as brute
from tests.motion.propagation.coning import angles
from tests.path.test_reference import CASES, build

import qtraj as qt

from .guards import used
from .tables import table

DEGREE = np.pi / 180
SCALES = (1.0, -3.0, 1e-3, 1e6)


def turns():
    """Tabulate durations of time-optimal slews, and peaks of polynomial slews of one radian in one second."""
    rows = [
        [f"{angle}°, 1°/s, 0.05°/s²: duration [s]", f"{found:.6f}", expected]
        for angle, expected in ((90, "110"), (10, "√800 = 28.284271"))
        for found in [float(qt.TimeOptimal(DEGREE, 0.05 * DEGREE).profile(angle * DEGREE).duration)]
    ]
    exact = {
        qt.Cubic: [(1, "3/2"), (2, "6")],
        qt.Quintic: [(1, "15/8"), (2, "10/√3"), (3, "60")],
        qt.Septic: [(1, "35/16"), (2, "84√5/25"), (3, "52.5")],
    }
    names = ("", "rate", "acceleration", "jerk")
    for law, expected in exact.items():
        profile = law(duration=1.0).profile(1.0)
        peaks = np.abs(jax.vmap(lambda t, p=profile: p.derivatives(t, 3))(jnp.linspace(0, 1 - 1e-12, 40_001))).max(0)
        rows += [[f"{law.__name__}, peak {names[k]}", f"{float(peaks[k]):.6f}", value] for k, value in expected]
    return table(["slew", "measured", "exact"], rows)


def brute_force():
    """Tabulate the deviations from integrations and searches in plain NumPy."""
    tests = {
        "end rates, minimum time": brute.test_slews_with_end_rates,
        "end rates, prescribed time": brute.test_slews_with_end_rates_of_a_fixed_duration,
        "S-curves": brute.test_s_curves,
    }
    rows = [[name, used(test) * brute.BRUTE, f"`{test.__name__}`"] for name, test in tests.items()]
    return table([f"{brute.COUNT} random profiles", "largest deviation", "checked by"], rows)


def frames():
    """Tabulate, for each scale of λ, the error of the final attitude propagated with the program's own rate."""
    rows, programs = [], [qt.FrameProgram(build(case)) for case in CASES]
    last = [program(program.duration).quaternion for program in programs]
    first = [program(0.0).quaternion for program in programs]
    for scale in SCALES:
        found = [
            qt.propagate(Rate(p), scale * q, np.array([0.0, float(p.duration)]))[-1]
            for p, q in zip(programs, first, strict=True)
        ]
        lengths = np.abs(np.linalg.norm(found, axis=1) / abs(scale) - 1)
        rows.append([f"{scale:g}", float(angles(np.stack(found), np.stack(last)).max()), float(lengths.max())])
    return table([f"factor of λ ({len(CASES)} paths)", "error angle [rad]", "relative change of norm"], rows)


class Rate(eqx.Module):
    """The rate ω⁰ of a program; it is a Module, so that one executable serves all paths."""

    program: qt.FrameProgram

    def __call__(self, t):
        return self.program(t).rate
