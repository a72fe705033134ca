"""Tuning by optimisers of optax: the same paths, proofs and derivatives as "sqp"."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from benchmarks.tuning.problems import problems

import qtraj as qt
from qtraj.design.tuning.problem import broadcasting

RATE = 0.35
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, RATE * 20, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-RATE * 28, -1.0, 0.1])
LIMITS = qt.Limits(curvature=0.048, lateral_acceleration=2.2)

# One object each for all tests: compiled code is cached per object.
ADAM = optax.adam(1e-2)
CHAIN = optax.chain(optax.clip_by_global_norm(1.0), optax.sgd(1e-2, momentum=0.9))
SCHEDULE = optax.adam(optax.cosine_decay_schedule(2e-2, 600))
OPTIMISERS = {"lbfgs": "lbfgs", "adam": ADAM, "chain": CHAIN, "optax.lbfgs": optax.lbfgs(), "schedule": SCHEDULE}

RTOL = 1e-8
"""Relative difference of objectives of one solution; limits may be exceeded by 2e-9 before the proof."""

DERIVATIVE_RTOL = 1e-5
"""Relative difference of derivatives of the solution, which amplify the difference of the solutions."""


def tuned(method, objective="nearest", motion="uniform", duration=None, starts=1, **more):
    return qt.tune(START, END, LIMITS, objective, motion, duration, method=method, starts=starts, **more)


@pytest.mark.parametrize(
    "name", ["lbfgs", "adam", "chain", *(pytest.param(x, marks=pytest.mark.slow) for x in ("optax.lbfgs", "schedule"))]
)
def test_every_optimiser_agrees_with_sqp(name):
    best, reference = tuned(OPTIMISERS[name]), tuned("sqp")
    assert best.converged, best.result
    assert best.certificate.holds
    assert float(best.objective) == pytest.approx(float(reference.objective), rel=RTOL)


@pytest.mark.parametrize(
    ("objective", "motion", "duration"),
    [
        ("fastest", "uniform", None),
        ("smoothest", "hermite", 4.0),
        pytest.param("smoothest", "uniform", 6.5, marks=pytest.mark.slow),
        pytest.param("fastest", "hermite", None, marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("name", ["adam", pytest.param("lbfgs", marks=pytest.mark.slow)])
def test_every_objective_and_motion_is_tuned(name, objective, motion, duration):
    best = tuned(OPTIMISERS[name], objective, motion, duration)
    reference = tuned("sqp", objective, motion, duration, starts=8)
    assert best.converged, best.result
    assert best.certificate.met
    assert float(best.objective) == pytest.approx(float(reference.objective), rel=RTOL)


def test_a_batch_equals_its_elements():
    curvatures = jnp.asarray([0.046, 0.048, 0.052])
    starts = jax.tree.map(lambda x: jnp.stack([x] * 3), START)
    batch = qt.tune(starts, END, jax.vmap(lambda k: qt.Limits(curvature=k))(curvatures), method=ADAM, starts=1)
    assert batch.converged.all(), str(batch)
    for k, curvature in enumerate(curvatures):
        one = qt.tune(START, END, qt.Limits(curvature=curvature), method=ADAM, starts=1)
        np.testing.assert_allclose(batch.objective[k], one.objective, rtol=1e-9)
        np.testing.assert_allclose(batch.path.radius[k], one.path.radius, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lbfgs", "adam"])
def test_derivatives_of_the_solution_agree_with_sqp(name):
    """Forward and reverse, under jit and vmap."""

    def slopes(method):
        def duration(curvature, velocity):
            start = qt.BoundaryState(START.position, velocity)
            limits = qt.Limits(curvature=curvature, lateral_acceleration=2.2)
            return qt.tune(start, END, limits, method=method, starts=1).path.duration

        return jax.jit(jax.vmap(jax.value_and_grad(duration, argnums=(0, 1)), in_axes=(0, None)))(
            jnp.asarray([0.047, 0.049]), START.velocity
        )

    ours, expected = slopes(OPTIMISERS[name]), slopes("sqp")
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=DERIVATIVE_RTOL, atol=DERIVATIVE_RTOL * float(jnp.max(jnp.abs(b))))


@pytest.mark.slow
def test_an_active_bound_enters_the_derivative():
    min_duration = 1.03 * float(tuned("sqp").path.duration)

    def reached(method):
        def radial(curvature):
            limits = qt.Limits(curvature=curvature, lateral_acceleration=2.2)
            bounds = {"duration": (min_duration, 8.0)}
            best = qt.tune(START, END, limits, bounds=bounds, method=method, starts=1)
            return best.start.velocity[0], best.path.duration

        return jax.jit(lambda k: (radial(k), jax.jacrev(radial)(k)))(0.048)

    ((radial, duration), slopes), expected = reached("lbfgs"), reached("sqp")
    assert float(duration) == pytest.approx(min_duration, rel=1e-9), "the bound is active"
    assert float(radial) == pytest.approx(float(expected[0][0]), rel=RTOL)
    assert float(slopes[1]) == pytest.approx(0.0, abs=1e-9)
    assert float(slopes[0]) == pytest.approx(float(expected[1][0]), rel=DERIVATIVE_RTOL)


class ClimbRate(eqx.Module):
    """A callable objective that contains an array."""

    target: jax.Array

    def __call__(self, path):
        return (path.rotating_derivatives(0.5 * path.duration, 1)[1, 2] - self.target) ** 2 + 1e-3 * path.duration


def test_a_callable_may_contain_arrays_and_be_traced():
    best = qt.tune(START, END, LIMITS, ClimbRate(jnp.asarray(0.5)), starts=1, method=ADAM)
    assert best.converged, best.result

    def climb_rate(path):
        return ClimbRate(jnp.asarray(0.5))(path)

    @jax.jit
    def traced(curvature):
        limits = qt.Limits(curvature=curvature, lateral_acceleration=2.2)
        return qt.tune(START, END, limits, climb_rate, starts=1, method=ADAM).objective

    assert float(traced(0.048)) == pytest.approx(float(best.objective), rel=RTOL)


def test_an_impossible_limit_is_infeasible():
    best = qt.tune(START, END, qt.Limits(curvature=0.01), bounds={"duration": (2.0, 8.0)}, method=ADAM, starts=1)
    assert best.status == "infeasible"
    assert "What would help" in best.result


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        ({"method": optax.adam}, "an optax optimiser such as optax.adam(1e-2)"),
        ({"method": "adagrad"}, "'sqp', 'lbfgs' or 'adam', or an optax optimiser"),
        ({"method": 3}, "but 3 was given"),
        ({"inner_steps": 0}, "inner_steps must be an integer, 1 or more, but 0 was given"),
        ({"max_steps": 2.5}, "max_steps must be an integer, 1 or more, but 2.5 was given"),
    ],
)
def test_an_invalid_method_raises(change, fragment):
    with pytest.raises(ValueError) as caught:
        qt.tune(START, END, LIMITS, **change)
    assert fragment in str(caught.value)


def random_problems(count, seed):
    with broadcasting():
        return problems(count, seed)


def test_one_start_finds_the_optimum_of_sqp_or_a_better_one():
    given = random_problems(12, 5)
    limits = jax.vmap(lambda k: qt.Limits(curvature=k))(jnp.asarray(given.limits))
    results = [qt.tune(given.starts, given.ends, limits, starts=1, method=m) for m in ("sqp", ADAM)]
    ratio = np.asarray(results[1].objective) / np.asarray(results[0].objective)
    assert results[1].certificate.holds.all()
    assert ratio.max() < 1 + 1e-6
    assert np.mean(np.abs(ratio - 1) < 1e-6) > 0.75
    assert np.all(results[1].iterations > 600)


def test_an_optimiser_that_diverges_does_no_harm():
    """The steps are far too large; "sqp" continues from a useless point, and from the initial states, too."""
    best = tuned(optax.sgd(1e6))
    assert best.converged, best.result
    assert float(best.objective) == pytest.approx(float(tuned("sqp").objective), rel=RTOL)
