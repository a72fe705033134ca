"""Tuned routes within limits on forces, friction, power and steering, also on roads that change along the way."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.design.route_derivatives import compare_with_automatic
from tests.design.test_tune_route import drive

import qtraj as qt
from qtraj.design.tuning_route import roads, setup
from qtraj.design.tuning_route.program import RouteProgram

G = 9.80665
CAR = qt.Vehicle(1200.0, drag_area=0.6, rolling_resistance=0.012, friction=(0.3, 0.25), bank=0.03, wheelbase=2.7)
SAMPLES = 20_001


def sampled(route, names, vehicle=None):
    t = np.linspace(0.0, float(route.duration), SAMPLES)
    return {name: np.asarray(qt.evaluate(route, t, (name,), vehicle=vehicle)[name]) for name in names}


def travelled(route):
    """The distances of the samples by sums of chords, which are 1e-7 of the length too short."""
    t = np.linspace(0.0, float(route.duration), SAMPLES)
    chords = np.linalg.norm(np.diff(np.asarray(qt.evaluate(route, t, ("position",)).position), axis=0), axis=1)
    return np.append(0.0, np.cumsum(chords))


@pytest.mark.parametrize(
    "vehicle", [CAR, qt.Vehicle(900.0, wheelbase=3.0, road=qt.Road([0, 40, 90], [0.0, 0.1, -0.1]))]
)
def test_derivatives_are_those_of_automatic_differentiation(vehicle):
    names = ("friction", "power", "lateral_force_min", "normal_load", "load_factor", "bank_angle", "steering_rate")
    bounds = np.array([0.8, 9e3, -1500.0, 1.3e4, 1.02, 0.2, 0.1])
    fields = dict(zip(names, bounds, strict=True))
    fields["lateral_force"] = (fields.pop("lateral_force_min"), 1500.0)
    route, limits = drive(6), qt.Limits(**fields, vehicle=vehicle)
    given = setup.parts(route)
    joints = len(given.h) + 1
    fixed = np.zeros((joints, 3), bool)
    road = roads.at_fine_nodes(route, limits, given)
    problem = setup.problem_of(given, names, bounds, np.full((joints, 2), 0.5), fixed, "nearest", False, road=road)
    compare_with_automatic(RouteProgram(problem), np.random.default_rng(1), 0.05)


def level(count=14):
    found = drive(count)
    flat = np.asarray(found.joints()) * [1, 1, 0]
    return qt.Route(np.asarray(found.times), *np.moveaxis(flat, 1, 0))


def test_friction_on_a_level_road_is_the_acceleration():
    """Without drag and bank, and at a constant height, the friction demand is |a|/(μ g)."""
    route, tube = level(), (0.5, 1e-5)
    car = qt.Vehicle(1500.0, friction=0.4)
    found = qt.tune_route(route, qt.Limits(friction=0.36, vehicle=car), tube)
    other = qt.tune_route(route, qt.Limits(acceleration=0.36 * 0.4 * G), tube)
    assert found.converged
    assert not qt.certify(route, qt.Limits(friction=0.36, vehicle=car)).met
    assert float(found.objective) == pytest.approx(float(other.objective), rel=2e-3)
    np.testing.assert_allclose(np.asarray(found.path.joints()), np.asarray(other.path.joints()), rtol=0, atol=2e-3)


@pytest.mark.parametrize(
    "limits",
    [
        {"friction": 0.55, "power": 5e3},
        {"lateral_force": (-1500.0, 1700.0), "normal_load": 1.3e4},
        {"steering_angle": 0.056, "steering_rate": 0.2},
        {"load_factor": 1.011, "bank_angle": 0.148},
    ],
)
def test_limits_that_need_a_vehicle_are_proved(limits):
    route, limits = drive(), qt.Limits(**limits, vehicle=CAR)
    assert not qt.certify(route, limits).met
    found = qt.tune_route(route, limits)
    assert found.converged, found.result
    assert found.certificate.holds
    for name, margin in _margins(found.path, limits).items():
        assert margin.min() >= -1e-9, name


def _margins(path, limits):
    t = np.linspace(0.0, float(path.duration), 2001)
    at = jax.jit(jax.vmap(lambda t: limits.margins(path, t)))
    return {name: np.asarray(x) for name, x in at(jnp.asarray(t)).items()}


def test_own_quantities_with_parameters_of_the_vehicle_are_tuned():
    demand = qt.Quantity("demand", "1", lambda p: p.acceleration[0] / (p.vehicle.gravity * p.vehicle.friction[0]))
    limits = qt.Limits(own={demand: (-0.1, 0.04)}, vehicle=CAR)
    found = qt.tune_route(drive(), limits)
    assert found.converged, found.result
    east = sampled(found.path, ("acceleration",))["acceleration"][:, 0] / (G * 0.3)
    assert east.max() == pytest.approx(0.04, abs=2e-4)
    assert east.max() <= 0.04 * (1 + 1e-9)


@pytest.mark.parametrize("kind", ["linear", "step"])
def test_a_slippery_part_of_the_road(kind):
    """The friction demand and the coefficient of friction at the distances of the tuned route, not of the given one."""
    road = qt.Road([0.0, 40.0, 60.0], bank=[0.0, 0.05, 0.0], friction=[0.3, 0.18, 0.3], kind=kind)
    car = qt.Vehicle(1200.0, drag_area=0.6, road=road)
    found = qt.tune_route(drive(), qt.Limits(friction=0.5, vehicle=car))
    assert found.converged, found.result
    assert found.certificate.holds
    plain = qt.Vehicle(1200.0, drag_area=0.6, friction=1.0)
    names = ("longitudinal_force", "lateral_force", "normal_load")
    x, y, z = sampled(found.path, names, plain).values()
    s = travelled(found.path)
    if kind == "linear":
        friction, bank = np.interp(s, road.distance, [0.3, 0.18, 0.3]), np.interp(s, road.distance, [0.0, 0.05, 0.0])
    else:
        row = np.searchsorted(road.distance, s, side="right") - 1
        friction, bank = np.array([0.3, 0.18, 0.3])[row], np.array([0.0, 0.05, 0.0])[row]
    across, onto = np.cos(bank) * y - np.sin(bank) * z, np.cos(bank) * z + np.sin(bank) * y
    used = np.hypot(x, across) / onto / friction
    inside = np.min(np.abs(s[:, None] - np.array(road.distance[1:])), axis=1) > 1e-3
    assert used[inside].max() <= 0.5 * (1 + 1e-5)
    assert used.max() > 0.49


def test_a_drive_with_a_stop_is_tuned_to_the_friction():
    t = np.arange(0.0, 40.0, 0.2)
    speed = np.interp(t, [0, 10, 15, 22, 28, 40], [8, 8, 0, 0, 8, 8])
    s = np.append(0.0, np.cumsum(0.1 * (speed[1:] + speed[:-1])))
    ring = np.stack([40 * np.sin(s / 40), 40 - 40 * np.cos(s / 40), 0 * s], axis=1)
    route = qt.fit_route(qt.Track(t, ring)).path
    assert len(route.stops) == 1
    limits = qt.Limits(friction=0.45, vehicle=qt.Vehicle(1200.0, friction=0.4))
    assert not qt.certify(route, limits).met
    found = qt.tune_route(route, limits, tube=(1.0, 0.01))
    assert found.converged, found.result
    assert np.nanmax(sampled(found.path, ("friction",), limits.vehicle)["friction"]) <= 0.45 * (1 + 1e-9)


def test_the_derivative_with_respect_to_the_limit_is_that_of_finite_differences():
    """To 2 %, because the derivatives refer to constant margins between the nodes."""
    route = level(6)

    def moved(friction):
        limits = qt.Limits(friction=friction, vehicle=CAR)
        return qt.tune_route(route, limits, tube=(0.5, 0.01)).objective

    slope, step = float(jax.grad(moved)(0.35)), 1e-4
    expected = (float(moved(0.35 + step)) - float(moved(0.35 - step))) / (2 * step)
    assert slope < 0
    assert slope == pytest.approx(expected, rel=0.02)


def test_derivatives_that_do_not_exist_are_refused():
    route, road = drive(4), qt.Road([0.0, 9.0], friction=[0.5, 0.4])
    for change, match in (
        (
            lambda x: qt.Limits(friction=x, vehicle=qt.Vehicle(1e3, road=road)),
            "a road that changes along the way inside jit",
        ),
        (lambda x: qt.Limits(friction=0.5, vehicle=qt.Vehicle(1e3, friction=x)), "with respect to the vehicle"),
    ):
        with pytest.raises(ValueError, match=match):
            jax.grad(lambda x, change=change: qt.tune_route(route, change(x)).objective)(0.5)


def crest(speed=14.0):
    """A drive over a crest of 3 m, at which a car loses five sixths of its load."""
    x = np.linspace(0.0, 80.0, 9)
    z, slope = 3 * np.exp(-(((x - 40) / 12) ** 2)), -(x - 40) / 72
    velocity = np.stack([1 + 0 * x, 0 * x, z * slope], -1) * speed
    acceleration = np.stack([0 * x, 0 * x, z * (slope**2 - 1 / 72)], -1) * speed**2
    return qt.Route(x / speed, np.stack([x, 0 * x, z], -1), velocity, acceleration)


def missing_load(p):
    """How much less than the weight the load on the road is, which is 0 at rest."""
    g, v, a = p.vehicle.gravity, p.velocity, p.acceleration
    along = (a.dot(v) + g * v[2]) / p.speed**2
    return p.vehicle.mass * (g - (a[2] + g - along * v[2]) * p.speed / qt.sqrt(v[0] ** 2 + v[1] ** 2))


@pytest.mark.parametrize("objective", ["nearest", "fastest"])
def test_a_least_load_on_the_road_has_the_optimum_of_the_load_that_is_missing(objective):
    car, others = qt.Vehicle(1000.0, friction=0.9), {"speed": 20.0, "acceleration": 8.0}
    limits = qt.Limits(normal_load=(6000.0, None), vehicle=car, **others)
    assert qt.certify(crest(), limits).status["normal_load_min"] == "broken"
    found = qt.tune_route(crest(), limits, tube=1.0, objective=objective)
    missing = qt.Quantity("missing_load", "N", missing_load)
    same = qt.Limits(own={missing: (None, 1000 * G - 6000)}, vehicle=car, **others)
    other = qt.tune_route(crest(), same, tube=1.0, objective=objective)
    assert found.converged, found.result
    assert found.certificate.holds
    assert qt.certify(found.path, limits).holds
    assert qt.peak(found.path, "normal_load_min", vehicle=car)[1] == pytest.approx(6000.0, rel=1e-4)
    assert float(found.objective) == pytest.approx(float(other.objective), rel=1e-3)


@pytest.mark.slow
def test_the_derivative_with_respect_to_a_least_load_is_that_of_the_optimum():
    def change(load):
        limits = qt.Limits(normal_load=(load, None), speed=20.0, acceleration=8.0, vehicle=qt.Vehicle(1000.0))
        return qt.tune_route(crest(), limits, tube=1.0).objective

    expected = (float(change(6020.0)) - float(change(5980.0))) / 40
    assert float(jax.grad(change)(6000.0)) == pytest.approx(expected, rel=5e-3)


def test_a_least_load_that_no_route_has_is_named():
    limits = qt.Limits(normal_load=(9.9e3, None), vehicle=qt.Vehicle(1000.0))
    found = qt.tune_route(crest(), limits, tube=0.01)
    assert not found.converged
    assert "normal_load_min" in str(found.result) + str(found)
