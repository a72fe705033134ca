"""`retime` on regular paths of every kind: random curves, sharp bends, slow parameters, straight lines."""

import numpy as np
import pytest
from benchmarks.random_paths import RandomPath, exact_duration, random_path, reparametrised
from scipy.interpolate import CubicSpline, PPoly

import qtraj as qt
from qtraj.design.timing import cells, spline

STREET = {"speed": 13.0, "lateral_acceleration": 2.0, "longitudinal_acceleration": 1.5}
FAST, SLOW, BRAKING = range(12), range(12, 130), range(200, 204)
SMOOTH = [seed for seed in range(9) if not {"cubic hermite", "lines"} & set(random_path(seed).kinds)]
"""Paths whose acceleration does not jump, and which do not reverse on a straight line."""


def from_rest(path, limits, **options):
    """The fastest timing from rest to rest."""
    return qt.retime(path, qt.Limits(**limits), 0.0, 0.0, **options)


def timing_of(path):
    """The path with its timing, or None if it reverses on a straight line."""
    try:
        return path, from_rest(qt.Route.from_piecewise(path.spline), path.limits)
    except ValueError as error:
        if path.kinds[0] == "lines" and "the velocity of the route is zero at" in str(error):
            return path, None
        raise


def check_against_the_exact_duration(path):
    path, timed = timing_of(path)
    if timed is None:
        return
    assert timed.code == qt.ResultCode.successful, timed.result
    exact = exact_duration(path, 50_000)
    assert -1e-3 * exact < float(timed.duration) - exact < 5e-3 * exact
    assert float(timed.gap) < 5e-3


@pytest.mark.parametrize("seed", FAST)
def test_random_paths_are_timed_as_fast_as_a_forward_and_a_backward_pass(seed):
    check_against_the_exact_duration(random_path(seed))


def test_a_timing_that_the_proofs_slow_down_is_within_the_tolerance():
    """Here, the proofs cost 0.015 % of the duration, which the first search does not leave."""
    _, timed = timing_of(random_path(667))
    assert timed.code == qt.ResultCode.successful, timed.result
    assert float(timed.gap) <= 1e-3


def test_a_squared_rate_that_is_negative_between_all_samples_of_a_cell_is_found():
    """On the first cells of this curve, whose parameter slows down, the duration is NaN."""
    path = random_path(1846)
    timed = from_rest(qt.Route.from_piecewise(reparametrised(path, 1846).spline), path.limits)
    assert timed.code == qt.ResultCode.successful, timed.result
    assert float(timed.duration) == pytest.approx(exact_duration(path), rel=2e-3)


@pytest.mark.parametrize("seed", BRAKING)
def test_braking_and_accelerating_differ(seed):
    check_against_the_exact_duration(random_path(seed).braking(3.0 if seed % 2 else 0.4))


@pytest.mark.slow
@pytest.mark.parametrize("seed", SLOW)
def test_more_random_paths_are_timed_as_fast_as_a_forward_and_a_backward_pass(seed):
    check_against_the_exact_duration(random_path(seed))


@pytest.mark.parametrize("seed", SMOOTH)
def test_with_a_limit_on_the_jerk_smaller_cells_give_the_same_duration(seed):
    path = random_path(seed)
    limits = path.limits | {"jerk": path.limits["longitudinal_acceleration"]}
    route = qt.Route.from_piecewise(path.spline)
    coarse, fine = from_rest(route, limits), from_rest(route, limits, tolerance=1e-4)
    assert coarse.code == fine.code == qt.ResultCode.successful
    assert float(coarse.duration) == pytest.approx(float(fine.duration), rel=1e-3)
    assert float(coarse.gap) < 1e-3


@pytest.mark.parametrize("seed", [28, 40])
def test_cells_are_halved_where_the_squared_rate_is_negative_between_the_nodes(seed):
    """With the first cells of these paths, the duration is NaN."""
    path = random_path(seed)
    limits = path.limits | {"jerk": 2 * path.limits["longitudinal_acceleration"]}
    timed = from_rest(qt.Route.from_piecewise(path.spline), limits)
    assert timed.code == qt.ResultCode.successful
    assert float(timed.gap) < 1e-3


def test_straight_lines_with_a_limit_on_the_jerk():
    """V = 5, A = J = 1: a ramp takes 6 s, so the duration is L/V + 6 s. Rounding does not turn the lines into bends."""
    rng, zero = np.random.default_rng(0), np.zeros((2, 3))
    for end in np.round(rng.uniform(-200, 200, (6, 3)), 1):
        route = qt.Route([0.0, 1], [[0, 0, 0], end], zero, zero)
        timed = from_rest(route, {"speed": 5.0, "acceleration": 1.0, "jerk": 1.0})
        assert timed.code == qt.ResultCode.successful
        assert float(timed.duration) == pytest.approx(np.linalg.norm(end) / 5 + 6, rel=1e-3)


@pytest.mark.parametrize(
    ("points", "duration"),
    [
        ([(16, -6, -2), (16, -6, -2), (3, -17, 3), (18, 11, -1), (10, 11, -1)], 28.69),
        ([(18, 17, 3), (-17, 16, -2), (17, 13, 3), (-15, -3, -2)], 29.32),
        ([(-15, -5, 2), (-6, 4, -1), (4, 16, -3), (-18, -16, 2), (17, -13, -2)], 30.91),
        ([(19, -15, 1), (-10, 10, 1), (18, -12, 2), (10, 11, -1)], 28.60),
    ],
)
def test_sharp_bends(points, duration):
    """The durations are those of a forward and a backward pass; some bends turn by more than 90° within 0.1 s."""
    route = qt.Route.from_piecewise(CubicSpline(5.0 * np.arange(len(points)), np.array(points, float)))
    timed = from_rest(route, STREET)
    assert timed.code == qt.ResultCode.successful
    assert float(timed.duration) == pytest.approx(duration, rel=1.5e-3)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("slow", [0.5, 5e-3])
def test_the_duration_does_not_depend_on_the_parameter(scale, slow):
    """A parabola whose parameter w slows down in the middle to a fraction of its mean: w' = slow + 3 (1 - slow) s²."""
    cubic = np.polynomial.Polynomial([0.0, slow, 0.0, 1 - slow])
    x, y = 40.0 * cubic, 20.0 * cubic**2
    own = [np.pad(p.coef, (0, 7 - p.coef.size)) for p in (x, y)]
    c = np.stack([*own, np.zeros(7)], axis=1) / scale ** np.arange(7)[:, None]
    shifted = PPoly(c[::-1, None], [0.0, scale])
    whole = PPoly(np.stack([_about(shifted, -scale), _about(shifted, 0.0)], axis=1), [0.0, scale, 2 * scale])
    route = qt.Route.from_piecewise(whole)
    plain = PPoly(np.array([[[0.0, 20, 0]], [[40.0, -40, 0]], [[-40.0, 20, 0]]]), [0.0, 2.0])
    expected = from_rest(qt.Route.from_piecewise(plain), STREET, tolerance=1e-5).duration
    timed = from_rest(route, STREET)
    assert timed.code == qt.ResultCode.successful
    assert timed.path.path.segments == 2
    assert float(timed.duration) == pytest.approx(float(expected), rel=1e-3)


def _about(p, start):
    """The coefficients of a polynomial in powers of t − start."""
    return np.stack([p.derivative(k)(start) / np.prod(np.arange(1.0, k + 1)) for k in range(7)])[::-1]


def test_the_second_derivative_of_the_path_may_jump():
    """Two arcs of different parameter speed meet: the timing is as fast as on each arc alone."""
    turn = CubicSpline([0.0, 1, 2], [[0, 0, 0], [10, 0, 0], [20, 3, 0]], bc_type=((1, [10.0, 0, 0]), (1, [10.0, 6, 0])))
    c, x = turn.c.copy(), turn.x.copy()
    bent = PPoly(np.concatenate([c[:3], c[3:]]) + np.zeros_like(c), x)
    bent.c[1, 1] += [0.0, 4.0, 0]  # the curvature jumps at the joint
    timed = from_rest(qt.Route.from_piecewise(bent), STREET)
    assert timed.code == qt.ResultCode.successful
    assert float(timed.gap) < 1e-3


def test_a_finer_spline_is_the_same_function():
    rng = np.random.default_rng(4)
    coarse = np.cumsum(np.append(0.0, rng.uniform(0.5, 2, 6)))
    fine = np.sort(np.concatenate([coarse, 0.5 * (coarse[1:] + coarse[:-1])]))
    coefficients = rng.normal(size=coarse.size + 2)
    powers = np.einsum("pkn,kn->np", spline.power_form(coarse), spline.local(coefficients))
    found = spline.inserted(fine, powers, coarse)
    again = np.einsum("pkn,kn->np", spline.power_form(fine), spline.local(found))
    for z in (0.0, 0.3, 1.0):
        at = again @ z ** np.arange(4)
        u = fine[:-1] + z * np.diff(fine)
        cell = np.minimum(np.searchsorted(coarse, u, side="right") - 1, coarse.size - 2)
        place = (u - coarse[cell]) / np.diff(coarse)[cell]
        expected = np.sum(powers[cell] * place[:, None] ** np.arange(4), axis=1)
        np.testing.assert_allclose(at, expected, rtol=0, atol=1e-13)


def test_the_gap_is_saved(tmp_path):
    path = random_path(6)
    timed = from_rest(qt.Route.from_piecewise(path.spline), path.limits)
    timed.save(tmp_path / "timed.json")
    assert float(qt.load(tmp_path / "timed.json").gap) == float(timed.gap) > 0


def test_with_knots_the_gap_bounds_the_distance_from_the_minimum():
    path = random_path(6)
    exact = exact_duration(path)
    for knots in (16, 64, 256):
        fixed = from_rest(qt.Route.from_piecewise(path.spline), path.limits, knots=knots)
        distance = 1 - exact / float(fixed.duration)
        assert fixed.code == qt.ResultCode.successful
        assert distance - 1e-5 < float(fixed.gap) < distance + 1e-3
        assert ("no timing is shorter" in str(fixed.result)) == (float(fixed.gap) > 1e-3)
    assert "no timing" not in str(from_rest(qt.Route.from_piecewise(path.spline), path.limits).result)


def test_with_knots_and_a_jerk_limit_the_gap_is_a_bound():
    chosen, fixed = (from_rest(bend(), LIMITED, knots=knots) for knots in (None, 32))
    assert fixed.code == qt.ResultCode.successful
    assert 1 - float(chosen.duration) / float(fixed.duration) < float(fixed.gap) < 1
    free = qt.retime(bend(), qt.Limits(speed=5.0, yaw_rate=0.5), knots=32)
    assert float(free.gap) == np.inf
    assert "a shorter one may exist" in str(free.result)


LIMITED = {"speed": 13.0, "acceleration": 2.0, "jerk": 1.0}


def bend():
    """A quarter turn of 60 m between two straights of 60 m."""
    points = [[0, 0, 0], [30, 0, 0], [60, 0, 0], [90, 30, 0], [90, 60, 0], [90, 90, 0]]
    return qt.Route.from_piecewise(CubicSpline(5.0 * np.arange(6), np.array(points, float)))


@pytest.fixture(scope="module")
def fastest():
    return from_rest(bend(), LIMITED)


@pytest.mark.parametrize("longer", [1.02, 1.5, 4.0])
def test_a_prescribed_duration_is_met_with_the_gentlest_accelerations(longer, fastest):
    timed = from_rest(bend(), LIMITED, duration=longer * float(fastest.duration))
    assert timed.code == qt.ResultCode.successful
    assert float(timed.duration) == pytest.approx(longer * float(fastest.duration), rel=1e-12)
    assert 1 / longer**2 - 1e-3 < float(timed.share) < 1
    reached = qt.evaluate(timed.path, np.linspace(0, float(timed.duration), 4001), tuple(LIMITED)).values
    share = float(timed.share)
    for name, factor in (("speed", 1.0), ("acceleration", share), ("jerk", share**1.5)):
        assert float(np.max(reached[name])) <= LIMITED[name] * factor * (1 + 1e-9)
    # With 1 % less of the accelerations, the fastest timing takes longer than prescribed.
    less = {"acceleration": 2.0 * 0.99 * share, "jerk": 1.0 * (0.99 * share) ** 1.5}
    assert float(from_rest(bend(), LIMITED | less).duration) > float(timed.duration)


def test_a_duration_that_is_too_short_is_told(fastest):
    timed = from_rest(bend(), LIMITED, duration=0.9 * float(fastest.duration))
    assert timed.code == qt.ResultCode.duration_too_short
    assert float(timed.duration) == pytest.approx(float(fastest.duration), rel=1e-9)
    with pytest.raises(ValueError, match="duration must be a positive finite number"):
        from_rest(bend(), LIMITED, duration=-1.0)


def test_without_a_limit_on_accelerations_the_whole_motion_is_slowed_down():
    timed = qt.retime(bend(), qt.Limits(speed=5.0), duration=100.0)
    assert timed.code == qt.ResultCode.successful
    assert float(timed.duration) == pytest.approx(100.0, rel=1e-12)
    assert "as prescribed" in timed.result


@pytest.mark.parametrize(
    ("given", "advice"),
    [
        (CubicSpline([0.0, 1, 2], np.eye(3)), r"qtraj.Route.from_piecewise\(spline\)"),
        (qt.Track([0.0, 1, 2, 3], np.eye(4)[:, :3]), r"qtraj.fit_route\(track\).path"),
        (np.eye(3), r"qtraj.Shape.through\(points\)"),
    ],
)
def test_what_is_no_path_gets_advice(given, advice):
    with pytest.raises(ValueError, match=advice):
        qt.retime(given, qt.Limits(speed=5.0))


def test_what_is_timed_already_gets_advice(fastest):
    for given, advice in ((fastest, "pass its field path"), (fastest.path, "pass its original path")):
        with pytest.raises(ValueError, match=advice):
            qt.retime(given, qt.Limits(speed=5.0))


@pytest.mark.parametrize("wrong", [{"tolerance": 0.0}, {"tolerance": 2.0}, {"knots": 500}, {"knots": True}])
def test_wrong_options_are_refused(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}.* must be"):
        from_rest(bend(), LIMITED, **wrong)
    assert from_rest(bend(), LIMITED, knots=np.int64(64)).code == qt.ResultCode.successful


def test_a_velocity_of_zero_within_a_segment_is_found_exactly():
    """x = (t − 1)³ stands at t = 1, and with another coordinate of 1e-6 t it does not."""
    c = np.array([[1.0, 0, 0], [-3.0, 0, 0], [3.0, 0, 0], [-1.0, 0, 0]])[:, None]
    with pytest.raises(ValueError, match="the velocity of the route is zero at 1 s"):
        qt.retime(qt.Route.from_piecewise(PPoly(c, [0.0, 2.0])), qt.Limits(speed=1.0))
    c[2, 0, 1] = 1e-6
    timed = from_rest(qt.Route.from_piecewise(PPoly(c, [0.0, 2.0])), STREET)
    assert timed.code == qt.ResultCode.successful


STRAIGHT = qt.Route([0.0, 1], [[0, 0, 0], [1000, 0, 0]], [[1000.0, 0, 0]] * 2, np.zeros((2, 3)))


@pytest.mark.parametrize("knots", [None, 512])
@pytest.mark.parametrize("speed", [1e-3, 0.05, 1.0, 5.0])
def test_small_speeds_at_the_ends(speed, knots):
    """x = v₀t + t² up to the middle: 1/√a is almost singular, and no limit bounds the speed of the relaxed timing."""
    timed = qt.retime(STRAIGHT, qt.Limits(acceleration=2.0), speed, speed, knots=knots)
    exact = (speed**2 + 2 * 2.0 * 500) ** 0.5 - speed
    assert timed.code == qt.ResultCode.successful
    assert float(timed.duration) == pytest.approx(exact, rel=3e-4)
    assert float(timed.duration) >= exact
    times = np.linspace(0.1, float(timed.duration) - 0.1, 501)
    before, after = (np.asarray(qt.evaluate(timed.path, times + h, ("position",)).position) for h in (-1e-4, 1e-4))
    moved = np.linalg.norm(after - before, axis=1) / 2e-4
    np.testing.assert_allclose(qt.evaluate(timed.path, times, ("speed",)).speed, moved, rtol=1e-6)


def test_without_a_limit_on_the_acceleration_the_gap_is_that_of_smaller_cells():
    timed = from_rest(STRAIGHT, {"speed": 5.0})
    assert timed.code == qt.ResultCode.successful
    assert 200 < float(timed.duration) < 200.2
    assert float(timed.duration) / 200 - 1 < float(timed.gap) < 1e-3


@pytest.mark.parametrize("more", [{}, {"jerk": 3.0}], ids=["acceleration", "jerk"])
def test_laps_on_chosen_cells(more):
    """A search that goes on with smaller cells starts from the periodic spline of the last one."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    radius = 40 + 9 * np.cos(3 * angle) + 5 * np.sin(2 * angle)
    shape = qt.Shape.through(np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle], axis=1), closed=True)
    limits = qt.Limits(**STREET | more)
    timed, fixed = qt.retime(shape, limits), qt.retime(shape, limits, knots=1024)
    assert timed.code == fixed.code == qt.ResultCode.successful
    assert float(timed.duration) == pytest.approx(float(fixed.duration), rel=1e-3)
    assert float(timed.gap) < 1e-3


def test_a_finer_periodic_spline_is_the_same_function():
    rng = np.random.default_rng(1)
    coarse = np.cumsum(np.append(0.0, rng.uniform(0.5, 2, 9)))
    fine = np.sort(np.concatenate([coarse, 0.5 * (coarse[1:] + coarse[:-1])]))
    own = rng.normal(size=9)
    powers = np.einsum("pkn,kn->np", spline.power_form(coarse, True), spline.local(np.append(own, own[:3])))
    found = spline.inserted(fine, powers, coarse, True)
    np.testing.assert_allclose(found[-3:], found[:3], rtol=0, atol=1e-13)
    again = np.einsum("pkn,kn->np", spline.power_form(fine, True), spline.local(found))
    np.testing.assert_allclose(again[::2, 0], powers[:, 0], rtol=0, atol=1e-13)
    np.testing.assert_allclose(again[1::2, 0], powers @ 0.5 ** np.arange(4), rtol=0, atol=1e-13)


def test_contradicting_limits_do_not_halve_cells_again_and_again():
    """The tyres cannot hold the vehicle on this slope, so the coefficients are NaN for every number of cells."""
    car = qt.Vehicle(1500.0, friction=0.5)
    hill = qt.Route([0.0, 1, 2], [[0, 0, 0], [10, 1, 8], [20, 0, 16]], [[10.0, 0, 8]] * 3, np.zeros((3, 3)))
    timed = from_rest(hill, {"friction": 0.9, "speed": 5.0, "vehicle": car})
    assert not timed.successful
    assert timed.timing.knots.size < 2000


def test_a_long_route_needs_few_cells():
    """A spline through 200 random points over 13.8 km: the duration is within the tolerance of the exact one."""
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.normal(0, 1, (200, 3)) * [1, 1, 0.02] + [1, 0, 0], axis=0) * 27.5
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline = CubicSpline(chord, points)
    timed = from_rest(qt.Route.from_piecewise(spline), STREET)
    exact = exact_duration(RandomPath(spline, ("walk", "chord", "cubic"), STREET))
    assert timed.code == qt.ResultCode.successful
    assert 0 < float(timed.duration) / exact - 1 < 1e-3
    assert float(timed.gap) == pytest.approx(float(timed.duration) / exact - 1, abs=5e-5)
    assert timed.timing.knots.size < 9000


def test_a_path_with_too_large_numbers_gets_one_clear_error():
    """No warning of an overflow precedes it: warnings are errors in the tests."""
    path = qt.Route([0.0, 1.0], [[0, 0, 0], [1e300, 0, 0]], np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(ValueError, match="use other units"):
        from_rest(path, STREET)


@pytest.mark.parametrize(("each", "converged"), [(cells.MOST_EACH, True), (8, False)])
def test_a_route_of_more_segments_may_have_more_cells(each, converged, monkeypatch):
    """Otherwise the gap of a long drive with a limit on the jerk cannot be estimated."""
    monkeypatch.setattr(cells, "MOST", 64)
    monkeypatch.setattr(cells, "MOST_EACH", each)
    points = np.cumsum(np.random.default_rng(5).normal(0.0, 5.0, (12, 3)) * [1, 1, 0.1] + [30, 0, 0], axis=0)
    timed = from_rest(qt.Route.from_piecewise(CubicSpline(4.0 * np.arange(12), points)), STREET | {"jerk": 0.9})
    assert timed.certificate.holds
    assert timed.converged == converged
