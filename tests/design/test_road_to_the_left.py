"""Roads with a direction to the left: a whole vertical loop with the registry's own quantities."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline
from tests.design import test_vertical_loop as own

import qtraj as qt
from qtraj.path.driving import segments_of

G, RADIUS, SPEED, BEND, GRIP = own.G, own.RADIUS, own.SPEED, own.BEND, own.GRIP
FORCES = ("longitudinal_force", "lateral_force", "normal_load", "friction")
CAR = qt.Vehicle(1.0, friction=GRIP, road=qt.Road(left=(0, 1, 0)))
DEMAND = G / np.sqrt(BEND**2 - G**2) / GRIP
"""The friction demand on a loop at constant speed is largest where cos θ = −gR/v²."""


def limits(load, friction, vehicle=CAR):
    return qt.Limits(normal_load=load, friction=friction, vehicle=vehicle)


def helix():
    """The loop as a spiral-helix about a horizontal axis, from the bottom to the bottom."""
    turned = qt.Placement((0.0, 0.0, RADIUS), (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0))
    return qt.SpiralHelix([RADIUS], [-np.pi / 2, SPEED / RADIUS], [0.0], 2 * np.pi * RADIUS / SPEED, turned)


def expected_forces(rows, vehicle, left, side):
    """Return the forces in the axes of the road, from vectors."""
    tangent = rows[1] / np.linalg.norm(rows[1])
    aside = left - (left @ tangent) * tangent
    aside /= np.linalg.norm(aside)
    normal, bank = np.cross(tangent, aside), float(vehicle.road.bank[0])
    road_left = np.cos(bank) * aside - np.sin(bank) * normal
    road_normal = np.cos(bank) * normal + np.sin(bank) * aside
    drag = 0.5 * float(vehicle.air_density * vehicle.drag_area) * np.linalg.norm(rows[1]) * rows[1]
    force = float(vehicle.mass) * (rows[2] + np.array([0.0, 0.0, G])) + drag
    along, across, load = force @ tangent, side * (force @ road_left), side * (force @ road_normal)
    grip_along, grip_across = np.asarray(vehicle.friction)
    demand = np.hypot(along / grip_along, across / grip_across) / load
    return along, across, load, demand if load > 0 else np.inf


@pytest.mark.parametrize("seed", range(4))
def test_forces_are_those_of_vectors(seed):
    random = np.random.default_rng(seed)
    route = qt.Route.from_piecewise(CubicSpline(np.arange(5.0), 5 * random.normal(size=(5, 3))))
    left, side = random.normal(size=3), 1 - 2 * (seed % 2)
    road = qt.Road(left=left, bank=random.uniform(-1, 1), inverted=side < 0)
    vehicle = qt.Vehicle(700.0, drag_area=1.3, friction=(0.9, 0.7), road=road)
    times = np.linspace(0.05, 3.95, 7)
    table = qt.evaluate(route, times, FORCES, vehicle=vehicle)
    expected = [expected_forces(np.asarray(route.derivatives(t, 2)), vehicle, left, side) for t in times]
    found = np.stack([getattr(table, name) for name in FORCES], axis=1)
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-6)


@pytest.mark.parametrize("path", [own.loop(), helix()], ids=["quintics", "helix"])
def test_the_load_at_the_top_carries_the_car(path):
    half = float(path.duration) / 2
    table = qt.evaluate(path, [0.0, half / 2, half], FORCES, vehicle=CAR)
    np.testing.assert_allclose(table.normal_load, [BEND + G, BEND, BEND - G], rtol=1e-6)
    assert float(table.normal_load[2]) == pytest.approx(12.69335, rel=1e-6)
    margins = limits((12.6, None), 1.0).margins(path, half)
    assert float(margins["normal_load_min"]) == pytest.approx(BEND - G - 12.6, rel=1e-4)
    assert float(qt.peak(path, "friction", CAR)[1]) == pytest.approx(DEMAND, rel=1e-6)


def test_extremes_are_those_of_a_circle_and_of_own_quantities():
    path = own.loop()
    found, other = qt.certify(path, limits((0.0, 40.0), 1.0)), qt.certify(path, own.limits((0.0, 40.0), 1.0))
    assert set(found.status.values()) == {"proved"}
    values = [float(found.worst[name][1]) for name in found.names]
    np.testing.assert_allclose(values, [BEND - G, BEND + G, DEMAND], rtol=1e-6)
    np.testing.assert_allclose(values, [float(other.worst[name][1]) for name in other.names], rtol=1e-9)
    assert [found.status[name] for name in found.names] == [other.status[name] for name in other.names]


def test_limits_are_decided_at_the_extremes():
    path = own.loop()
    found = qt.certify(path, limits((0.0, 40.0), 1.0))
    low, high, friction = (float(found.worst[name][1]) for name in found.names)
    for slack, status in ((1e-9, "proved"), (-1e-9, "broken")):
        tight = limits((low * (1 - slack), high * (1 + slack)), friction * (1 + slack))
        assert set(qt.certify(path, tight).status.values()) == {status}


@pytest.mark.parametrize("seed", range(6))
def test_statuses_are_those_of_own_quantities(seed):
    """Random limits near the extremes, on loops of random speeds."""
    random = np.random.default_rng(seed)
    path = own.loop(random.uniform(10.5, 16.0), segments=16)
    extremes = qt.certify(path, limits((-100.0, 100.0), 100.0))
    low, high, friction = (float(extremes.worst[name][1]) for name in extremes.names)
    near = 1 + random.choice([-1, 1], size=3) * 10.0 ** random.uniform(-9, -2, size=3)
    bounds = (low * near[0], high * near[1]), friction * near[2]
    found, other = qt.certify(path, limits(*bounds)), qt.certify(path, own.limits(*bounds))
    assert [found.status[name] for name in found.names] == [other.status[name] for name in other.names]


def test_a_car_that_would_fall_is_found():
    """At 9 m/s the load at the top is negative, and the friction demand has poles."""
    found = qt.certify(own.loop(9.0), limits((0.0, 40.0), 1.0))
    assert found.status == {"normal_load_min": "broken", "normal_load_max": "proved", "friction": "broken"}
    assert float(found.worst["normal_load_min"][1]) == pytest.approx(8.1 - G, rel=1e-6)


def test_a_bank_turns_the_road_from_its_direction():
    """With a bank β, the load at the top is (v²/R − g) cos β, and the lateral force (g − v²/R) sin β."""
    banked = qt.Vehicle(1.0, friction=GRIP, road=qt.Road(left=(0, 3, 0), bank=0.2))
    path, top = own.loop(), BEND - G
    table = qt.evaluate(path, [float(path.duration) / 2], FORCES, vehicle=banked)
    assert float(table.normal_load[0]) == pytest.approx(top * np.cos(0.2), rel=1e-6)
    assert float(table.lateral_force[0]) == pytest.approx(-top * np.sin(0.2), rel=1e-6)
    load = qt.certify(path, limits((top * np.cos(0.2) * (1 - 1e-6), None), 1.0, banked))
    assert set(load.status.values()) == {"proved"}


def test_the_opposite_direction_is_the_outer_side_of_the_loop():
    outer = qt.Vehicle(1.0, friction=GRIP, road=qt.Road(left=(0, -1, 0)))
    found = qt.certify(own.loop(), limits((None, 0.0), 1.0, outer))
    assert found.status == {"normal_load_max": "proved", "friction": "undefined"}
    assert "the load on the road is not positive" in str(found)


@pytest.mark.parametrize("kind", ["linear", "step"])
def test_a_direction_that_changes_along_the_way(kind):
    """The road is level next to the bottom of the loop, where both roads are the same."""
    path = own.loop()
    changing = qt.Road([0.0, 1.0, float(path.length()) - 1.0], left=[None, (0, 1, 0), None], kind=kind)
    vehicle = qt.Vehicle(1.0, friction=GRIP, road=changing)
    found = qt.certify(path, limits((12.6, 40.0), 1.0, vehicle))
    assert set(found.status.values()) == {"proved"}
    alone = qt.certify(path, limits((12.6, 40.0), 1.0))
    for name in found.names:
        assert float(found.worst[name][1]) == pytest.approx(float(alone.worst[name][1]), rel=1e-6)
    times = np.linspace(0.0, float(path.duration), 41)
    one, other = (qt.evaluate(path, times, ("normal_load",), vehicle=x).normal_load for x in (CAR, vehicle))
    np.testing.assert_allclose(one, other, rtol=1e-9)
    timed = qt.retime(path, qt.Limits(friction=1.0, speed=18.0, vehicle=vehicle))
    assert set(timed.certificate.status.values()) == {"proved"}


@pytest.mark.parametrize(("friction", "speed", "duration"), [(0.53, 15.0, 4.189316), (0.9, 13.0, 4.833219)])
def test_a_loop_is_retimed_in_one(friction, speed, duration):
    """The durations are those of a linear program on 400 intervals, solved by SciPy."""
    bounds = qt.Limits(friction=friction, speed=speed, vehicle=CAR)
    found = qt.retime(own.loop(SPEED), bounds)
    assert set(found.certificate.status.values()) == {"proved"}
    assert float(found.path.duration) == pytest.approx(duration, rel=2e-4)
    assert set(qt.certify(found.path, bounds).status.values()) == {"proved"}
    half = float(found.path.duration) / 2
    top = qt.evaluate(found.path, [half], ("normal_load",), vehicle=CAR).normal_load
    assert float(top[0]) == pytest.approx(speed**2 / RADIUS - G, rel=0.02)


def test_power_is_proved_on_a_retimed_loop():
    bounds = qt.Limits(friction=1.0, speed=18.0, power=120.0, vehicle=CAR)
    found = qt.retime(own.loop(), bounds)
    assert set(found.certificate.status.values()) == {"proved"}
    assert float(found.certificate.worst["power"][1]) == pytest.approx(120.0, rel=1e-3)


def test_a_loop_is_tuned_to_its_friction():
    path, bounds = own.loop(11.0, segments=16), limits((-1.0, 40.0), 1.0)
    assert qt.certify(path, bounds).status["friction"] == "broken"
    found = qt.tune_route(path, bounds)
    assert set(found.certificate.status.values()) == {"proved"}
    assert float(found.certificate.worst["normal_load_min"][1]) > 0


def test_a_helix_on_its_side_is_sampled():
    found = qt.certify(helix(), limits((0.0, 40.0), 1.0))
    assert set(found.status.values()) == {"sampled"}
    np.testing.assert_allclose(found.values, [BEND - G, BEND + G, DEMAND], rtol=1e-6)


def test_a_path_along_the_direction_is_undefined():
    line = qt.Route([0.0, 1.0], [[0, 0, 0], [0, 5, 0]], [[0, 5, 0], [0, 5, 0]], np.zeros((2, 3)))
    found = qt.certify(line, limits((0.0, None), 1.0))
    assert set(found.status.values()) == {"undefined"}
    assert "runs along the direction to the left" in str(found)


def test_a_parked_vehicle_is_on_a_level_road():
    still = qt.Route([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3)))
    vehicle = qt.Vehicle(2.0, road=qt.Road(left=(1.0, 0.0, 0.0)))
    assert float(qt.evaluate(still, [0.5], ("normal_load",), vehicle=vehicle).normal_load[0]) == pytest.approx(2 * G)
    assert qt.certify(still, limits((2 * G - 1e-6, None), 1.0, vehicle)).holds


def test_a_route_that_reverses_is_refused():
    there = [[0, 0, 0], [5, 0, 0], [0, 0, 0]]
    route = qt.Route([0.0, 4.0, 8.0], there, np.zeros((3, 3)), np.zeros((3, 3)))
    assert segments_of(route)
    with pytest.raises(ValueError, match="direction of the road to the left"):
        qt.certify(route, limits((0.0, None), 1.0))


def test_searches_for_helices_name_the_alternative():
    with pytest.raises(ValueError, match="from_path"):
        qt.retime(helix(), qt.Limits(friction=1.0, speed=18.0, vehicle=CAR))
    start, end = qt.BoundaryState((20, 0, 0), (1, 7, 0.3)), qt.BoundaryState((0, 28, 1.5), (-9.8, -1, 0.1))
    with pytest.raises(ValueError, match="use tune_route"):
        qt.tune(start, end, limits((0.0, None), 1.0))


def test_a_speed_profile_has_the_forces_of_the_loop():
    found = qt.retime(own.loop(), qt.Limits(friction=1.0, speed=15.0, vehicle=CAR))
    profile = qt.speed_profile(found)
    assert np.isfinite(np.asarray(profile.speed)).all()
    assert float(np.max(np.asarray(profile.usage[profile.names.index("friction")]))) == pytest.approx(DEMAND, rel=1e-2)


def test_the_normal_load_is_limited_from_both_sides():
    """Where the speed is below its limit, the fastest timing has the load 30 N, so v² = R(30 N/kg − g cos θ)."""
    bounds = qt.Limits(speed=18.0, normal_load=(12.6, 30.0), friction=2.0, vehicle=CAR)
    found = qt.retime(own.loop(), bounds)
    assert set(found.certificate.status.values()) == {"proved"}
    squares = lambda x: min(18.0**2, RADIUS * (30.0 - G * np.cos(x)))  # noqa: E731
    edge = np.arccos((30.0 - 18.0**2 / RADIUS) / G)
    expected = 2 * RADIUS * quad(lambda x: squares(x) ** -0.5, 0.0, np.pi, points=[edge])[0]
    assert float(found.path.duration) == pytest.approx(expected, rel=1e-3)
    assert float(found.certificate.worst["normal_load_max"][1]) == pytest.approx(30.0, rel=1e-3)
    times = np.linspace(0.0, float(found.path.duration), 2001)
    load = qt.evaluate(found.path, times, ("normal_load",), vehicle=CAR).normal_load
    assert 12.6 <= load.min() == pytest.approx(float(found.certificate.worst["normal_load_min"][1]), rel=1e-4)
    assert load.max() <= 30.0
    assert set(qt.certify(found.path, bounds).status.values()) == {"proved"}


def test_a_load_is_proved_and_refuted_on_a_timing():
    """At 15 m/s the load on a banked road with drag has its extremes at the top and the bottom of the loop."""
    banked = qt.Vehicle(800.0, drag_area=1.0, friction=1.0, road=qt.Road(left=(0, 1, 0), bank=0.1))
    timed = qt.retime(own.loop(), qt.Limits(speed=15.0, friction=1.0, vehicle=banked)).path
    low, high = (800.0 * np.cos(0.1) * (BEND + x) for x in (-G, G))
    for slack, status in ((1e-3, "proved"), (-1e-3, "broken")):
        bounds = qt.Limits(normal_load=(low * (1 - slack), high * (1 + slack)), vehicle=banked)
        assert set(qt.certify(timed, bounds).status.values()) == {status}


def test_a_load_that_no_timing_has_is_named():
    found = qt.retime(own.loop(segments=16), qt.Limits(speed=15.0, normal_load=(12.8, None), vehicle=CAR))
    assert not found.certificate.holds
    assert "the lower bound on normal_load contradicts another limit" in str(found.result)


def test_a_loop_that_is_too_slow_is_explained():
    found = qt.retime(own.loop(segments=16), qt.Limits(speed=9.0, friction=1.0, vehicle=CAR))
    assert not found.certificate.holds
    assert "at (0, 0, 20) m, only a high speed keeps it there" in str(found.result)


def test_batches_and_derivatives_use_the_direction():
    one = helix()
    paths = jax.tree.map(lambda x: jnp.stack([jnp.asarray(x)] * 2), one)
    times = np.linspace(0.0, float(one.duration), 9)
    table, expected = (qt.evaluate(x, times, FORCES, vehicle=CAR) for x in (paths, one))
    for name in FORCES:
        np.testing.assert_allclose(getattr(table, name)[1], getattr(expected, name), rtol=1e-9, atol=1e-9)

    def demand(rate):
        angle = jnp.stack([jnp.asarray(one.angle[0]), rate])
        return qt.peak(qt.SpiralHelix(one.radius, angle, one.height, one.duration, one.placement), "friction", CAR)[1]

    rate = SPEED / RADIUS
    slope = -2 * G / GRIP * BEND**2 / rate / (BEND**2 - G**2) ** 1.5  # of G / √((R·rate²)² − G²) / GRIP
    assert float(jax.grad(demand)(jnp.asarray(rate))) == pytest.approx(slope, rel=1e-6)
