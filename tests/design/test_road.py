"""Limits on forces of a road whose bank and friction change along the way: closed forms, and dense sampling."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import qtraj as qt

G, RADIUS, SPEED = 9.80665, 100.0, 15.0
CLOSE = 1e-6
NAMES = ("friction", "lateral_force", "normal_load", "power", "longitudinal_force")


def circle(radius=RADIUS, speed=SPEED, duration=40.0):
    return qt.SpiralHelix([radius], [0.0, speed / radius], [0.0], duration)


def straight(*bank, length=100.0):
    """A straight road of constant speed, and a vehicle on the bank at its ends."""
    route = qt.Route(
        [0.0, 4.0, 10.0], [[0, 0, 0], [0.4 * length, 0, 0], [length, 0, 0]], [[10, 0, 0]] * 3, [[0, 0, 0]] * 3
    )
    return route, qt.Vehicle(1000.0, road=qt.Road([0.0, length], bank=bank))


def loop(radius=10.0, speed=15.0, segments=64):
    """A loop in the plane of x and z, on which the top is passed at half of the duration."""
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    sin, cos, zero = np.sin(angle), np.cos(angle), 0 * angle
    position = radius * np.stack([sin, zero, 1 - cos], axis=1)
    velocity = speed * np.stack([cos, zero, sin], axis=1)
    acceleration = speed**2 / radius * np.stack([-sin, zero, cos], axis=1)
    return qt.Route(angle * radius / speed, position, velocity, acceleration)


def random_route(rng):
    """A smooth route through random points, not nearly vertical."""
    count = rng.integers(4, 8)
    x = np.cumsum(rng.uniform(25.0, 45.0, count))
    points = np.stack([x, rng.uniform(-12, 12, count), rng.uniform(-2, 2, count)], axis=1)
    times = np.append(0.0, np.cumsum(rng.uniform(2.0, 4.0, count - 1)))
    velocity = np.gradient(points, times, axis=0)
    acceleration = rng.uniform(-0.5, 0.5, points.shape)
    return qt.Route(times, points, velocity, acceleration)


def random_road(rng, length):
    count = rng.integers(2, 6)
    distance = np.append(0.0, np.sort(rng.uniform(0.05, 1.1, count - 1)) * length)
    parts = {"bank": rng.uniform(-0.25, 0.25, count), "friction": rng.uniform(0.4, 1.0, (count, 2))}
    kept = {name: x for name, x in parts.items() if rng.uniform() < 0.8} or parts
    return qt.Road(distance, kind=str(rng.choice(["linear", "step"])), **kept)


def sampled(path, vehicle, name, count=4001):
    times = np.linspace(0.0, float(path.duration), count)
    return np.asarray(getattr(qt.evaluate(path, times, (name,), frame=qt.Upright(), vehicle=vehicle), name))


def test_no_friction_is_needed_on_a_circle_with_the_bank_of_its_speed():
    bank = np.arctan(SPEED**2 / (G * RADIUS))
    road = qt.Road([0.0, 100.0, 300.0, 400.0], bank=[bank, bank, bank, -0.1])
    path, vehicle = circle(duration=19.0), qt.Vehicle(1000.0, road=road)
    certificate = qt.certify(path, qt.Limits(friction=1e-6, normal_load=(1000 * G, 1.2e4), vehicle=vehicle))
    assert certificate.holds
    load = sampled(path, vehicle, "normal_load")
    np.testing.assert_allclose(load, 1000 * np.hypot(G, SPEED**2 / RADIUS), rtol=1e-12)
    assert qt.certify(circle(duration=26.0), qt.Limits(friction=1e-6, vehicle=vehicle)).status["friction"] == "broken"


@pytest.mark.parametrize("factor", [1 - CLOSE, 1 + CLOSE])
def test_the_extreme_of_a_side_slope_is_decided_exactly(factor):
    route, vehicle = straight(0.0, 0.3)
    limits = qt.Limits(
        friction=np.tan(0.3) * factor,
        lateral_force=1000 * G * np.sin(0.3) * factor,
        normal_load=(1000 * G * np.cos(0.3) / factor, None),
        vehicle=vehicle,
    )
    certificate = qt.certify(route, limits)
    assert set(certificate.status.values()) == {"proved" if factor > 1 else "broken"}


@pytest.mark.parametrize("factor", [1 - CLOSE, 1 + CLOSE])
def test_the_extreme_within_a_linear_piece_is_decided_exactly(factor):
    """The bank of the speed is passed on the way, where the friction demand is zero and the load largest."""
    bank = np.arctan(SPEED**2 / (G * RADIUS))
    vehicle = qt.Vehicle(1.0, road=qt.Road([0.0, 500.0], bank=[bank - 0.2, bank + 0.3]))
    largest = np.hypot(G, SPEED**2 / RADIUS)
    certificate = qt.certify(circle(duration=30.0), qt.Limits(normal_load=(None, largest * factor), vehicle=vehicle))
    assert certificate.status["normal_load_max"] == ("proved" if factor > 1 else "broken")
    assert certificate.worst["normal_load_max"][1] == pytest.approx(largest, rel=1e-9)


def test_friction_is_demand_divided_by_what_is_available():
    route, _ = straight(0.0, 0.0)
    vehicle = qt.Vehicle(1000.0, bank=0.1, road=qt.Road([0, 30, 50], friction=[0.8, 0.4, 0.8]))
    times = np.array([0.0, 3.0, 4.0, 8.0])
    found = qt.evaluate(route, times, ("friction",), vehicle=vehicle).friction
    np.testing.assert_allclose(found, np.tan(0.1) / np.array([0.8, 0.4, 0.6, 0.8]), rtol=1e-12)
    certificate = qt.certify(route, qt.Limits(friction=0.2, vehicle=vehicle))
    assert certificate.status["friction"] == "broken"
    assert certificate.worst["friction"][0] == pytest.approx(3.0, abs=1e-6)


def test_where_the_road_changes_in_steps_both_values_hold():
    route, _ = straight(0.0, 0.0)
    steps = {"friction": [0.8, 0.1, 0.8], "kind": "step"}
    vehicle = qt.Vehicle(1000.0, bank=0.1, road=qt.Road([0, 40, 60], **steps))
    limits = qt.Limits(friction=0.5, vehicle=vehicle)
    certificate = qt.certify(route, limits)
    assert certificate.status["friction"] == "broken"
    assert 4.0 - 1e-6 <= certificate.worst["friction"][0] <= 6.0 + 1e-6
    assert certificate.worst["friction"][1] == pytest.approx(np.tan(0.1) / 0.1, rel=1e-9)
    assert qt.certify(route.window(0, 4), limits).status["friction"] == "proved"  # the ice begins at its end
    assert qt.certify(route.window(0, 4.001), limits).status["friction"] == "broken"


def test_the_track_carries_the_car_at_the_top_of_a_loop():
    path, quarter = loop(), np.pi / 2 * 10.0
    road = qt.Road([0, quarter, 3 * quarter], inverted=[False, True, False])
    top = [float(path.duration) / 2]
    on_track, on_road = (
        float(qt.evaluate(path, top, ("normal_load",), vehicle=qt.Vehicle(1.0, road=x)).normal_load[0])
        for x in (road, None)
    )
    assert on_track == pytest.approx(15.0**2 / 10 - G, abs=1e-9)
    assert on_road == pytest.approx(-on_track, abs=1e-9)
    force = qt.dynamics.forces(path, top[0], 1.0, G)
    assert float(force[1]) == pytest.approx(on_track, abs=1e-6)  # towards the centre of curvature
    part = path.window(path.times[20], path.times[44])
    limits = qt.Limits(
        friction=0.5,
        normal_load=(on_track * (1 - CLOSE), None),
        vehicle=qt.Vehicle(1.0, road=qt.Road([0], inverted=True)),
    )
    assert qt.certify(part, limits).holds
    assert qt.certify(part, qt.Limits(friction=0.5, vehicle=qt.Vehicle(1.0))).status["friction"] == "undefined"


# The first four seeds have each quantity once.
@pytest.mark.parametrize("seed", [*range(4), *(pytest.param(k, marks=pytest.mark.slow) for k in range(4, 8))])
def test_proofs_agree_with_dense_sampling(seed):
    """No proof is contradicted by a sample, and limits close to the sampled extreme are decided."""
    rng = np.random.default_rng([20, seed])
    path = random_route(rng)
    vehicle = qt.Vehicle(
        1200.0,
        drag_area=0.6 * (seed % 2),
        rolling_resistance=0.01 * (seed % 3),
        road=random_road(rng, float(path.length())),
    )
    for name in ("friction", NAMES[1 + seed % 4]):
        values = sampled(path, vehicle, name)
        largest = np.max(values) if name in ("friction", "normal_load", "power") else np.max(np.abs(values))
        for factor in (0.99, 1.01):
            limit = largest + (factor - 1) * abs(largest)
            bound = (None, limit) if name in ("normal_load", "power") else limit
            certificate = qt.certify(path, qt.Limits(**{name: bound}, vehicle=vehicle))
            (status,) = certificate.status.values()
            assert status == ("proved" if factor > 1 else "broken"), (name, factor)
            (worst,) = certificate.worst.values()
            assert abs(float(worst[1])) == pytest.approx(abs(largest), rel=1e-3)


def test_a_limit_and_a_road_that_both_change():
    route, vehicle = straight(0.0, 0.3)
    limit = qt.Along([0.0, 100.0], [0.01, np.tan(0.3) + 0.01], kind="linear")
    assert qt.certify(route, qt.Limits(friction=limit, vehicle=vehicle)).holds  # tan is convex
    limit = qt.Along([0.0, 50.0], [0.2, np.tan(0.3) * (1 + CLOSE)])
    assert qt.certify(route, qt.Limits(friction=limit, vehicle=vehicle)).holds
    limit = qt.Along([0.0, 50.0], [np.tan(0.15) * (1 - 1e-4), 1.0])
    assert qt.certify(route, qt.Limits(friction=limit, vehicle=vehicle)).status["friction"] == "broken"


def test_a_curve_is_sampled():
    import jax.numpy as jnp

    path = qt.Curve(lambda t: jnp.stack([10 * t, 0 * t, 0 * t]), 10.0)
    vehicle = qt.Vehicle(1000.0, road=qt.Road([0.0, 100.0], bank=[0.0, 0.3]))
    for factor, status in ((0.999, "broken"), (1.001, "sampled")):
        limits = qt.Limits(friction=np.tan(0.3) * factor, vehicle=vehicle)
        assert qt.certify(path, limits).status["friction"] == status


def test_a_parked_vehicle_stands_on_the_road_of_its_place():
    route = qt.Route(
        [0.0, 10.0, 20.0], [[0, 0, 0], [50, 0, 0], [50, 0, 0]], [[10, 0, 0], [0, 0, 0], [0, 0, 0]], [[0, 0, 0]] * 3
    )
    vehicle = qt.Vehicle(1000.0, road=qt.Road([0.0, 50.0], bank=[0.0, 0.2]))
    certificate = qt.certify(route, qt.Limits(lateral_force=1000 * G * np.sin(0.2) * (1 + 1e-5), vehicle=vehicle))
    assert certificate.holds
    certificate = qt.certify(route, qt.Limits(lateral_force=1000 * G * np.sin(0.2) * (1 - 1e-5), vehicle=vehicle))
    assert certificate.status["lateral_force"] == "broken"


def test_what_does_not_support_roads_says_so():
    route, vehicle = straight(0.0, 0.3)
    with pytest.raises(ValueError, match="changes along the way"):
        qt.peak(route, "friction", vehicle)
    with pytest.raises(ValueError, match="one path with concrete values"):
        qt.evaluate(route, [0.0, 1.0], ("friction",), vehicle=vehicle, reduce="max")
    with pytest.raises(ValueError, match="lower bound on friction"):
        qt.certify(route, qt.Limits(friction=(0.01, 0.9), vehicle=vehicle))
    a, b = qt.BoundaryState([20, 0, 0], [1, 7, 0.3]), qt.BoundaryState([0, 28, 1.5], [-9.8, -1, 0.1])
    with pytest.raises(ValueError, match="changes along the way"):
        qt.tune(a, b, qt.Limits(friction=0.5, vehicle=vehicle))


def test_limits_that_do_not_depend_on_the_road_are_proved():
    quick = qt.Quantity("pace", "m/s", lambda p: p.speed * p.vehicle.mass / p.vehicle.mass)
    grip = qt.Quantity("grip", "m/s", lambda p: p.speed / p.vehicle.friction[0])
    vehicle = qt.Vehicle(1000.0, wheelbase=2.7, road=qt.Road([0.0, 50.0], friction=[0.8, 0.4]))
    found = qt.certify(circle(), qt.Limits(steering_angle=0.1, own={quick: 20.0}, vehicle=vehicle))
    assert found.status["steering_angle"] == found.status["pace"] == "proved"
    with pytest.raises(ValueError, match="the quantity grip depends on the bank or the friction"):
        qt.certify(circle(), qt.Limits(own={quick: 20.0, grip: 1e9}, vehicle=vehicle))


def test_margins_of_forces_on_a_road_need_concrete_values():
    route = straight(0.0, 0.1)[0]
    limits = qt.Limits(friction=0.5, vehicle=qt.Vehicle(1000.0, road=qt.Road([0.0, 100.0], friction=[0.8, 0.4])))
    with pytest.raises(ValueError, match="need concrete values"):
        jax.vmap(lambda t: limits.margins(route, t))(jnp.array([1.0, 2.0]))


@pytest.mark.slow
def test_a_road_of_many_sections_is_proved():
    count = 9000
    road = qt.Road(np.linspace(0.0, 90.0, count), friction=0.8 + 0.05 * np.sin(np.arange(count)))
    limits = qt.Limits(friction=0.9, vehicle=qt.Vehicle(1000.0, road=road))
    assert qt.certify(straight(0.0, 0.0)[0], limits).status["friction"] == "proved"


def test_own_quantities_on_a_road_that_changes_in_steps_are_proved():
    demand = qt.Quantity("demand", "1", lambda p: p.acceleration[0] / (p.vehicle.gravity * p.vehicle.friction[0]))
    load = qt.Quantity("load", "N", lambda p: p.vehicle.mass * p.acceleration[0])
    route = qt.Route([0.0, 2.0], [[0.0, 0, 0], [6.0, 0, 0]], [[2.0, 0, 0], [4.0, 0, 0]], [[1.0, 0, 0], [1.0, 0, 0]])
    largest = 1.0 / (9.80665 * 0.5)  # at the constant acceleration 1 m/s², where the friction is least
    for share, status in ((1.001, "proved"), (0.999, "broken")):
        car = qt.Vehicle(1e3, road=qt.Road([0, 3, 4], friction=[0.8, 0.5, 0.7], kind="step"))
        found = qt.certify(route, qt.Limits(own={demand: (-0.9, share * largest)}, vehicle=car))
        assert found.status == {"demand_min": "proved", "demand_max": status}
        assert float(found.worst["demand_max"][1]) == pytest.approx(largest, rel=1e-9)
    linear = qt.Vehicle(1e3, road=qt.Road([0, 3, 4], friction=[0.8, 0.5, 0.7]))
    with pytest.raises(ValueError, match=r"the quantity demand depends on .* pass a Road with kind='step'"):
        qt.certify(route, qt.Limits(own={demand: 0.9}, vehicle=linear))
    assert qt.certify(route, qt.Limits(own={load: 1500.0}, vehicle=linear)).holds
