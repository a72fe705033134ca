"""Mistakes that the checked types of this session catch first must be explained to users, who run without them."""

import subprocess
import sys

SCRIPT = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import qtraj as qt

helix = qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 2.0)
start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 4.0, 0.0])
end = qt.BoundaryState([0.0, 10.0, 0.0], [-4.0, 0.0, 0.0])
limits = qt.Limits(speed=9.0)
mistakes = [
    (lambda: qt.SpiralHelix.from_boundary(start, end, turns=0.5), "must be an integer"),
    (lambda: qt.SpiralHelix.hermite(start, end, 3.0, turns=0.5), "must be an integer"),
    (lambda: helix.position(np.zeros(4)), "jax.vmap over the instants, or qtraj.evaluate"),
    (lambda: qt.trihedral(helix, np.zeros(4)), "jax.vmap over the instants, or qtraj.evaluate"),
    (lambda: qt.trihedral(helix, 1.0, qt.Natural), "a frame such as Natural() or Upright()"),
    (lambda: qt.evaluate([helix, helix], [0.0]), "a path, or many of them stacked into one"),
    (lambda: qt.tune(start, end, {"speed": 9.0}), "limits must be a Limits"),
    (lambda: qt.tune(start, end, limits, objective=lambda path: path.angle), "the objective must be one number"),
    (lambda: qt.BoundaryState(start, end), "must be 3 real numbers"),
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
