"""Tuning: limits are met, objectives minimal, infeasible problems explained, and invalid input raises."""

import itertools
import math
import re
import time
from functools import lru_cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from benchmarks.tuning import hard
from scipy.optimize import NonlinearConstraint, minimize

import qtraj as qt
from qtraj.design.tuning.motions.registry import MOTIONS
from qtraj.design.tuning.objectives.registry import OBJECTIVES
from qtraj.design.tuning.problem import pose
from qtraj.path.boundary import cylindrical
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import value as path_value

RATE = 0.35
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, RATE * 20, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-RATE * 28, -1.0, 0.1])
LIMITS = qt.Limits(curvature=0.048, lateral_acceleration=2.2)

SHORT_DURATION = {"duration": (2.0, 8.0)}  # [s]: without it, slow paths with wide loops meet almost any curvature

RTOL = 1e-6  # of objectives


def minimum_by_slsqp(objective, motion, limits=LIMITS, duration=None, starts=3):
    """The minimum objective by SciPy's SLSQP from several starts, with the limits at 300 fixed instants."""
    problem = pose(START, END, OBJECTIVES[objective], MOTIONS[motion], duration, 0, None)
    bounds = limits.given()

    def values(z):
        path = problem.path(z)
        times = jnp.linspace(0.0, 1.0, 300) * path.duration
        margins = [1.0 - jax.vmap(lambda t, n=name: path_value(path, t, n))(times) / bounds[name] for name in bounds]
        return problem.cost(z), jnp.concatenate(margins)

    compiled = jax.jit(lambda z: (values(z), jax.jacfwd(values)(z)))  # values and derivatives in one compilation

    @lru_cache(maxsize=1)
    def evaluate(z):
        (cost, margins), (slope, jacobian) = jax.device_get(compiled(np.asarray(z)))
        return float(cost), margins, slope, jacobian

    rng, best = np.random.default_rng(0), math.inf
    for k in range(starts):
        result = minimize(
            lambda z: evaluate(tuple(z))[0],
            0.1 * k * rng.normal(size=problem.size),
            jac=lambda z: evaluate(tuple(z))[2],
            constraints=NonlinearConstraint(
                lambda z: evaluate(tuple(z))[1], 0.0, np.inf, jac=lambda z: evaluate(tuple(z))[3]
            ),
            method="SLSQP",
            options={"ftol": 1e-13, "maxiter": 300},
        )
        if np.min(evaluate(tuple(result.x))[1]) > -1e-7:
            best = min(best, float(result.fun))
    return best * float(problem.scale)


CASES = [
    ("nearest", "uniform", None),
    pytest.param("fastest", "uniform", None, marks=pytest.mark.slow),
    pytest.param("smoothest", "uniform", 6.5, marks=pytest.mark.slow),
    pytest.param("nearest", "hermite", None, marks=pytest.mark.slow),
    pytest.param("smoothest", "hermite", 4.0, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("objective", "motion", "duration"), CASES)
def test_limits_are_met_at_the_minimum_objective(objective, motion, duration):
    best = qt.tune(START, END, LIMITS, objective=objective, motion=motion, duration=duration)
    assert best.status == "converged", best.result
    assert best.certificate.met
    assert all(best.certificate.margin(name) >= 0 for name in LIMITS.given())
    reference = minimum_by_slsqp(objective, motion, duration=duration)
    assert best.objective <= reference * (1 + RTOL), "no worse than SciPy's SLSQP"
    for state, given, t in ((best.start, START, 0.0), (best.end, END, best.path.duration)):
        np.testing.assert_array_equal(state.position, given.position)
        np.testing.assert_allclose(best.path.position(t), given.position, atol=1e-12)
        np.testing.assert_allclose(best.path.velocity(t), state.velocity, atol=1e-12)
    if duration is not None:
        assert float(best.path.duration) == pytest.approx(duration, rel=1e-14)


@pytest.mark.parametrize("motion", ["uniform", pytest.param("hermite", marks=pytest.mark.slow)])
def test_the_objective_is_the_one_defined(motion):
    """Squares of the changes of the cylindrical components, plus those of the duration for hermite motion."""
    best = qt.tune(START, END, LIMITS, motion=motion)
    given = np.array([[1.0, 7.0, 0.3], [-1.0, RATE * 28, 0.1]])  # V_ρ, V_φ, V_h at A and at B
    ends = [best.path.rotating_derivatives(t, 1)[1] for t in (0.0, best.path.duration)]
    expected = np.sum((np.asarray(ends) - given) ** 2)
    if motion == "hermite":
        own = math.pi / 2 / RATE
        speed2 = (START.velocity @ START.velocity + END.velocity @ END.velocity) / 2
        expected += float(((best.path.duration - own) / own) ** 2 * speed2)
    assert best.objective == pytest.approx(expected, rel=1e-10)


@pytest.mark.slow
def test_a_callable_objective_is_minimised():
    def climb_rate(path):
        return (path.rotating_derivatives(0.5 * path.duration, 1)[1, 2] - 0.5) ** 2 + 1e-3 * path.duration

    best = qt.tune(START, END, LIMITS, objective=climb_rate)
    assert best.status == "converged", best.result
    nearest = qt.tune(START, END, LIMITS)
    assert best.objective < float(climb_rate(nearest.path))


def test_wide_limits_do_not_change_the_states():
    best = qt.tune(START, END, qt.Limits(curvature=1.0, lateral_acceleration=50.0))
    assert best.status == "converged"
    assert best.objective == pytest.approx(0.0, abs=1e-15)
    assert "No limit is active" in best.result
    np.testing.assert_allclose(best.start.velocity, START.velocity, atol=1e-9)


def test_the_rates_of_the_states_may_differ():
    end = qt.BoundaryState(END.position, 1.5 * END.velocity)
    with pytest.raises(ValueError, match="disagree"):
        qt.SpiralHelix.from_boundary(START, end)
    best = qt.tune(START, end, LIMITS)
    assert best.status == "converged", best.result
    assert float(best.path.angle[1]) > 0, "ω keeps its sign"


@pytest.mark.parametrize(("sense", "turns"), [(-1.0, 0), (1.0, 1)])
def test_sense_and_whole_turns(sense, turns):
    """Mirrored in the plane y = 0 the problem and its solution are mirrored; whole turns are kept."""
    mirror = np.array([1.0, sense, 1.0])
    start = qt.BoundaryState(START.position * mirror, START.velocity * mirror)
    end = qt.BoundaryState(END.position * mirror, END.velocity * mirror)
    limits = LIMITS if turns == 0 else qt.Limits(lateral_acceleration=2.2, curvature=0.06)
    best = qt.tune(start, end, limits, turns=turns)
    assert best.status == "converged", best.result
    assert float(best.path.turn) == pytest.approx(sense * (math.pi / 2 + 2 * math.pi * turns))
    if turns == 0:
        assert best.objective == pytest.approx(float(qt.tune(START, END, LIMITS).objective), rel=1e-9)


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_placement():
    placement = qt.Placement([623000.0, 4848000.0, 150.0])
    start = qt.BoundaryState(START.position + placement.origin, START.velocity)
    end = qt.BoundaryState(END.position + placement.origin, END.velocity)
    best = qt.tune(start, end, LIMITS, placement=placement)
    assert best.objective == pytest.approx(float(qt.tune(START, END, LIMITS).objective), rel=1e-6)


FAR = jnp.asarray([414_000.0, 4_874_000.0, 0.0])


def test_a_far_axis_needs_a_placement():
    """States in UTM coordinates: the world's z axis is 4900 km away."""
    start, end = (qt.BoundaryState(state.position + FAR, state.velocity) for state in (START, END))
    with pytest.raises(
        ValueError, match=r"m away from the world's z axis.* origin = \[414002\.604, 4874002\.485, 0\.0\]"
    ):
        qt.tune(start, end, LIMITS)
    best = qt.tune(start, end, LIMITS, placement=qt.axis_between(start, end))
    near = qt.tune(START, END, LIMITS, placement=qt.axis_between(START, END))
    assert best.objective == pytest.approx(float(near.objective), rel=1e-6)
    values = jax.tree.map(lambda *x: jnp.stack(x), START, start), jax.tree.map(lambda *x: jnp.stack(x), END, end)
    assert qt.tune(*values, LIMITS).code.tolist() == [qt.ResultCode.successful, qt.ResultCode.axis_far_away]


@pytest.mark.parametrize("options", [{}, {"motion": "hermite"}, {"motion": "hermite", "duration": 4.0}])
def test_local_coordinates_far_from_their_origin_need_a_placement(options):
    """34 m apart and 49 km from the axis, about which one of them seems to turn forwards and one backwards."""
    start = qt.BoundaryState([6253.5, 48488.1, 1.5], [1.0, 7.0, 0.3])
    end = qt.BoundaryState([6233.5, 48516.1, 3.0], [-9.8, -1.0, 0.1])
    with pytest.raises(ValueError, match=r"m away from the world's z axis.*axis_between"):
        qt.tune(start, end, qt.Limits(curvature=0.05), **options)


@pytest.mark.parametrize("motion", ["uniform", "hermite"])
def test_a_fixed_heading_leaves_the_speed_free(motion):
    slow = qt.Limits(curvature=0.06, lateral_acceleration=1.2)
    best = qt.tune(START, END, slow, motion=motion, fixed=("start.heading", "end.heading"))
    assert best.converged, best.result
    for given, tuned in ((START, best.start), (END, best.end)):
        before, after = (np.arctan2(*np.asarray(x.velocity)[1::-1]) for x in (given, tuned))
        assert after == pytest.approx(before, abs=1e-12)
        assert np.hypot(*tuned.velocity[:2]) < 0.95 * np.hypot(*given.velocity[:2])
    unbounded = qt.tune(START, END, slow, motion=motion)
    assert best.objective > unbounded.objective


def test_the_derivative_of_a_solution_with_fixed_headings():
    def objective(limit):
        limits, fixed = qt.Limits(lateral_acceleration=limit), ("start.heading", "end.heading")
        return qt.tune(START, END, limits, motion="hermite", fixed=fixed, starts=1).path.duration

    slope = jax.jit(jax.grad(objective))(1.2)
    h = 1e-4
    assert slope == pytest.approx(float(objective(1.2 + h) - objective(1.2 - h)) / (2 * h), rel=1e-5)


def test_a_fixed_heading_needs_a_velocity_about_the_axis():
    with pytest.raises(ValueError, match=r"a fixed heading determines start\.V_rho"):
        qt.tune(START, END, LIMITS, fixed=("start.heading", "start.V_rho"))
    with pytest.raises(ValueError, match=r"'start\.heading' is not a variable"):
        qt.tune(START, END, LIMITS, bounds={"start.heading": (0.0, 1.0)})
    outwards = qt.BoundaryState(END.position, [0.0, 5.0, 0.0])
    with pytest.raises(ValueError, match="a fixed heading needs a velocity about the axis"):
        qt.tune(START, outwards, LIMITS, motion="hermite", duration=4.0, fixed=("end.heading",))


def test_progress_is_reported():
    reports = []
    qt.tune(START, END, LIMITS, progress=reports.append)
    assert str(reports[0]).endswith(" of 8 searches")
    assert 0 < reports[0].fraction <= 1


def test_progress_of_a_batch_is_reported_a_few_times_a_second():
    reports = []
    started = time.monotonic()
    qt.tune(*stacked(12), starts=4, progress=reports.append)
    assert 1 <= len(reports) <= 2 + (time.monotonic() - started) / 0.25


IMPOSSIBLE = qt.Limits(curvature=0.02, lateral_acceleration=2.2)


@pytest.fixture(scope="module")
def impossible():
    return qt.tune(START, END, IMPOSSIBLE, bounds=SHORT_DURATION, starts=3)


def test_an_impossible_limit_is_explained(impossible):
    best = impossible
    assert best.status == "infeasible"
    assert not best.converged
    assert not best.certificate.met
    assert "no boundary velocities were found that satisfy the limits (54 starts tried)" in best.result
    assert "The limit on curvature can be satisfied alone; no path was found that satisfies all limits" in best.result
    assert qt.tune(START, END, qt.Limits(curvature=0.02), bounds=SHORT_DURATION).certificate.met
    assert "What would help: raise curvature to" in best.result
    # The remedy does help.
    needed = float(best.result.split("raise curvature to ")[1].split(" ")[0])
    solved = qt.tune(START, END, qt.Limits(curvature=needed, lateral_acceleration=2.2), bounds=SHORT_DURATION)
    assert solved.certificate.met, solved.result


@pytest.mark.parametrize("transform", [lambda f: f, pytest.param(jax.jit, marks=pytest.mark.slow)])
def test_only_infeasible_problems_are_tried_from_more_starts(transform):
    """An ill-posed problem is not tried."""
    start = jax.tree.map(lambda x: jnp.stack([x] * 3), START)
    ends = jax.vmap(qt.BoundaryState)(jnp.stack([END.position] * 2 + [START.position]), jnp.stack([END.velocity] * 3))

    def tuned(curvature):
        limits = jax.vmap(lambda k: qt.Limits(curvature=k, lateral_acceleration=2.2))(curvature)
        return qt.tune(start, ends, limits, bounds=SHORT_DURATION, starts=1)

    many = transform(tuned)(jnp.array([0.06, 0.02, 0.05]))
    assert many.status.tolist() == ["converged", "infeasible", "ill-posed"]
    assert many.starts_tried.tolist() == [1, 52, 0]
    assert str(many).startswith("3 tunings from 0 … 52 starts each: 1 converged, 1 infeasible, 1 ill-posed")


@pytest.mark.slow
def test_conflicting_limits_are_distinguished_from_impossible_ones():
    """At fixed duration, curvature alone can be met, and lateral acceleration cannot."""
    best = qt.tune(START, END, LIMITS, objective="smoothest", duration=math.pi / 2 / RATE)
    assert best.status == "infeasible"
    assert "The limit on curvature can be satisfied alone; no path was found that satisfies all limits" in best.result
    assert (
        "The limit on lateral_acceleration was not satisfied, even as the only limit (59 starts tried)" in best.result
    )
    assert "longer duration" in best.result


@pytest.mark.slow
def test_the_advised_limits_can_be_met():
    """The binormal flips near the end, between the samples: the search must not miss that peak."""

    def state(radius, azimuth, height, velocity):
        c, s = math.cos(azimuth), math.sin(azimuth)
        turned = [c * velocity[0] - s * velocity[1], s * velocity[0] + c * velocity[1], velocity[2]]
        return qt.BoundaryState([radius * c, radius * s, height], turned)

    start = state(12.10862503, 0.346097279, 0.0, (0.958982947, 6.408680674, 0.348393623))
    end = state(14.74777406, 3.074427696, -0.208613192, (1.923014338, 9.346460724, -0.151097611))
    given = {"longitudinal_acceleration": 1.4369171989, "curvature": 0.0489412393, "angular_rate": 0.6101825845}
    options = {"motion": "hermite", "bounds": {"duration": (4.0534807776, 5.4236823257)}}
    best = qt.tune(start, end, qt.Limits(**given), **options)
    assert best.status == "infeasible"
    assert np.all(np.asarray(best.certificate.values) < 1.2 * np.asarray(best.certificate.limits))
    alone = "The limit on angular_rate can be satisfied alone; no path was found that satisfies all limits"
    assert best.certificate.status["angular_rate"] == "proved" or alone in best.result
    assert qt.tune(start, end, qt.Limits(angular_rate=given["angular_rate"]), **options).certificate.met
    advised = {name: float(number) for name, number in re.findall(r"(\w+) to (\S+) (?:1/m|m/s²|rad/s)", best.result)}
    assert set(advised) <= set(given)
    assert advised
    assert qt.tune(start, end, qt.Limits(**{**given, **advised}), **options).certificate.met
    curvature = qt.Limits(curvature=0.04894123934727429)  # only a few starts lead to this path
    assert qt.tune(start, end, curvature, **options).status == "converged"
    assert "even as the only limit" not in best.result
    for name in given:
        if f"{name} can be satisfied alone" in best.result:
            assert qt.tune(start, end, qt.Limits(**{name: given[name]}), **options).certificate.met


FAR_APART = (
    qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 5.0, 1.0]),
    qt.BoundaryState([0.0, 12.0, 2.0], [-6.0, 0.0, 1.0]),
)


@pytest.mark.parametrize("limit", [*(pytest.param(x, marks=pytest.mark.slow) for x in (1e-3, 1e-6)), 1e-300])
def test_a_limit_far_out_of_reach_is_infeasible(limit):
    best = qt.tune(*FAR_APART, qt.Limits(curvature=limit), starts=2)
    assert best.status == "infeasible", best.result
    assert np.all(np.isfinite(best.path.radius))
    assert "raise curvature to 0." in best.result


def test_a_default_bound_that_is_reached_is_reported():
    """A very low curvature needs a wide loop. A bound set by the user gives no warning."""
    best = qt.tune(*FAR_APART, qt.Limits(curvature=0.01))
    assert best.status == "converged", best.result
    assert "duration reached the default bounds of the search" in best.result
    bounded = qt.tune(*FAR_APART, qt.Limits(curvature=0.06), bounds={"duration": (None, 2.0)})
    assert float(bounded.path.duration) == pytest.approx(2.0, rel=1e-6)
    assert "default bounds" not in bounded.result


@pytest.mark.parametrize("weight", [1.0, 10.0])
def test_without_active_limits_the_rate_is_the_weighted_mean(weight):
    """ω = Σ w ρ V_φ / Σ w ρ², which the first step reaches exactly, or only nearly."""
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, 5.0, 1.0])
    end = qt.BoundaryState([0.0, 10.0, 2.0], [-5.122, 0.0, 1.0])
    best = qt.tune(start, end, qt.Limits(curvature=1.0), weights={"start.V_phi": weight}, starts=1)
    assert best.status == "converged"
    rate = (weight * 5.0 + 5.122) / (10 * (weight + 1))
    assert float(best.path.angle[1]) == pytest.approx(rate, rel=1e-11)


def test_a_user_turn_may_oppose_the_sense_of_the_start():
    start = qt.BoundaryState([10.0, 0.0, 0.0], [0.0, -0.5, 1.0])
    end = qt.BoundaryState([0.0, 10.0, 2.0], [-6.0, 0.0, 1.0])
    given = qt.SpiralHelix.hermite(start, end, 3.0)
    wide = qt.Limits(curvature=1e3, lateral_acceleration=1e3)
    best = qt.tune(start, end, wide, motion="hermite", duration=3.0, turn=given.turn)
    assert float(best.path.turn) == pytest.approx(math.pi / 2)
    np.testing.assert_allclose(best.path.angle, given.angle, atol=1e-9)
    assert float(qt.tune(start, end, wide, motion="hermite", duration=3.0).path.turn) < 0


def test_a_path_through_its_own_axis_gives_a_warning():
    start = qt.BoundaryState([10.0, 0.0, 0.0], [-30.0, 5.0, 0.0])
    end = qt.BoundaryState([0.0, 10.0, 0.0], [-5.0, 30.0, 0.0])
    best = qt.tune(start, end, qt.Limits(curvature=1e3, lateral_acceleration=1e4))
    assert "crosses its own axis" in best.result


def test_the_outcome_passes_through_jit():
    best = qt.tune(START, END, LIMITS)
    assert jax.jit(lambda best: best.path.position(0.0))(best).shape == (3,)
    assert jax.jit(lambda best: best)(best).certificate.status == best.certificate.status


def test_too_few_steps_are_reported():
    best = qt.tune(START, END, LIMITS, starts=1, max_steps=1)
    assert best.status == "not converged"
    assert "max_steps" in best.result


@pytest.mark.parametrize(
    ("change", "fragment"),
    [
        ({"motion": "circular"}, "'uniform' or 'hermite'"),
        ({"objective": "cheapest"}, "'nearest', 'fastest', 'smoothest'"),
        ({"limits": qt.Limits()}, "no limit was given"),
        ({"objective": "fastest", "limits": qt.Limits(curvature=0.05)}, "there is no fastest path"),
        ({"duration": 5.0}, "the duration follows from the tuned angular rate"),
        ({"duration": -5.0, "motion": "hermite"}, "must be positive"),
        ({"turns": -1}, "must be 0 or more, but -1 was given"),
        ({"turn": 1.0}, "does not lead from the azimuth of the start"),
        ({"end": START}, "same azimuth"),
        ({"start": qt.BoundaryState([20.0, 0, 0], [1.0, 0.0, 0.3])}, "sense of rotation is unknown"),
        ({"start": qt.BoundaryState([0.0, 0, 0], [1.0, 7.0, 0.3])}, "axis"),
        ({"end": qt.BoundaryState(END.position, -END.velocity)}, "opposite senses"),
        ({"start": qt.BoundaryState(START.position, START.velocity, [0.0, 0, 0])}, "accelerations"),
        ({"fixed": ["start.V_phi"]}, "'start.V_phi' is not a variable of this problem (in uniform motion V_phi"),
        ({"fixed": ["duration"], "bounds": {"duration": (4.0, 5.0)}}, "duration is both fixed and bounded"),
        ({"bounds": {"end.V_h": (1.0, -1.0)}}, "the bounds of end.V_h contradict"),
        ({"bounds": {"duration": (-1.0, 5.0)}}, "must be positive"),
        ({"weights": {"end.V_h": -1.0}}, "must be finite and 0 or more"),
        ({"weights": {"end.V_h": 1.0}, "objective": "smoothest"}, "weights apply to objective='nearest'"),
        ({"weights": {"duration": 2.0}}, "'duration' cannot be weighted"),
        ({"method": "newton"}, "'sqp', 'lbfgs' or 'adam'"),
        ({"starts": 0}, "must be 1 or more"),
        ({"objective": lambda path: path.duration * jnp.nan}, "the objective must be finite"),
    ],
)
def test_invalid_arguments_raise_with_a_reason(change, fragment):
    arguments = {"start": START, "end": END, "limits": LIMITS} | change
    with pytest.raises(ValueError) as caught:
        qt.tune(**arguments)
    assert fragment in str(caught.value)


def test_the_outcome_is_stored_exactly(tmp_path):
    best = qt.tune(START, END, LIMITS)
    best.save(tmp_path / "best.json")
    solved = qt.load(tmp_path / "best.json")
    for a, b in zip(jax.tree.leaves(solved), jax.tree.leaves(best), strict=True):
        assert np.all(np.asarray(a) == np.asarray(b))


def test_the_advised_change_of_a_number_helps(impossible):
    assert impossible.status == "infeasible"
    advised = float(impossible.result.split("change the turn from 1.571 to ")[1].split(" ")[0])
    turn = advised - 0.01  # printed with four digits
    cos, sin = math.cos(turn), math.sin(turn)
    position = jnp.asarray([28.0 * cos, 28.0 * sin, 1.5])
    velocity = jnp.asarray([-cos - RATE * 28 * sin, -sin + RATE * 28 * cos, 0.1])
    solved = qt.tune(START, qt.BoundaryState(position, velocity), IMPOSSIBLE, bounds=SHORT_DURATION)
    assert solved.converged, solved.result


def velocities(path):
    """Cylindrical velocities (V_ρ, V_φ, V_h) at both ends, and the duration."""
    ends = [cylindrical(path.state(t), path.placement).velocity for t in (0.0, path.duration)]
    return {
        **{f"start.{name}": float(v) for name, v in zip(COMPONENTS, ends[0], strict=True)},
        **{f"end.{name}": float(v) for name, v in zip(COMPONENTS, ends[1], strict=True)},
        "duration": float(path.duration),
    }


COMPONENTS = ("V_rho", "V_phi", "V_h")


def test_variables_are_fixed_bounded_and_weighted_by_name():
    given = {"start.V_rho": 1.0, "end.V_h": 0.1}
    unbounded = velocities(qt.tune(START, END, LIMITS, starts=2).path)
    assert unbounded["start.V_rho"] != pytest.approx(1.0, abs=1e-3)
    best = qt.tune(START, END, LIMITS, starts=2, fixed=tuple(given), bounds={"duration": (None, 5.7)})
    assert best.converged, best.result
    tuned = velocities(best.path)
    for name, value in given.items():
        assert tuned[name] == pytest.approx(value, abs=1e-12)
    assert tuned["duration"] == pytest.approx(5.7, abs=1e-7)
    assert unbounded["duration"] > 5.7
    weighted = velocities(qt.tune(START, END, LIMITS, starts=2, weights={"end.V_rho": 100.0}).path)
    assert abs(weighted["end.V_rho"] + 1.0) < 0.5 * abs(unbounded["end.V_rho"] + 1.0)


def stacked(count):
    """Problems that differ in the end's position and in the limits."""
    shifts = jnp.linspace(0.0, 3.0, count)
    ends = jax.vmap(lambda s: qt.BoundaryState(END.position + jnp.stack([s * 0, s, s / 3]), END.velocity))(shifts)
    starts = jax.vmap(lambda s: qt.BoundaryState(START.position + 0 * s, START.velocity))(shifts)
    limits = jax.vmap(lambda s: qt.Limits(curvature=0.048 - 0.001 * s, lateral_acceleration=2.2 + 0 * s))(shifts)
    return starts, ends, limits


@pytest.fixture(scope="module")
def many():
    """The outcomes of five problems."""
    return qt.tune(*stacked(5), starts=2)


def test_a_batch_equals_its_elements(many):
    starts, ends, limits = stacked(5)
    assert len(many) == 5
    assert list(many.status) == ["converged"] * 5, many.result
    assert "proved to be satisfied on the whole path" in many.result[3]
    for k in (0, 4):
        one = qt.tune(*(jax.tree.map(lambda x, k=k: x[k], part) for part in (starts, ends, limits)), starts=2)
        np.testing.assert_allclose(many[k].path.radius, one.path.radius, atol=1e-9)
        assert float(many.objective[k]) == pytest.approx(float(one.objective), rel=1e-9)
        assert many[k].certificate.status == one.certificate.status
    with pytest.raises(ValueError, match=r"a file can contain only one result, but this is a batch of 5"):
        many.save("many.toml")
    with pytest.raises(ValueError, match="pass all data with the same batch shape"):
        qt.tune(starts, ends, jax.vmap(lambda k: qt.Limits(curvature=k, lateral_acceleration=k))(jnp.ones(3)))


def test_advice_on_an_element_is_computed_on_request():
    starts, ends, limits = stacked(2)
    limits = jax.tree.map(lambda x: x.at[1].set(0.2 * x[1]), limits)
    many = qt.tune(starts, ends, limits, starts=1)
    one = qt.tune(*(jax.tree.map(lambda x: x[1], each) for each in (starts, ends, limits)), starts=1)
    assert list(many.status) == ["converged", "infeasible"]
    assert "What would help: raise" in many.result[1]
    assert many[1].result == many.result[1]
    assert re.sub(r"[\d.]+", "", many.result[1]) == re.sub(r"[\d.]+", "", one.result)
    assert jax.tree.map(lambda x: x[::-1], many).result[0] == many.result[1]
    # Batches can be joined, but only the elements of the first keep their advice.
    others = qt.tune(starts, ends, limits, starts=1, max_steps=2)
    values = jax.tree.map(lambda *x: jnp.concatenate(x), many, others)
    assert values.result[1] == many.result[1]
    assert "tune this problem alone" in values.result[3]


def test_an_ill_posed_element_of_a_batch_has_its_own_result():
    starts, ends, limits = stacked(6)
    positions = starts.position.at[1].set(0.0).at[2, 1].set(jnp.nan)
    velocities = starts.velocity.at[3].set(0.0).at[4].set(jnp.asarray([1.0, 0.0, 0.0]))
    bad = jax.vmap(qt.BoundaryState)(positions, velocities)
    limits = jax.tree.map(lambda x: x.at[5].set(-x[5]), limits)
    codes = [
        qt.ResultCode.successful,
        qt.ResultCode.position_on_axis,
        qt.ResultCode.state_not_finite,
        qt.ResultCode.sense_unknown,
        qt.ResultCode.sense_unknown,
        qt.ResultCode.limit_not_positive,
    ]
    many = qt.tune(bad, ends, limits)
    assert many.code.tolist() == codes
    assert list(many.status) == ["converged", *["ill-posed"] * 5]
    assert many.result[1] == f"ill-posed: {qt.ResultCode.position_on_axis.text}"
    assert np.all(np.isnan(many.path.radius[1:]))
    assert not np.any(many.certificate.code[1:] < qt.ResultCode.not_converged)
    assert float(many.objective[0]) == pytest.approx(float(qt.tune(*stacked(1)).objective[0]), rel=1e-9)
    traced = jax.jit(jax.vmap(lambda a, b, limits: qt.tune(a, b, limits, starts=1).code))(bad, ends, limits)
    assert traced.tolist() == codes
    with pytest.raises(RuntimeError, match="element 1 of the batch: ill-posed: a boundary position lies on the axis"):
        qt.tune(bad, ends, limits, throw=True)


@pytest.mark.slow
def test_the_solution_is_differentiable_in_its_data():
    """The derivatives by the implicit function theorem agree with finite differences."""

    def duration(radius, rate, curvature):
        position, velocity = jnp.asarray(START.position), jnp.asarray(START.velocity)
        start = qt.BoundaryState(position.at[0].set(radius), velocity.at[1].set(rate * 20))
        return qt.tune(start, END, qt.Limits(curvature=curvature), starts=1).path.duration

    evaluate = (20.0, RATE, 0.048)

    @jax.jit
    def values(*evaluate):
        """The value, and reverse-mode and forward-mode derivatives from one linearisation."""
        value, push = jax.linearize(duration, *evaluate)
        return value, jax.linear_transpose(push, *evaluate)(jnp.ones_like(value)), push(1.0, 0.0, 0.0)

    value, gradient, forward = values(*evaluate)
    assert float(value) == pytest.approx(float(duration(*evaluate)), rel=1e-12)
    for k, (slope, size) in enumerate(zip(gradient, (1e-3, 1e-5, 1e-6), strict=True)):
        higher, lower = (values(*evaluate[:k], evaluate[k] + sign * size, *evaluate[k + 1 :])[0] for sign in (1, -1))
        assert float(slope) == pytest.approx(float(higher - lower) / (2 * size), rel=2e-5)
    assert float(forward) == pytest.approx(float(gradient[0]), rel=1e-9)


def test_a_batch_has_a_length_and_shares_unbatched_data(many):
    starts, _, limits = stacked(5)
    assert len(list(many)) == 5
    with pytest.raises(IndexError, match="there are 5 problems"):
        many[5]
    with pytest.raises(ValueError, match="pass all data with the same batch shape"):
        qt.tune(START, END, limits)
    shared = qt.tune(starts, END, LIMITS, starts=1)
    np.testing.assert_array_equal(shared.end.position[1], END.position)


def test_velocities_that_all_vanish_raise():
    still = qt.BoundaryState(START.position, [0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="not all zero"):
        qt.tune(still, qt.BoundaryState(END.position, [0.0, 0, 0]), LIMITS, motion="hermite", duration=4.0, turn=1.0)


@pytest.mark.parametrize(("steps", "steps_text"), [(1, "1 step"), (2, "2 steps"), (0, "0 steps")])
@pytest.mark.parametrize("status", ["converged", "not converged"])
def test_the_plural_of_step(status, steps, steps_text):
    path = qt.SpiralHelix([10.0], [0.0, 0.4], [0.0, 0.5], 5.0)
    ends = path.state(0.0), path.state(path.duration)
    code = {"converged": qt.ResultCode.successful, "not converged": qt.ResultCode.not_converged}[status]
    result = qt.Tuned(path, *ends, 0.0, qt.certify(path, qt.Limits(speed=9.0)), code, steps)
    assert f"{status} {'after' if ' ' in status else 'in'} {steps_text}: " in result.result
    assert f", {steps_text};" in repr(result)


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="only Linux lists memory maps")
@pytest.mark.parametrize("motion", ["uniform", pytest.param("hermite", marks=pytest.mark.slow)])
def test_other_sets_of_limits_compile_nothing(motion):
    """A dozen sets of one, two and three limits: each compilation would keep about 1500 memory maps."""
    loose = {"curvature": 0.06, "speed": 12.0, "acceleration": 9.0, "jerk": 20.0, "slope": 0.5, "yaw_rate": 1.0}
    sets = [given for k in (1, 2, 3) for given in list(itertools.combinations(loose, k))[:4]]

    def tuned(given):
        limits = qt.Limits(**{name: loose[name] for name in given})
        return qt.tune(START, END, limits, motion=motion, bounds=SHORT_DURATION, starts=1)

    tuned(sets[0])
    before = len(Path("/proc/self/maps").read_text().splitlines())
    for given in sets[1:]:
        assert tuned(given).certificate.names == tuple(name for name in QUANTITIES if name in given)
    assert len(Path("/proc/self/maps").read_text().splitlines()) - before < 100


def test_a_slow_path_is_found_where_only_slow_paths_satisfy_the_limits():
    start = qt.BoundaryState([33.056113024448955, 0, 0], [-1.3368157653904151, 6.732633155459598, -0.3152318591037186])
    end = qt.BoundaryState(
        [15.693203358995527, 30.951362349340478, 1.3232649454582903],
        [-6.473727320390239, 1.1493243161483648, 0.1694074595445203],
    )
    limits = qt.Limits(slope=0.023696277674519324, curvature=0.057509988890773314, speed=5.824460926884738)
    found = qt.tune(start, end, limits, starts=2)
    assert found.converged, found.result
    assert set(found.certificate.status.values()) == {"proved"}
    assert "duration reached the default bounds" in found.result


HIDDEN = {  # limits 1 % above the peaks of a path that a random search found, at most 0.8 of those of the initial path
    "sqp": hard.Posed(
        np.array([19.41603873, 0.0, 0.0]),
        np.array([1.56749173, 8.06178158, 0.16052632]),
        np.array([-22.72203286, 16.56401171, 0.63629733]),
        np.array([-3.61227337, -7.34320308, 0.21203502]),
        7.4047999752662,
        np.array([3.7023999876331, 44.4287998515972]),
        np.array([0.01749032, 1.78222987]),
    ),
    "adam": hard.Posed(
        np.array([27.94686716, 0.0, 0.0]),
        np.array([1.96046696, -7.50641978, 0.28913971]),
        np.array([-24.06381396, -10.88263701, -0.84698594]),
        np.array([-1.40917682, 7.60106133, -0.29901385]),
        9.837011361248205,
        np.array([4.9185056806241, 59.02206816748923]),
        np.array([0.01901061, 2.02388069]),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "method"), [("sqp", "sqp"), ("adam", optax.adam(1e-2))], ids=["sqp", "adam"])
def test_more_starts_are_not_worse(name, method):
    """The planned starts alone need searches for the smallest violation, which lead to better paths than others."""
    few, many = (hard.costs(hard.tuned([HIDDEN[name]], *way)[0]) for way in (("sqp", 8), (method, 64)))
    assert np.all(np.isfinite(few))
    assert np.all(many <= few * (1 + RTOL))
