"""`certify` of retimed paths: agreement with the certificate of `retime`, violations that `evaluate` confirms."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import PPoly

import qtraj as qt
from qtraj.path.quantity import quantity

KNOTS = 64
CORNER = qt.SpiralHelix.hermite(
    qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
)
CAR = qt.Vehicle(1500.0, drag_area=0.7, rolling_resistance=0.012, friction=(1.0, 0.8), bank=0.05)
COMFORT = {
    "speed": 20.0,
    "acceleration": 4.0,
    "lateral_acceleration": 3.0,
    "longitudinal_acceleration": 2.5,
    "jerk": 2.0,
    "yaw_rate": 1.0,
}
DRIVEN = {"speed": 7.0, "friction": 0.3, "power": 3e4, "vehicle": CAR}


def stopping():
    """Up to a stop, a wait of 5 s, and on, with a slope and a bend."""
    position = [[-12.0, -0.6, -0.2], [0, 0, 0], [0, 0, 0], [12, 1, 1]]
    velocity = [[6.0, 0.3, 0.1], [0, 0, 0], [0, 0, 0], [6, 0.8, 0.2]]
    return qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))


def winding():
    """Four segments, of which two share the cells of different lengths."""
    t = np.array([0.0, 1.0, 2.5, 3.0, 5.0])
    position = np.stack([8 * t, 4 * np.sin(0.6 * t), 0.2 * t], axis=1)
    velocity = np.stack([8 + 0 * t, 2.4 * np.cos(0.6 * t), 0.2 + 0 * t], axis=1)
    return qt.Route(t, position, velocity, np.stack([0 * t, -1.44 * np.sin(0.6 * t), 0 * t], axis=1))


CASES = {
    "corner": (CORNER, COMFORT, {"start_speed": 0.0, "end_speed": 6.0}),
    "car": (CORNER, {"friction": 0.9, "power": 1e5, "jerk": 8.0, "vehicle": CAR}, {"start_speed": 0.0}),
    "winding": (winding(), {"speed": 14.0, "lateral_acceleration": 2.0, "yaw_acceleration": 0.5}, {}),
    "stop": (stopping(), DRIVEN, {}),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    path, limits, ends = CASES[request.param]
    return limits, qt.retime(path, qt.Limits(**limits), knots=KNOTS, throw=True, **ends)


def test_the_certificate_agrees_with_that_of_retime(case):
    limits, timed = case
    found = qt.certify(timed.path, qt.Limits(**limits))
    assert found.holds
    assert found.names == timed.certificate.names
    assert found.status == timed.certificate.status
    np.testing.assert_allclose(found.values, timed.certificate.values, rtol=1e-4)
    np.testing.assert_array_equal(found.limits, timed.certificate.limits)


def test_a_loosened_limit_stays_proved_and_a_tightened_one_is_broken(case):
    """At the reported time `evaluate` finds the reported value, which is larger than the limit."""
    limits, timed = case
    for name, limit in limits.items():
        if name == "vehicle":
            continue
        largest = timed.certificate.worst[name][1]
        assert qt.certify(timed.path, qt.Limits(**{**limits, name: 1.1 * limit})).holds
        found = qt.certify(timed.path, qt.Limits(**{**limits, name: largest * (1 - 1e-4)}))
        assert found.unmet == [name]
        time, value, bound = found.worst[name]
        assert found.status[name] == "broken"
        assert value > bound
        output = quantity(name).variable
        table = qt.evaluate(timed.path, np.array([time]), (output,), vehicle=limits.get("vehicle"))
        evaluated = abs(float(np.ravel(table.values[output])[0]))
        assert evaluated > bound
        assert evaluated == pytest.approx(value, rel=1e-8)


def test_limits_on_the_shape_are_proved_on_the_original_path(case):
    _, timed = case
    shape = qt.Limits(curvature=0.2, slope=0.5)
    found, own = qt.certify(timed.path, shape), qt.certify(timed.path.path, shape)
    assert found.status == own.status
    assert found.status["slope"] == "proved"  # at a stop, the curvature is undefined
    for name in shape.given():
        (time, value, _), (parameter, expected, _) = found.worst[name], own.worst[name]
        np.testing.assert_equal(value, expected)
        assert time == pytest.approx(float(timed.timing.time(parameter)))
    tight = 0.9 * found.worst["slope"][1]
    broken = qt.certify(timed.path, qt.Limits(slope=tight))
    assert broken.status == {"slope": "broken"}
    near = broken.worst["slope"][0] + np.array([-1e-2, 0.0, 1e-2])  # the largest slope may be that of a stop
    slopes = qt.evaluate(timed.path, near, ("slope",)).values["slope"]
    assert np.nanmax(slopes) > tight


def test_a_stored_path_has_the_same_certificate(case, tmp_path):
    limits, timed = case
    timed.path.save(tmp_path / "path.json")
    found, again = (qt.certify(path, qt.Limits(**limits)) for path in (timed.path, qt.load(tmp_path / "path.json")))
    assert again.holds
    for field in ("codes", "times", "values", "limits"):
        np.testing.assert_array_equal(getattr(again, field), getattr(found, field))


def test_all_kinds_of_limits_keep_their_order():
    """Limits on timing, on shape, and limits that can only be sampled."""
    timed = qt.retime(CORNER, qt.Limits(speed=9.0, vehicle=CAR, power=1e5), knots=KNOTS)
    forces = {"normal_load": 1e6, "lateral_force": 1e6}
    limits = qt.Limits(speed=9.0, curvature=0.2, power=1e5, torsion=9.0, vehicle=CAR, **forces)
    found = qt.certify(timed.path, limits)
    assert found.names == tuple(limits.given())
    assert set(found.status.items()) == {
        ("curvature", "proved"),
        ("torsion", "proved"),
        ("speed", "proved"),
        ("power", "proved"),
        ("normal_load", "proved"),
        ("lateral_force", "sampled"),
    }
    assert qt.certify(timed.path, qt.Limits()).names == ()


def test_the_angular_rate_of_a_straight_path_is_undefined():
    straight = qt.SpiralHelix([10.0, 5.0], [0.3], [2.0, 1.0], 20.0)
    limits = qt.Limits(speed=5.0, angular_rate=0.5)
    timed = qt.retime(straight, limits, knots=KNOTS)
    found = qt.certify(timed.path, limits)
    assert found.status == timed.certificate.status == {"speed": "proved", "angular_rate": "undefined"}
    assert np.isnan(found.worst["angular_rate"][1])


LIMITS = qt.Limits(speed=9.0, lateral_acceleration=3.0, longitudinal_acceleration=2.5, curvature=0.2)
TIMED = {name: value for name, value in LIMITS.given().items() if name != "curvature"}


@pytest.fixture(scope="module")
def paths():
    each = [qt.SpiralHelix(CORNER.radius * k, CORNER.angle, CORNER.height, CORNER.duration) for k in (1.0, 1.2)]
    timed = [qt.retime(path, qt.Limits(**TIMED), start_speed=0.0, knots=16).path for path in each]
    return jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *timed)


@pytest.mark.parametrize("how", ["batch", "vmap", "jit"])
def test_batches_agree_with_single_paths(paths, how):
    ones = [qt.certify(jax.tree.map(lambda x, k=k: x[k], paths), LIMITS) for k in range(2)]
    found = {
        "batch": lambda: qt.certify(paths, LIMITS),
        "vmap": lambda: jax.vmap(lambda path: qt.certify(path, LIMITS))(paths),
        "jit": lambda: jax.jit(jax.vmap(qt.certify, (0, None)))(paths, LIMITS),
    }[how]()
    assert found.holds.tolist() == [one.holds for one in ones] == [True, True]
    for field in ("codes", "times", "values", "limits"):
        expected = np.stack([getattr(one, field) for one in ones])
        np.testing.assert_allclose(getattr(found, field), expected, rtol=1e-6)


def test_each_path_of_a_batch_may_have_its_own_limits(paths):
    limits = jax.vmap(lambda v: qt.Limits(speed=v, curvature=0.2))(jnp.array([9.0, 5.0]))
    assert qt.certify(paths, limits).status["speed"].tolist() == ["proved", "broken"]


def test_the_largest_value_is_differentiable():
    """On a circle the lateral acceleration is a·R·rate² for u̇² = a."""
    radius, a = 30.0, 4.0

    def largest(radius, a):
        path = qt.SpiralHelix(jnp.stack([radius, 0 * radius]), [0.0, 0.1], [0.0], 20.0)
        powers = jnp.zeros((16, 4)).at[:, 0].set(a)
        retimed = qt.RetimedPath(path, qt.Timing(powers, jnp.linspace(0.0, 20.0, 17)))
        return qt.certify(retimed, qt.Limits(lateral_acceleration=9.0)).values[0]

    by_radius, by_a = jax.grad(largest, (0, 1))(radius, a)
    assert by_radius == pytest.approx(a * 0.01, rel=1e-6)
    assert by_a == pytest.approx(radius * 0.01, rel=1e-6)


TURNING = qt.SpiralHelix([30.0], [0.0, 0.1], [0.0], 20.0)
CURVE = qt.Curve(lambda t: jnp.stack([30 * jnp.cos(0.1 * t), 30 * jnp.sin(0.1 * t), 0 * t]), 20.0)


def slow(knots):
    powers = np.zeros((len(knots) - 1, 4))
    powers[:, 0] = 1.0
    return qt.Timing(powers, knots)


@pytest.mark.parametrize(
    ("path", "knots"),
    [
        (CURVE, np.linspace(0.0, 20.0, 17)),  # not polynomial
        (TURNING, np.append(np.linspace(0.0, 18.0, 16), 20.0)),  # of different lengths
        (winding(), np.linspace(0.0, 5.0, 17)),  # cells that contain joints
    ],
)
def test_other_cells_are_sampled(path, knots):
    found = qt.certify(qt.RetimedPath(path, slow(knots)), qt.Limits(speed=20.0, curvature=1.0))
    assert found.status == {"curvature": "sampled", "speed": "sampled"}
    assert qt.certify(qt.RetimedPath(path, slow(knots)), qt.Limits(speed=1.0)).status == {"speed": "broken"}


def test_traced_cells_of_different_lengths_are_not_proved():
    def status(knots):
        powers = np.zeros((16, 4))
        powers[:, 0] = 1.0

        @jax.jit
        def certificate(knots):
            return qt.certify(qt.RetimedPath(TURNING, qt.Timing(powers, knots)), qt.Limits(speed=20.0, curvature=1.0))

        return certificate(knots).status

    assert status(np.linspace(0.0, 20.0, 17)) == {"curvature": "proved", "speed": "proved"}
    assert status(np.append(np.linspace(0.0, 18.0, 16), 20.0)) == {"curvature": "proved", "speed": "sampled"}
    assert status(np.linspace(0.0, 19.0, 17)) == {"curvature": "undecided", "speed": "sampled"}


@pytest.fixture(scope="module")
def corners():
    """Three corners driven by one car, each with its own limit, and their certificates one by one."""
    corner = qt.SpiralHelix.hermite(
        qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
    )
    car = qt.Vehicle(1500.0, drag_area=0.7, rolling_resistance=0.012, friction=(1.0, 0.4), bank=0.05)
    limits = [qt.Limits(friction=jnp.asarray(x), power=1e5, vehicle=car) for x in (0.9, 0.7, 0.8)]
    timed = [
        qt.retime(
            qt.SpiralHelix(corner.radius * k, corner.angle, corner.height, corner.duration),
            qt.Limits(friction=0.9, power=1e5, vehicle=car),
            start_speed=0.0,
            knots=16,
        ).path
        for k in (1.2, 1.0, 1.1)
    ]
    return timed, limits, [qt.certify(path, own) for path, own in zip(timed, limits, strict=True)]


@pytest.mark.parametrize("count", [2, 3])
def test_a_batch_of_paths_with_one_vehicle(corners, count):
    """Three paths are as many as there are coordinates."""
    single, limits, alone = (each[:count] for each in corners)
    timed = jax.tree.map(lambda *x: jnp.stack(x), *single)
    friction = jnp.stack([own.friction for own in limits])
    together = qt.certify(timed, eqx.tree_at(lambda own: own.friction, limits[0], friction))
    for k in range(count):
        np.testing.assert_array_equal(together.codes[k], alone[k].codes)
        np.testing.assert_allclose(together.values[k], alone[k].values, rtol=1e-9)


def test_traced_limits_of_a_retimed_route():
    t, speed = np.array([0.0, 2, 4, 6]), 8.0
    sine, cosine, zero = np.sin(0.3 * t), np.cos(0.3 * t), 0 * t
    route = qt.Route(
        t,
        np.stack([speed * t, 3 * sine, zero], 1),
        np.stack([speed + zero, 0.9 * cosine, zero], 1),
        np.stack([zero, -0.27 * sine, zero], 1),
    )
    timed = qt.retime(route, qt.Limits(speed=10.0, lateral_acceleration=2.0), knots=64)
    codes = jax.jit(lambda speed: qt.certify(timed.path, qt.Limits(speed=speed)).codes)(10.1)
    np.testing.assert_array_equal(codes, qt.certify(timed.path, qt.Limits(speed=10.1)).codes)


ALL = {"speed": 50.0, "acceleration": 50.0, "longitudinal_acceleration": 50.0, "jerk": 1e3, "friction": 50.0}
STEP, BEND = [[1.0, 0, 0, 0], [2.0, 0, 0, 0]], [[1.0, 0, 0, 0], [1.0, 1, 0, 0]]


@pytest.mark.parametrize(
    ("coefficients", "rest", "undecided"),
    [
        ([[1.0, 1, 0, 0], [2.0, 1, 0, 0]], False, set()),
        (STEP, False, {"acceleration", "longitudinal_acceleration", "jerk", "friction"}),
        (BEND, False, {"jerk"}),
        ([[0.0, 1, 0, 0], [1.0, 1, 0, 0]], True, set()),
        ([[0.1, 0.9, 0, 0], [1.0, 0.9, 0, 0]], True, set(ALL)),
    ],
    ids=["smooth", "speed jumps", "acceleration jumps", "rest", "no rest"],
)
def test_a_timing_that_jumps_is_not_proved(coefficients, rest, undecided):
    timing = qt.Timing(coefficients, np.linspace(0.0, 6.0, 3), (rest, False))
    found = qt.certify(qt.RetimedPath(CORNER, timing), qt.Limits(**ALL, vehicle=CAR))
    expected = {name: "undecided" if name in undecided else "proved" for name in ALL}
    assert found.status == expected


def test_a_route_whose_acceleration_jumps_is_not_proved():
    bends = np.array([[[0.0, 0.5, 0], [0, 0.8, 0]], [[5.0, 0, 0], [5, 1, 0]], [[0.0, 0, 0], [5, 0.5, 0]]])
    route = qt.Route.from_piecewise(PPoly(bends, [0.0, 1.0, 2.0]))
    timing = qt.Timing([[1.0, 0, 0, 0]] * 4, np.linspace(0.0, 2.0, 5))
    found = qt.certify(qt.RetimedPath(route, timing), qt.Limits(acceleration=20.0, jerk=20.0))
    assert found.status == {"acceleration": "proved", "jerk": "undecided"}


def test_the_largest_values_are_those_of_dense_samples(case):
    limits, timed = case
    chosen = qt.Limits(**limits)
    table = np.stack(
        [
            np.asarray(jax.vmap(lambda t, n=name: chosen.values(timed.path, t)[n])(_dense(timed)))
            for name in chosen.given()
        ]
    )
    largest = np.nanmax(np.abs(table), axis=1)
    ratio = np.asarray(timed.certificate.values) / largest
    assert ratio.min() > 1 - 1e-6
    assert ratio.max() < 1 + 3e-4  # the samples omit the knots


def _dense(timed):
    """Instants in all cells, not close to stops, where rounding errors dominate some quantities."""
    times = np.asarray(timed.timing.times)
    fractions = np.linspace(0.02, 0.98, 49)
    return (times[:-1, None] + np.diff(times)[:, None] * fractions).ravel()


@pytest.mark.parametrize("seed", range(5))
def test_the_largest_value_in_a_cell_is_exact(seed):
    """On a straight path of the speed V, the longitudinal acceleration is V a'/2, whose largest value is known."""
    rng = np.random.default_rng(seed)
    at, speed, duration = rng.uniform(0.1, 0.9), 5.0, 20.0
    steepest, bend = rng.uniform(3.0, 5.0), rng.uniform(1.0, 3.0)  # a' = steepest − bend (x − at)²
    rising = [1.0, steepest - bend * at**2, bend * at, -bend / 3]
    timing = qt.Timing([rising, [sum(rising), 0, 0, 0]], np.linspace(0.0, duration, 3))
    straight = qt.SpiralHelix([10.0, speed], [0.3], [0.0], duration)
    found = qt.certify(qt.RetimedPath(straight, timing), qt.Limits(longitudinal_acceleration=50.0))
    assert found.holds
    np.testing.assert_allclose(found.values[0], 0.5 * speed * steepest / (duration / 2), rtol=1e-11)
