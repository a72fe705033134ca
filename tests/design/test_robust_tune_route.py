"""Robust tuning of routes: the share in independent samples, what deviates, and refusals."""

from typing import Any

import numpy as np
import pytest
from scipy.special import ndtri

import qtraj as qt
from qtraj.design.robust.driven_route import driven_route

SAMPLES, INSTANTS = 20_000, 65
BUS = qt.Vehicle(mass=9000.0)
LIMITS = qt.Limits(lateral_acceleration=1.6, speed=6.6)
SPREAD = qt.Spread(start_velocity=0.06, end_position=0.1, end_velocity=0.06, limits={"lateral_acceleration": 0.03})


def turn(joints=5):
    """A turn with 6 m/s and a radius of 20 m, whose lateral acceleration is 1.8 m/s²."""
    t = np.linspace(0.0, 8.0, joints)
    r = 20 * np.stack([np.sin(0.3 * t), np.cos(0.3 * t), 0 * t], axis=1)
    v = 6 * np.stack([np.cos(0.3 * t), -np.sin(0.3 * t), 0 * t], axis=1)
    return qt.Route(t, r, v, -0.09 * r)


def robust(route: Any = None, limits=LIMITS, spread: Any = SPREAD, **options: Any):
    """A call with defaults; all states may change."""
    given: Any = {"fixed": np.zeros(5, bool)} | options
    return qt.robust_tune_route(turn() if route is None else route, limits, spread, **given)


@pytest.fixture(scope="module")
def solved():
    return robust(samples=2048)


def test_the_share_holds_in_independent_samples(solved):
    """Quintics between deviating states by SciPy, sampled in time: no code of the search is used."""
    assert solved.successful
    path, rng = solved.tuned.path, np.random.default_rng(5)
    times, states = np.asarray(path.times), np.asarray(path.joints())
    largest = np.zeros((SAMPLES, 2))
    for rows in ((0, 1), (1, 3), (3, 4)):
        first, last = (np.broadcast_to(states[k], (SAMPLES, 3, 3)).copy() for k in rows)
        if rows[0] == 0:
            first[:, 1] += SPREAD.start_velocity * rng.normal(size=(SAMPLES, 3))
        if rows[1] == 4:
            last[:, 0] += SPREAD.end_position * rng.normal(size=(SAMPLES, 3))
            last[:, 1] += SPREAD.end_velocity * rng.normal(size=(SAMPLES, 3))
        if rows == (1, 3):
            instants = np.linspace(times[1], times[3], INSTANTS)
            v, a = (x[None] for x in path.sampled(instants, 2)[1:])
        else:
            v, a = quintics(first, last, times[rows[1]] - times[rows[0]])
        speed = np.linalg.norm(v, axis=-1)
        level = np.hypot(v[..., 0], v[..., 1])
        lateral = np.abs(v[..., 0] * a[..., 1] - v[..., 1] * a[..., 0]) / level
        largest = np.maximum(largest, np.stack([lateral.max(axis=1), speed.max(axis=1)], axis=1))
    bounds = np.array([1.6, 6.6]) + np.array([0.03, 0.0]) * rng.normal(size=(SAMPLES, 1))
    share = (largest <= bounds).all(axis=1).mean()
    assert 0.985 <= share <= 0.995


def quintics(first, last, h):
    """Velocity and acceleration of the quintics between states (n, 3, 3), by a linear system."""
    from numpy.polynomial import polynomial

    powers = np.stack([polynomial.polyvander(np.array([0.0, h]), 5)])
    d = np.array([[[k == j for k in range(6)] for j in range(6)]], float)[0]
    derivative = [np.stack([np.pad(polynomial.polyder(row, m), (0, m)) for row in d]) for m in range(3)]
    system = np.concatenate([np.stack([powers[0] @ x.T for x in derivative])[:, k] for k in (0, 1)])
    c = np.linalg.solve(system, np.concatenate([first, last], axis=1))
    grid = polynomial.polyvander(np.linspace(0.0, h, INSTANTS), 5)
    return (grid @ derivative[1].T) @ c, (grid @ derivative[2].T) @ c


def test_the_values_of_vehicles_that_deviate_are_those_of_certify():
    """The largest friction is between the segments at the ends, so all of them must be computed for each vehicle."""
    limits, still = qt.Limits(friction=1.0, power=1e6, vehicle=qt.Vehicle(9000.0, drag_area=5.0)), np.zeros((2, 12))
    tuned = qt.tune_route(turn(), limits)
    deviations = np.array([[400.0, 2.0], [-300.0, -9.0]])
    values = driven_route(tuned, limits).largest(still, deviations)
    for row, (mass, area) in zip(values, deviations, strict=True):
        vehicle = qt.Vehicle(9000.0 + mass, drag_area=max(5.0 + area, 0.0))
        worst = qt.certify(tuned.path, qt.Limits(friction=1.0, power=1e6, vehicle=vehicle)).worst
        np.testing.assert_allclose(row, [worst[name][1] for name in ("friction", "power")], rtol=1e-9)


def test_a_limit_that_deviates_alone_is_tightened_by_a_quantile():
    found = robust(limits=qt.Limits(lateral_acceleration=1.6), spread=qt.Spread(limits={"lateral_acceleration": 0.05}))
    assert found.successful
    tight = float(np.asarray(found.limits.lateral_acceleration))
    slack = 5e-4 / (np.exp(-(ndtri(0.99) ** 2) / 2) / np.sqrt(2 * np.pi))  # of the quantile, for the accepted share
    assert tight == pytest.approx(1.6 - ndtri(0.99) * 0.05, abs=1.2 * slack * 0.05)


@pytest.mark.parametrize("joints", [2, 3, 5])
def test_the_route_without_deviations_is_the_tuned_one(joints):
    limits = qt.Limits(friction=0.3, speed=(5.0, 7.0), vehicle=BUS)
    tuned = qt.tune_route(turn(joints), limits)
    values = driven_route(tuned, limits).largest(np.zeros((2, 12)))
    expected = [float(tuned.certificate.worst[name][1]) for name in limits.given()]
    np.testing.assert_allclose(values, np.tile(expected, (2, 1)), rtol=1e-9)


@pytest.mark.parametrize("joints", [2, 4])
def test_deviating_routes_have_the_deviating_states(joints):
    """The speed at an end after a change of the velocity there is that of the state."""
    limits = qt.Limits(speed=(1.0, 9.0))
    tuned = qt.tune_route(turn(joints), limits)
    change = np.zeros((2, 12))
    change[0, 3:6] = 2.0 * np.asarray(tuned.path.joints()[0, 1]) / 6.0
    change[1, 9:] = 2.0 * np.asarray(tuned.path.joints()[-1, 1]) / 6.0
    values = driven_route(tuned, limits).largest(change)
    assert (values[:, list(limits.given()).index("speed")] >= 8.0 - 1e-6).all()


def test_results_are_saved(solved, tmp_path):
    solved.save(tmp_path / "robust.json")
    assert qt.load(tmp_path / "robust.json").result == solved.result
    assert float(solved.to_xarray().sampled_share) == float(solved.sampled_share)


def test_limits_at_fixed_ends_are_infeasible():
    found = robust(limits=qt.Limits(speed=6.05), spread=qt.Spread(start_velocity=0.2), samples=256, fixed=None)
    assert not found.successful
    assert "With tightened limits" in found.result


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: robust(3), "route must be a Route"),
        (lambda: robust(spread=0.1), "spread must be a Spread"),
        (lambda: robust(share=0.2), "from 0.5 to 0.9999, but 0.2"),
        (lambda: robust(closed=True), "a closed route has no ends"),
        (lambda: robust(limits=qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0]))), "supports only limits"),
        (lambda: robust(limits=qt.Limits(keep_out=[qt.Ball([0, 0, 0], 1.0)])), "omit keep_out"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize("call", ["robust_tune_route", "robust_tune"])
def test_unknown_options_are_named_with_the_function_that_was_called(call):
    with pytest.raises(TypeError, match=rf"^{call}\(\) got an unexpected keyword argument 'fixd'; .*'fixed'"):
        getattr(qt, call)(turn(), *([turn()] if call == "robust_tune" else []), LIMITS, SPREAD, fixd=None)
