"""Boxes of routes: proofs against routes with other states, tunings, and what is refused."""

from typing import Any

import numpy as np
import pytest

import qtraj as qt
from qtraj.design.robust.route_box import RouteBoxProblem

BUS, COACH = qt.Vehicle(mass=9000.0), qt.Vehicle(mass=9000.0, drag_area=5.0)
FREE: Any = np.zeros(5, bool)
ROUNDING = 1e-9


def turn(joints=5):
    """A turn with 6 m/s and a radius of 20 m that climbs a little."""
    t = np.linspace(0.0, 8.0, joints)
    r = np.stack([20 * np.sin(0.3 * t), 20 * np.cos(0.3 * t), 0.1 * t], axis=1)
    v = np.stack([6 * np.cos(0.3 * t), -6 * np.sin(0.3 * t), 0.1 + 0 * t], axis=1)
    a = -0.09 * r * [1, 1, 0]
    return qt.Route(t, r, v, a)


def near(route, deviations):
    """Return the route between other states, and the mass and drag area that are added; no code of boxes is used."""
    position, velocity, acceleration = (np.moveaxis(np.asarray(route.joints()), 1, 0)[k].copy() for k in range(3))
    original, vehicle = velocity.copy(), [0.0, 0.0]
    for name, x in deviations.items():
        if name in ("mass", "drag_area"):
            vehicle[name == "drag_area"] = x
            continue
        end, kind = name.split("_", 1)
        at = 0 if end == "start" else -1
        ahead = original[at] / np.linalg.norm(original[at])
        left = np.array([-ahead[1], ahead[0], 0.0]) / np.hypot(*ahead[:2])
        direction = {"lateral": left, "vertical": np.array([0.0, 0.0, 1.0]), "speed": ahead}[kind.split("_")[0]]
        (position if kind.endswith("position") else velocity)[at] += x * direction
    return qt.Route(np.asarray(route.times), position, velocity, acceleration), vehicle


def value(route, name, deviations, vehicle=None):
    """Return the largest value of a quantity along a route near another."""
    path, (mass, area) = near(route, deviations)
    if vehicle is not None:
        vehicle = qt.Vehicle(float(vehicle.mass) + mass, drag_area=float(vehicle.drag_area) + area)
    return qt.certify(path, qt.Limits(**{name: 1e9}, vehicle=vehicle)).worst[name][1]


CASES = [
    (4, "speed", None, qt.Box(start_speed=0.3)),
    (2, "lateral_acceleration", None, qt.Box(start_lateral_speed=0.1, end_lateral_position=(-0.1, 0.2))),
    (4, "lateral_acceleration", None, qt.Box(start_lateral_speed=0.1, end_lateral_position=(-0.1, 0.2))),
    (2, "slope", None, qt.Box(start_vertical_speed=0.3)),
    (4, "slope", None, qt.Box(end_vertical_position=0.2)),
    (4, "curvature", None, qt.Box(end_speed=0.2)),
    (4, "friction", COACH, qt.Box(start_speed=0.2, mass=(-100, 1000))),
    (4, "power", COACH, qt.Box(drag_area=(-2, 8), mass=(0, 1000))),
]
"""The number of joints, the quantity, the vehicle and the box."""


@pytest.mark.parametrize(("joints", "name", "vehicle", "box"), CASES, ids=[f"{x[1]}-{x[0]}" for x in CASES])
def test_a_limit_at_the_worst_sample_separates_proofs_from_counterexamples(joints, name, vehicle, box):
    """No sample may exceed a proved limit, and slightly below the worst sample no limit may be proved."""
    route, rng = turn(joints), np.random.default_rng(2)
    unit = np.concatenate([rng.random((8, len(box.names))), rng.integers(0, 2, (8, len(box.names)))])
    samples = box.lowest + (box.highest - box.lowest) * unit
    values = [value(route, name, dict(zip(box.names, x, strict=True)), vehicle) for x in samples]
    limits = qt.Limits(**{name: 1e9}, vehicle=vehicle)
    found = RouteBoxProblem.of(route, limits, box).values(samples)[1][:, 0]
    np.testing.assert_allclose(found, values, rtol=ROUNDING)
    worst = max(values)
    proved = qt.certify_box(route, qt.Limits(**{name: 1.03 * worst}, vehicle=vehicle), box)
    assert proved.holds
    assert float(proved.values[0]) >= worst * (1 - ROUNDING)
    broken = qt.certify_box(route, qt.Limits(**{name: worst * (1 - 1e-6)}, vehicle=vehicle), box)
    assert broken.status == {name: "broken"}
    (_, at, largest, limit) = broken.worst[name]
    assert largest > limit
    assert value(route, name, at, vehicle) == pytest.approx(largest, rel=ROUNDING)


def test_a_segment_on_which_nothing_deviates_is_checked_too():
    """The lateral acceleration of the third segment is above the limit, that of the first one is not."""
    t = np.linspace(0.0, 8.0, 5)
    r = np.stack([6 * t, np.where(t > 3, (t - 4) ** 2, 0.0), 0 * t], axis=1)
    v = np.stack([6 + 0 * t, np.where(t > 3, 2 * (t - 4), 0.0), 0 * t], axis=1)
    route = qt.Route(t, r, v, np.zeros((5, 3)))
    found = qt.certify_box(route, qt.Limits(lateral_acceleration=1.0), qt.Box(start_speed=0.01))
    assert found.status == {"lateral_acceleration": "broken"}
    assert found.worst["lateral_acceleration"][0] > 2.0


TUNINGS = [
    (qt.Limits(lateral_acceleration=1.6, speed=6.6), qt.Box(start_speed=0.1, limits={"lateral_acceleration": 0.05})),
    (qt.Limits(friction=0.18, vehicle=BUS), qt.Box(mass=(0, 1000), start_speed=0.1, limits={"friction": 0.01})),
]


@pytest.mark.parametrize(("limits", "box"), TUNINGS, ids=["state", "vehicle"])
def test_tunings_are_proved_and_near_their_limits(limits, box):
    """The worst sample must reach 97 % of the strictest value of the first limit."""
    found = qt.robust_tune_route(turn(), limits, box, fixed=FREE)
    assert found.successful, found.result
    assert qt.certify_box(found.tuned.path, limits, box).holds
    (name, deviation) = next(iter(box.limits.items()))
    strictest = float(np.asarray(getattr(limits, name))) + deviation[0]
    rng = np.random.default_rng(4)
    samples = box.lowest + (box.highest - box.lowest) * rng.random((12, len(box.names)))
    samples = np.concatenate([samples, box.lowest[None], box.highest[None]])
    each = [dict(zip(box.names, x, strict=True)) for x in samples]
    values = [value(found.tuned.path, name, x, limits.vehicle) for x in each]
    assert 0.97 * strictest <= max(values) <= strictest


def test_a_limit_that_deviates_alone_is_its_strictest_value():
    box = qt.Box(limits={"lateral_acceleration": 0.1})
    found = qt.robust_tune_route(turn(), qt.Limits(lateral_acceleration=1.6), box, fixed=FREE)
    assert found.successful
    assert int(found.rounds) == 1
    assert float(np.asarray(found.limits.lateral_acceleration)) == pytest.approx(1.5, abs=1e-5)


def test_a_closed_route_with_a_vehicle_that_deviates():
    t = np.linspace(0.0, 8.0, 5)
    rate = np.pi / 4
    r = 20 * np.stack([np.cos(rate * t), np.sin(rate * t), 0 * t], axis=1)
    v = 20 * rate * np.stack([-np.sin(rate * t), np.cos(rate * t), 0 * t], axis=1)
    loop = qt.Route(t, r, v, -(rate**2) * r)
    limits = qt.Limits(lateral_force=1.2e5, vehicle=BUS)
    found = qt.robust_tune_route(loop, limits, qt.Box(mass=(-100, 300)), closed=True)
    assert found.successful, found.result
    with pytest.raises(ValueError, match="a closed route has no ends"):
        qt.robust_tune_route(loop, limits, qt.Box(start_speed=0.1), closed=True)


def test_results_are_saved(tmp_path):
    found = qt.robust_tune_route(turn(), qt.Limits(speed=6.6), qt.Box(end_lateral_speed=(0.0, 0.05)), fixed=FREE)
    found.save(tmp_path / "box.json")
    loaded = qt.load(tmp_path / "box.json")
    assert loaded.result == found.result
    assert loaded.certificate.box.intervals == {"end_lateral_speed": (0.0, 0.05)}
    assert isinstance(loaded.tuned.path, qt.Route)
    assert "limits proved for all deviations" in found.record().summary


def test_a_limit_at_fixed_ends_has_advice():
    found = qt.robust_tune_route(turn(), qt.Limits(speed=6.05), qt.Box(start_speed=0.2))
    assert not found.successful
    assert "make the box smaller" in found.result or "With tightened limits" in found.result


def stopping():
    """A route that starts at rest."""
    t = np.linspace(0.0, 4.0, 3)
    r = np.stack([t**2, 0 * t, 0 * t], axis=1)
    return qt.Route(t, r, np.stack([2 * t, 0 * t, 0 * t], axis=1), np.tile([2.0, 0, 0], (3, 1)))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: of(box=qt.Box(start_axial_speed=0.1)),
            "only for spiral-helices, because a route has no axis",
        ),
        (lambda: of(box=qt.Box(end_radial_speed=0.1)), "pass any of start_speed, start_lateral_speed"),
        (lambda: of(stopping(), qt.Box(start_speed=0.1)), "start_speed needs a velocity that is not zero"),
        (lambda: of(box=qt.Box(mass=10.0)), "limits have no vehicle"),
        (lambda: of(3), "a SpiralHelix or a Route"),
        (lambda: of(limits=qt.Limits(keep_out=[qt.Ball([0, 0, 0], 1.0)])), "omit keep_out"),
        (lambda: tuned(box=qt.Box(start_axial_speed=0.1)), "only for spiral-helices"),
        (lambda: tuned(share=0.9), "only for a Spread"),
        (lambda: tuned(limits=qt.Limits()), "at least one limit"),
        (lambda: tuned(limits=qt.Limits(speed=qt.Along([0.0, 9.0], [9.0, 8.0]))), "supports only limits"),
        (lambda: tuned(box=qt.Box(limits={"jerk": 1.0})), "no such limit"),
        (lambda: qt.Box(gain=0.1), "sweep over simulations with random gains"),
    ],
)
def test_mistakes_are_named(call, message):
    with pytest.raises((ValueError, TypeError), match=message):
        call()


def of(route: Any = None, box=None, limits=None):
    """A call of `certify_box` with defaults."""
    given = qt.Limits(speed=9.0) if limits is None else limits
    return qt.certify_box(turn() if route is None else route, given, qt.Box(start_speed=0.1) if box is None else box)


def tuned(box=None, limits=None, **options: Any):
    """A call of `robust_tune_route` with defaults."""
    given = qt.Limits(speed=9.0) if limits is None else limits
    return qt.robust_tune_route(turn(), given, qt.Box(start_speed=0.1) if box is None else box, **options)
