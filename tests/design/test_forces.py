"""Limits on friction, power and forces: proofs against dense sampling, planted violations, routes, tuning."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt
from qtraj.path.quantity import quantity
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
    outputs = {name: quantity(name).variable for name in names}
    table = qt.evaluate(path, times, tuple(outputs.values()), vehicle=vehicle)
    return {name: np.asarray(table.values[output]) for name, output in outputs.items()}


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


def test_a_vehicle_in_float32_is_certified_in_float64():
    numbers = [np.float32(x) for x in (12e3, 6.0, 0.007, 0.05)]
    friction = np.asarray([0.6, 0.5], np.float32)
    single = qt.Vehicle(numbers[0], None, numbers[1], numbers[2], friction, numbers[3])
    double = qt.Vehicle(float(numbers[0]), None, *(float(x) for x in numbers[1:3]), friction.astype(float), numbers[3])
    found = [qt.certify(PATH, qt.Limits(friction=2.0, power=1e6, vehicle=x)) for x in (single, double)]
    np.testing.assert_allclose(found[0].values, found[1].values, rtol=1e-12)
    assert found[0].status == {"friction": "proved", "power": "proved"}


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
    assert "the load on the road is not positive" in str(certificate)


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


def test_a_parked_vehicle_has_its_weight_on_the_road():
    """Its load is m·g·cos β and its lateral force m·g·sin β; nothing else acts on it."""
    route = qt.Route([0.0, 4.0, 8.0], [[0.0, 0, 0], [0, 0, 0], [10.0, 0, 0]], np.zeros((3, 3)), np.zeros((3, 3)))
    vehicle = qt.Vehicle(1e3, friction=0.5, bank=0.1)
    weight = 1e3 * 9.80665
    exact = {"normal_load": weight * np.cos(0.1), "lateral_force": weight * np.sin(0.1), "friction": np.tan(0.1) / 0.5}
    for name, value in exact.items():
        for factor, status in ((1 + 1e-9, "proved"), (1 - 1e-9, "broken"), (1.0, "undecided")):
            findings = qt.certify(route, qt.Limits(**{name: factor * value}, vehicle=vehicle)).segments
            assert findings.status[name][0] == status, (name, factor)
            assert findings.values[0, 0] == pytest.approx(value, rel=1e-14)
    broken = qt.certify(route, qt.Limits(normal_load=0.5 * weight, speed=90.0, vehicle=vehicle))
    assert broken.status == {"normal_load": "broken", "speed": "proved"}
    assert np.asarray(broken.broken)[0] == pytest.approx([0.0, 8.0])


@pytest.mark.parametrize("rows", [1, 2], ids=["one segment", "and another"])
def test_a_single_segment_from_rest_to_rest_is_proved_and_refuted(rows):
    """A segment that stops at both ends is certified in two halves; times are those of the segment."""
    names = ("longitudinal_force", "friction", "power", "normal_load")
    extra = [[0.0, 0.0, 0.0]] * (rows - 1)
    states = [*extra, [0.0, 0.0, 0.0], [10.0, 0.0, 0.0]], np.zeros((rows + 1, 3)), np.zeros((rows + 1, 3))
    route = qt.Route(4.0 * np.arange(rows + 1), *states)  # with two rows, the vehicle first waits for 4 s
    vehicle = qt.Vehicle(1e3, friction=0.5)
    start = 4.0 * (rows - 1)
    largest = 10 / 16 * 10 / np.sqrt(3)  # [m/s²] of the quintic 10u³ − 15u⁴ + 6u⁵, at u = (1 ± 1/√3)/2
    exact = {"longitudinal_force": 1e3 * largest, "friction": largest / 9.80665 / 0.5, "normal_load": 9806.65}
    exact["power"] = float(sampled(route, vehicle)["power"].max())
    above = qt.certify(route, qt.Limits(**{k: (1 + 1e-6) * exact[k] for k in names}, vehicle=vehicle))
    assert set(above.status.values()) == {"proved"}, str(above)
    below = qt.certify(route, qt.Limits(**{k: (1 - 1e-6) * exact[k] for k in names}, vehicle=vehicle))
    assert set(below.status.values()) == {"broken"}, str(below)
    assert np.asarray(below.segments.codes).shape == (rows, 4)
    for name in ("longitudinal_force", "friction"):
        time, value, _ = below.worst[name]
        assert value == pytest.approx(exact[name], rel=1e-6), name
        u = (time - start) / 4
        assert min(abs(u - 0.5 - x / np.sqrt(12)) for x in (1, -1)) < 1e-3, name
    other = qt.certify(route, qt.Limits(longitudinal_acceleration=largest * (1 + 1e-6)))
    assert other.status == {"longitudinal_acceleration": "proved"}


def test_a_banked_road_is_refused_for_a_route_that_reverses():
    """Forwards and back over one road: its bank would change sides with the direction of motion."""
    states = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 0.0, 0.0]], np.zeros((3, 3)), np.zeros((3, 3))
    route = qt.Route([0.0, 4.0, 8.0], *states)
    banked = qt.Vehicle(1e3, bank=0.1)
    for use in (
        lambda: qt.certify(route, qt.Limits(friction=0.9, vehicle=banked)),
        lambda: qt.evaluate(route, [1.0], ("friction",), vehicle=banked),
    ):
        with pytest.raises(ValueError, match=r"the route reverses at t = .* s, but the bank"):
            use()
    level = qt.certify(route, qt.Limits(friction=0.9, vehicle=qt.Vehicle(1e3)))
    assert level.status == {"friction": "proved"}
    assert float(qt.evaluate(route.window(0.0, 4.0), [1.0], ("friction",), vehicle=banked).friction[0]) > 0.1


@pytest.mark.parametrize("friction", [0.40, 0.45])
def test_the_fastest_path_uses_the_grip_at_several_instants_and_is_proved(friction):
    """The margin of the search must be enough where both roots appear, at both ends and in between."""
    limits = qt.Limits(friction=friction, vehicle=TRUCK)
    best = qt.tune(START, END, limits, objective="fastest", motion="hermite", bounds=SHORT, starts=2, max_steps=100)
    assert best.converged, best.result
    assert best.certificate.holds
    used = sampled(best.path, TRUCK, 2001)["friction"]
    assert np.sum((used[1:-1] > 0.9999 * friction) & (used[1:-1] >= used[2:]) & (used[1:-1] >= used[:-2])) >= 1
    assert used[0] > 0.9999 * friction
    assert used.max() <= friction


def test_the_intervals_of_a_route_are_those_of_the_samples(from_rest):
    limits = qt.Limits(friction=0.3, vehicle=TRUCK)
    times = np.linspace(0.0, 12.0, 20001)[1:-1]
    above = np.asarray(qt.evaluate(from_rest, times, ("friction",), vehicle=TRUCK).friction) > 0.3
    inside = np.zeros_like(above)
    for a, b in qt.certify(from_rest, limits).intervals("friction"):
        inside |= (times > a) & (times < b)
    assert 0 < above.sum() < above.size
    assert (above != inside).sum() <= 2


def test_round_off_at_a_stop_is_not_an_interval(from_rest):
    """Every interval contains a violated sample, or the peak of its segment."""
    times = np.linspace(0.0, 12.0, 20001)[1:-1]
    for name in ("lateral_force", "normal_load", "friction"):
        values = sampled(from_rest, TRUCK, 20001, (name,))[name][1:-1]
        for part in (0.9, 0.3, 0.1):
            certificate = qt.certify(from_rest, qt.Limits(**{name: part * float(values.max())}, vehicle=TRUCK))
            violated = times[values > part * values.max()]
            for a, b in certificate.intervals(name):
                assert b - a > 1e-9
                assert np.any((violated >= a) & (violated <= b)), (name, part, a, b)


LIMITS = {"friction": 0.42, "power": 58e3}


@pytest.fixture(scope="module")
def tuned():
    return qt.tune(START, END, qt.Limits(**LIMITS, vehicle=TRUCK), bounds=SHORT, starts=2)


def test_a_truck_whose_grip_and_power_bind_is_tuned_and_proved(tuned):
    assert tuned.converged, tuned.result
    assert tuned.certificate.holds
    assert set(tuned.certificate.active) == set(LIMITS)
    assert eqx.tree_equal(tuned.vehicle, TRUCK)
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
    active = {name for name, limit in limits.items() if samples[name].max() > limit * (1 - 1e-6)}
    assert set(best.certificate.active) == active
    assert active


def uniform_paths(variables):
    """Paths of uniform rotation from (20, 0, 0) to (0, 28, 1.5) m by V_ρ and V_h at both ends and ω, and V_φ there."""
    radial, climb, rate = variables[:, 0:2], variables[:, 2:4], variables[:, 4]
    T = (np.pi / 2) / rate

    def cubic(a, b, slopes):
        mean = (b - a) / T
        second, third = (3 * mean - 2 * slopes[:, 0] - slopes[:, 1]) / T, (slopes.sum(axis=1) - 2 * mean) / T**2
        return np.stack([np.full_like(T, a), slopes[:, 0], second, third], axis=1)

    phi = np.stack([np.zeros_like(T), rate], axis=1)
    return jax.vmap(qt.SpiralHelix)(cubic(20.0, 28.0, radial), phi, cubic(0.0, 1.5, climb), T)


def test_a_tuned_path_is_no_farther_than_any_that_meets_the_limits_nearby(tuned):
    """Optimality: of random paths nearby, in all five variables, those within the limits are farther."""
    rng = np.random.default_rng(3)
    first, last = np.asarray(tuned.start.velocity), np.asarray(tuned.end.velocity)  # at azimuths 0 and 90°
    best = np.array([first[0], last[1], first[2], last[2], (np.pi / 2) / float(tuned.path.duration)])
    directions = rng.normal(size=(1000, 5)) * [1.0, 1.0, 1.0, 1.0, 0.05]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    variables = np.concatenate([best[None], best + directions * 10.0 ** rng.uniform(-3, -1, (1000, 1))])

    def objective(x):
        change = x[:, :4] - [1.0, -1.0, 0.3, 0.0]
        return np.sum(change**2, axis=1) + (20 * x[:, 4] - 7.0) ** 2 + (28 * x[:, 4] - 9.8) ** 2

    assert objective(variables)[0] == pytest.approx(float(tuned.objective), rel=1e-9)
    paths = uniform_paths(variables)
    times = np.linspace(0.0, 1.0, 501) * np.asarray(paths.duration)[:, None]
    table = qt.evaluate(paths, times, tuple(LIMITS), vehicle=TRUCK)
    used = np.max([np.asarray(table.values[name]).max(axis=1) / limit for name, limit in LIMITS.items()], axis=0)
    assert used[0] == pytest.approx(1.0, rel=1e-5)
    within = used < 1 - 1e-9
    assert 20 < within.sum() < 980
    assert np.all(objective(variables)[within] > float(tuned.objective) * (1 - 1e-8))
    nearer = objective(variables) < float(tuned.objective)
    assert nearer.sum() > 100  # these exist, but violate a limit


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
