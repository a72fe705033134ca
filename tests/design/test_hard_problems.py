"""Problems that are feasible only far from their initial paths, and the starts that find these paths."""

import jax
import numpy as np
import pytest
from benchmarks.tuning.hard import MISSED, PLANNED, hard, tuned

from qtraj.design.tuning import screened
from qtraj.design.tuning.motions.hermite import Hermite
from qtraj.design.tuning.objectives.nearest import Nearest
from qtraj.design.tuning.problem import broadcasting, pose
from qtraj.design.tuning.searches import searches_of
from qtraj.path.boundary import BoundaryState


@pytest.mark.parametrize("name", ["against", *(pytest.param(x, marks=pytest.mark.slow) for x in ("climb", "chord"))])
def test_no_feasible_problem_is_called_infeasible(name):
    """Eight starts miss these problems, which 56 further starts and the paths of a random search solve."""
    best, _ = tuned([hard(name, MISSED[name][0])], "sqp", 8)
    assert best.status.tolist() == ["converged"]
    assert best.certificate.holds.all()
    assert np.asarray(best.starts_tried).tolist() == [PLANNED + screened.CHOSEN]


def searches():
    given = [hard("against", k) for k in MISSED["against"][:2]]
    stacked = [np.stack([getattr(x, key) for x in given]) for key in ("position", "velocity")]
    end = [np.stack([getattr(x, key) for x in given]) for key in ("end_position", "end_velocity")]
    with broadcasting():
        states = jax.vmap(BoundaryState)(*stacked), jax.vmap(BoundaryState)(*end)
        problem = pose(*states, Nearest(), Hermite(), np.array([x.duration for x in given]))
    limits = {"curvature": np.array([x.limits[0] for x in given])}
    low, high = np.full((2, len(problem.names)), -3.0), np.full((2, len(problem.names)), 3.0)
    low[:, -1], high[:, -1] = -2.0, 0.4
    return searches_of(problem, limits, low, high)


def test_screened_starts_are_apart_within_bounds_and_better_than_others():
    both = searches()
    starts = screened.screened_starts(both)
    assert starts.shape == (7, 2, screened.CHOSEN)
    assert np.all((starts >= both.low[:, :, None]) & (starts <= both.high[:, :, None]))
    for k in range(2):
        one, z = both.take([k]), starts[:, k]
        np.testing.assert_array_equal(screened.screened_starts(one)[:, 0], z)
        distances = np.linalg.norm(z[:, :, None] - z[:, None], axis=0) + 10 * np.eye(screened.CHOSEN)
        assert distances.min() >= screened.APART
        others = np.clip(np.random.default_rng(1).normal(size=(7, 500)), one.low, one.high)
        assert screened._largest(one, z).max() < np.median(screened._largest(one, others))
