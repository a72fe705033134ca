"""Steering angle and rate, load factor, tilt and bank angle: values, derivatives, proofs and searches."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.foundation import document
from qtraj.io.dataset import path_dataset
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import GRAVITY
from qtraj.path.values import value

L = 2.7
CAR = qt.Vehicle(1500.0, wheelbase=L)
START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 6.0, 0.3])
END = qt.BoundaryState([0.0, 20.0, 1.5], [-7.0, -1.0, 0.1])
HELIX = qt.SpiralHelix.hermite(START, END, 4.0)
SIGNED = ("bank_angle", "steering_angle", "steering_rate")
NAMES = ("load_factor", "tilt", *SIGNED)
SIDES = ("load_factor_min", "tilt_min", *(f"{name}_{side}" for name in SIGNED for side in ("min", "max")))
STEP, DERIVATIVE = 1e-5, 1e-8  # of central differences, and their error relative to the largest component


def winding():
    t = np.arange(0.0, 32.0, 2.0)
    return qt.Route.from_piecewise(
        CubicSpline(t, np.stack([8 * t + 6 * np.sin(t / 5), 30 * np.sin(t / 9), 0.3 * np.sin(t / 7)], axis=1))
    )


ROUTE = winding()


def sampled(path, name, times, vehicle=CAR):
    """Return the values of a quantity, or of one side of it, at many instants."""
    output = quantity(name).variable
    return np.asarray(qt.evaluate(path, times, (output,), vehicle=vehicle).values[output])


def random_helix(rng):
    radius, angle, height = (rng.normal(size=4) * [1.0, 0.4, 0.1, 0.02] for _ in range(3))
    radius[0] += 12.0
    angle[1] += 0.5
    return qt.SpiralHelix(radius, angle, height, 3.0)


def test_values_agree_with_the_reference():
    """17-digit values at 1.3 s, computed in 60 digits from the definitions."""
    exact = {
        "steering_angle": 0.14869132988964714,
        "steering_rate": -0.01165899906123302,
        "load_factor": 1.089226995263109,
        "tilt": 0.39757520511976529,
        "bank_angle": 0.38679678446192859,
    }
    table = qt.evaluate(HELIX, [1.3], NAMES, vehicle=CAR)
    for name, expected in exact.items():
        assert float(table.values[name][0]) == pytest.approx(expected, rel=1e-14)
        compiled = jax.jit(lambda t, name=name: value(HELIX, t, name, CAR.parameters()))(1.3)
        assert float(compiled) == pytest.approx(abs(expected), rel=1e-14)


def test_left_turns_are_positive():
    for sign in (1.0, -1.0):
        turn = qt.SpiralHelix([10.0], [0.0, 0.5 * sign, 0.05 * sign], [0.0, 0.1], 2.0)
        for name, signs in (("bank_angle", sign), ("steering_angle", sign)):
            found = sampled(turn, f"{name}_max", [0.0, 1.0])
            assert np.all(np.sign(found) == signs)
            assert sampled(turn, name, [0.0, 1.0]) == pytest.approx(np.abs(found), rel=1e-15)


def test_steady_turns_have_their_closed_forms():
    """A circle of the radius R at the rate w: the steering angle is atan(L/R), and tilt and bank are atan(Rw²/g)."""
    radius, rate = 15.0, 0.4
    circle = qt.SpiralHelix([radius], [0.0, rate], [0.0], 6.0)
    lean = np.arctan(radius * rate**2 / GRAVITY)
    exact = {
        "steering_angle": np.arctan(L / radius),
        "tilt": lean,
        "bank_angle": lean,
        "load_factor": 1 / np.cos(lean),
    }
    for name, expected in exact.items():
        assert sampled(circle, name, [0.0, 2.0, 6.0]) == pytest.approx(expected, rel=1e-14)
        for factor, status in ((1 + 1e-12, "proved"), (1 - 1e-12, "broken")):
            assert qt.certify(circle, qt.Limits(**{name: factor * expected}, vehicle=CAR)).status[name] == status
        found = qt.certify(circle, qt.Limits(**{name: expected}, vehicle=CAR))  # rounding errors decide
        assert found.status[name] in ("proved", "undecided") or found.worst[name][1] > expected
    assert np.abs(sampled(circle, "steering_rate", [0.0, 2.0])) == pytest.approx(0.0, abs=1e-15)


def test_the_steering_rate_is_the_derivative_of_the_steering_angle():
    def angle(t):
        return value(HELIX, t, "steering_angle_max", CAR.parameters())

    for t in (0.0, 1.3, 4.0):
        rate = jax.jvp(angle, (t,), (1.0,))[1]
        assert float(value(HELIX, t, "steering_rate_max", CAR.parameters())) == pytest.approx(float(rate), rel=1e-11)


@pytest.mark.parametrize("name", [*NAMES, *SIDES])
def test_derivatives_agree_with_finite_differences(name):
    """With respect to time, path, wheelbase and gravity, forward and reverse."""

    def f(x):
        path = qt.SpiralHelix(x[:3], x[3:6], x[6:9], 4.5)
        vehicle = qt.Vehicle(1e3, gravity=x[10], wheelbase=x[11])
        return value(path, x[9], name, vehicle.parameters())

    x = jnp.asarray([20.0, 1.0, 0.3, 0.2, 0.35, 0.02, 1.0, 0.4, 0.05, 1.3, 9.5, 2.7])
    steps = STEP * jnp.diag(jnp.abs(x))
    differences = jax.vmap(lambda h: (f(x + h) - f(x - h)) / (2 * jnp.sum(h)))(steps)
    scale = np.abs(differences).max()
    for derivative in (jax.jacrev, jax.jacfwd):
        np.testing.assert_allclose(derivative(f)(x), differences, rtol=0, atol=DERIVATIVE * scale)


@pytest.mark.parametrize("name", NAMES)
def test_proofs_at_the_exact_extremes(name):
    sides = [side for side in (name, f"{name}_min", f"{name}_max") if side in (*NAMES, *SIDES)]
    for side in sides:
        extreme, entry = float(qt.peak(HELIX, side, CAR)[1]), quantity(side)
        for change, status in ((1e-9, "proved"), (-1e-9, "broken")):
            bound = extreme + entry.side * abs(extreme) * change
            limit = (bound, None) if entry.lower else bound if side == name else (None, bound)
            found = qt.certify(HELIX, qt.Limits(**{name: limit}, vehicle=CAR))
            assert found.status == {side: status}
            assert found.worst[side][1] == pytest.approx(extreme, rel=1e-12)


def test_random_bounds_agree_with_dense_samples():
    """No proof is contradicted: random pairs on random spiral-helices."""
    rng, times = np.random.default_rng(3), np.linspace(0.0, 3.0, 8001)
    checked = {"proved": 0, "broken": 0}
    for _ in range(25):
        path = random_helix(rng)
        for name in NAMES:
            values = sampled(path, f"{name}_min", times)
            room = 1e-3 * (values.max() - values.min())
            low, high = np.quantile(values, rng.choice([0.0, 0.3], 2) * [1, -1] + [0, 1]) + room * np.array([-1, 1])
            low = max(low, 0.0) if name in ("load_factor", "tilt") else low
            found = qt.certify(path, qt.Limits(**{name: (low, high)}, vehicle=CAR))
            for side, status in found.status.items():
                holds = low <= values.min() if quantity(side).lower else high >= values.max()
                assert status == ("proved" if holds else "broken"), (side, found)
                checked[status] += 1
    assert min(checked.values()) > 50


def test_routes_agree_with_dense_samples():
    times = np.linspace(0.0, float(ROUTE.duration), 30_001)
    for name in NAMES:
        largest = float(np.abs(sampled(ROUTE, name, times)).max())
        above = qt.certify(ROUTE, qt.Limits(**{name: largest * (1 + 1e-5)}, vehicle=CAR))
        assert above.status == {name: "proved"}
        below = qt.certify(ROUTE, qt.Limits(**{name: largest * (1 - 1e-3)}, vehicle=CAR))
        assert below.status == {name: "broken"}
        violated = np.abs(sampled(ROUTE, name, times)) > largest * (1 - 1e-3)
        inside = np.zeros_like(violated)
        for a, b in below.intervals(name):
            inside |= (times >= a) & (times <= b)
        assert (violated != inside).sum() <= 2 * len(below.intervals(name))


def test_limits_that_change_in_steps():
    """On the second half of a route another limit holds."""
    times = np.linspace(0.0, float(ROUTE.duration), 20_001)
    speeds = np.linalg.norm(np.asarray(qt.evaluate(ROUTE, times, ("velocity",)).velocity), axis=1)
    s = np.append(0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times)))
    half = 0.5 * s[-1]
    for name in NAMES:
        values = np.abs(sampled(ROUTE, name, times))
        parts = np.array([values[s <= half].max(), values[s >= half].max()])
        for factors, status in (((1.001, 1.001), "proved"), ((0.99, 1.5), "broken"), ((1.5, 0.99), "broken")):
            along = qt.Along([0.0, half], parts * factors)
            assert qt.certify(ROUTE, qt.Limits(**{name: along}, vehicle=CAR)).status == {name: status}


def test_angles_beyond_a_right_angle():
    """A fall with twice the acceleration of gravity presses everything against the ceiling."""
    fall = qt.Route(
        [0.0, 1.0], [[0, 0, 0], [5, 0, -GRAVITY]], [[5, 0, 0], [5, 0, -2 * GRAVITY]], [[0, 0, -2 * GRAVITY]] * 2
    )
    assert sampled(fall, "tilt", [0.5]) == pytest.approx(np.pi, abs=1e-7)
    assert sampled(fall, "load_factor", [0.5]) == pytest.approx(1.0, rel=1e-14)
    found = qt.certify(fall, qt.Limits(tilt=3.1, bank_angle=3.1, load_factor=1.001))
    assert found.status == {"load_factor": "proved", "tilt": "broken", "bank_angle": "broken"}


def test_a_vertical_path_has_no_bank_angle():
    climb = qt.SpiralHelix([2.0], [0.3], [0.0, 1.0, 0.2], 2.0)
    found = qt.certify(climb, qt.Limits(bank_angle=0.3, steering_angle=0.3, steering_rate=0.3, vehicle=CAR))
    assert set(found.status.values()) == {"undefined"}
    assert qt.certify(climb, qt.Limits(tilt=0.01, load_factor=1.05)).holds
    for name in NAMES:
        number, slope = jax.value_and_grad(lambda t, name=name: value(climb, t, name, CAR.parameters()))(1.0)
        assert np.isfinite([number, slope]).all()


def test_a_straight_level_road():
    """The polynomials of the angles vanish identically."""
    line = qt.Route([0.0, 2.0, 4.0], [[0, 0, 0], [10, 0, 0], [20, 0, 0]], [[5, 0, 0]] * 3, [[0, 0, 0]] * 3)
    around = dict.fromkeys(SIGNED, (-0.1, 0.1)) | {"tilt": 0.1, "load_factor": (0.9, 1.1)}
    assert qt.certify(line, qt.Limits(**around, vehicle=CAR)).holds
    above = dict.fromkeys(("tilt", *SIGNED), (0.1, None)) | {"load_factor": (1.1, None)}
    assert set(qt.certify(line, qt.Limits(**above, vehicle=CAR)).status.values()) == {"broken"}


def test_at_a_standstill():
    """From rest to rest on a curve: only gravity and the acceleration in the direction of motion act at the ends."""
    states = [[0.0, 0, 0], [10.0, 3.0, 0], [20.0, 0, 0]], [[0.0, 0, 0], [5.0, 0, 0], [0.0, 0, 0]], [[1.0, 0, 0]] * 3
    route = qt.Route([0.0, 4.0, 8.0], *states)
    table = qt.evaluate(route, [0.0, 8.0], ("load_factor", "tilt", "bank_angle"))
    assert np.asarray(table.load_factor) == pytest.approx(np.hypot(1.0, 1 / GRAVITY), rel=1e-14)
    assert np.asarray(table.tilt) == pytest.approx(np.arctan(1 / GRAVITY), rel=1e-14)
    assert np.asarray(table.bank_angle) == pytest.approx(0.0, abs=1e-14)
    times = np.linspace(0.0, 8.0, 20_001)
    for name in ("load_factor", "tilt", "bank_angle"):
        largest = np.abs(sampled(route, name, times)).max()
        assert qt.certify(route, qt.Limits(**{name: largest * 1.0001})).status == {name: "proved"}
        assert qt.certify(route, qt.Limits(**{name: largest * 0.999})).status == {name: "broken"}
    parked = qt.Route([0.0, 4.0], [[0.0, 0, 0]] * 2, np.zeros((2, 3)), np.zeros((2, 3)))
    assert qt.certify(parked, qt.Limits(load_factor=1.01, tilt=0.01, bank_angle=0.01)).holds


def test_the_gravity_of_the_vehicle_is_used():
    moon = qt.Vehicle(100.0, gravity=1.62)
    acceleration = np.asarray(HELIX.derivatives(1.3, 2))[2]
    expected = np.linalg.norm(acceleration + np.array([0, 0, 1.62])) / 1.62
    assert sampled(HELIX, "load_factor", [1.3], moon) == pytest.approx(expected, rel=1e-14)
    largest = float(qt.peak(HELIX, "load_factor", moon)[1])
    assert largest > 1.5 * float(qt.peak(HELIX, "load_factor")[1])
    limits = qt.Limits(load_factor=largest * (1 + 1e-9), vehicle=moon)
    assert qt.certify(HELIX, limits).holds
    assert not qt.certify(HELIX, qt.Limits(load_factor=largest * (1 - 1e-9), vehicle=moon)).holds
    margin = limits.margins(HELIX, 1.3)["load_factor"]
    assert float(margin) == pytest.approx(largest * (1 + 1e-9) - expected, rel=1e-12)


def test_float32():
    path = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), HELIX)
    single = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32), CAR)
    for vehicle in (single, CAR):
        table = qt.evaluate(path, np.float32([0.7, 1.3]), NAMES, vehicle=vehicle)
        for name in NAMES:
            assert table.values[name].dtype == np.float32
            np.testing.assert_allclose(table.values[name], sampled(HELIX, f"{name}_min", [0.7, 1.3]), rtol=1e-4)
    assert qt.evaluate(path, np.float32([0.7]), ("load_factor",)).load_factor.dtype == np.float32
    assert value(path, jnp.float32(1.3), "tilt").dtype == np.float32
    peaks = {name: float(qt.peak(HELIX, name, CAR)[1]) for name in NAMES}
    above = qt.certify(path, qt.Limits(**{name: 1.001 * x for name, x in peaks.items()}, vehicle=single))
    assert set(above.status.values()) == {"proved"}


def test_paths_of_other_kinds_are_sampled():
    curve = qt.Curve(HELIX.position, 4.0)
    tilted = qt.SpiralHelix([20.0, 0.5], [0.0, 0.3, 0.02], [0.0, 0.5], 4.0, qt.Placement([0, 0, 0], [1.0, 0.2, 0, 0]))
    for path in (curve, tilted):
        peaks = {name: float(qt.peak(path, name, CAR)[1]) for name in NAMES}
        above = qt.certify(path, qt.Limits(**{name: 1.001 * x for name, x in peaks.items()}, vehicle=CAR))
        assert set(above.status.values()) == {"sampled"}
        below = qt.certify(path, qt.Limits(**{name: 0.999 * x for name, x in peaks.items()}, vehicle=CAR))
        assert set(below.status.values()) == {"broken"}


def test_shapes_and_timings():
    """The steering angle depends on the shape only."""
    shape = qt.Shape.through([[0, 0, 0], [20, 4, 0], [40, 0, 0], [60, 8, 0]])
    largest = float(qt.peak(shape.route, "steering_angle", CAR)[1])
    for factor, status in ((1.001, "proved"), (0.999, "broken")):
        limits = qt.Limits(steering_angle=factor * largest, vehicle=CAR)
        assert qt.certify(shape, limits).status == {"steering_angle": status}
        timed = qt.retime(shape, qt.Limits(lateral_acceleration=3.0, longitudinal_acceleration=2.0), 3.0, 3.0).path
        assert qt.certify(timed, limits).status == {"steering_angle": status}
    assert qt.certify(timed, qt.Limits(load_factor=1.2, bank_angle=0.4)).status == {
        "load_factor": "sampled",
        "bank_angle": "sampled",
    }
    with pytest.raises(ValueError, match="a shape has no times, so limits on load_factor cannot"):
        qt.certify(shape, qt.Limits(load_factor=1.2))


def test_derivatives_of_certificates():
    def largest(x):
        path = qt.SpiralHelix([20.0, x[0]], [0.0, x[1], 0.02], [0.0, 0.5], 4.0)
        vehicle = qt.Vehicle(1e3, wheelbase=x[2], gravity=x[3])
        names = ("bank_angle", "load_factor", "steering_angle", "tilt")
        return qt.certify(path, qt.Limits(**dict.fromkeys(names, 0.5), vehicle=vehicle)).values

    x = jnp.asarray([0.5, 0.3, 2.7, 9.5])
    differences = jax.vmap(lambda h: (largest(x + h) - largest(x - h)) / (2 * STEP))(STEP * jnp.eye(4)).T
    np.testing.assert_allclose(jax.jacfwd(largest)(x), differences, atol=1e-7)
    np.testing.assert_allclose(jax.jacrev(largest)(x), differences, atol=1e-7)


LIMITS = {
    "angle": {"steering_angle": 0.17},
    "rate": {"steering_rate": (-0.05, 0.04)},
    "bank": {"bank_angle": (0.1, 0.38), "load_factor": 1.08},
    "tilt": {"tilt": 0.38},
}


@pytest.mark.parametrize("given", LIMITS.values(), ids=LIMITS.keys())
def test_limits_that_bind_are_tuned_and_proved(given):
    limits = qt.Limits(**given, vehicle=CAR)
    assert not qt.certify(HELIX, limits).holds
    best = qt.tune(START, END, limits, motion="hermite", duration=4.0, starts=2)
    assert best.converged, best.result
    assert best.certificate.holds
    assert best.certificate.active


def test_advice_is_in_the_units_of_the_user():
    """With one turn of 90°, no path between these states bends this much everywhere."""
    best = qt.tune(START, END, qt.Limits(steering_angle=(0.3, None), vehicle=CAR), motion="uniform", starts=2)
    assert not best.converged
    smallest = best.certificate.worst["steering_angle_min"][1]
    assert f"the largest minimum found is {smallest:.6g} rad" in str(best.result)
    lower = float(re.search(r"lower steering_angle_min to ([\d.]+) rad", str(best.result))[1])
    assert 0.999 * smallest < lower < smallest
    limits = qt.Limits(steering_angle=(lower, None), vehicle=CAR)
    assert qt.tune(START, END, limits, motion="uniform", starts=2).converged


def test_storage(tmp_path):
    limits = qt.Limits(steering_angle=(-0.3, 0.4), bank_angle=0.5, vehicle=CAR)
    for suffix in ("toml", "json"):
        file = tmp_path / f"limits.{suffix}"
        document.save(limits, file)
        loaded = document.load(file)
        assert float(loaded.vehicle.wheelbase) == L
        assert loaded.given() == limits.given()
    old = tmp_path / "old.toml"
    document.save(qt.Vehicle(1e3), old)
    assert "wheelbase" not in old.read_text()
    assert document.load(old).wheelbase is None
    dataset = path_dataset({"path": HELIX}, limits, samples=21)
    assert float(dataset["vehicle_wheelbase"]) == L
    assert dataset["steering_angle"].attrs["units"] == "rad"
    times = np.linspace(0.0, 4.0, 21)
    np.testing.assert_allclose(dataset["steering_angle"][0], sampled(HELIX, "steering_angle_max", times), rtol=1e-12)
    assert "steering_angle" not in path_dataset({"path": HELIX}, qt.Limits(load_factor=2.0), samples=21)


def test_batches_of_vehicles():
    lengths = jnp.asarray([2.0, 3.0])
    cars = jax.vmap(lambda x: qt.Vehicle(1e3, wheelbase=x))(lengths)
    paths = jax.tree.map(lambda x: jnp.stack([x, x]), HELIX)
    found = np.asarray(qt.evaluate(paths, [1.3], ("steering_angle",), vehicle=cars).steering_angle)[:, 0]
    assert found == pytest.approx(np.arctan(lengths * float(value(HELIX, 1.3, "horizontal_curvature"))), rel=1e-13)
    limits = jax.vmap(lambda x: qt.Limits(steering_angle=0.2, vehicle=qt.Vehicle(1e3, wheelbase=x)))(lengths)
    assert np.asarray(qt.certify(paths, limits).codes).ravel().tolist() == [0, 2]


def falling(acceleration, segments=2):
    """A straight plan at 10 m/s with a constant vertical acceleration [m/s²]."""
    t, zero = np.linspace(0.0, 2.0, segments + 1), np.zeros(segments + 1)
    states = [
        [10 * t, zero, acceleration * t**2 / 2],
        [zero + 10, zero, acceleration * t],
        [zero, zero, zero + acceleration],
    ]
    return qt.Route(t, *(np.stack(x, axis=1) for x in states))


@pytest.mark.parametrize("segments", [1, 2, 60])
@pytest.mark.parametrize("bounds", [(-0.5, 0.5), (0.1, 0.2), (-0.2, -0.1), (None, 0.5), (-0.5, None)])
def test_the_sign_of_the_bank_is_undefined_upside_down(bounds, segments):
    """The bank angle is a half turn there, of either sign; it is no part of any of these intervals."""
    path = falling(-20.0, segments)
    assert np.abs(qt.evaluate(path, [0.7], ("bank_angle",)).bank_angle) == pytest.approx(np.pi)
    assert set(qt.certify(path, qt.Limits(bank_angle=bounds)).status.values()) == {"undefined"}
    assert qt.certify(path, qt.Limits(bank_angle=0.5)).status == {"bank_angle": "broken"}
    assert qt.certify(falling(0.0, segments), qt.Limits(bank_angle=(-0.5, 0.5))).holds


def test_a_specific_force_of_zero_has_no_direction():
    path = falling(-9.80665)
    for bounds in (0.5, (0.2, None)):
        assert set(qt.certify(path, qt.Limits(tilt=bounds)).status.values()) == {"undefined"}
    certificate = qt.certify(path, qt.Limits(bank_angle=(0.1, 0.5)))
    assert set(certificate.status.values()) == {"undefined"}
    assert "the specific force is zero" in str(certificate)
    assert qt.certify(path, qt.Limits(load_factor=(0.5, None))).status == {"load_factor_min": "broken"}


REFUSED = {
    "no gravity": (
        lambda: qt.Limits(load_factor=(0.5, None), vehicle=qt.Vehicle(1e3, gravity=0.0)),
        "load_factor is relative to gravity, but the vehicle has gravity = 0",
    ),
    "no vehicle": (lambda: qt.Limits(steering_angle=0.3), "the limit steering_angle needs a wheelbase"),
    "no wheelbase": (
        lambda: qt.Limits(steering_rate=0.3, vehicle=qt.Vehicle(1e3)),
        "the limit steering_rate needs a wheelbase: pass vehicle=Vehicle(mass=..., wheelbase=...)",
    ),
    "an output": (lambda: qt.evaluate(HELIX, [0.0], ("steering_angle",)), "'steering_angle' needs a wheelbase"),
    "a peak": (lambda: qt.peak(HELIX, "steering_angle", qt.Vehicle(1e3)), "needs a wheelbase"),
    "a wheelbase of zero": (lambda: qt.Vehicle(1e3, wheelbase=0.0), "wheelbase of a vehicle must be positive"),
    "a right angle": (lambda: qt.Limits(steering_angle=1.6, vehicle=CAR), "an angle below 1.5708 rad, but 1.6 rad"),
    "a side": (lambda: qt.Limits(bank_angle=(-4.0, 1.0)), "must be an angle below 3.14159 rad, but -4 rad"),
    "a step": (lambda: qt.Limits(tilt=qt.Along([0, 9], [0.3, 4.0])), "an angle below 3.14159 rad, but 4 rad"),
    "a line": (lambda: qt.Limits(tilt=qt.Along([0, 9], [0.3, 3.4], "linear")), "an angle below 3.14159 rad, but 3.4"),
    "a timing": (lambda: qt.retime(ROUTE, qt.Limits(speed=9.0, load_factor=1.2)), "load_factor"),
    "zero": (lambda: qt.Limits(tilt=0.0), "limit tilt must be positive"),
}


@pytest.mark.parametrize(("make", "fragment"), REFUSED.values(), ids=REFUSED.keys())
def test_errors_name_the_cause(make, fragment):
    with pytest.raises(ValueError) as caught:
        make()
    assert fragment in str(caught.value)
