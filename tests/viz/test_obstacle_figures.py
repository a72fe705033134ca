"""The body of a vehicle in figures."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import qtraj as qt
from qtraj.viz.obstacles import draw_body


def test_the_body_keeps_its_front_in_reverse():
    """A ball 2 m in front of a car is drawn there on the way forth and on the way back."""
    x, zero = [[0.0, 0, 0], [10.0, 0, 0], [0.0, 0, 0]], np.zeros((3, 3))
    route = qt.Route([0.0, 4.0, 8.0], x, zero, zero)
    limits = qt.Limits(keep_out=[qt.Ball([0.0, 50.0, 0.0], 1.0)], body=[(2.0, 0.4)])
    figure, axes = plt.subplots()
    draw_body(axes, limits, route, np.array([2.0, 4.0, 6.0]), np.array([1.0, 0.0]))
    drawn = [patch.center for patch in axes.patches]
    plt.close(figure)
    assert np.ravel(drawn) == pytest.approx([6.0, 0.0, 11.0, 0.0, 6.0, 0.0])
