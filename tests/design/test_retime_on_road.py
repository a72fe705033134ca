"""The fastest timing on a road whose bank and friction change along the way."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.design.timing import cell_claims
from qtraj.design.timing.road_cells import _inside

G = 9.80665
SHAPE = qt.Shape.through([[0, 0, 0], [60, 0, 0], [120, 40, 0], [160, 120, 2], [140, 200, 0]])
LENGTH = float(SHAPE.length)


def retimed(road, **limits):
    limits = qt.Limits(
        **({"friction": 0.9, "power": 2e5, "speed": 45.0} | limits), vehicle=qt.Vehicle(1500.0, road=road)
    )
    found = qt.retime(SHAPE, limits, tolerance=3e-3)
    assert found.certificate.holds
    assert qt.certify(found.path, limits).holds
    return found, limits


@pytest.mark.parametrize(
    "road",
    [
        qt.Road([0, LENGTH], bank=[0.2, -0.1], friction=0.8),
        qt.Road([0, 100, 130], friction=[0.8, 0.4, 0.8], kind="step"),
        qt.Road([0, 60, 100, 200], bank=[0.0, 0.15, 0.15, 0.0], friction=[0.8, 0.4, 0.8, 0.6]),
    ],
)
def test_the_timing_is_proved_and_uses_the_friction(road):
    found, limits = retimed(road)
    times = np.linspace(0, float(found.duration), 2001)[1:-1]
    used = np.asarray(
        qt.evaluate(found.path, times, ("friction",), frame=qt.Upright(), vehicle=limits.vehicle).friction
    )
    assert 0.895 < used.max() <= 0.9 * (1 + 1e-9)
    slower = qt.certify(found.path, qt.Limits(friction=0.88, vehicle=limits.vehicle))
    assert slower.status["friction"] == "broken"


def test_on_a_circle_the_speed_is_that_of_the_bank_and_the_friction():
    """v² = g R (tan β + μ)/(1 − μ tan β) at the place with the least of it."""
    radius, bank, friction = 50.0, 0.2, 0.5
    path = qt.SpiralHelix([radius], [0.0, 10.0 / radius], [0.0], 20.0)
    road = qt.Road([0.0, 100.0, 200.0], bank=[0.0, bank, bank], friction=friction, kind="step")
    found = qt.retime(path, qt.Limits(friction=1.0, acceleration=30.0, vehicle=qt.Vehicle(1.0, road=road)), knots=256)
    assert found.certificate.holds
    speed = qt.speed_profile(found)
    at = np.asarray(speed.distance)
    for place, tan in ((50.0, 0.0), (190.0, np.tan(bank))):
        largest = np.sqrt(G * radius * (tan + friction) / (1 - friction * tan))
        assert float(np.interp(place, at, speed.speed)) <= largest * (1 + 1e-6)
    assert float(np.interp(30.0, at, speed.speed)) == pytest.approx(np.sqrt(G * radius * friction), rel=1e-3)


def test_a_road_that_is_too_steep_is_named():
    line = qt.Shape.through([[0, 0, 0], [50, 0, 0], [100, 0, 0]])
    vehicle = qt.Vehicle(1.0, road=qt.Road([0, 50, 100], bank=[0.0, 0.5, 0.0], friction=0.4))
    found = qt.retime(line, qt.Limits(friction=1.0, speed=20.0, vehicle=vehicle), start_speed=10.0)
    assert "steep" in str(found.result)


def test_a_traced_call_says_what_to_do():
    import jax

    vehicle = qt.Vehicle(1500.0, road=qt.Road([0, 60], bank=[0.0, 0.15]))
    with pytest.raises(ValueError, match="outside jit"):
        jax.grad(lambda x: qt.retime(SHAPE, qt.Limits(friction=x, speed=40.0, vehicle=vehicle)).duration)(0.5)


def test_a_limit_that_changes_along_a_banked_road():
    road = qt.Road([0, 60, 100, 200], bank=[0.0, 0.15, 0.15, 0.0], friction=0.8)
    retimed(road, friction=qt.Along([0.0, 100.0, 200.0], [0.9, 0.6, 0.9]))


def test_cells_with_many_sections_are_those_of_a_loop():
    rng = np.random.default_rng(0)
    values, first = rng.normal(size=40), rng.integers(0, 40, 200)
    last = np.minimum(first + rng.integers(0, 12, 200), 39)
    for extreme, absent in ((np.maximum, -np.inf), (np.minimum, np.inf)):
        found = _inside(extreme, values, first, last, absent)
        expected = [extreme.reduce(values[a + 1 : b + 1], initial=absent) for a, b in zip(first, last, strict=True)]
        np.testing.assert_array_equal(found, expected)


def test_a_linear_limit_on_a_road_that_changes_is_proved_in_parts_of_cells(monkeypatch):
    """With the strictest value of a cell in its parts, thousands of claims were decided in integers, all in vain."""
    t = np.arange(0.0, 20.0, 0.5)
    route = qt.fit_route(qt.Track(t, np.stack([12 * t, 25 * np.sin(0.25 * t), 0 * t], axis=1))).path
    s = np.linspace(0.0, float(route.arc_length(float(route.duration))), 13)
    road = qt.Road(s, bank=0.05 * np.sin(s / 40), friction=0.6 + 0.2 * np.cos(s / 30))
    limit = qt.Along(s, 0.7 + 0.2 * np.cos(s / 30), "linear")
    decided, count = cell_claims.CellClaims.within, [0]

    def counted(*arguments):
        count[0] += 1
        return decided(*arguments)

    monkeypatch.setattr(cell_claims.CellClaims, "within", counted)
    timed = qt.retime(route, qt.Limits(speed=40.0, friction=limit, vehicle=qt.Vehicle(1200.0, road=road)))
    assert timed.converged, timed.result
    assert count[0] < 300


@pytest.mark.parametrize("ends", [(True, False), (False, True), (True, True)])
def test_the_friction_bounds_the_acceleration_where_the_route_itself_is_at_rest(ends):
    """Six metres at the acceleration μ·limit·g, on routes whose derivative vanishes where they start or end."""
    rest = [[0.0, 0.0, 0.0] if x else [4.0, 0.0, 0.0] for x in ends]
    pull = [[3.0, 0.0, 0.0] if ends[0] else [0.0] * 3, [-3.0, 0.0, 0.0] if ends[1] else [0.0] * 3]
    route = qt.Route([0.0, 2.0], [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]], rest, pull)
    limits = qt.Limits(speed=50.0, friction=0.5, vehicle=qt.Vehicle(1000.0, friction=0.7))
    timed = qt.retime(route, limits)
    assert timed.certificate.holds, timed.result
    reach, push = (1, 6.0) if sum(ends) == 1 else (2, 3.0)
    expected = reach * np.sqrt(2 * push / (0.35 * 9.80665))
    assert float(timed.path.duration) == pytest.approx(expected, rel=1e-3)
    table = qt.evaluate(timed.path, np.linspace(0.0, timed.path.duration, 1001), ("friction",), vehicle=limits.vehicle)
    assert 0.4999 < np.asarray(table.friction)[[0, -1]].max() <= np.asarray(table.friction).max() <= 0.5
