"""Several bodies with one timing: exact forward and backward passes, closed forms, samples of all bodies, refusals."""

import jax
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt

LIMITS = {"speed": 13.0, "lateral_acceleration": 2.0, "longitudinal_acceleration": 1.5}
OTHERS = {"speed": 8.0, "lateral_acceleration": 3.0, "longitudinal_acceleration": 1.0}
U = 5.0 * np.arange(7)
ZERO = np.zeros(3)
WAITS_FIRST = qt.Route(
    [0.0, 1, 2, 3], [ZERO, ZERO, [3, 0.5, 0], [6, 1.2, 0]], [ZERO, ZERO, [6, 1, 0], ZERO], np.zeros((4, 3))
)
MOVES = qt.Route(
    [0.0, 1, 2, 3],
    [[0, 3, 0], [2, 3, 0], [5.5, 3.5, 0], [9.5, 4, 1]],
    [ZERO, [4, 0, 0], [3, 1, 0], [5, 0, 2]],
    np.zeros((4, 3)),
)


def splines(seed, count=2):
    rng = np.random.default_rng(seed)
    return [CubicSpline(U, rng.uniform(-20, 20, (U.size, 3))) for _ in range(count)]


def least_duration(derivatives, u, limits):
    """The minimum duration from rest to rest on a grid: controllable sets backwards, then the largest step forwards.

    `derivatives` are r' and r'' of each body at the grid points `u`. With a = u̇² and b = da/du, the limits are
    a ≤ `upper` and |p·a + q·b| ≤ A for each body that moves.
    """
    upper, p, q, most = np.full(u.size, np.inf), [], [], []
    for (v, w), own in zip(derivatives, limits, strict=True):
        speed = np.linalg.norm(v, axis=1)
        moves = speed > 1e-6 * speed.max()
        size, bend = np.where(moves, speed, 1.0), np.linalg.norm(np.cross(v, w), axis=1)
        upper = np.where(moves, np.minimum(upper, (own["speed"] / size) ** 2), upper)
        across = np.where(moves & (bend > 0), bend / size, 1e-300)
        upper = np.minimum(upper, own["lateral_acceleration"] / across)
        p.append(np.where(moves, np.sum(v * w, axis=1) / size, 0.0))
        q.append(np.where(moves, 0.5 * speed, 0.0))
        most.append(own["longitudinal_acceleration"])
    p, q, most, h = np.array(p).T, np.array(q).T, np.array(most), np.diff(u)
    highest = np.zeros(u.size)
    for i in range(u.size - 2, -1, -1):  # the largest a from which some b leads to a next a from 0 to the largest
        k = q[i] > 0
        slope = np.append(-p[i, k] / q[i, k], -1 / h[i])
        low, high = np.append(-most[k] / q[i, k], 0.0), np.append(most[k] / q[i, k], highest[i + 1] / h[i])
        change, room = slope[:, None] - slope, high - low[:, None]
        tightest = np.where(change > 1e-14, room / np.where(change > 1e-14, change, 1.0), np.inf)
        highest[i] = min(upper[i], tightest.min())
    a = np.zeros(u.size)
    for i in range(u.size - 1):
        k = q[i] > 0
        b = np.append((most[k] - p[i, k] * a[i]) / q[i, k], (highest[i + 1] - a[i]) / h[i])
        a[i + 1] = min(a[i] + h[i] * b.min(), highest[i + 1])
    rate = np.sqrt(np.maximum(a, 0.0))
    return float(np.sum(2 * h / (rate[1:] + rate[:-1])))


def of_splines(bodies, u):
    return [(x(u, 1), x(u, 2)) for x in bodies]


def check_samples(timed, limits):
    """Every body satisfies its limits at samples, and all are at the same parameter."""
    duration = float(timed[0].duration)
    times = np.linspace(0.0, duration, 1001)
    for body, own in zip(timed, limits, strict=True):
        assert body.code == qt.ResultCode.successful
        assert set(body.certificate.status.values()) == {"proved"}
        assert float(body.duration) == duration
        assert np.array_equal(body.timing.coefficients, timed[0].timing.coefficients)
        x = qt.evaluate(body.path, times, tuple(own))
        for name, limit in own.items():
            value = getattr(x, name)
            size = np.linalg.norm(value, axis=-1) if np.ndim(value) == 2 else np.abs(value)
            assert np.nanmax(size) <= limit * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_two_bodies_are_as_fast_as_exact_passes(seed):
    bodies = splines(seed)
    given = [LIMITS, OTHERS]
    routes = [qt.Route.from_piecewise(x) for x in bodies]
    timed = qt.retime_together(routes, [qt.Limits(**x) for x in given], 0.0, 0.0)
    check_samples(timed, given)
    u = np.linspace(U[0], U[-1], 8001)
    exact = least_duration(of_splines(bodies, u), u, given)
    assert float(timed[0].duration) == pytest.approx(exact, rel=1e-3)
    assert float(timed[0].gap) <= 1e-3
    for route, own in zip(routes, given, strict=True):
        assert float(timed[0].duration) > (1 - 1e-3) * float(qt.retime(route, qt.Limits(**own), 0.0, 0.0).duration)


@pytest.mark.parametrize("more", [{}, {"jerk": 1.0}, {"acceleration": 1.8, "jerk": 2.0}])
def test_one_body_twice_and_its_enlarged_copy_are_one_body(more):
    """A copy of three times the size with limits of three times the size is no other condition."""
    (spline,), own = splines(5, 1), LIMITS | more
    route = qt.Route.from_piecewise(spline)
    large = qt.Route.from_piecewise(CubicSpline(U, 3 * spline(U)))
    scaled = {name: 3 * x for name, x in own.items()}
    alone = float(qt.retime(route, qt.Limits(**own), 0.0, 0.0).duration)
    for second, limits in ((route, own), (large, scaled)):
        timed = qt.retime_together([route, second], [qt.Limits(**own), qt.Limits(**limits)], 0.0, 0.0)
        assert float(timed[1].duration) == pytest.approx(alone, rel=1e-3)
    check_samples(timed, [own, scaled])


def test_a_body_may_wait_while_another_one_moves():
    given = [{"speed": 3.0, "lateral_acceleration": 2.0, "longitudinal_acceleration": 2.0}] * 2
    timed = qt.retime_together([WAITS_FIRST, MOVES], qt.Limits(**given[0]), 0.0, 0.0)
    check_samples(timed, given)
    u = np.linspace(0.0, 3.0, 6001)
    exact = least_duration([x.sampled(u, 2)[1:] for x in (WAITS_FIRST, MOVES)], u, given)
    assert float(timed[0].duration) == pytest.approx(exact, rel=2e-3)
    waits = timed[0].path
    leaves = timed[0].timing.time(1.0)
    assert np.array_equal(waits.position(0.0), waits.position(0.9 * leaves))
    check_samples(
        qt.retime_together([WAITS_FIRST, MOVES], qt.Limits(speed=3.0, acceleration=2.0, jerk=4.0), 0.0, 0.0),
        [{"speed": 3.0, "acceleration": 2.0, "jerk": 4.0}] * 2,
    )


def test_on_lines_the_slower_body_decides():
    """12 m and 6 m of lines in step: the first one, at 3 m/s and 2 m/s², needs 12/3 + 3/2 s, the second one is slower
    than its own limits; with 1 m/s for the second one, it needs 6/1 + 1/1 s."""
    u, still = [0.0, 1.0], np.zeros((2, 3))
    first = qt.Route(u, [[0, 0, 0], [12, 0, 0]], np.tile([12.0, 0, 0], (2, 1)), still)
    second = qt.Route(u, [[0, 1, 0], [0, 7, 0]], np.tile([0, 6.0, 0], (2, 1)), still)
    own = qt.Limits(speed=3.0, longitudinal_acceleration=2.0)
    for other, duration in ((own, 5.5), (qt.Limits(speed=1.0, longitudinal_acceleration=1.0), 7.0)):
        timed = qt.retime_together([first, second], [own, other], 0.0, 0.0)
        assert float(timed[0].duration) == pytest.approx(duration, rel=1e-3)
    timed = qt.retime_together((first, second), own, start_speed=2.0, end_speed=0.0)
    assert np.allclose(np.asarray(timed[0].speeds), [2.0, 0.0], atol=1e-6)
    assert np.allclose(np.asarray(timed[1].speeds), [1.0, 0.0], atol=1e-6)


def test_the_duration_has_derivatives_with_respect_to_the_limits_of_all_bodies():
    routes = [qt.Route.from_piecewise(x) for x in splines(2)]

    def duration(x):
        first, second = {"lateral_acceleration": x[0]}, {"longitudinal_acceleration": x[1]}
        limits = qt.Limits(**LIMITS | first), qt.Limits(**OTHERS | second)
        return qt.retime_together(routes, limits, 0.0, 0.0, knots=128)[1].duration

    at = np.array([0.6, 1.5])
    slope = np.asarray(jax.grad(duration)(at))
    for k, step in enumerate(0.02 * np.eye(2)):
        difference = (float(duration(at + step)) - float(duration(at - step))) / 0.04
        assert difference < -0.1
        assert slope[k] == pytest.approx(difference, rel=0.03)


def test_a_lap_of_two_bodies():
    """Two circles around one centre in step: the outer one drives at its limit all the time."""
    angle = np.linspace(0.0, 2 * np.pi, 33)
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    circle[-1] = circle[0]
    inner, outer = (qt.Route.from_piecewise(CubicSpline(angle, r * circle, bc_type="periodic")) for r in (10.0, 12.0))
    timed = qt.retime_together([inner, outer], qt.Limits(speed=6.0, longitudinal_acceleration=1.0), periodic=True)
    assert float(timed[0].duration) == pytest.approx(2 * np.pi * 12 / 6, rel=1e-4)
    assert np.ptp(np.asarray(timed[0].speeds)) < 1e-6
    with pytest.raises(ValueError, match="the same speed at its start"):
        qt.retime_together([inner, outer], qt.Limits(speed=6.0), 1.0, periodic=True)


def test_the_result_of_a_body_is_stored_and_explained(tmp_path):
    timed = qt.retime_together([WAITS_FIRST, MOVES], qt.Limits(speed=3.0, longitudinal_acceleration=2.0), 0.0, 0.0)
    timed[1].save(tmp_path / "body.json")
    assert qt.load(tmp_path / "body.json").result == timed[1].result
    assert "converged: the fastest timing takes" in timed[0].result
    assert qt.certify(timed[1].path, qt.Limits(speed=3.0)).holds


@pytest.mark.parametrize(
    ("paths", "limits", "error", "says"),
    [
        (MOVES, {"speed": 3.0}, ValueError, "at least two routes"),
        ([MOVES], {"speed": 3.0}, ValueError, "for one path, use retime"),
        ([MOVES, qt.Shape.through([[0, 0, 0], [1, 0, 0]])], {"speed": 3.0}, TypeError, "path 1 is a Shape"),
        ([MOVES, MOVES.window(0.0, 2.0)], {"speed": 3.0}, ValueError, "the joints of route 1"),
        ([WAITS_FIRST, WAITS_FIRST], {"speed": 3.0}, ValueError, "all bodies are at rest at 1 s"),
        ([MOVES, MOVES], {"longitudinal_acceleration": 3.0}, ValueError, "a limit that bounds the speed"),
        ([MOVES, MOVES], {"speed": qt.Along([0.0, 5.0], [3.0, 4.0])}, ValueError, "only constant limits"),
    ],
)
def test_refusals_say_what_to_do(paths, limits, error, says):
    with pytest.raises(error, match=says):
        qt.retime_together(paths, qt.Limits(**limits))


def test_the_number_of_limits_must_be_that_of_the_bodies():
    with pytest.raises(ValueError, match="2 paths need as many limits"):
        qt.retime_together([MOVES, MOVES], [qt.Limits(speed=3.0)])
    with pytest.raises(RuntimeError, match="end_speed cannot be reached"):
        qt.retime_together([MOVES, WAITS_FIRST], qt.Limits(speed=3.0), 0.0, 5.0, throw=True)


def test_a_prescribed_duration_is_met_as_gently_as_possible():
    """The limits of all bodies are reduced by one factor, with which the timing takes the prescribed duration."""
    limits = [qt.Limits(speed=3.0, longitudinal_acceleration=1.0), qt.Limits(speed=3.0, acceleration=2.0, jerk=5.0)]
    routes = [MOVES, WAITS_FIRST]
    fastest = qt.retime_together(routes, limits, 0.0, 0.0, knots=64)
    wanted = 1.4 * float(fastest[0].duration)
    timed = qt.retime_together(routes, limits, 0.0, 0.0, duration=wanted, knots=64, throw=True)
    assert timed[1].duration == pytest.approx(wanted, rel=1e-3)
    share = float(timed[0].share)
    assert 0.3 < share < 0.9
    gentle = [
        qt.Limits(speed=3.0, longitudinal_acceleration=share),
        qt.Limits(speed=3.0, acceleration=2 * share, jerk=5 * share**1.5),
    ]
    for own, limit in zip(timed, gentle, strict=True):
        assert qt.certify(own.path, limit).holds
        assert np.max(own.usage) <= 1
    again = qt.retime_together(routes, gentle, 0.0, 0.0, knots=64)
    assert again[0].duration == pytest.approx(wanted, rel=2e-3)
    short = qt.retime_together(routes, limits, 0.0, 0.0, duration=0.5 * wanted, knots=64)
    assert short[0].code == qt.ResultCode.duration_too_short
    with pytest.raises(ValueError, match="duration"):
        qt.retime_together(routes, limits, duration=-1.0)
