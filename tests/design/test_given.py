"""The path that tuning starts from."""

import numpy as np

import qtraj as qt
from qtraj.design.tuning.given import given_path

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 6.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-8.0, -1.0, 0.1])


def test_whole_turns_may_be_an_integer_of_numpy(as_a_user_runs_it):
    turns = given_path(START, END, turns=np.int64(1)).turn
    assert turns == given_path(START, END, turns=1).turn


def test_it_meets_the_given_velocities_where_it_can():
    path = given_path(START, END, motion="hermite", duration=7.0)
    for state, given in ((path.state(0.0), START), (path.state(7.0), END)):
        np.testing.assert_allclose(state.position, given.position, atol=1e-12)
        np.testing.assert_allclose(state.velocity, given.velocity, atol=1e-12)
