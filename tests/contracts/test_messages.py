"""Messages for mistakes in types and shapes, in a process without the type checks of the test session."""

import subprocess
import sys

import pytest

PATHS = """
helix = qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 2.0)
start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
end = qt.BoundaryState([0.0, 10.0, 0.0], [-4.0, 0.0, 0.0])
limits = qt.Limits(speed=9.0)
mistakes = [
    (lambda: qt.SpiralHelix.from_boundary(start, end, turns=0.5), "must be an integer"),
    (lambda: qt.SpiralHelix.hermite(start, end, 3.0, turns=0.5), "must be an integer"),
    (lambda: qt.SpiralHelix.hermite(start, end, 3.0, turns=1e300), "of at most 1,000,000,000, but the float 1e+300"),
    (lambda: qt.SpiralHelix.hermite(start, end, 3.0, turns=10**400), "of at most 1,000,000,000, but the int 1000"),
    (lambda: qt.SpiralHelix.hermite(start, end, 3.0, turns=True), "but the bool True was given"),
    (lambda: helix.position(np.zeros(4)), "jax.vmap over the instants, or qtraj.evaluate"),
    (lambda: qt.trihedral(helix, np.zeros(4)), "jax.vmap over the instants, or qtraj.evaluate"),
    (lambda: qt.trihedral(helix, 1.0, qt.Natural), "a frame such as Natural() or Upright()"),
    (lambda: qt.evaluate([helix, helix], [0.0]), "a path or a batch of paths was expected"),
    (lambda: qt.tune(start, end, {"speed": 9.0}), "limits must be a Limits"),
    (lambda: qt.tune(start, end, limits, objective=lambda path: path.angle), "the objective must be one number"),
    (lambda: qt.BoundaryState(start, end), "must be 3 real numbers"),
]
"""

MOTION = """
one, still, times = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 1.0]
turn = qt.EulerTurn(one, [1.0, 1.0, 0.0, 0.0], qt.Quintic(duration=1.0))
law = qt.AccelerationLaw(2.0, 1.0)
mistakes = [
    (lambda: qt.simulate(lambda t: t, law, one, still, times), "program must be an object such as FrameProgram(path)"),
    (lambda: qt.simulate(turn, 2.0, one, still, times), "law must be an object such as AccelerationLaw"),
    (lambda: qt.simulate(turn, law, one, still, times, sensor=0.1), "sensor must be an object such as"),
    (lambda: qt.simulate(turn, law, one, still, times, actuator=1.0), "actuator must be an object such as"),
    (lambda: qt.simulate(turn, law, one, [0.0] * 2, times), "the initial rate must have shape (3,) or (4,)"),
    (lambda: qt.integrate(lambda t, q, w: jnp.zeros(3), one, still, times), "the virtual scalar part first"),
    (lambda: qt.propagate(lambda t: jnp.zeros(2), one, times), "omega(t) must have shape (3,)"),
    (lambda: qt.EulerTurn(one, one, 2.0), "a motion profile such as TimeOptimal"),
    (lambda: qt.FrameProgram(qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 2.0), qt.Natural), "a frame such as Natural()"),
    (lambda: turn(np.zeros(4)), "jax.vmap over the instants"),
    (lambda: qt.TimeOptimal("fast", 1.0), "must be a number"),
    (lambda: qt.error_response(law, one, still[:3], 1.0), "the rate of the error must have shape (4,)"),
]
"""

SCRIPT = """
import jax, jax.numpy as jnp, numpy as np
jax.config.update("jax_enable_x64", True)
import qtraj as qt
{given}
for mistake, expected in mistakes:
    try:
        mistake()
    except ValueError as error:
        if expected not in str(error):
            print("expected", repr(expected), "but the message is", error)
    else:
        print("nothing was raised where", repr(expected), "was expected")
"""


@pytest.mark.parametrize("given", [PATHS, MOTION], ids=["paths", "motion"])
def test_mistakes_are_explained(given):
    script = SCRIPT.format(given=given)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
