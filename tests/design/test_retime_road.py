"""Limits on friction and power in `retime`: closed forms, dense samples, planted violations, derivatives."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import qtraj as qt
from qtraj.algebra import subdivision
from qtraj.design.proof.certificate import BROKEN, PROVED
from qtraj.design.proof.deciding import decided
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.proof import prove
from qtraj.design.timing.retimed_cells import cells_of
from qtraj.design.timing.sources import source

G = 9.80665
RADIUS, ANGLE = 30.0, 2.0
CIRCLE = qt.SpiralHelix([RADIUS], [0.0, ANGLE / 20], [0.0], 20.0)
MASS, GRIP, POWER, LENGTH = 1500.0, 0.8, 1e5, 400.0
SPEEDS = np.array([[20.0, 0, 0]] * 3)
STRAIGHT = qt.Route([0.0, 10, 20], [[0.0, 0, 0], [LENGTH / 2, 0, 0], [LENGTH, 0, 0]], SPEEDS, np.zeros((3, 3)))
CAR = qt.Vehicle(MASS, drag_area=0.7, rolling_resistance=0.012, friction=(1.0, 0.8), bank=0.05)
START, END = qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0])
CORNER = qt.SpiralHelix.hermite(START, END, duration=6.0)


def grip(**more):
    return qt.Limits(friction=1.0, vehicle=qt.Vehicle(MASS, friction=GRIP), **more)


@pytest.mark.parametrize("bank", [0.0, 0.15])
def test_the_speed_on_a_circle_is_the_speed_at_which_the_tyres_slide(bank):
    """On a banked circle tan(β + arctan μ) = v²/gR."""
    limits = qt.Limits(friction=1.0, vehicle=qt.Vehicle(MASS, friction=GRIP, bank=bank))
    timed = qt.retime(CIRCLE, limits, knots=128)
    speed = np.sqrt(G * RADIUS * np.tan(bank + np.arctan(GRIP)))
    assert timed.certificate.status == {"friction": "proved"}
    np.testing.assert_allclose(float(timed.duration), ANGLE * RADIUS / speed, rtol=2e-5)
    np.testing.assert_allclose(np.asarray(timed.speeds), speed, rtol=2e-5)


def test_rest_to_rest_on_a_circle_follows_the_friction_circle():
    """With E = v²/2 and the distance s, (dE/ds)² + (2E/R)² = (μg)² from rest: E = ½μgR sin(2s/R)."""
    timed = qt.retime(CIRCLE, grip(), start_speed=0.0, end_speed=0.0)
    rising, half = np.pi * RADIUS / 4, ANGLE * RADIUS / 2
    time = quad(lambda s: (GRIP * G * RADIUS * np.sin(2 * s / RADIUS)) ** -0.5, 0, rising, limit=400)[0]
    expected = 2 * (time + (half - rising) / np.sqrt(GRIP * G * RADIUS))
    assert timed.certificate.holds
    np.testing.assert_allclose(float(timed.duration), expected, rtol=1e-3)


@pytest.mark.parametrize("brakes", [False, True])
def test_a_straight_start_is_limited_by_grip_and_then_by_power(brakes):
    """m v dv/dt = P after the grip; braking is limited by the grip alone, although it takes more power."""
    end = 0.0 if brakes else None
    timed = qt.retime(STRAIGHT, grip(power=POWER), start_speed=0.0, end_speed=end, tolerance=1e-4)
    v1 = POWER / (MASS * GRIP * G)
    first = v1**2 / (2 * GRIP * G)

    def reached(x):
        return (v1**3 + 3 * POWER / MASS * (x - first)) ** (1 / 3)

    def left(x):
        return LENGTH - x - reached(x) ** 2 / (2 * GRIP * G)

    at = LENGTH
    if brakes:
        low, high = first, LENGTH
        for _ in range(80):
            low, high = (low, 0.5 * (low + high)) if left(0.5 * (low + high)) < 0 else (0.5 * (low + high), high)
        at = low
    v2 = reached(at)
    expected = v1 / (GRIP * G) + (v2**2 - v1**2) * MASS / (2 * POWER) + (v2 / (GRIP * G) if brakes else 0.0)
    assert timed.certificate.status == {"friction": "proved", "power": "proved"}
    np.testing.assert_allclose(float(timed.duration), expected, rtol=3e-4)


@pytest.fixture(scope="module")
def corner():
    limits = qt.Limits(friction=0.9, power=POWER, jerk=8.0, vehicle=CAR)
    return limits, qt.retime(CORNER, limits, start_speed=0.0, end_speed=6.0)


def test_the_proof_agrees_with_dense_samples_and_refutes_smaller_limits(corner):
    limits, timed = corner
    times = np.linspace(0, float(timed.duration), 100_001)[1:-1]
    values = qt.evaluate(timed.path, times, ("friction", "power"), vehicle=CAR).values
    assert timed.certificate.holds
    assert float(np.max(values["friction"])) <= 0.9 <= float(np.max(values["friction"])) * (1 + 1e-4)
    assert float(np.max(values["power"])) <= POWER <= float(np.max(values["power"])) * (1 + 1e-4)
    cells = cells_of(timed.path)
    assert cells is not None
    powers = timed.timing.coefficients
    for name in ("friction", "power"):
        given = limits.given()[name] * 0.999
        bounds = {n: jnp.asarray(given if n == name else np.inf) for n in NAMES}
        road = jax.tree.map(jnp.asarray, limits.road(powers.dtype))
        codes = np.asarray(prove(source(CORNER), cells.grid, (powers, np.array([True, False])), bounds, road).codes)
        assert (codes[NAMES.index(name)] == BROKEN).any()
        assert (np.delete(codes, NAMES.index(name), axis=0) == PROVED).all()


def with_a_stop():
    position = [[-12.0, -0.6, -0.2], [0, 0, 0], [0, 0, 0], [12, 1, 1]]
    velocity = [[6.0, 0.3, 0.1], [0, 0, 0], [0, 0, 0], [6, 0.8, 0.2]]
    return qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))


def test_power_alone_does_not_bound_the_acceleration_at_a_stop():
    limits = qt.Limits(speed=7.0, power=3e4, vehicle=CAR)
    with pytest.raises(ValueError, match=r"at a stop of a route.*Add a limit on acceleration, .* or jerk"):
        qt.retime(with_a_stop(), limits, knots=128)


def test_stops_slopes_and_crests_are_proved(corner):
    route = with_a_stop()
    limits = qt.Limits(speed=7.0, friction=0.3, power=3e4, vehicle=CAR)
    timed = qt.retime(route, limits, knots=128)
    assert timed.certificate.holds, timed.result
    times = np.linspace(0, float(timed.duration), 20_001)
    table = qt.evaluate(timed.path, times, ("speed", "friction", "power"), vehicle=CAR)
    moving = np.asarray(table.speed) > 1e-3
    assert np.max(np.asarray(table.values["friction"])[moving]) <= 0.3
    assert np.max(np.asarray(table.values["power"])[moving]) <= 3e4


def test_derivatives_of_the_duration_with_respect_to_the_vehicle():
    """At speeds without active power, the time scales as μ^-½ and does not depend on the mass."""

    def duration(friction, mass):
        limits = qt.Limits(friction=1.0, vehicle=qt.Vehicle(mass, friction=friction))
        return qt.retime(CIRCLE, limits, start_speed=0.0, end_speed=0.0, knots=128).duration

    value, (by_friction, by_mass) = jax.value_and_grad(duration, (0, 1))(GRIP, MASS)
    np.testing.assert_allclose(float(by_friction), -0.5 * float(value) / GRIP, rtol=1e-4)
    assert abs(float(by_mass)) < 1e-9 * float(value) / MASS
    np.testing.assert_allclose(float(jax.jvp(lambda x: duration(x, MASS), (GRIP,), (1.0,))[1]), float(by_friction))


def test_the_result_is_stored_with_its_vehicle_and_its_profile_shows_the_limits(corner, tmp_path):
    _, timed = corner
    timed.save(tmp_path / "timed.json")
    loaded = qt.load(tmp_path / "timed.json")
    assert float(loaded.vehicle.bank) == 0.05
    profile = qt.speed_profile(loaded)
    assert profile.names == ("jerk", "friction", "power")
    assert np.all(np.asarray(profile.speed) <= np.asarray(profile.speed_bound) * (1 + 1e-6))
    assert profile.share("friction") > 0.1
    assert "vehicle_mass" in timed.to_xarray()


def test_a_batch_of_limits_matches_single_searches():
    limits = [0.6, 0.9]

    def duration(x):
        return qt.retime(CIRCLE, qt.Limits(friction=x, vehicle=CAR), knots=64).duration

    batch = jax.vmap(duration)(jnp.asarray(limits))
    np.testing.assert_allclose(batch, [float(duration(x)) for x in limits], rtol=1e-9)


def test_a_batch_of_vehicles_and_powers_matches_single_searches():
    """jax.vmap over the vehicle (mass and drag) and the limit on power gives the results of a loop."""
    vehicles = jax.vmap(lambda m, drag: qt.Vehicle(m, drag_area=drag, friction=GRIP))(
        jnp.array([800.0, 1500.0, 40_000.0]), jnp.array([0.3, 0.7, 6.0])
    )
    powers = jnp.array([3e4, 1e5, 3e5])

    def timed(vehicle, power):
        limits = qt.Limits(friction=0.9, power=power, vehicle=vehicle)
        return qt.retime(CORNER, limits, start_speed=0.0, end_speed=6.0, knots=64)

    batch = jax.vmap(timed)(vehicles, powers)
    loop = [timed(jax.tree.map(lambda x, k=k: x[k], vehicles), powers[k]) for k in range(3)]
    assert batch.certificate.holds.tolist() == [one.certificate.holds for one in loop] == [True] * 3
    assert batch.code.tolist() == [int(one.code) for one in loop]
    for of in (lambda x: x.duration, lambda x: x.speeds, lambda x: x.certificate.values, lambda x: x.timing.times):
        np.testing.assert_allclose(of(batch), np.stack([of(one) for one in loop]), rtol=1e-6, atol=1e-9)
    np.testing.assert_array_equal(batch.vehicle.mass, vehicles.mass)
    assert np.unique(np.round(batch.duration, 3)).size == 3


def test_derivatives_without_a_limit_on_friction():
    """The absent limit is infinite, and must not make the derivatives NaN."""

    def duration(bank, rate):
        path = qt.SpiralHelix([RADIUS], jnp.stack([0.0 * rate, rate]), [0.0], 20.0)
        limits = qt.Limits(speed=30.0, power=POWER, vehicle=qt.Vehicle(MASS, drag_area=0.7, bank=bank))
        return qt.retime(path, limits, start_speed=0.0, knots=64).duration

    by_bank, by_rate = jax.grad(duration, (0, 1))(0.05, ANGLE / 20)
    assert abs(float(by_bank)) < 1e-9  # without rolling resistance, the power does not depend on the bank
    step = 1e-4
    slope = (duration(0.05, ANGLE / 20 + step) - duration(0.05, ANGLE / 20 - step)) / (2 * step)
    np.testing.assert_allclose(float(by_rate), float(slope), rtol=1e-3)


@pytest.mark.parametrize(("slope", "speed"), [(0.04, 0.9), (0.055, 1.3)])
def test_a_vehicle_with_little_power_climbs_from_rest_to_rest(slope, speed):
    """The work against gravity takes at least the time that the climb takes at a constant speed."""
    mass, length, time = 9000.0, 60.0, 10.0
    position, velocity = [[0.0, 0, 0], [length, 0, slope * length]], [[length / time, 0, slope * length / time]] * 2
    path = qt.Route([0.0, time], position, velocity, np.zeros((2, 3)))
    weight = mass * G * np.sin(np.arctan(slope))
    limits = qt.Limits(speed=15.0, friction=0.6, power=weight * speed, vehicle=qt.Vehicle(mass))
    timed = qt.retime(path, limits, start_speed=0.0, end_speed=0.0, knots=256, throw=True)
    steady = length * np.hypot(1, slope) / speed
    assert steady < float(timed.duration) < 1.04 * steady  # the kinetic energy takes up to 1.1 s more
    assert set(timed.certificate.status.values()) == {"proved"}


@pytest.mark.parametrize(("share", "code"), [(0.9, "not_finite"), (1.1, "successful")])
def test_a_road_that_is_too_steep_is_reported(share, code):
    """Without motion the slope of 0.8 in the middle of the road needs the friction 0.8/μ; above it, a timing exists."""
    x, grip = np.linspace(0.0, 200.0, 9), 2.0
    shape = qt.Shape.through(np.stack([x, 0.3 * x * (200 - x) / 100, 0.8 * x], axis=1))
    limits = qt.Limits(speed=20.0, friction=share * 0.8 / grip, vehicle=qt.Vehicle(MASS, friction=grip))
    timed = qt.retime(shape, limits, 0.0, 0.0)
    assert timed.code == qt.ResultCode[code]
    needed = re.search(r"gravity alone needs ([\d.]+) of", timed.result)
    assert (needed is None) == (code == "successful")
    if needed is not None:
        assert float(needed.group(1)) == pytest.approx(0.8 / grip, rel=1e-3)
        assert re.search(r"at \((99|100|101)[\d.]*, ", timed.result)


def test_proofs_take_less_work_after_many_undecided_claims(monkeypatch):
    works = []

    def undecided(claim, strict, max_work):
        works.append(max_work)
        return subdivision.Decision(False, False)

    monkeypatch.setattr(subdivision, "decide", undecided)
    found = decided(np.ones(9, bool), lambda: None, lambda k: k, max_work=6400, patience=3)
    assert not (found.proved | found.refuted).any()
    assert works == [6400] * 3 + [100] * 6
    works.clear()
    decided(np.ones(9, bool), lambda: None, lambda k: k, max_work=6400)
    assert works == [6400] * 9
