"""The public API agrees with all cases of the high-precision reference."""

import json
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

CASES = json.loads((Path(__file__).parents[1] / "data" / "trihedral.json").read_text())["cases"]
RELATIVE = 1e-12
RELATIVE_ACCELERATION = 1e-10  # ε⁰ uses the fourth derivative

evaluate = jax.jit(lambda path, t: (path.derivatives(t, 3), qt.trihedral(path, t)))


def build(case: dict) -> qt.SpiralHelix:
    start, end = qt.BoundaryState(**case["start"]), qt.BoundaryState(**case["end"])
    if case["kind"] == "hermite":
        turns = math.ceil(case["turn"] / (2 * math.pi) - 0.5)  # the number of whole turns beyond (−π, π]
        return qt.SpiralHelix.hermite(start, end, case["duration"], turns=turns)
    return qt.SpiralHelix.from_boundary(start, end)


def assert_close(actual, expected, relative=RELATIVE, scale=None):
    expected = np.asarray(expected)
    scale = np.linalg.norm(expected) if scale is None else scale
    np.testing.assert_allclose(np.asarray(actual), expected, rtol=0, atol=relative * scale)


@pytest.mark.parametrize("case", CASES, ids=[f"{i}-{c['kind']}" for i, c in enumerate(CASES)])
def test_boundary_problem_and_trihedral(case):
    path = build(case)
    assert_close(path.duration, case["duration"])
    assert_close(path.turn, case["turn"])
    assert_close(path.radius, case["radius"])
    assert_close(path.height, case["height"])
    for sample in case["samples"]:
        r, trihedral = evaluate(path, jnp.asarray(sample["t"]))
        for k, name in enumerate(("position", "velocity", "acceleration", "jerk")):
            assert_close(r[k], sample[name])
        assert bool(trihedral.defined)
        assert_close(trihedral.dcm(), sample["dcm"])
        q = trihedral.quaternion()
        assert_close(q * jnp.sign(q @ jnp.asarray(sample["quaternion"])), sample["quaternion"])
        assert_close(trihedral.gibbs(), sample["gibbs"])
        assert_close(trihedral.speed, np.linalg.norm(sample["velocity"]))
        assert_close(trihedral.curvature, sample["curvature"])
        assert_close(trihedral.torsion, sample["torsion"])
        assert_close(trihedral.rate, sample["rate"])
        if sample.get("angular_acceleration") is not None:
            assert_close(trihedral.acceleration, sample["angular_acceleration"], RELATIVE_ACCELERATION)
