"""The initial path of tuning."""

import numpy as np

import qtraj as qt
from qtraj.design.tuning.initial import initial_path

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 6.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-8.0, -1.0, 0.1])


def test_turns_may_be_a_numpy_integer(as_a_user_runs_it):
    turns = initial_path(START, END, turns=np.int64(1)).turn
    assert turns == initial_path(START, END, turns=1).turn


def test_hermite_motion_meets_the_boundary_velocities():
    path = initial_path(START, END, motion="hermite", duration=7.0)
    for state, expected in ((path.state(0.0), START), (path.state(7.0), END)):
        np.testing.assert_allclose(state.position, expected.position, atol=1e-12)
        np.testing.assert_allclose(state.velocity, expected.velocity, atol=1e-12)
