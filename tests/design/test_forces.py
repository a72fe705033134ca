"""Limits on friction, power and forces: proofs against dense sampling, planted violations, routes, tuning."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.road_quantities import ROAD_QUANTITIES

FORCES = tuple(entry.name for entry in ROAD_QUANTITIES)
TRUCK = qt.Vehicle(12e3, None, 6.0, 0.007, (0.6, 0.5), 0.05)
PATH = qt.SpiralHelix([20.0, 1.0, 0.3, -0.05], [0.2, 0.35, 0.02, -0.004], [1.0, 0.4, 0.05, -0.01], 4.5)
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3])
END = qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.0])
SHORT = {"duration": (2.0, 8.0)}


def sampled(path, vehicle, count=20001, names=FORCES):
    times = np.linspace(0.0, float(path.duration), count)
    times[-1] = np.nextafter(times[-1], 0.0) if isinstance(path, qt.Route) else times[-1]
    table = qt.evaluate(path, times, names, vehicle=vehicle)
    return {name: np.asarray(table.values[name]) for name in names}


@pytest.mark.parametrize(
    "vehicle", [TRUCK, qt.Vehicle(1.0), qt.Vehicle(2e3, None, 0.7, 0.01, 0.9, -0.3)], ids=["bank", "point", "adverse"]
)
def test_proofs_agree_with_dense_sampling(vehicle):
    """Proved above the largest sample, broken below it, and the reported values are the largest."""
    peaks = {name: float(x.max()) for name, x in sampled(PATH, vehicle).items()}
    certificate = qt.certify(PATH, qt.Limits(**{k: (1 + 1e-5) * x for k, x in peaks.items()}, vehicle=vehicle))
    assert set(certificate.status.values()) == {"proved"}, str(certificate)
    for name, peak in peaks.items():
        found = certificate.worst[name][1]
        assert found == pytest.approx(peak, rel=1e-7), name
        assert found >= peak * (1 - 1e-12), name
    certificate = qt.certify(PATH, qt.Limits(**{k: (1 - 1e-5) * x for k, x in peaks.items()}, vehicle=vehicle))
    assert set(certificate.status.values()) == {"broken"}, str(certificate)


def test_limits_at_the_peak_are_proved_from_a_relative_gap_of_1e_9():
    for name in FORCES:
        peak = float(qt.peak(PATH, name, TRUCK)[1])
        for gap, status in ((1e-9, "proved"), (-1e-9, "broken")):
            assert qt.certify(PATH, qt.Limits(**{name: peak * (1 + gap)}, vehicle=TRUCK)).status == {name: status}


def test_a_planted_violation_between_samples_is_refuted():
    """A jerk forward and up between two of 200 instants, which needs power and grip, and presses on the road."""
    times = np.array([0.0, 5.0, 5.005, 5.01, 10.0])
    position = np.array([[15 * t, 0.0, 0.0] for t in times])
    position[2] += [2e-5, 0.0, 2e-5]
    velocity, acceleration = np.array([[15.0, 0.0, 0.0]] * 5), np.zeros((5, 3))
    route = qt.Route(times, position, velocity, acceleration)
    vehicle = qt.Vehicle(1e3)
    coarse = sampled(route, vehicle, 200, ("friction", "power", "normal_load"))
    limits = qt.Limits(friction=0.05, power=2e3, normal_load=1.1e4, vehicle=vehicle)
    assert coarse["friction"].max() < 0.05
    assert coarse["power"].max() < 2e3
    assert coarse["normal_load"].max() < 1.1e4
    certificate = qt.certify(route, limits)
    assert set(certificate.status.values()) == {"broken"}, str(certificate)
    for name in certificate.names:
        for a, b in certificate.intervals(name):
            assert 5.0 - 1e-9 <= a <= b <= 5.01 + 1e-9, name


def test_a_vehicle_that_leaves_the_road_has_no_friction_limit_proved():
    hill = qt.SpiralHelix([100.0], [0.0, 0.3], [0.0, 12.0, -6.0], 2.0)  # 12 m/s² downwards
    certificate = qt.certify(hill, qt.Limits(friction=100.0, vehicle=qt.Vehicle(1e3)))
    assert certificate.status == {"friction": "undefined"}
    assert "the load on the road vanishes" in str(certificate)


def test_a_path_about_a_tilted_axis_is_sampled():
    tilted = qt.SpiralHelix(PATH.radius, PATH.angle, PATH.height, 4.5, qt.Placement([0.0] * 3, [1.0, 0.05, 0.02, 0.0]))
    peaks = {name: float(x.max()) for name, x in sampled(tilted, TRUCK).items()}
    certificate = qt.certify(tilted, qt.Limits(**{k: 1.001 * x for k, x in peaks.items()}, vehicle=TRUCK))
    assert set(certificate.status.values()) == {"sampled"}
    for name, peak in peaks.items():
        assert certificate.worst[name][1] == pytest.approx(peak, rel=1e-6), name


def test_the_largest_power_of_a_braking_vehicle_is_negative():
    slowing = qt.SpiralHelix([100.0], [0.0, 0.3, -0.02], [0.0], 4.0)
    certificate = qt.certify(slowing, qt.Limits(power=1.0, vehicle=qt.Vehicle(1e3)))
    assert certificate.status == {"power": "proved"}
    assert certificate.worst["power"][1] == pytest.approx(sampled(slowing, qt.Vehicle(1e3))["power"].max(), rel=1e-9)


def test_a_batch_has_a_vehicle_for_each_path():
    masses = jnp.asarray([1e3, 2e3, 4e3])
    paths = jax.vmap(lambda x: qt.SpiralHelix(PATH.radius * x, PATH.angle, PATH.height, 4.5))(jnp.ones(3))
    limits = jax.vmap(lambda m: qt.Limits(normal_load=3e4, vehicle=qt.Vehicle(m)))(masses)
    values = np.asarray(qt.certify(paths, limits).values[:, 0])
    np.testing.assert_allclose(values, values[0] * np.asarray(masses) / 1e3, rtol=1e-12)


def test_values_of_certificates_are_differentiable_in_path_and_vehicle():
    def largest(x):
        path = qt.SpiralHelix(PATH.radius * x[0], PATH.angle, PATH.height, 4.5)
        return qt.certify(path, qt.Limits(friction=1.0, vehicle=qt.Vehicle(1e3, bank=x[1]))).values[0]

    x, step = jnp.asarray([1.0, 0.1]), 1e-6
    gradient = jax.grad(largest)(x)
    for k in range(2):
        e = step * jnp.eye(2)[k]
        peaks = [
            qt.peak(
                qt.SpiralHelix(PATH.radius * y[0], PATH.angle, PATH.height, 4.5),
                "friction",
                qt.Vehicle(1e3, bank=y[1]),
            )[1]
            for y in (x + e, x - e)
        ]
        assert float(gradient[k]) == pytest.approx(float(peaks[0] - peaks[1]) / (2 * step), rel=1e-6)


@pytest.fixture(scope="module")
def from_rest():
    """A route that starts and stops: from rest it accelerates, climbs, turns and brakes to rest."""
    times = np.array([0.0, 4.0, 8.0, 12.0])
    position = [[0.0, 0.0, 0.0], [12.0, 0.0, 0.3], [40.0, 8.0, 1.0], [60.0, 24.0, 1.0]]
    velocity = [[0.0, 0.0, 0.0], [6.0, 0.0, 0.2], [7.0, 3.0, 0.1], [0.0, 0.0, 0.0]]
    acceleration = [[1.5, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.6, 0.0], [-1.0, -0.8, 0.0]]
    return qt.Route(times, position, velocity, acceleration)


def test_a_route_from_rest_to_rest_is_proved_and_refuted(from_rest):
    samples = sampled(from_rest, TRUCK)
    peaks = {name: float(x[1:].max()) for name, x in samples.items()}  # at a standstill the samples have no direction
    above = qt.certify(from_rest, qt.Limits(**{k: (1 + 1e-4) * x for k, x in peaks.items()}, vehicle=TRUCK))
    assert set(above.status.values()) == {"proved"}, str(above)
    below = qt.certify(from_rest, qt.Limits(**{k: (1 - 1e-4) * x for k, x in peaks.items()}, vehicle=TRUCK))
    assert set(below.status.values()) == {"broken"}, str(below)
    for name, peak in peaks.items():
        assert above.worst[name][1] == pytest.approx(peak, rel=1e-4), name


def test_the_intervals_of_a_route_are_those_of_the_samples(from_rest):
    limits = qt.Limits(friction=0.3, vehicle=TRUCK)
    times = np.linspace(0.0, 12.0, 20001)[1:-1]
    above = np.asarray(qt.evaluate(from_rest, times, ("friction",), vehicle=TRUCK).friction) > 0.3
    inside = np.zeros_like(above)
    for a, b in qt.certify(from_rest, limits).intervals("friction"):
        inside |= (times > a) & (times < b)
    assert 0 < above.sum() < above.size
    assert (above != inside).sum() <= 2


LIMITS = {"friction": 0.42, "power": 58e3}


@pytest.fixture(scope="module")
def tuned():
    return qt.tune(START, END, qt.Limits(**LIMITS, vehicle=TRUCK), bounds=SHORT, starts=2)


def test_a_truck_whose_grip_and_power_bind_is_tuned_and_proved(tuned):
    assert tuned.converged, tuned.result
    assert tuned.certificate.holds
    assert set(tuned.certificate.active) == set(LIMITS)
    samples = sampled(tuned.path, TRUCK)
    for name, limit in LIMITS.items():
        assert samples[name].max() == pytest.approx(limit, rel=1e-6)
        assert samples[name].max() <= limit


def test_the_other_forces_are_tuned_by_the_same_search():
    limits = {"normal_load": 1.205e5, "longitudinal_force": 5e3, "lateral_force": 4.8e4}
    best = qt.tune(START, END, qt.Limits(**limits, vehicle=TRUCK), bounds=SHORT, starts=2)
    assert best.converged, best.result
    samples = sampled(best.path, TRUCK)
    for name, limit in limits.items():
        assert samples[name].max() <= limit * (1 + 1e-9), name
    assert best.certificate.active


def test_a_tuned_path_is_no_farther_than_any_that_meets_the_limits_nearby(tuned):
    """Optimality: along random directions, paths with a smaller change of velocities violate a limit."""
    problem_start, problem_end = np.asarray(tuned.start.velocity), np.asarray(tuned.end.velocity)
    assert float(tuned.objective) > 0
    rng = np.random.default_rng(3)
    towards = (np.asarray(START.velocity) - problem_start, np.asarray(END.velocity) - problem_end)
    for _ in range(4):
        part = 0.02 * rng.uniform(0.2, 1.0)
        start = qt.BoundaryState(START.position, problem_start + part * towards[0])
        end = qt.BoundaryState(END.position, problem_end + part * towards[1])
        path = qt.SpiralHelix.hermite(start, end, float(tuned.path.duration))
        samples = sampled(path, TRUCK, 2001)
        assert any(samples[name].max() > limit for name, limit in LIMITS.items())


def test_the_solution_is_differentiable_in_the_vehicle(tuned):
    def duration(grip):
        vehicle = qt.Vehicle(12e3, None, 6.0, 0.007, grip * jnp.asarray([0.6, 0.5]), 0.05)
        best = qt.tune(START, END, qt.Limits(**LIMITS, vehicle=vehicle), bounds=SHORT, starts=2)
        return best.path.duration

    slope, step = float(jax.grad(duration)(1.0)), 1e-4
    assert slope == pytest.approx((float(duration(1 + step)) - float(duration(1 - step))) / (2 * step), rel=1e-3)
    assert float(duration(1.0)) == pytest.approx(float(tuned.path.duration), rel=1e-9)


def test_advice_for_a_truck_that_cannot_meet_its_limits():
    best = qt.tune(START, END, qt.Limits(friction=0.02, vehicle=TRUCK), bounds=SHORT, starts=2)
    assert best.status == "infeasible"
    assert "raise friction to" in best.result
