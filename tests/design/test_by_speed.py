"""Limits that depend on the speed, and ellipses of accelerations: closed forms, dense samples and an exact pass."""

import equinox as eqx
import jax
import numpy as np
import pytest
from benchmarks.random_paths import exact_duration, random_path, with_speed
from scipy.integrate import quad
from scipy.optimize import brentq

import qtraj as qt
from qtraj.foundation.document import save

CLOSED_FORM, ORACLE, EXTREME = 1e-3, 5e-3, 1e-9
"""Relative tolerances of durations, and the relative distance of limits from the exact extreme."""

LINE = qt.Shape.through([[0, 0, 0], [200, 0, 0], [400, 0, 0]])
ANGLES = np.linspace(0, 2 * np.pi, 33)[:-1]
CIRCLE = qt.Shape.through(50 * np.stack([np.cos(ANGLES), np.sin(ANGLES), 0 * ANGLES], axis=1), closed=True)
GRIP = qt.BySpeed([0, 15, 30], magnitude=[9, 8, 4])


def proved(path, limits, **more) -> qt.Retimed:
    timed = qt.retime(path, limits, **more)
    assert timed.certificate.holds, timed.certificate
    assert qt.certify(timed.path, limits).holds
    return timed


def test_an_engine_curve_gives_the_exponential_start():
    """v' = 3 − 0.06 v: v = 50(1 − e^(−0.06 t)), and the distance is its integral."""
    limits = qt.Limits(longitudinal_acceleration=qt.BySpeed([0, 40], lower=[-6, -6], upper=[3, 0.6]), speed=100)
    timed = proved(LINE, limits, start_speed=0)
    exact = brentq(lambda t: 50 * t - 50 / 0.06 * (1 - np.exp(-0.06 * t)) - 400, 1, 100)
    assert exact <= float(timed.duration) <= exact * (1 + CLOSED_FORM)
    assert float(timed.speeds[1]) == pytest.approx(50 * (1 - np.exp(-0.06 * exact)), rel=CLOSED_FORM)


def distance_to(speed, acceleration) -> float:
    """The distance in which the speed changes from 0 by an acceleration that depends on it: ∫ v dv/a(v)."""
    return quad(lambda v: v / acceleration(v), 0, speed, points=[10, 20], epsabs=1e-10)[0]


def test_motor_and_brake_curves_on_a_straight_line_agree_with_quadratures():
    def motor(v):
        return np.interp(v, [0, 10, 20, 30], [3, 3, 1.5, 0.8])

    def brake(v):
        return np.interp(v, [0, 10, 20, 30], [6, 6, 5, 3])

    speeds = [0, 10, 20, 30]
    curves = qt.BySpeed(speeds, lower=[-6, -6, -5, -3], upper=[3, 3, 1.5, 0.8])
    timed = proved(LINE, qt.Limits(longitudinal_acceleration=curves), start_speed=0, end_speed=0)
    top = brentq(lambda v: distance_to(v, motor) + distance_to(v, brake) - 400, 1, 60)
    exact = sum(quad(lambda v, f=f: 1 / f(v), 0, top, points=[10, 20])[0] for f in (motor, brake))
    assert exact <= float(timed.duration) <= exact * (1 + CLOSED_FORM)


def test_a_brake_that_changes_along_the_way_and_a_motor_curve_agree_with_quadratures():
    """The brake allows 2 m/s² up to 300 m and then 1 m/s²: from there on, v² = 2(400 − s)."""

    def motor(v):
        return 3 - 0.08 * v

    limits = qt.Limits(longitudinal_acceleration=(qt.Along([0, 300], [-2, -1]), qt.BySpeed([0, 30], upper=[3, 0.6])))
    timed = proved(LINE, limits, start_speed=0, end_speed=0)
    top = brentq(lambda v: distance_to(v, motor) + (v * v - 200) / 4 - 300, 15, 29)
    exact = quad(lambda v: 1 / motor(v), 0, top)[0] + (top - np.sqrt(200)) / 2 + np.sqrt(200)
    assert exact <= float(timed.duration) <= exact * (1 + CLOSED_FORM)


def test_an_ellipse_on_a_straight_line_brakes_and_accelerates_differently():
    timed = proved(LINE, qt.Limits(combined_acceleration=qt.Ellipse(6, 2, 9), speed=100), start_speed=0, end_speed=0)
    assert float(timed.duration) == pytest.approx(np.sqrt(800 * (1 / 2 + 1 / 6)), rel=CLOSED_FORM)


@pytest.mark.parametrize(
    ("limits", "lateral"),
    [
        (qt.Limits(combined_acceleration=qt.Ellipse(6, 2, 9)), lambda v: 9.0),
        (qt.Limits(combined_acceleration=qt.Ellipse(6, 2, GRIP)), lambda v: np.interp(v, [0, 15, 30], [9, 8, 4])),
        (qt.Limits(lateral_acceleration=GRIP), lambda v: np.interp(v, [0, 15, 30], [9, 8, 4])),
    ],
)
def test_a_circle_is_driven_at_the_fixed_point(limits, lateral):
    speed = brentq(lambda v: v * v / 50 - lateral(v), 1, 30)
    assert float(proved(CIRCLE, limits).duration) == pytest.approx(2 * np.pi * 50 / speed, rel=CLOSED_FORM)


def test_a_limit_that_does_not_change_with_the_speed_is_an_ordinary_one():
    by_speed = qt.Limits(
        longitudinal_acceleration=qt.BySpeed([0, 10, 30], lower=[-6, -6, -6], upper=[2, 2, 2]),
        lateral_acceleration=qt.BySpeed([5], magnitude=[4]),
    )
    usual = qt.Limits(longitudinal_acceleration=(-6, 2), lateral_acceleration=4)
    shape = qt.Shape.through([[0, 0, 0], [60, 0, 0], [90, 30, 0], [60, 60, 0], [0, 60, 0]])
    durations = [float(proved(shape, x, start_speed=0, end_speed=0).duration) for x in (by_speed, usual)]
    assert durations[0] == pytest.approx(durations[1], rel=CLOSED_FORM)


@pytest.mark.parametrize("seed", [0, 2, 7, 8, 20, 31])
def test_random_paths_take_as_long_as_in_an_exact_pass(seed):
    path = with_speed(random_path(seed, 12), seed)
    timed = proved(qt.Route.from_piecewise(path.spline), qt.Limits(**path.limits), start_speed=0, end_speed=0)
    assert float(timed.duration) == pytest.approx(exact_duration(path, 20_000), rel=ORACLE)


def random_curve(rng: np.random.Generator, top: float) -> qt.BySpeed:
    speeds = np.sort(rng.uniform(0, top, int(rng.integers(1, 5))))
    return qt.BySpeed(speeds, magnitude=np.exp(rng.normal(0, 0.5, speeds.size)))


def sample_path(kind: str, seed: int):
    rng = np.random.default_rng(seed)
    if kind == "helix":
        start = qt.BoundaryState([20, 0, 0], [rng.normal(), 6, 0.3])
        return qt.SpiralHelix.hermite(start, qt.BoundaryState([0, 20, 1.5], [-7, rng.normal(), 0.1]), 4.0)
    times = np.array([0.0, 1.5, 3.0, 5.0])
    points = np.cumsum(rng.normal([8, 0, 0], [1, 4, 1], (4, 3)), axis=0)
    velocity, acceleration = rng.normal([5, 0, 0], 1.0, (4, 3)), rng.normal(0, 1.0, (4, 3))
    if kind == "stops":
        velocity[[0, -1]] = 0.0
    route = qt.Route(times, points, velocity, acceleration)
    if kind != "timing":
        return route
    limits = qt.Limits(speed=12, lateral_acceleration=3, longitudinal_acceleration=(-5, 3))
    return qt.retime(route, limits, start_speed=3).path


def ratios(path, t, limit):
    """The quantities on which the tests put a limit, divided by the limit, at the times t."""
    outputs = ("longitudinal_acceleration", "lateral_acceleration", "speed")
    found = qt.evaluate(path, np.atleast_1d(t), outputs)
    along, across, speed = (np.asarray(getattr(found, x)) for x in outputs)
    if isinstance(limit, qt.Ellipse):
        return np.asarray(limit.usage(along, across, speed))
    return (
        across / np.asarray(limit.at(speed)),
        along / np.asarray(limit.at(speed)),
        -along / np.asarray(limit.at(speed)),
    )


def extreme(path, ratio) -> float:
    """The largest ratio: dense samples, and denser ones around the largest sample; it may have a kink."""
    low, high = 0.0, float(path.duration)
    for _ in range(5):
        t = np.linspace(low, high, 4001)
        k = int(np.argmax(ratio(t)))
        low, high = t[max(k - 1, 0)], t[min(k + 1, t.size - 1)]
    return float(ratio(t)[k])


@pytest.mark.parametrize(("kind", "seed"), [*((x, k) for x in ("helix", "route") for k in range(4)), ("timing", 1)])
def test_limits_beside_the_exact_extreme_are_decided(kind, seed):
    """A limit that is slightly larger than the extreme is proved, and one that is smaller is refuted."""
    path, rng = sample_path(kind, seed), np.random.default_rng(100 + seed)
    curves = [random_curve(rng, 9.0) for _ in range(3)]
    ellipse = qt.Ellipse(*curves)
    for k, name in ((0, "lateral_acceleration"), (1, "upper"), (2, "lower"), (None, "combined_acceleration")):
        limit = ellipse if k is None else curves[k]
        ratio = (lambda t: ratios(path, t, ellipse)) if k is None else (lambda t, k=k: ratios(path, t, curves[k])[k])
        most = extreme(path, ratio)
        for factor, holds in ((1 + EXTREME, True), (1 - EXTREME, False)):
            own = limit.scaled(most * factor)
            if name in ("upper", "lower"):
                sides = (None, own) if name == "upper" else (own.scaled(-1.0), None)
                limits = qt.Limits(longitudinal_acceleration=sides)
            else:
                limits = qt.Limits(**{name: own})
            found = qt.certify(path, limits)
            assert [*found.status.values()] == ["proved" if holds else "broken"], (name, found)


@pytest.mark.parametrize("kind", ["helix", "route", "stops", "timing"])
def test_no_proof_contradicts_dense_samples(kind):
    for seed in range(6):
        path, rng = sample_path(kind, 10 + seed), np.random.default_rng(seed)
        limit = qt.Ellipse(*(random_curve(rng, 9.0).scaled(rng.uniform(0.5, 8)) for _ in range(3)))
        status = qt.certify(path, qt.Limits(combined_acceleration=limit)).status["combined_acceleration"]
        t = np.linspace(0, float(path.duration), 3001)[1:-1]
        worst = float(np.max(ratios(path, t, limit)))
        assert status in ("proved", "broken")
        assert (status == "broken") == (worst > 1), (seed, status, worst)


def test_at_a_speed_between_two_lines_both_hold():
    """A constant speed at which the limit bends: a claim about open ranges of the speed alone would prove anything."""
    path = qt.SpiralHelix([10.0], [0.0, 1.0], [0.0], 4.0)  # 10 m/s and 10 m/s²
    for value, status in ((9.0, "broken"), (11.0, "proved")):
        grip = qt.BySpeed([0, 10, 20], magnitude=[12, value, 12])
        limits = qt.Limits(lateral_acceleration=grip, combined_acceleration=qt.Ellipse(grip, grip, grip))
        assert set(qt.certify(path, limits).status.values()) == {status}


def test_values_of_certificates_and_margins_are_those_at_the_speed():
    path = sample_path("helix", 3)
    limits = qt.Limits(
        lateral_acceleration=GRIP, combined_acceleration=qt.Ellipse(8, qt.BySpeed([2, 9], upper=[5, 3]), 9)
    )
    found = qt.certify(path, limits)
    for name, (time, value, limit) in found.worst.items():
        ratio = ratios(path, time, getattr(limits, name))
        assert value / limit == pytest.approx(float(np.ravel(ratio[0])[0]), rel=1e-9)
        assert float(limits.margins(path, time)[name]) == pytest.approx(limit - value, rel=1e-6)


def test_a_certificate_of_a_timing_contains_the_excess_where_the_limit_bends():
    path = sample_path("timing", 2)
    t = np.linspace(0, float(path.duration), 2001)
    speeds = np.asarray(qt.evaluate(path, t, ("speed",)).speed)
    bend = 0.8001 * speeds.max()
    valley = qt.BySpeed([0, bend - 1e-4, bend, bend + 1e-4], magnitude=[9, 9, 0.1, 9])
    ellipse = qt.Ellipse(9.0, valley, 9.0)
    time, value, limit = qt.certify(path, qt.Limits(combined_acceleration=ellipse)).worst["combined_acceleration"]
    crossings = np.flatnonzero(np.diff(np.sign(speeds - bend)))
    k = crossings[np.argmin(np.abs(t[crossings] - time))]
    at = brentq(lambda x: float(qt.evaluate(path, [x], ("speed",)).speed[0]) - bend, t[k], t[k + 1], xtol=1e-12)
    assert time == pytest.approx(at, abs=1e-6)
    assert (value, limit) == (pytest.approx(float(ratios(path, at, qt.Ellipse(9.0, 0.1, 9.0))[0]), rel=1e-6), 1)


@pytest.mark.parametrize("form", ["toml", "json"])
def test_limits_by_speed_can_be_stored(tmp_path, form):
    limits = qt.Limits(
        longitudinal_acceleration=(qt.BySpeed([0, 10], lower=[-6, -4]), 2),
        lateral_acceleration=GRIP,
        combined_acceleration=qt.Ellipse(8, qt.BySpeed([2, 9], upper=[5, 3]), 9),
    )
    save(limits, tmp_path / f"limits.{form}")
    found = qt.load(tmp_path / f"limits.{form}")
    assert repr(found) == repr(limits)
    assert eqx.tree_equal(found, limits)
    both = qt.BySpeed([0, 10], [-6, -4], [3, 1])
    assert [repr(x) for x in both.sides()] == ["BySpeed([0, 10], lower=[-6, -4])", "BySpeed([0, 10], upper=[3, 1])"]
    assert repr(both.scaled(-2)) == "BySpeed([0, 10], lower=[-6, -2], upper=[12, 8])"


def test_a_route_reports_where_it_violates_a_limit_by_speed():
    route = sample_path("route", 1)
    limit = qt.BySpeed([0, 6], upper=[1.0, 0.5])
    found = qt.certify(route, qt.Limits(longitudinal_acceleration=limit))
    t = np.linspace(0, float(route.duration), 2001)
    above = ratios(route, t, qt.BySpeed([0, 6], magnitude=[1.0, 0.5]))[1] > 1
    inside = np.zeros(t.size, bool)
    for start, end in np.asarray(found.broken):
        inside |= (t >= start) & (t <= end)
    assert inside.any()
    assert np.mean(inside != above) < 2e-3


def test_a_timing_by_speed_with_a_jerk_limit_and_a_prescribed_duration():
    motor = qt.BySpeed([0, 10, 30], lower=[-6, -6, -4], upper=[3, 3, 0.8])
    free = proved(LINE, qt.Limits(longitudinal_acceleration=motor, jerk=4.0, speed=30), start_speed=0, end_speed=0)
    slow = proved(CIRCLE, qt.Limits(combined_acceleration=qt.Ellipse(6, 2, GRIP)), duration=30)
    assert float(free.duration) > 17
    assert float(slow.duration) == pytest.approx(30, rel=CLOSED_FORM)


def test_profiles_and_files_contain_the_limit(tmp_path):
    motor = qt.BySpeed([0, 10, 30], lower=[-6, -6, -4], upper=[3, 3, 0.8])
    limits = qt.Limits(longitudinal_acceleration=motor, combined_acceleration=qt.Ellipse(7, 4, GRIP), speed=25)
    timed = qt.retime(LINE, limits, start_speed=0, end_speed=0)
    timed.save(tmp_path / "timed.toml")
    profile = qt.speed_profile(qt.load(tmp_path / "timed.toml"))
    row = profile.names.index("longitudinal_acceleration_max")
    known = np.interp(np.asarray(profile.speed), [0, 10, 30], [3, 3, 0.8])
    assert np.asarray(profile.bounds)[row][1:-1] == pytest.approx(known[1:-1], abs=0.3)
    assert float(np.max(profile.values[profile.names.index("combined_acceleration")])) == pytest.approx(6 / 7, rel=1e-3)
    assert str(qt.Limits(longitudinal_acceleration=motor)) == (
        "Limits(longitudinal_acceleration=(BySpeed([0, 10, 30], lower=[-6, -6, -4]), "
        "BySpeed([0, 10, 30], upper=[3, 3, 0.8])))"
    )


MOTOR = qt.BySpeed([0, 10], upper=[3, 1])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: qt.BySpeed([0, 10]), "magnitude"),
        (lambda: qt.BySpeed([0, 10], magnitude=[1]), "for each of the 2 speeds"),
        (lambda: qt.BySpeed([10, 0], upper=[1, 2]), "ascending"),
        (lambda: qt.BySpeed([-1, 0], upper=[1, 2]), "at least 0"),
        (lambda: qt.BySpeed([0, 1], upper=[1, np.nan]), "finite"),
        (lambda: qt.BySpeed([0, 1], upper=[1, None]), "upper must contain one finite number"),
        (lambda: qt.BySpeed([0, 1], magnitude=[1, -1]), "must be positive"),
        (lambda: qt.Ellipse(8, -1, 9), "accelerating must be positive"),
        (lambda: qt.Ellipse(8, np.inf, 9), "accelerating must be positive and finite"),
        (lambda: qt.Ellipse(qt.BySpeed([0, 1], upper=[1, 0]), 1, 9), "braking must be positive"),
        (lambda: qt.Ellipse(8, 3, qt.BySpeed([0], lower=[1])), "lateral must have the bound upper="),
        (lambda: qt.Limits(longitudinal_acceleration=(MOTOR, 2)), "must have the bound lower="),
        (
            lambda: qt.Limits(longitudinal_acceleration=(qt.BySpeed([0], magnitude=[6]), 2)),
            "must have the bound lower=",
        ),
        (lambda: qt.Ellipse(8, "fast", 9), "accelerating must be a number"),
        (lambda: qt.Limits(curvature=MOTOR), "may depend on the speed"),
        (lambda: qt.Limits(speed=(None, MOTOR)), "may depend on the speed"),
        (lambda: qt.Limits(combined_acceleration=9), "must be an Ellipse"),
        (lambda: qt.Limits(lateral_acceleration=qt.Ellipse(1, 1, 1)), "combined_acceleration="),
        (lambda: qt.Limits(lateral_acceleration=qt.BySpeed([0], lower=[1])), "upper"),
        (lambda: qt.Limits(lateral_acceleration=qt.BySpeed([0, 1], magnitude=[1, -1])), "positive"),
        (lambda: qt.Limits(longitudinal_acceleration=qt.BySpeed([0, 5], [-1, 2], [1, 1])), "at 5 m/s"),
        (lambda: qt.peak(sample_path("route", 1), "combined_acceleration"), "certify"),
        (
            lambda: jax.grad(
                lambda v: qt.retime(LINE, qt.Limits(speed=9, longitudinal_acceleration=MOTOR), v).duration
            )(1.0),
            "outside jit",
        ),
    ],
)
def test_what_is_not_supported_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def starting(upper) -> qt.Limits:
    return qt.Limits(longitudinal_acceleration=(None, upper), speed=60.0)


def test_a_small_value_beside_a_large_one_costs_no_time():
    """The reserve is a fraction of each value. The speed rises to 1.5 m/s at once, and then at 0.1 m/s²."""
    timed = proved(LINE, starting(qt.BySpeed([0, 1, 1.5], upper=[10, 10, 0.1])), start_speed=0.0)
    before = 1 / 10 + quad(lambda v: 1 / np.interp(v, [1, 1.5], [10, 0.1]), 1, 1.5)[0]
    way = 0.05 + quad(lambda v: v / np.interp(v, [1, 1.5], [10, 0.1]), 1, 1.5)[0]
    after = (-1.5 + np.sqrt(1.5**2 + 2 * 0.1 * (400 - way))) / 0.1
    assert float(timed.duration) == pytest.approx(before + after, rel=5e-4)


def test_faster_speeds_may_be_allowed_again():
    angles = np.linspace(0, 3, 9)
    arc = qt.Shape.through(20 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1))
    limits = {"lateral_acceleration": qt.BySpeed([0, 10, 12], magnitude=[4, 4, 20])}
    timed = proved(arc, qt.Limits(**limits, speed=18.0, longitudinal_acceleration=5.0))
    assert np.isnan(timed.gap)
    assert "the fastest timing that was found" in timed.result
    faster = qt.retime(arc, qt.Limits(speed=18.0, longitudinal_acceleration=5.0))
    assert qt.certify(faster.path, qt.Limits(**limits)).holds
    limits = {"lateral_acceleration": qt.BySpeed([0, 10], magnitude=[4, 12])}  # rises, but less than the square
    assert proved(arc, qt.Limits(**limits, speed=18.0, longitudinal_acceleration=5.0)).gap <= 1e-3


def test_the_worst_value_violates_a_limit_that_is_broken():
    """The violation is next to a speed at which the limit bends, between samples."""
    timed = qt.retime(LINE, starting(3.0), start_speed=0.0)
    found = qt.certify(timed.path, starting(qt.BySpeed([0, 7.0, 7.01, 7.02, 30], upper=[3.1, 3.1, 2.9, 3.1, 3.1])))
    assert found.status["longitudinal_acceleration_max"] == "broken"
    _, value, limit = found.worst["longitudinal_acceleration_max"]
    assert value > limit * 1.01


def test_steep_steps_are_timed_with_smaller_cells():
    timed = proved(LINE, starting(qt.BySpeed([0, 5, 5.1, 20], upper=[1, 1, 4, 4])), start_speed=0.0)
    slow = quad(lambda v: 1 / np.interp(v, [5, 5.1], [1, 4]), 5, 5.1)[0]
    way = 12.5 + quad(lambda v: v / np.interp(v, [5, 5.1], [1, 4]), 5, 5.1)[0]
    rest = (-5.1 + np.sqrt(5.1**2 + 2 * 4 * (400 - way))) / 4
    assert 5 + slow + rest <= float(timed.duration) <= 1.01 * (5 + slow + rest)


@pytest.mark.parametrize(
    ("limit", "speeds", "message"),
    [
        ((None, qt.BySpeed([0, 10], upper=[0, 3])), (0.0, None), "cannot start: pass a positive value there"),
        ((qt.BySpeed([0, 10], lower=[0, -6]), 3.0), (None, 0.0), "cannot come to rest: pass a negative value there"),
    ],
)
def test_limits_that_allow_no_start_or_stop_are_refused(limit, speeds, message):
    with pytest.raises(ValueError, match=message):
        qt.retime(LINE, qt.Limits(longitudinal_acceleration=limit, speed=60.0), *speeds)


def test_bounds_that_contradict_each_other_at_every_speed_are_refused():
    with pytest.raises(ValueError, match=r"\(2.0, 1.5\) was given at 50 m"):
        qt.Limits(longitudinal_acceleration=(qt.Along([0, 50], [-3, 2]), qt.BySpeed([0, 10], upper=[1.5, 1])))
    qt.Limits(longitudinal_acceleration=(qt.Along([0, 50], [-3, 1.2]), qt.BySpeed([0, 10], upper=[1.5, 1])))
