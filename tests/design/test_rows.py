"""The rows of tuning: limits in unit time, and peaks that move with the variables."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.design.magnitudes import UNITS, squared
from qtraj.design.tuning.problem import pose
from qtraj.design.tuning.rows import excess, find_peaks, rows_at

START = qt.BoundaryState([20.0, 0.0, 0.0], [-3.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -3.0, 0.1])
AXIS = qt.Placement([1.0, -2.0, 0.5], [0.99, 0.02, -0.03, 0.1])
MOTIONS = ("uniform", "hermite")


def posed(motion, placement=None):
    problem = pose(START, END, "nearest", motion, None, 0, placement)
    return problem, 0.1 * jnp.asarray(np.random.default_rng(5).normal(size=problem.size))


@pytest.mark.parametrize("placement", [None, AXIS], ids=["upright", "tilted"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_unit_of_time_changes_no_excess(motion, placement):
    problem, z = posed(motion, placement)
    path, limit = problem.path(z), jnp.asarray(1.7)
    fractions = jnp.asarray([0.0, 0.3, 1.0])
    for name in UNITS:
        found = jax.vmap(lambda u, name=name: excess(problem, z, u, name, limit))(fractions)
        squares = jax.vmap(lambda u, name=name: squared(path, u * path.duration, name))(fractions)
        np.testing.assert_allclose(2 * found + 1, squares / limit**2, rtol=1e-9, atol=1e-14, err_msg=name)


@pytest.mark.parametrize(
    ("motion", "placement"), [("uniform", None), pytest.param("hermite", AXIS, marks=pytest.mark.slow)]
)
def test_rows_have_the_derivatives_of_the_excess(motion, placement):
    """With the motion of their peaks, by the implicit function theorem."""
    problem, z = posed(motion, placement)
    limits = qt.Limits(curvature=0.05)

    @jax.jit
    def both(z):
        def g(z, u):
            return excess(problem, z, u, "curvature", limits.curvature)

        def exact(u):
            mixed, bend = jax.jacfwd(jax.grad(g), 1)(z, u), jax.jacfwd(jax.jacfwd(g, 1), 1)(z, u)
            return jax.grad(g)(z, u), jax.hessian(g)(z, u), jnp.outer(mixed, mixed) / bend, bend

        peaks = jax.tree.map(lambda x: x[0], find_peaks(problem, limits, z))
        return *rows_at(problem, limits, z, jax.tree.map(lambda x: x[None], peaks)), peaks, jax.vmap(exact)(peaks.time)

    rows, hessians, peaks, (slopes, seconds, moved, bends) = both(0.1 * z)
    there = np.asarray(peaks.present)
    assert np.any(there & peaks.moving)
    moved = np.where((peaks.moving & (bends < 0))[:, None, None], moved, 0.0)
    np.testing.assert_allclose(rows.slope[: there.size][there], slopes[there], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(hessians[0][there], (seconds - moved)[there], rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("motion", MOTIONS)
def test_slopes_and_hessians_are_those_of_peaks_that_move(motion):
    """Against differences of the rows about the points next to it, whose peaks are sought anew."""
    problem, z = posed(motion)
    z = 0.1 * z
    limits = qt.Limits(curvature=0.05, lateral_acceleration=3.0)
    step = 1e-5

    @jax.jit
    def at(z):
        peaks = find_peaks(problem, limits, z)
        rows, hessians = rows_at(problem, limits, z, peaks)
        k = peaks.time.shape[1]
        of_peaks = jax.tree.map(lambda x: x.reshape(2, -1, *x.shape[1:])[:, :k], rows)
        return of_peaks.value, of_peaks.slope, hessians, peaks

    _, slopes, hessians, peaks = at(z)
    assert np.all(np.any(peaks.present & peaks.moving, axis=1)), "an inner peak of both limits"
    for k in range(problem.size):
        (low, low_slopes, _, before), (high, high_slopes, _, after) = (at(z.at[k].add(s)) for s in (-step, step))
        held = peaks.moving | (peaks.time == 0) | (peaks.time == 1)  # the rest stand where the path is slowest
        same = held & peaks.present & before.present & after.present
        rates = (high - low)[same] / (2 * step), (high_slopes - low_slopes)[same] / (2 * step)
        np.testing.assert_allclose(slopes[same][:, k], rates[0], rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(hessians[same][:, k], rates[1], rtol=1e-5, atol=1e-5)
