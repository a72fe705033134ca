"""The fastest timing along a path: closed forms, dense samples, finite differences, routes with stops."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import CubicSpline, PPoly

import qtraj as qt
from qtraj.design.timing import search
from qtraj.design.timing.constraints import NAMES
from qtraj.design.timing.directions import directions
from qtraj.design.timing.grid import uniform
from qtraj.design.timing.parts import of_path
from qtraj.design.timing.proof import prove
from qtraj.design.timing.retime import source
from qtraj.path.stops import Segments
from qtraj.path.values import value

KNOTS = 128
CORNER = qt.SpiralHelix.hermite(
    qt.BoundaryState([30.0, 0, 0], [0, 10.0, 1]), qt.BoundaryState([0, 45.0, 8], [-12.0, 2, 0]), 6.0
)
COMFORT = {
    "speed": 20.0,
    "acceleration": 4.0,
    "lateral_acceleration": 3.0,
    "longitudinal_acceleration": 2.5,
    "jerk": 2.0,
    "yaw_rate": 1.0,
}


def helix(radius, angle, height, duration):
    """A spiral-helix with four coefficients of each kind, as `CORNER` has: all share their executables."""
    rows = [np.pad(np.array(c, float), (0, 4 - len(c))) for c in (radius, angle, height)]
    return qt.SpiralHelix(rows[0], rows[1], rows[2], duration)


STRAIGHT = helix([10.0, 5.0], [0.3], [2.0, 1.0], 20.0)  # 102.0 m along one line
LENGTH = 20.0 * 26**0.5
CIRCLE = helix([30.0], [0.0, 0.1], [0.0], 20.0)
SPIRAL = helix([20.0], [0.0, 0.2], [0.0, 3.0], 10.0)


def retimed(path, ends=(None, None), **limits):
    return qt.retime(path, qt.Limits(**limits), start_speed=ends[0], end_speed=ends[1], knots=KNOTS, throw=True)


def largest(path, name, samples=20_001):
    """The largest of dense samples of a quantity, from the derivatives of the retimed path."""
    times = jnp.linspace(0.0, path.duration, samples)[1:-1]
    return float(jnp.max(jax.jit(jax.vmap(lambda t: value(path, t, name)))(times)))


def test_a_straight_line_is_driven_with_a_trapezoid_of_speed():
    timed = retimed(STRAIGHT, (0.0, 0.0), speed=9.0, longitudinal_acceleration=2.0)
    assert np.isclose(timed.duration, 9 / 2 + LENGTH / 9, rtol=1e-4)
    assert timed.certificate.holds
    short = retimed(STRAIGHT, (0.0, 0.0), speed=90.0, longitudinal_acceleration=2.0)
    assert np.isclose(short.duration, 2 * (LENGTH / 2) ** 0.5, rtol=1e-4)
    (first, last) = timed.intervals("speed", part=0.999)[0]
    assert first == pytest.approx(4.5, abs=0.3)
    assert last == pytest.approx(LENGTH / 9, abs=0.3)


def test_the_jerk_rounds_the_corners_of_the_speed():
    """Constant acceleration A from rest, then jerk −J until the speed V, and the same backwards at the end."""
    V, A, J = 9.0, 2.0, 1.0
    timed = retimed(STRAIGHT, (0.0, 0.0), speed=V, longitudinal_acceleration=A, jerk=J)
    v1, s = V - A * A / (2 * J), A / J
    way = v1**2 / (2 * A) + v1 * s + A * s**2 / 2 - J * s**3 / 6
    assert np.isclose(timed.duration, 2 * (v1 / A + s) + (LENGTH - 2 * way) / V, rtol=2e-4)
    assert timed.certificate.holds
    assert largest(timed.path, "jerk") <= J


@pytest.mark.parametrize(("length", "optimum"), [(1.0, 0.2), (1e-4, 0.002)])
def test_known_optima_of_the_suite_of_toppra(length, optimum):
    """`two_points_1` and `two_points_2`: 100 m/s and 100 m/s² on a line whose own velocity is zero at both ends."""
    points = np.array([[0.0, 0, 0], [0, length, 0]])
    line = qt.Route.from_piecewise(CubicSpline([0.0, 1.0], points, bc_type="clamped"))
    timed = retimed(line, (0.0, 0.0), speed=100.0, acceleration=100.0)
    assert optimum <= timed.duration <= optimum * (1 + 5e-5)
    assert timed.certificate.holds


@pytest.mark.parametrize(("path", "speed", "radius"), [(CIRCLE, 3.0, 30.0), (SPIRAL, 5.0, 31.25)])
@pytest.mark.parametrize("limit", [7.0, 15.0])
def test_a_circle_and_a_helix_from_rest_to_rest(path, speed, radius, limit):
    """Constant longitudinal acceleration up to the speed that the speed or the lateral acceleration allows."""
    across, along = 3.0, 2.0
    timed = retimed(path, (0.0, 0.0), speed=limit, lateral_acceleration=across, longitudinal_acceleration=along)
    highest, length = min(limit, (across * radius) ** 0.5), speed * float(path.duration)
    least = length / highest + highest / along
    assert highest**2 / along < length
    assert least <= timed.duration <= least * (1 + 2e-4)
    assert timed.certificate.holds


def test_a_circle_from_rest_with_a_total_acceleration():
    """With w = v², (w'/2)² + (w/R)² = A²: w = A·R·sin(2s/R) until the whole acceleration is lateral."""
    R, A, length = 30.0, 3.0, 60.0
    timed = retimed(CIRCLE, (0.0, None), acceleration=A)
    reached = R * np.pi / 4
    rising = quad(lambda s: 2 * (A * R * np.sin(2 * s * s / R)) ** -0.5 * s, 0, reached**0.5)[0]
    assert np.isclose(timed.duration, rising + (length - reached) / (A * R) ** 0.5, rtol=2e-4)
    assert timed.certificate.holds


@pytest.mark.parametrize(("limits", "speed"), [({"lateral_acceleration": 2.0}, 7.0), ({"yaw_rate": 0.3}, 9.0)])
def test_a_helix_is_driven_with_a_constant_speed(limits, speed):
    curvature = 20 * 0.04 / (16 + 9)
    bound = {
        "lateral_acceleration": lambda a: (a / curvature) ** 0.5,
        "yaw_rate": lambda w: w / (0.2 / 5.0 * 4.0 / 5.0),
    }
    ((name, limit),) = limits.items()
    expected = min(bound[name](limit), speed)
    timed = retimed(SPIRAL, speed=speed, **limits)
    assert np.isclose(timed.duration, 10.0 * 5.0 / expected, rtol=1e-5)
    assert timed.certificate.holds


@pytest.fixture(scope="module")
def comfortable():
    return retimed(CORNER, (0.0, 6.0), **COMFORT)


def test_dense_samples_agree_with_the_certificate(comfortable):
    assert comfortable.certificate.holds
    for name, limit in COMFORT.items():
        reached = largest(comfortable.path, name)
        assert reached <= limit * (1 + 1e-9)
        assert reached == pytest.approx(comfortable.certificate.worst[name][1], rel=2e-3)
    assert largest(comfortable.path, "longitudinal_acceleration") > 0.999 * COMFORT["longitudinal_acceleration"]


def test_a_timing_that_breaks_a_limit_between_nodes_is_not_proved(comfortable):
    """The proof does not depend on the search: a slightly faster timing is broken."""
    timing, polynomials = comfortable.timing, source(CORNER)
    assert polynomials is not None
    bounds = {name: jnp.asarray(COMFORT.get(name, np.inf)) for name in (*COMFORT, "yaw_acceleration", "angular_rate")}
    for factor, broken in ((1.0, False), (1.002, True)):
        own = timing.coefficients * factor, jnp.asarray(timing.rest)
        found = prove(polynomials, uniform(KNOTS), own, bounds).whole()
        assert bool(jnp.any(found == 2)) == broken


def test_proofs_agree_with_dense_samples():
    """Random timings about the limits: a cell that is proved exceeds no limit at any sample, a broken one does."""
    rng = np.random.default_rng(3)
    values = 1 + rng.uniform(-0.2, 0.2, KNOTS + 1)
    bend = rng.uniform(-0.05, 0.05, KNOTS)
    rows = np.stack([values[:-1], np.diff(values) - bend, bend, 0 * bend], axis=1)
    knots = np.linspace(0.0, float(CORNER.duration), KNOTS + 1)
    timing = qt.Timing(rows, knots)
    inside = knots[:-1, None] + knots[1] * np.clip(np.linspace(0.0, 1.0, 129), 1e-6, 1 - 1e-6)[None]
    times = jax.jit(jax.vmap(timing.time))(jnp.asarray(inside.ravel()))
    path = qt.RetimedPath(CORNER, timing)
    names = ("speed", "acceleration", "lateral_acceleration", "longitudinal_acceleration", "jerk", "yaw_rate")
    sampled = {
        name: np.asarray(jax.jit(jax.vmap(lambda t, name=name: value(path, t, name)))(times)).reshape(KNOTS, -1).max(1)
        for name in names
    }
    bounds = {name: jnp.asarray(np.median(sampled[name]) if name in names else np.inf) for name in NAMES}
    polynomials = source(CORNER)
    assert polynomials is not None
    codes = prove(polynomials, uniform(KNOTS), (timing.coefficients, np.array([False, False])), bounds).codes
    for name, code in zip(NAMES, np.asarray(codes), strict=True):
        if name in names:
            over = sampled[name] / float(bounds[name]) - 1
            assert set(code) == {0, 2}
            assert over[code == 0].max() < 1e-9
            assert over[code == 2].min() > -1e-3


def test_speeds_at_the_ends(comfortable):
    assert comfortable.speeds == pytest.approx([0.0, 6.0], rel=1e-5)
    path = comfortable.path
    assert jnp.linalg.norm(path.velocity(0.0)) == 0
    assert jnp.linalg.norm(path.velocity(path.duration)) == pytest.approx(6.0, rel=1e-5)
    assert jnp.allclose(path.position(0.0), CORNER.position(0.0))
    assert jnp.allclose(path.position(path.duration), CORNER.position(CORNER.duration))


def test_parameter_and_time_are_inverse(comfortable):
    timing = comfortable.timing
    u = jnp.linspace(0.0, CORNER.duration, 1001)
    times = jax.vmap(timing.time)(u)
    assert jnp.all(jnp.diff(times) > 0)
    assert jnp.allclose(jax.vmap(timing.parameter)(times), u, rtol=0, atol=1e-11)
    assert times[-1] == pytest.approx(float(comfortable.duration), rel=1e-12)


def test_derivatives_of_the_retimed_path(comfortable):
    path, t = comfortable.path, 3.21
    rows = path.derivatives(t, 4)
    for order in range(4):
        step = 1e-4
        change = (path.derivatives(t + step, order)[order] - path.derivatives(t - step, order)[order]) / (2 * step)
        assert jnp.allclose(change, rows[order + 1], rtol=1e-5, atol=1e-6)


def test_repeated_derivatives_of_the_retimed_path(comfortable):
    """Differentiating `position` again and again gives what `derivatives` gives, at rest and at the end too."""
    path = comfortable.path
    velocity = jax.jacfwd(path.position)
    acceleration = jax.jacfwd(velocity)
    rows = jax.jit(lambda t: (velocity(t), acceleration(t), jax.jacfwd(acceleration)(t), path.derivatives(t, 3)[1:]))
    for t in (0.0, 0.7, 3.21, float(path.duration)):
        *found, expected = rows(t)
        assert jnp.allclose(jnp.stack(found)[:2], expected[:2], rtol=1e-9, atol=1e-9)
        assert t == 0 or jnp.allclose(found[2], expected[2], rtol=1e-8, atol=1e-8)


def test_derivatives_in_the_timing(comfortable):
    """Second derivatives in time and in the coefficients, mixed, against finite differences."""
    timing = comfortable.timing

    def place(t, k):
        return qt.Timing(timing.coefficients * (1 + k), timing.knots, timing.rest).parameter(t)

    rate = jax.jit(jax.grad(place))
    step, at = 1e-4, (3.21, 0.02)
    expected = (rate(at[0], at[1] + step) - rate(at[0], at[1] - step)) / (2 * step)
    assert jax.jit(jax.grad(jax.grad(place), argnums=1))(*at) == pytest.approx(float(expected), rel=1e-6)
    assert jax.jit(jax.grad(jax.grad(place, argnums=1)))(*at) == pytest.approx(float(expected), rel=1e-6)


def test_a_traced_zero_speed_is_a_failure():
    """Rest changes the cells, so it must be known; the code says so instead of ignoring the zero."""
    limits = qt.Limits(speed=9.0, longitudinal_acceleration=2.0)
    timed = jax.vmap(lambda v: qt.retime(STRAIGHT, limits, start_speed=v, knots=KNOTS))(jnp.array([0.0, 1.0, np.nan]))
    codes = [qt.ResultCode.rest_unknown, qt.ResultCode.successful, qt.ResultCode.not_finite]
    assert timed.code.tolist() == codes
    assert timed.speeds[1, 0] == pytest.approx(1.0, rel=1e-5)
    assert "Pass the number 0 for an end at rest" in timed.result[0]


def test_the_number_zero_is_known_inside_jit():
    """Tracing is enough: whether an end is at rest is part of the structure of the result."""

    def slower(speed):
        limits = qt.Limits(speed=speed, longitudinal_acceleration=2.0)
        return qt.retime(STRAIGHT, limits, start_speed=0.0, end_speed=0, knots=KNOTS)

    assert jax.eval_shape(slower, jnp.asarray(9.0)).timing.rest == (True, True)


def test_a_speed_without_bound_is_a_failure():
    timed = qt.retime(STRAIGHT, qt.Limits(lateral_acceleration=2.0), knots=KNOTS)
    assert timed.code == qt.ResultCode.speed_unbounded
    assert not timed.converged
    with pytest.raises(RuntimeError, match="Add a limit on speed"):
        timed.check()


def test_the_angular_rate_is_undefined_on_a_straight_path():
    timed = qt.retime(STRAIGHT, qt.Limits(speed=5.0, angular_rate=0.5), knots=KNOTS)
    assert timed.certificate.status == {"speed": "proved", "angular_rate": "undefined"}
    assert timed.result.count("a limited quantity is undefined") == 1
    assert "angular_rate is undefined at t =" in timed.result


def test_a_slowed_timing_is_not_called_the_fastest(monkeypatch):
    """The last resort against an excess between the nodes, a slower drive on the whole path, is no optimum."""
    satisfied = search._satisfied
    monkeypatch.setattr(search, "_satisfied", lambda *a: (*satisfied(*a)[:2], jnp.asarray(np.inf)))
    timed = qt.retime(STRAIGHT, qt.Limits(speed=9.0, longitudinal_acceleration=2.0), knots=KNOTS)
    assert timed.code == qt.ResultCode.not_converged
    assert "Try a larger tolerance, or more knots" in timed.result


def test_a_speed_that_cannot_be_reached_is_told():
    timed = qt.retime(CORNER, qt.Limits(**COMFORT), start_speed=0.0, end_speed=50.0, knots=KNOTS)
    assert timed.code == qt.ResultCode.end_speed_not_reached
    assert not timed.converged
    assert "the fastest timing ends with" in timed.result
    assert timed.certificate.holds
    with pytest.raises(RuntimeError, match="cannot be reached within the limits"):
        timed.check()


def test_gradients_of_the_least_time():
    """On a trapezoid of speed, T = V/A + L/V; on a helix T = L√(κ/A). The path counts too: its turning changes L, κ."""

    def straight(values):
        limits = qt.Limits(speed=values[0], longitudinal_acceleration=values[1])
        return qt.retime(STRAIGHT, limits, start_speed=0.0, end_speed=0.0, knots=KNOTS).duration

    def turning(values):
        angle = jnp.asarray(SPIRAL.angle).at[1].set(values[0])
        path = qt.SpiralHelix(SPIRAL.radius, angle, SPIRAL.height, SPIRAL.duration)
        return qt.retime(path, qt.Limits(lateral_acceleration=values[1]), knots=KNOTS).duration

    V, A = 9.0, 2.0
    assert jax.grad(straight)(jnp.array([V, A])) == pytest.approx([1 / A - LENGTH / V**2, -V / A**2], rel=1e-3)
    at = np.array([0.2, 2.0])
    weights = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # central differences of order 8
    slopes = []
    for change in 0.03 * np.diag(at):
        pairs = [turning(at + k * change) - turning(at - k * change) for k in range(1, 5)]
        slopes.append(weights @ np.array(pairs) / change.sum())
    assert jax.grad(turning)(jnp.asarray(at)) == pytest.approx(np.array(slopes), rel=1e-6)


def test_a_batch_of_paths():
    paths = jax.vmap(lambda k: qt.SpiralHelix(CORNER.radius * k, CORNER.angle, CORNER.height, CORNER.duration))(
        jnp.array([1.0, 1.1])
    )
    limits = qt.Limits(speed=20.0, lateral_acceleration=3.0, longitudinal_acceleration=2.5)
    many = jax.vmap(lambda path: qt.retime(path, limits, knots=KNOTS))(paths)
    one = qt.retime(jax.tree.map(lambda x: x[1], paths), limits, knots=KNOTS)
    assert many.duration[1] == pytest.approx(float(one.duration), rel=1e-7)
    assert many.certificate.holds.tolist() == [True, True]
    assert many.to_xarray()["usage"].dims == ("batch", "limit", "cell")
    assert repr(many).startswith("Retimed(2 paths, ")


def test_a_retimed_path_is_a_path(comfortable, tmp_path):
    path = comfortable.path
    path.save(tmp_path / "path.json")
    again = qt.load(tmp_path / "path.json")
    assert jnp.array_equal(again.derivatives(2.5, 3), path.derivatives(2.5, 3))
    table = qt.evaluate(path, [0.5, 2.0], ("speed", "curvature"))
    assert table.speed[1] == pytest.approx(float(jnp.linalg.norm(path.velocity(2.0))))
    attitude = qt.FrameProgram(path, qt.Upright())(2.0)
    assert jnp.linalg.norm(attitude.rate) < 1.0
    assert path.length() == pytest.approx(float(CORNER.length()), rel=1e-8)


def test_a_curve_is_only_sampled():
    curve = qt.Curve(lambda t: jnp.stack([10 * jnp.cos(t), 10 * jnp.sin(t), 0 * t]), 3.0)
    timed = qt.retime(curve, qt.Limits(lateral_acceleration=2.5), knots=KNOTS)
    assert timed.certificate.status == {"lateral_acceleration": "sampled"}
    assert timed.code == qt.ResultCode.limits_sampled
    assert timed.duration == pytest.approx(30.0 / 5.0, rel=1e-5)


# Routes


def winding():
    """A drive of 12 segments through a double bend."""
    t = np.arange(13.0)
    rows = [
        [8 * t, 4 * np.sin(0.6 * t), 0.2 * t],
        [8 + 0 * t, 2.4 * np.cos(0.6 * t), 0.2 + 0 * t],
        [0 * t, -1.44 * np.sin(0.6 * t), 0 * t],
    ]
    return qt.Route(t, *(np.array(row).T for row in rows))


def stopping():
    """Up to a stop, a wait of 5 s, and on; the velocity and the acceleration vanish at the stop."""
    position = [[-12.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 1, 0.5]]
    velocity = [[6.0, 0.3, 0], [0, 0, 0], [0, 0, 0], [6, 0.5, 0.2]]
    return qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))


def test_a_route_is_proved_on_every_segment():
    limits = qt.Limits(speed=14.0, lateral_acceleration=2.0, longitudinal_acceleration=1.5, jerk=1.0)
    timed = qt.retime(winding(), limits, start_speed=5.0, knots=KNOTS, throw=True)
    assert timed.certificate.holds
    assert timed.speeds[0] == pytest.approx(5.0, rel=1e-5)
    for name, limit in limits.given().items():
        assert largest(timed.path, name) <= limit * (1 + 1e-9)


def test_stops_keep_their_lengths():
    limits = qt.Limits(speed=7.0, longitudinal_acceleration=2.0, jerk=3.0)
    timed = qt.retime(stopping(), limits, knots=KNOTS)
    timing = timed.timing
    assert timing.time(8.0) - timing.time(3.0) == pytest.approx(5.0, rel=1e-12)
    middle = float(timing.time(5.0))
    assert jnp.linalg.norm(timed.path.velocity(middle)) == 0
    assert timed.certificate.holds
    assert largest(timed.path, "jerk") <= 3.0 * (1 + 1e-9)
    assert timed.duration < 11.0 + 5.0


def test_what_is_left_of_the_speed_at_a_stop_is_removed_from_its_direction():
    """r' = u·(1, 0, 0) and a little across it at u = 0: the direction is (1, 0, 0) with and without that part."""
    exact, rest = np.zeros((1, 3, 3)), np.zeros((1, 3, 3))
    exact[0, 2, 0] = rest[0, 2, 0] = 0.5
    rest[0, 1, 1] = 1e-13
    standing = np.array([[True, False]])
    for c in (exact, rest):
        (found,) = directions(Segments(np.zeros(1), c, np.full(1, 1.0)), standing).values()
        assert found.factor.floats() == [0, 1]
        assert [p.floats() for p in found.direction] == [[1], [0], [0]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"limits": qt.Limits(speed=5.0, curvature=1.0, longitudinal_jerk=1.0)},
            "Remove the limits on longitudinal_jerk, and check them",
        ),
        ({"limits": qt.Limits(longitudinal_acceleration=1.0)}, "bounds the speed.* add a limit on the speed"),
        ({"limits": qt.Limits(speed=5.0), "knots": 100}, "power of two"),
        ({"limits": qt.Limits(speed=5.0), "start_speed": -1.0}, "at least 0"),
        ({"limits": qt.Limits(speed=5.0), "stop_speed": -0.1}, "stop_speed must be at least 0"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.retime(CORNER if "stop_speed" not in arguments else winding(), **arguments)


def test_a_path_that_stands_is_refused():
    standing = helix([10.0, 0.0, 1.0], [0.0], [0.0], 2.0)
    with pytest.raises(ValueError, match="velocity of the path is zero at some instant"):
        qt.retime(standing, qt.Limits(speed=5.0), knots=KNOTS)


def creeping():
    """The fit of a stop overshoots a little."""
    velocity = [[6.0, 0.3, 0], [-0.003, 0, 0], [6, 0.5, 0.2]]
    return qt.Route([0.0, 3, 6], [[-12.0, 0, 0], [0, 0, 0], [12, 1, 0.5]], velocity, np.zeros((3, 3)))


def test_a_vehicle_that_turns_back_at_a_stop_stands_there():
    """Slow motion is replaced by a stop; what is driven faster keeps its path and its parameter."""
    route = creeping()
    limits = qt.Limits(speed=7.0, longitudinal_acceleration=2.0, jerk=3.0)
    timed = qt.retime(route, limits, knots=KNOTS, stop_speed=0.2)
    assert timed.certificate.holds
    driven = timed.path.path
    assert driven.duration == route.duration
    t = jnp.linspace(0.0, 6.0, 4001)
    apart = jax.jit(jax.vmap(lambda u: jnp.linalg.norm(driven.position(u) - route.position(u))))
    gaps = np.asarray(apart(t))
    own = np.linalg.norm(np.asarray(jax.jit(jax.vmap(route.velocity))(t)), axis=1)
    assert 0 < gaps.max() < 0.03
    assert gaps[own > 0.2].max() < 1e-12
    assert min(timed.timing.squared_speed(u) for u in (0.5, 5.5)) > 0
    assert not np.asarray(driven.velocity(3.0)).any()


def test_a_route_that_turns_back_within_a_segment_is_refused_with_the_parts_to_take():
    """A route that reverses on a straight line is refused, and the parts that the message names are retimed."""
    limits = qt.Limits(speed=7.0, longitudinal_acceleration=2.0, jerk=3.0)
    velocity = [[6.0, 0, 0], [-0.003, 0, 0], [6, 0, 0]]
    route = qt.Route([0.0, 3, 6], [[-12.0, 0, 0], [0, 0, 0], [12, 0, 0]], velocity, np.zeros((3, 3)))
    with pytest.raises(ValueError, match="the velocity of the route is zero at") as error:
        qt.retime(route, limits)
    found = re.search(r"before (\S+) s and after (\S+) s", str(error.value))
    assert found
    first, last = map(float, found.groups())
    assert 2.5 < first < 3.0 < last < 3.5
    assert qt.retime(route.window(0.0, first), limits, end_speed=0.0).certificate.holds


def test_a_route_with_a_kink_is_refused():
    states = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    kinked = qt.Route.from_piecewise(PPoly(np.stack([np.diff(states, axis=0), states[:-1]]), [0.0, 1, 2]))
    with pytest.raises(ValueError, match="the velocity of the route jumps at 1 s"):
        qt.retime(kinked, qt.Limits(speed=5.0), knots=KNOTS)


def test_rounded_accelerations_are_no_jumps():
    """A drive at constant velocity: its accelerations are zero to within rounding."""
    t = np.array([0.0, 0.1, 0.3, 0.7, 1.1])
    velocity = np.array([3.3, -0.7, 0.1])
    route = qt.Route(t, t[:, None] * velocity, np.tile(velocity, (5, 1)), np.zeros((5, 3)))
    parts, standing = of_path(route, ("jerk",))
    assert len(parts) == 1
    assert standing == (False, False)


def test_a_batch_is_refused_with_advice():
    """The call that the message for paths and limits advises has the durations of single calls."""
    limits = qt.Limits(speed=9.0, longitudinal_acceleration=2.0)
    paths = jax.tree.map(lambda *x: jnp.stack(x), STRAIGHT, CIRCLE)
    with pytest.raises(ValueError, match=r"a batch of shape \(2,\) was given: use jax.vmap"):
        qt.retime(paths, limits)
    durations = jax.vmap(lambda path: qt.retime(path, limits, knots=64).duration)(paths)
    single = [float(qt.retime(path, limits, knots=64).duration) for path in (STRAIGHT, CIRCLE)]
    np.testing.assert_allclose(durations, single, rtol=1e-5)
    many = jax.vmap(lambda v: qt.Limits(speed=v))(jnp.array([9.0, 8.0]))
    with pytest.raises(ValueError, match=r"the limit speed has the batch shape \(2,\): use jax.vmap"):
        qt.retime(STRAIGHT, many)


def test_a_batch_of_routes_is_refused_with_advice():
    points = np.array([[-12.0, 0, 0], [0, 0, 0], [12, 1, 0.5]])
    rows = [np.array([[6.0, 0.3, 0], [3, 0, 0], [6, 0.5, v]]) for v in (0.2, 0.5)]
    routes = [qt.Route([0.0, 3, 6], points, velocity, np.zeros((3, 3))) for velocity in rows]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *routes)
    limits = qt.Limits(speed=9.0, longitudinal_acceleration=2.0)
    with pytest.raises(ValueError, match=r"a batch of shape \(2,\) was given: call it once for each route"):
        qt.retime(batch, limits)
    first = qt.retime(jax.tree.map(lambda x: x[0], batch), limits)
    assert float(first.duration) == float(qt.retime(routes[0], limits).duration)
