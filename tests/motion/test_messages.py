"""Mistakes that the checked types of this session catch first must be explained to users, who run without them."""

import subprocess
import sys

SCRIPT = """
import jax, jax.numpy as jnp, numpy as np
import qtraj as qt

one, still, times = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.0, 1.0]
turn = qt.EulerTurn(one, [1.0, 1.0, 0.0, 0.0], qt.Quintic(duration=1.0))
law = qt.AccelerationLaw(2.0, 1.0)
mistakes = [
    (lambda: qt.simulate(lambda t: t, law, one, still, times), "program must be one such as FrameProgram(path)"),
    (lambda: qt.simulate(turn, 2.0, one, still, times), "law must be one such as AccelerationLaw"),
    (lambda: qt.simulate(turn, law, one, still, times, sensor=0.1), "sensor must be one such as"),
    (lambda: qt.simulate(turn, law, one, still, times, actuator=1.0), "actuator must be one such as"),
    (lambda: qt.simulate(turn, law, one, [0.0] * 3, times), "the initial rate must have shape (4,)"),
    (lambda: qt.integrate(lambda t, q, w: jnp.zeros(3), one, still, times), "the virtual scalar part first"),
    (lambda: qt.propagate(lambda t: jnp.zeros(2), one, times), "omega(t) must have shape (3,)"),
    (lambda: qt.EulerTurn(one, one, 2.0), "a law such as TimeOptimal"),
    (lambda: qt.FrameProgram(qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 2.0), qt.Natural), "a frame such as Natural()"),
    (lambda: turn(np.zeros(4)), "jax.vmap over the instants"),
    (lambda: qt.TimeOptimal("fast", 1.0), "must be a number"),
    (lambda: qt.error_response(law, one, still[:3], 1.0), "the rate of the error must have shape (4,)"),
]
for mistake, expected in mistakes:
    try:
        mistake()
    except ValueError as error:
        if expected not in str(error):
            print("expected", repr(expected), "but the message is", error)
    else:
        print("nothing was raised where", repr(expected), "was expected")
"""


def test_mistakes_are_explained():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
