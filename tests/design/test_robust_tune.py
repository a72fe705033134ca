"""Robust tuning: the share in independent samples, closed forms, what is not tightened, and refusals."""

import jax
import numpy as np
import pytest
from scipy.special import ndtri

import qtraj as qt
from qtraj.design.robust.driven import driven

START = qt.BoundaryState([20.0, 0.0, 0.0], [0.0, 6.0, 0.0])
END = qt.BoundaryState([0.0, 22.0, 1.0], [-6.0, 0.0, 0.2])

SAMPLES, INSTANTS = 20_000, 65  # the standard deviation of the share is 0.0007

PROBLEMS = {
    "hermite": (
        qt.Limits(curvature=1 / 17, lateral_acceleration=1.5),
        qt.Spread(start_position=0.1, start_velocity=0.1, end_position=0.1, end_velocity=0.1),
        {"motion": "hermite"},
    ),
    "uniform": (
        qt.Limits(lateral_acceleration=1.7, slope=0.2),
        qt.Spread(start_velocity=[0.08, 0.05, 0.02], end_velocity=0.05, limits={"lateral_acceleration": 0.04}),
        {},
    ),
}


@pytest.fixture(scope="module", params=PROBLEMS)
def solved(request):
    """A problem and its result."""
    limits, spread, options = PROBLEMS[request.param]
    return limits, spread, qt.robust_tune(START, END, limits, spread, **options)


def test_the_share_holds_in_independent_samples(solved):
    """Paths between deviating states, by the public constructor, sampled in time: no code of the search is used."""
    limits, spread, found = solved
    assert found.successful
    assert float(found.sampled_share) == pytest.approx(0.99, abs=5e-4)
    rng, path = np.random.default_rng(7), found.tuned.path
    states = [
        np.asarray(getattr(state, name)) + np.asarray(getattr(spread, f"{end}_{name}")) * rng.normal(size=(SAMPLES, 3))
        for end, state in (("start", found.tuned.start), ("end", found.tuned.end))
        for name in ("position", "velocity")
    ]

    def between(p, v, q, w):
        return qt.SpiralHelix.hermite(qt.BoundaryState(p, v), qt.BoundaryState(q, w), path.duration)

    names = [name for name in ("curvature", "lateral_acceleration", "slope") if getattr(limits, name) is not None]
    times = np.linspace(0.0, float(path.duration), INSTANTS)
    largest = qt.evaluate(jax.jit(jax.vmap(between))(*states), times, names, reduce="max")
    satisfied = np.ones(SAMPLES, bool)
    for name in names:
        bound = float(getattr(limits, name)) + spread.limits.get(name, 0.0) * rng.normal(size=SAMPLES)
        satisfied &= np.abs(np.asarray(largest[name])) <= bound
    assert 0.987 <= satisfied.mean() <= 0.993


def test_the_path_is_within_the_tightened_limits(solved):
    limits, _, found = solved
    assert found.tuned.certificate.holds
    assert qt.certify(found.tuned.path, found.limits).holds
    for name, tight in found.limits.given().items():
        assert 0.5 * float(getattr(limits, name)) < float(tight) < float(getattr(limits, name))


@pytest.mark.parametrize("share", [0.9, 0.999])
def test_a_limit_that_deviates_alone_is_tightened_by_a_quantile(share):
    sigma = 0.05
    spread = qt.Spread(limits={"lateral_acceleration": sigma})
    options = {"share": share, "motion": "hermite", "samples": 2**14}
    found = qt.robust_tune(START, END, qt.Limits(lateral_acceleration=1.5), spread, **options)
    tight = float(found.limits.lateral_acceleration)
    assert found.tuned.certificate.active == ["lateral_acceleration"]
    slack = 5e-4 / (np.exp(-(ndtri(share) ** 2) / 2) / np.sqrt(2 * np.pi))  # of the quantile, for the accepted share
    assert tight == pytest.approx(1.5 - ndtri(share) * sigma, abs=1.2 * slack * sigma)


BUS = qt.Vehicle(mass=9000.0, drag_area=5.0)


def test_a_mass_that_deviates_alone_is_tightened_by_a_quantile():
    """A lateral force is the mass times an acceleration."""
    limits, spread = qt.Limits(lateral_force=13.5e3, vehicle=BUS), qt.Spread(mass=300.0)
    found = qt.robust_tune(START, END, limits, spread, motion="hermite", samples=2**14)
    assert found.successful
    assert float(found.limits.lateral_force) == pytest.approx(13.5e3 / (1 + ndtri(0.99) * 300.0 / 9000.0), rel=1e-3)


def test_the_values_of_vehicles_that_deviate_are_those_of_certify():
    limits = qt.Limits(friction=1.0, power=1e6, vehicle=BUS)
    tuned = qt.tune(START, END, limits, motion="hermite", starts=1)
    deviations = np.array([[400.0, 2.0], [-300.0, -9.0]])
    values = driven(tuned, limits).largest(np.zeros((2, 12)), deviations)
    for row, (mass, area) in zip(values, deviations, strict=True):
        vehicle = qt.Vehicle(9000.0 + mass, drag_area=max(5.0 + area, 0.0))
        checked = qt.certify(tuned.path, qt.Limits(friction=1.0, power=1e6, vehicle=vehicle))
        np.testing.assert_allclose(row, checked.values, rtol=1e-9)


def test_without_need_nothing_is_tightened():
    limits, spread = qt.Limits(lateral_acceleration=3.0), qt.Spread(start_velocity=0.01)
    found = qt.robust_tune(START, END, limits, spread)
    assert (float(found.factor), int(found.rounds), float(found.sampled_share)) == (0.0, 1, 1.0)
    assert found.limits is limits
    np.testing.assert_array_equal(found.tuned.path.radius, qt.tune(START, END, limits).path.radius)


def test_a_spread_that_is_too_large_is_infeasible_with_advice():
    limits, spread = qt.Limits(lateral_acceleration=1.5), qt.Spread(limits={"lateral_acceleration": 1.0})
    found = qt.robust_tune(START, END, limits, spread, samples=256)
    assert not found.successful
    assert found.result.startswith("infeasible: the spread is too large for the limits")
    with pytest.raises(RuntimeError, match="spread is too large"):
        found.check()


def test_infeasible_limits_are_explained_by_the_tuning():
    found = qt.robust_tune(START, END, qt.Limits(speed=0.01), qt.Spread(start_velocity=0.1), samples=256, starts=1)
    assert not found.successful
    assert "With tightened limits: infeasible" in found.result


@pytest.mark.parametrize("turns", [0, 1])
def test_the_path_without_deviations_is_the_tuned_path(turns):
    limits = qt.Limits(lateral_acceleration=2.0)
    tuned = qt.tune(START, END, limits, turns=turns, starts=1)
    near = driven(tuned, limits)
    assert near.turns == turns
    values = near.largest(np.zeros((2, 12)))
    assert tuple(limits.given()) == tuned.certificate.names
    np.testing.assert_allclose(values, np.tile(tuned.certificate.values, (2, 1)), rtol=1e-9)


def test_equal_seeds_give_equal_results():
    options = {"samples": 256, "starts": 1}
    factors = [float(robust(limits=qt.Limits(lateral_acceleration=1.7), seed=s, **options).factor) for s in (1, 1, 2)]
    assert factors[0] == factors[1] != factors[2]


def test_results_are_saved(solved, tmp_path):
    limits, _, found = solved
    found.save(tmp_path / "robust.json")
    same = qt.load(tmp_path / "robust.json")
    assert same.result == found.result
    data = found.to_xarray()
    assert float(data.sampled_share) == float(found.sampled_share)
    assert data.sizes["limit"] == len(limits.given())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qt.Spread(), "every standard deviation is zero.*use tune or tune_route"),
        (lambda: qt.Spread(start_velocity=-0.1), "start_velocity must contain finite standard deviations, 0 or more"),
        (lambda: qt.Spread(end_position=[0.1, 0.2]), r"end_position must be a number or \(3,\), but has the shape"),
        (lambda: qt.Spread(limits={"speed": np.nan}), "'speed'.* finite standard deviations"),
        (lambda: qt.robust_tune(START, END, qt.Limits(speed=9.0), 0.1), "spread must be a Spread"),
        (lambda: qt.Spread(mass=[1.0, 2.0]), "mass must be a number, but has the shape"),
        (lambda: robust(qt.Spread(mass=9.0)), "the vehicle deviates, but limits have none"),
        (lambda: robust(qt.Spread(mass=2e3), limits=qt.Limits(power=1e5, vehicle=BUS)), "more than 8 standard deviat"),
        (lambda: robust(share=1.0), "from 0.5 to 0.9999, but 1.0"),
        (lambda: robust(share="0.9"), "from 0.5 to 0.9999, but '0.9'"),
        (lambda: robust(samples=1000), "a power of two from 256"),
        (lambda: robust(samples=256.0), "but 256.0 was given"),
        (lambda: robust(samples=[256]), "a power of two from 256"),
        (lambda: robust(seed=-1), "seed must be an integer, 0 or more, but -1"),
        (lambda: robust(seed="a"), "seed must be an integer, 0 or more, but 'a'"),
        (lambda: robust(qt.Spread(limits={"jerk": 1.0})), "contains 'jerk', but there is no such limit"),
        (lambda: robust(limits=qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0]))), "robust_tune supports only limits"),
        (lambda: robust(limits=qt.Limits(keep_out=[qt.Ball([0, 0, 0], 1.0)])), "omit keep_out"),
        (lambda: robust(start=jax.vmap(qt.BoundaryState)(np.ones((2, 3)), np.ones((2, 3)))), "tunes one problem"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def robust(spread=None, *, start=START, limits=None, **options):
    """A call with defaults."""
    own = qt.Spread(start_velocity=0.1) if spread is None else spread
    return qt.robust_tune(start, END, qt.Limits(speed=9.0) if limits is None else limits, own, **options)
