"""A vertical loop whose track has a constant direction to the left: one certificate for the loop, closed forms."""

import numpy as np
import pytest

import qtraj as qt

G, RADIUS, SPEED, GRIP = 9.80665, 10.0, 15.0, 0.9
BEND = SPEED**2 / RADIUS
LEFT = (0.0, 1.0, 0.0)


def specific_force(p):
    """The force of the track divided by the mass, along the path, to the left and normal to the track."""
    drag, up = p.velocity * (p.vehicle.drag * p.speed), [0, 0, p.vehicle.gravity]
    f = p.acceleration + up + drag
    return f.dot(p.velocity) / p.speed, f.dot(LEFT), f.dot(p.velocity.cross(LEFT)) / p.speed


def used_friction(p):
    along, across, load = specific_force(p)
    mu_along, mu_across = p.vehicle.friction
    return qt.sqrt((along / mu_along) ** 2 + (across / mu_across) ** 2) / load


LOAD = qt.Quantity("track_load", "N", lambda p: p.vehicle.mass * specific_force(p)[2])
FRICTION = qt.Quantity("track_friction", "1", used_friction)
CAR = qt.Vehicle(1.0, friction=GRIP)


def loop(speed=SPEED, segments=64):
    """A loop in the plane of x and z, from the bottom to the bottom."""
    angle = np.linspace(0.0, 2 * np.pi, segments + 1)
    sin, cos, zero = np.sin(angle), np.cos(angle), 0 * angle
    position = RADIUS * np.stack([sin, zero, 1 - cos], axis=1)
    velocity = speed * np.stack([cos, zero, sin], axis=1)
    acceleration = speed**2 / RADIUS * np.stack([-sin, zero, cos], axis=1)
    return qt.Route(angle * RADIUS / speed, position, velocity, acceleration)


def limits(load, friction, vehicle=CAR):
    return qt.Limits(own={LOAD: load, FRICTION: friction}, vehicle=vehicle)


def test_the_extremes_are_those_of_a_circle():
    """The friction demand g sin θ/(v²/R + g cos θ) is largest where cos θ = −gR/v²."""
    found = qt.certify(loop(), limits((0.0, 40.0), 1.0))
    expected = {"track_load_min": BEND - G, "track_load_max": BEND + G}
    expected["track_friction"] = G / np.sqrt(BEND**2 - G**2) / GRIP
    assert set(found.status.values()) == {"proved"}
    half = float(loop().duration) / 2
    for name, value in expected.items():
        time, worst, _ = found.worst[name]
        assert float(worst) == pytest.approx(value, rel=1e-6)
        places = {"track_load_min": [half], "track_load_max": [0.0, 2 * half]}
        bend = np.arccos(-G / BEND) * RADIUS / SPEED
        assert min(abs(float(time) - x) for x in places.get(name, [bend, 2 * half - bend])) < 1e-3


def test_limits_are_decided_at_the_extremes():
    found = qt.certify(loop(), limits((0.0, 40.0), 1.0))
    low, high, friction = (float(found.worst[name][1]) for name in found.names)
    for slack, status in ((1e-9, "proved"), (-1e-9, "broken")):
        own = limits((low * (1 - slack), high * (1 + slack)), friction * (1 + slack))
        assert set(qt.certify(loop(), own).status.values()) == {status}


def test_a_car_that_would_fall_is_found():
    """At 9 m/s the load at the top is negative, and the friction demand has poles."""
    found = qt.certify(loop(9.0), limits((0.0, 40.0), 1.0))
    assert [found.status[name] for name in found.names] == ["broken", "proved", "broken"]
    assert float(found.worst["track_load_min"][1]) == pytest.approx(8.1 - G, rel=1e-6)


def test_forces_are_those_of_the_upright_frame_where_it_exists():
    """Below the top on a road below the car, and above on a road that is inverted; with drag and two coefficients."""
    quarter = RADIUS * np.pi / 2
    road = qt.Road([0.0, quarter, 3 * quarter], inverted=[False, True, False])
    fields = {"friction": (0.9, 0.7), "drag_area": 1.2}
    path, plain, inverted = loop(), qt.Vehicle(500.0, **fields), qt.Vehicle(500.0, **fields, road=road)
    times = np.linspace(0.0, float(path.duration), 102)
    own = qt.evaluate(path, times, (LOAD, FRICTION), vehicle=plain)
    registry = qt.evaluate(path, times, ("normal_load", "friction"), vehicle=inverted)
    np.testing.assert_allclose(own[LOAD], registry.normal_load, rtol=1e-9)
    np.testing.assert_allclose(own[FRICTION], registry.friction, rtol=1e-9)


def test_a_loop_is_tuned_to_its_friction():
    path, own = loop(11.0, segments=16), limits((-1.0, 40.0), 1.0)
    assert qt.certify(path, own).status["track_friction"] == "broken"
    found = qt.tune_route(path, own)
    assert set(found.certificate.status.values()) == {"proved"}
    assert float(found.certificate.worst["track_load_min"][1]) > 0
