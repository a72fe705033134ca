"""Routes: segments between joint states against SciPy, joints, cutting and joining, lengths, documents, derivatives."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.integrate import quad
from scipy.interpolate import BPoly, BSpline, CubicSpline, PchipInterpolator, PPoly, make_interp_spline

import qtraj as qt

ORIGIN = np.array([623425.5423, 4848821.0011, 153.8523])
"""UTM coordinates, which leave nine digits for the metres."""


def states(count=7, orders=4, seed=0, origin=ORIGIN):
    """Times and smooth joint states of a winding drive."""
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.5, 2.0, count))
    t = times - times[0]
    rows = [
        [4.0 * t, 3 * np.sin(0.7 * t), 0.2 * np.cos(0.3 * t)],
        [4.0 + 0 * t, 2.1 * np.cos(0.7 * t), -0.06 * np.sin(0.3 * t)],
        [0 * t, -1.47 * np.sin(0.7 * t), -0.018 * np.cos(0.3 * t)],
        [0 * t, -1.029 * np.cos(0.7 * t), 0.0054 * np.sin(0.3 * t)],
    ]
    found = [np.array(row).T + rng.normal(0, 0.02, (count, 3)) for row in rows[:orders]]
    found[0] = found[0] + origin
    return times, found


@pytest.fixture(scope="module", params=[3, 4], ids=["quintic", "septic"])
def case(request):
    times, orders = states(orders=request.param)
    return qt.Route(times, *orders), times, orders


def grid(route, count=101):
    return np.linspace(0, float(route.duration), count)


def derivatives(route, times, order=4):
    return np.asarray(jax.vmap(lambda t: route.derivatives(t, order))(jnp.asarray(times)))


def test_segments_are_the_hermite_interpolants_of_scipy(case):
    route, times, orders = case
    local = np.stack([orders[0] - orders[0][0], *orders[1:]], axis=1)
    known = BPoly.from_derivatives(times - times[0], local)
    t = grid(route)
    found = derivatives(route, t)
    for k in range(5):
        expected = known(t, nu=k) + (orders[0][0] if k == 0 else 0)
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=1e-10 * 4.0**k + 1e-9 * (k == 0))


def test_joints_are_the_given_states(case):
    route, times, orders = case
    np.testing.assert_array_equal(route.times, times - times[0])
    joints = np.asarray(route.joints(len(orders) - 1))
    for k, given in enumerate(orders):
        np.testing.assert_allclose(joints[:, k], given, rtol=0, atol=2e-9 if k == 0 else 1e-12)
    assert float(jnp.max(jnp.abs(route.jumps(len(orders) - 1)))) < 1e-11


def test_large_coordinates_lose_no_digits():
    times, orders = states(origin=np.zeros(3))
    orders[0] = np.round(orders[0] * 2**28) / 2**28
    near = qt.Route(times, *orders)
    moved = [orders[0] + np.array([2.0**23, 2.0**22, 0]), *orders[1:]]
    far = qt.Route(times, *moved)
    np.testing.assert_allclose(far.coefficients, near.coefficients, rtol=0, atol=0)
    back = far.origin - near.origin
    local = derivatives(far, grid(far), 1)[:, 0] - np.asarray(back)
    np.testing.assert_allclose(local, derivatives(near, grid(near), 1)[:, 0], rtol=0, atol=1e-8)


def test_one_executable_serves_any_number_of_segments():
    seen = []

    @jax.jit
    def last(route):
        seen.append(1)
        return route.derivatives(0.5 * route.duration, 4)

    for count in (40, 50, 65):
        times, orders = states(count)
        last(qt.Route(times, *orders[:3]))
    assert len(seen) == 1
    some = [qt.Route(*(lambda t, x: (t, *x))(*states(n, 3))) for n in (40, 65)]
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *some)
    both = jax.vmap(lambda route: route.position(3.0))(stacked)
    np.testing.assert_allclose(both[1], some[1].position(3.0), rtol=0, atol=1e-9)


def test_joints_use_the_later_segment_and_outside_the_route_is_extrapolated():
    c = np.zeros((2, 2, 3))
    c[0, :, 0], c[1, :, 0] = [1.0, -1.0], [2.0, 1.0]  # 2 + t, and then 1 − (t − 1)
    route = qt.Route.from_piecewise(PPoly(c, [0.0, 1.0, 2.0]))
    assert float(route.velocity(1.0)[0]) == -1.0
    assert float(route.velocity(np.nextafter(1.0, 0))[0]) == 1.0
    assert float(route.position(-1.0)[0]) == 1.0
    assert float(route.position(3.0)[0]) == -1.0
    assert int(route.index(1.0)) == 1
    assert int(route.index(9.0)) == 1
    assert float(route.jumps(1)[0, 1, 0]) == -2.0
    assert not np.isfinite(np.asarray(route.position(np.nan))).any()


def test_window_segment_reverse_and_sum_are_the_same_curve(case):
    route, _, _ = case
    t0, t1 = 0.37, float(route.duration) - 0.41
    part = route.window(t0, t1)
    t = grid(part)
    np.testing.assert_allclose(derivatives(part, t), derivatives(route, t + t0), rtol=0, atol=3e-9)
    assert part.segments == route.segments
    np.testing.assert_allclose(route.window(0.0, float(route.duration)).coefficients, route.coefficients)
    one, start = route.segment(-1), float(route.times[-2])
    assert one.segments == 1
    np.testing.assert_allclose(derivatives(one, grid(one)), derivatives(route, grid(one) + start), rtol=0, atol=1e-9)
    back = route.reversed()
    signs = (-1.0) ** np.arange(5)[:, None]
    expected = derivatives(route, float(route.duration) - t) * signs
    inner = np.min(np.abs(t[:, None] - np.asarray(back.times)[None]), axis=1) > 1e-9  # at joints the other side is used
    np.testing.assert_allclose(derivatives(back, t)[inner], expected[inner], rtol=0, atol=1e-8)
    whole = route.window(0.0, t1) + route.window(t1, float(route.duration))
    assert whole.segments == route.segments + 1
    np.testing.assert_allclose(derivatives(whole, grid(route))[1:-1], derivatives(route, grid(route))[1:-1], atol=3e-8)


def test_a_replaced_window_can_be_joined_to_the_rest(case):
    route, _, _ = case
    a, b = (float(x) for x in np.asarray(route.times)[[2, 4]])
    whole = route.window(0, a) + route.window(a, b) + route.window(b, float(route.duration))
    assert float(jnp.max(jnp.abs(whole.jumps(2)))) < 1e-9


def test_routes_that_do_not_meet_are_not_joined(case):
    route, _, _ = case
    with pytest.raises(ValueError, match="but the first ends at"):
        route + route
    with pytest.raises(TypeError):
        route + 1.0


def test_length_and_its_inverse(case):
    route, _, _ = case

    def speed(t):
        return float(np.linalg.norm(derivatives(route, [t], 1)[0, 1]))

    middle = 0.55 * float(route.duration)
    inner = [float(t) for t in route.times if t < middle][1:]
    known, _ = quad(speed, 0, middle, points=inner, limit=200, epsabs=1e-11)
    covered = route.arc_length(middle)
    assert float(covered) == pytest.approx(known, abs=1e-9)
    assert float(route.time_at(covered)) == pytest.approx(middle, abs=1e-12 * float(route.duration))
    assert float(route.length()) == pytest.approx(float(route.arc_length(route.duration)), rel=1e-13)
    assert float(route.time_at(-1.0)) == 0.0
    assert float(route.time_at(1e9)) == float(route.duration)
    slope = jax.grad(lambda s: route.time_at(s))(covered)
    assert float(slope) == pytest.approx(1 / speed(middle), rel=1e-10)


def test_length_of_a_route_that_stops():
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 1, 0.0]]
    stop = qt.Route([0, 1, 3, 4], corners, np.zeros((4, 3)), np.zeros((4, 3)))
    assert float(stop.length()) == pytest.approx(1 + np.sqrt(2), rel=1e-13)
    assert float(stop.time_at(1.0)) == pytest.approx(1.0, abs=1e-4)
    assert np.isfinite(float(jax.grad(lambda r: r.length(), allow_int=True)(stop).duration))


def test_nearest_point_against_a_dense_search(case):
    route, _, _ = case
    rng = np.random.default_rng(1)
    t = grid(route, 200_001)
    dense = np.asarray(qt.evaluate(route, t, ("position",)).position)
    for _ in range(5):
        point = dense[rng.integers(len(dense))] + rng.normal(0, 1.0, 3)
        squares = np.sum((dense - point) ** 2, axis=1)
        found = route.nearest(point)
        assert float(found.distance) <= np.sqrt(squares.min()) + 1e-9
        assert float(found.distance) == pytest.approx(np.sqrt(squares.min()), abs=1e-6)
        assert float(found.time) == pytest.approx(t[squares.argmin()], abs=1e-3)
        np.testing.assert_allclose(found.position, route.position(found.time), rtol=0, atol=2e-9)
        away = (point - np.asarray(found.position)) / float(found.distance)
        pull = jax.grad(lambda x: route.nearest(x).distance)(jnp.asarray(point))
        np.testing.assert_allclose(pull, away, rtol=0, atol=1e-6)


X = np.array([0.0, 1.0, 2.5, 3.0, 4.5, 6.0, 7.0, 8.5])
Y = np.stack([X, np.sin(X), 0.1 * X**2], axis=1)


@pytest.mark.parametrize(
    "spline",
    [CubicSpline(X + 5, Y), PchipInterpolator(X, Y), *(make_interp_spline(X, Y, k=k) for k in (1, 2, 3, 5, 7))],
    ids=lambda s: f"{type(s).__name__}{getattr(s, 'k', '')}",
)
def test_splines_of_scipy_convert_to_routes_and_back(spline):
    route = qt.Route.from_piecewise(spline)
    first = 5.0 if type(spline) is CubicSpline else 0.0
    t = grid(route)[1:-1]
    found = derivatives(route, t)
    for k in range(3):
        np.testing.assert_allclose(found[:, k], spline(t + first, nu=k), rtol=0, atol=1e-11)
    back = route.to_ppoly()
    np.testing.assert_allclose(back(t), spline(t + first), rtol=0, atol=1e-11)
    assert qt.Route.from_piecewise(back).segments == route.segments


def test_other_splines_and_invalid_splines():
    bernstein = BPoly.from_derivatives(X, Y[:, None].repeat(2, axis=1))
    route = qt.Route.from_piecewise(bernstein)
    np.testing.assert_allclose(derivatives(route, X[1:-1], 0)[:, 0], Y[1:-1], rtol=0, atol=1e-12)
    repeated = BSpline([0, 0, 0, 0, 1, 1, 2, 2, 2, 2.0], np.arange(18.0).reshape(6, 3) ** 2, 3)
    route = qt.Route.from_piecewise(repeated)
    assert route.segments == 2
    np.testing.assert_allclose(derivatives(route, [0.3, 1.7], 0)[:, 0], repeated([0.3, 1.7]), rtol=0, atol=1e-12)
    for bad, words in [
        (CubicSpline(X, Y[:, :2]), r"shape \(3,\)"),
        (PPoly(np.ones((9, 1, 3)), [0, 1]), "at most degree 7"),
        (PPoly(np.full((2, 1, 3), np.nan), [0, 1]), "finite"),
        (lambda t: t, "PPoly, CubicSpline, BSpline or BPoly"),
    ]:
        with pytest.raises(ValueError, match=words):
            qt.Route.from_piecewise(bad)


HELIX = qt.SpiralHelix(
    [20.0, 1.0, -0.05], [0.3, 0.25, 0.01], [3.0, 0.5], 9.0, qt.Placement(ORIGIN, [1.0, 0.1, -0.2, 0.3])
)


@pytest.mark.parametrize("tolerance", [1e-1, 1e-3, 1e-6])
def test_a_spiral_helix_converts_within_the_tolerance(tolerance):
    route = qt.Route.from_path(HELIX, tolerance)
    t = grid(route, 20_001)
    away = np.asarray(qt.evaluate(route, t, ("position",)).position - qt.evaluate(HELIX, t, ("position",)).position)
    largest = float(np.max(np.linalg.norm(away, axis=1)))
    assert largest <= tolerance
    assert largest > tolerance / 2000  # the bound is tight: halving the segments reduces it by a factor of 256
    assert float(jnp.max(jnp.abs(route.jumps(3)))) < 1e-7


def test_conversions_without_a_proof_are_refused():
    with pytest.raises(ValueError, match="pass a larger tolerance"):
        qt.Route.from_path(HELIX, 1e-12)
    with pytest.raises(ValueError, match="a polynomial path"):
        qt.Route.from_path(qt.Curve(lambda t: jnp.stack([t, t, t]), 1.0))


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_document_is_exact(case, suffix, tmp_path):
    route, _, _ = case
    route.save(tmp_path / f"route{suffix}")
    again = qt.load(tmp_path / f"route{suffix}")
    assert all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(again), jax.tree.leaves(route), strict=True))
    program = qt.FrameProgram(route, qt.Upright())
    program.save(tmp_path / f"program{suffix}")
    assert np.array_equal(qt.load(tmp_path / f"program{suffix}")(0.5).quaternion, program(0.5).quaternion)


def test_an_invalid_document_is_refused(case, tmp_path):
    file = tmp_path / "route.toml"
    case[0].save(file)
    text = file.read_text()
    for bad, words in [
        (text.replace("duration", "durations"), "no field 'durations'"),
        (text.replace("origin = ", "# origin = ").replace("[\n    62", "# [\n    62"), "route.toml"),
    ]:
        file.write_text(bad)
        with pytest.raises(ValueError, match=words):
            qt.load(file)


def test_derivatives_in_the_joint_states_and_times():
    times, orders = states(5, 3, origin=np.zeros(3))

    def at(times, *orders):
        route = qt.Route(times, *orders)
        return jnp.sum(route.position(1.3) ** 2) + route.length() + route.nearest([3.0, 1.0, 1.0]).distance

    given = [jnp.asarray(times), *map(jnp.asarray, orders)]
    check_grads(at, given, 1, atol=1e-5, rtol=1e-5)


def test_evaluate_peak_and_dynamics_accept_routes(case):
    route, _, _ = case
    t = grid(route, 1001)
    table = qt.evaluate(route, t, ("position", "curvature", "yaw_rate", "quaternion", "defined"), frame=qt.Upright())
    np.testing.assert_allclose(table.position, derivatives(route, t, 0)[:, 0], rtol=0, atol=1e-9)
    assert np.asarray(table.defined).all()
    time, value = qt.peak(route, "curvature")
    assert float(value) == pytest.approx(float(np.max(table.curvature)), rel=1e-3)
    assert float(qt.Limits(curvature=1.0).values(route, time)["curvature"]) == pytest.approx(float(value), rel=1e-9)
    forces = qt.dynamics.forces(route, 1.0, 2.0, [0.0, 0.0, -9.81])
    assert np.isfinite(np.asarray(jax.tree.leaves(forces)[0])).all()


def test_the_peak_of_a_long_route_is_found_between_a_thousand_instants():
    times, orders = states(600, 3, origin=np.zeros(3))
    orders[2][301] += [0.0, 9.0, 0.0]
    route = qt.Route(times, *orders)
    time, value = qt.peak(route, "acceleration")
    assert float(time) == pytest.approx(times[301] - times[0], abs=0.2)
    near = float(time) + np.linspace(-0.5, 0.5, 4001)
    dense = qt.evaluate(route, near, ("acceleration_magnitude",)).acceleration_magnitude
    assert float(value) == pytest.approx(float(np.max(dense)), rel=1e-6)


def test_evaluation_agrees_with_fifty_digits(case):
    route, _, _ = case
    with mpmath.workdps(50):
        c = np.asarray(route.coefficients)[2]
        t = float(route.times[2]) + 0.3
        s = mpmath.mpf(t) - mpmath.mpf(float(route.starts[2]))
        exact = [sum(mpmath.mpf(float(x)) * s**j for j, x in enumerate(c[:, k])) for k in range(3)]
        exact = [float(x) for x in exact]
    np.testing.assert_allclose(route.position(t) - route.origin, exact, rtol=0, atol=2e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.0], np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3))), "two or more"),
        (
            ([0.0, 0.0], np.zeros((2, 3)), np.zeros((2, 3)), np.zeros((2, 3))),
            r"times\[1\] = 0 s follows times\[0\] = 0 s",
        ),
        (([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((2, 3))), "the velocity of a route must have shape"),
        (([0.0, 1.0], np.zeros((2, 3)), np.zeros((2, 3)), np.full((2, 3), np.nan)), "the acceleration of a route"),
    ],
)
def test_bad_states_are_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        qt.Route(*arguments)


def test_methods_that_need_concrete_values(case):
    route, _, _ = case
    with pytest.raises(ValueError, match="needs concrete values"):
        jax.jit(lambda r: r.window(0.0, 1.0).duration)(route)
    with pytest.raises(IndexError, match="segment 99 does not exist"):
        route.segment(99)
    with pytest.raises(ValueError, match="a window must lie within"):
        route.window(1.0, 0.5)
