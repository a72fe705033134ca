"""Limits with two sides: lower and upper bounds on signed values."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.design.limits import limits_of
from qtraj.path.motion_quantities import MOTION_QUANTITIES
from qtraj.path.quantity import quantity

START = qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 6.0, 0.3])
END = qt.BoundaryState([0.0, 20.0, 1.5], [-7.0, -1.0, 0.1])
HELIX = qt.SpiralHelix.hermite(START, END, 4.0)
LINE = qt.Shape.through([[0.0, 0.0, 0.0], [50.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
CAR = qt.Vehicle(mass=1500.0, rolling_resistance=0.01, drag_area=0.6)

MOTION = tuple(entry.name for entry in MOTION_QUANTITIES)
SIGNED = ("torsion", "longitudinal_acceleration", "slope", "yaw_rate", "yaw_acceleration", *MOTION)
FORCES = ("longitudinal_force", "lateral_force", "normal_load", "power")
POSITIVE = ("curvature", "speed", "acceleration", "lateral_acceleration", "jerk")


def winding():
    """A route of 60 s whose speed varies, with turns to both sides, up and down."""
    t = np.arange(0.0, 62.0, 2.0)
    return qt.Route.from_piecewise(
        CubicSpline(t, np.stack([8 * t + 6 * np.sin(t / 5), 30 * np.sin(t / 9), 0.3 * np.sin(t / 7)], axis=1))
    )


ROUTE = winding()


def signed(path, name, times, vehicle=None):
    return of_each(path, (name,), times, vehicle)[name]


def of_each(path, names, times, vehicle=None):
    """The signed values of several limits, from one evaluation of the path."""
    outputs = {name: quantity(f"{name}_min").variable for name in names}
    values = qt.evaluate(path, times, tuple(dict.fromkeys(outputs.values())), vehicle=vehicle).values
    return {name: np.asarray(values[output]) for name, output in outputs.items()}


def test_signs_are_forward_left_and_up():
    """A left turn that brakes and climbs, and its mirror image that descends."""
    braking = qt.SpiralHelix([10.0], [0.0, 0.5, -0.05], [0.0, 0.2], 2.0)
    mirrored = qt.SpiralHelix([10.0], [0.0, -0.5, 0.05], [0.0, -0.2], 2.0)
    names = ("longitudinal_acceleration", "slope", "yaw_rate", "torsion")
    for path, signs in ((braking, [-1, 1, 1, 1]), (mirrored, [-1, -1, -1, 1])):
        table = qt.evaluate(path, [1.0], names)
        assert [np.sign(float(table.values[name][0])) for name in names] == signs
        both = qt.evaluate(path, [1.0], ("longitudinal_acceleration", "longitudinal_acceleration_magnitude"))
        assert float(both.longitudinal_acceleration_magnitude[0]) == -float(both.longitudinal_acceleration[0])


def test_signed_values_agree_with_the_reference():
    """17-digit values at 1.3 s of the hermite spiral-helix, computed in 60 digits from the definitions."""
    exact = {
        "longitudinal_acceleration": 1.1238399271167439,
        "slope": 0.054939483184407634,
        "yaw_rate": 0.46921727730627377,
        "longitudinal_jerk": -1.1980887878681236,
        "lateral_jerk": 0.73892352360867554,
        "horizontal_curvature": 0.055480340529293635,
        "curvature_rate": -0.0044150432244786107,
        "sharpness": -0.00052124949134843971,
        "height": 0.521503125,
        "vertical_speed": 0.46534375,
        "vertical_acceleration": 0.041875,
    }
    assert set(MOTION) <= set(exact)
    for name, value in exact.items():
        assert signed(HELIX, name, [1.3])[0] == pytest.approx(value, rel=1e-14)


OF_HELIX = [*SIGNED, *FORCES, *POSITIVE]
OF_ROUTE = [name for name in OF_HELIX if name != "torsion"]  # undefined at the inflections of the route


def densely(path, names):
    joints = np.asarray(path.times) if isinstance(path, qt.Route) else np.zeros(1)
    times = np.union1d(np.linspace(0.0, float(path.duration), 100_001), [joints, np.maximum(joints - 1e-12, 0.0)])
    return of_each(path, names, times, CAR)


@functools.cache
def of_helix():
    return densely(HELIX, OF_HELIX)


@functools.cache
def of_route():
    return densely(ROUTE, OF_ROUTE)


@pytest.mark.parametrize(
    ("path", "name"),
    [*((HELIX, name) for name in OF_HELIX), *((ROUTE, name) for name in OF_ROUTE)],
    ids=[*(f"helix-{name}" for name in OF_HELIX), *(f"route-{name}" for name in OF_ROUTE)],
)
def test_both_sides_are_decided_next_to_the_extremes(path, name):
    """Bounds at the extremes of dense samples, wider or narrower by 1e-6 of their range."""
    vehicle = CAR if name in FORCES else None
    values = (of_helix if path is HELIX else of_route)()[name]
    low, high = float(values.min()), float(values.max())
    if name in POSITIVE and low < 1e-3 * high:
        low = -1.0  # too small for a positive lower bound
    room = 1e-6 * (high - low)
    lower = None if low == -1.0 and name in POSITIVE else low
    for widened, statuses in ((room, {"proved"}), (-room, {"broken"})):
        pair = None if lower is None else lower - widened, high + widened
        found = qt.certify(path, qt.Limits(**{name: pair}, vehicle=vehicle))
        assert set(found.status.values()) == statuses, found
        assert len(found.status) == 1 + (lower is not None)
        for side, (_, value, limit) in found.worst.items():
            extreme = low if quantity(side).lower else high
            assert value == pytest.approx(extreme, abs=room)
            assert np.sign(found.margin(side)) == np.sign(widened)
            assert limit == pytest.approx(extreme, abs=1.1 * room)


def test_random_bounds_agree_with_dense_samples():
    """No proof is contradicted: a pair on each quantity, on random spiral-helices."""
    rng, of_heights = np.random.default_rng(11), np.random.default_rng(12)
    checked, count = {"proved": 0, "broken": 0}, 12
    for _ in range(count):
        radius, angle, height = (rng.normal(size=4) * [1.0, 0.4, 0.1, 0.02] for _ in range(3))
        radius[0] += 12.0
        angle[1] += 0.5
        path = qt.SpiralHelix(radius, angle, height, 3.0)
        times = np.linspace(0.0, 3.0, 4001)
        pairs, holds = {}, {}
        for name, values in of_each(path, SIGNED, times).items():
            low, high = np.quantile(
                values, (of_heights if name == "height" else rng).choice([0.0, 0.3], 2) * [1, -1] + [0, 1]
            )
            room = 1e-3 * (values.max() - values.min())
            low, high = pairs[name] = low - room, high + room
            holds |= {f"{name}_min": low <= values.min(), f"{name}_max": high >= values.max()}
        found = qt.certify(path, qt.Limits(**pairs))
        assert set(found.status) == set(holds)
        for side, status in found.status.items():
            if status == "undefined":
                continue
            assert status == ("proved" if holds[side] else "broken"), (side, found)
            checked[status] += 1
    assert min(checked.values()) > 2 * count


def test_a_bound_at_the_exact_extreme_is_decided():
    """Braking at the end of a line: a = 2 - 3t; relative distances of 1e-12 are decided."""
    path = qt.Route([0.0, 1.0], [[0, 0, 0], [10.5, 0, 0]], [[10, 0, 0], [10.5, 0, 0]], [[2, 0, 0], [-1, 0, 0]])
    for factor, statuses in ((1 + 1e-12, ["proved", "proved"]), (1 - 1e-12, ["broken", "broken"])):
        found = qt.certify(path, qt.Limits(longitudinal_acceleration=(-factor, 2 * factor)))
        assert list(found.status.values()) == statuses


def test_braking_in_reverse_is_negative():
    """Along the direction of travel: a vehicle that backs up and slows down brakes."""
    back = qt.Route([0.0, 2.0], [[0, 0, 0], [-4, 0, 0]], [[-3, 0, 0], [-1, 0, 0]], [[1, 0, 0], [1, 0, 0]])
    assert np.all(signed(back, "longitudinal_acceleration", [0.5, 1.5]) < 0)
    assert qt.certify(back, qt.Limits(longitudinal_acceleration=(-1.5, 0.5))).holds
    assert qt.certify(back, qt.Limits(longitudinal_acceleration=(-0.5, 1.5))).status == {
        "longitudinal_acceleration_min": "broken",
        "longitudinal_acceleration_max": "proved",
    }


@pytest.mark.parametrize("knots", [None, 512])
def test_retimed_lines_have_the_durations_of_closed_forms(knots):
    """100 m from rest to rest with accelerations (-6, 2): v² = 2·100/(1/2 + 1/6); then with a speed of 12 m/s."""
    for speed, exact in ((100.0, np.sqrt(2 * 100 * (1 / 2 + 1 / 6))), (12.0, 12 / 2 + 12 / 6 + (100 - 36 - 12) / 12)):
        limits = qt.Limits(longitudinal_acceleration=(-6.0, 2.0), speed=speed)
        timed = qt.retime(LINE, limits, start_speed=0, end_speed=0, knots=knots)
        assert timed.certificate.holds, timed.result
        assert float(timed.duration) == pytest.approx(exact, rel=1e-3)
        assert float(timed.duration) > exact
        assert qt.certify(timed.path, limits).holds


def test_a_number_and_its_pair_give_the_same_timing():
    common = {"speed": 13.0, "lateral_acceleration": 2.0}
    durations = [
        float(qt.retime(ROUTE, qt.Limits(**common, longitudinal_acceleration=x), start_speed=0, end_speed=0).duration)
        for x in (1.5, (-1.5, 1.5), (-4.0, 1.5))
    ]
    assert durations[1] == pytest.approx(durations[0], rel=1e-4)
    assert durations[2] < 0.99 * durations[0]


@pytest.mark.parametrize(
    ("limits", "ends"),
    [
        ({"longitudinal_acceleration": (-4.0, 1.5), "jerk": 2.0}, (0, 0)),
        ({"longitudinal_acceleration": (-4.0, None)}, (0, 0)),
        ({"longitudinal_acceleration": (0.0, 0.5)}, (3.0, None)),
        ({"longitudinal_acceleration": (-1.0, 2.0), "yaw_rate": (-0.15, 0.3)}, (0, 0)),
        ({"longitudinal_acceleration": (-1.0, 2.0), "yaw_acceleration": (-0.2, 0.4)}, (0, 0)),
        ({"longitudinal_acceleration": (-1.0, 2.0), "speed": (4.0, 12.0)}, (5.0, 6.0)),
        ({"longitudinal_acceleration": (-1.0, 2.0), "vertical_speed": (-0.05, 0.1)}, (0, 0)),
        ({"longitudinal_acceleration": (-1.0, 2.0), "vertical_acceleration": (-0.01, 0.02)}, (0, 0)),
        ({"longitudinal_acceleration": 1.5, "vertical_acceleration": 0.01}, (0, 0)),
        ({"longitudinal_acceleration": 1.5, "curvature_rate": (-0.001, 0.002)}, (0, 0)),
        ({"longitudinal_acceleration": 1.5, "curvature_rate": 0.001}, (0, 0)),
    ],
)
def test_timings_with_two_sides_are_proved_and_reach_their_limits(limits, ends):
    given = qt.Limits(**{"speed": 12.0, "lateral_acceleration": 2.0} | limits)
    timed = qt.retime(ROUTE, given, *ends)
    assert timed.certificate.holds, timed.result
    assert timed.converged
    usage = dict(zip(timed.certificate.names, np.asarray(timed.usage).max(axis=1), strict=True))
    assert any(usage[name] > 0.999 for name in usage if quantity(name).base or name in limits), usage
    for name, (time, value, limit) in timed.certificate.worst.items():
        output = quantity(name).variable
        if time < float(timed.path.duration):
            seen = float(qt.evaluate(timed.path, [time], (output,)).values[output][0])
            assert seen == pytest.approx(value, rel=1e-5, abs=1e-5), name
        assert quantity(name).side * (limit - value) >= 0


def test_pairs_on_the_yaw_acceleration_let_the_acceleration_jump_where_the_path_does():
    """As for a number: the third derivative of this spline jumps at its joints, and with it the yaw acceleration."""
    common = {"speed": 12.0, "lateral_acceleration": 2.0, "longitudinal_acceleration": 1.5}
    number, pair = (qt.retime(ROUTE, qt.Limits(**common, yaw_acceleration=x), 0, 0) for x in (0.02, (-0.02, 0.02)))
    assert number.certificate.holds, number.result
    assert pair.certificate.holds, pair.result
    assert float(pair.duration) == pytest.approx(float(number.duration), rel=1e-3)


def test_the_duration_has_derivatives_with_respect_to_both_sides():
    def duration(sides):
        limits = qt.Limits(speed=8.0, longitudinal_acceleration=(-sides[0], sides[1]))
        return qt.retime(HELIX, limits, start_speed=0, end_speed=0, knots=128).duration

    at, step = jnp.array([3.0, 1.5]), 1e-3
    slopes = [(duration(at + d) - duration(at - d)) / (2 * step) for d in step * np.eye(2)]
    assert np.all(np.array(slopes) < -0.1)
    np.testing.assert_allclose(jax.grad(duration)(at), slopes, rtol=2e-3)


def test_a_batch_of_pairs_is_timed():
    def duration(low):
        limits = qt.Limits(speed=8.0, longitudinal_acceleration=(-low, 1.5))
        return qt.retime(HELIX, limits, start_speed=0, end_speed=0, knots=64).duration

    each = [float(duration(low)) for low in (1.0, 2.0, 4.0)]
    np.testing.assert_allclose(jax.vmap(duration)(jnp.array([1.0, 2.0, 4.0])), each, rtol=1e-6)
    assert each[0] > each[1] > each[2]


TIGHT = {
    "vertical_speed": (0.2, 0.34),
    "sharpness": (-1e-4, 3e-4),
    "longitudinal_jerk": (-0.02, 0.1),
    "longitudinal_acceleration": (-0.02, 0.3),
    "speed": (6.6, 7.1),
    "slope": (0.03, 0.05),
    "yaw_acceleration": (-0.02, 0.01),
}


@pytest.mark.parametrize("name", list(TIGHT))
def test_tuned_paths_satisfy_two_sides(name):
    found = qt.tune(START, END, qt.Limits(**{name: TIGHT[name]}), motion="hermite", starts=2)
    assert found.converged, found.result
    assert found.certificate.holds
    assert found.certificate.active, found.certificate
    free = qt.tune(START, END, qt.Limits(speed=100.0), motion="hermite", starts=1)
    assert float(found.objective) > float(free.objective) + 1e-6


@pytest.mark.parametrize("name", ["curvature_rate", "longitudinal_jerk", "vertical_speed"])
def test_tuned_routes_satisfy_limits_on_rates(name):
    values = signed(ROUTE, name, np.linspace(0.0, 60.0, 20_001))
    low, high = 1.1 * float(values.min()), 0.95 * float(values.max())
    free = np.zeros(31, bool)  # the vertical speed is largest at the start
    found = qt.tune_route(ROUTE, qt.Limits(**{name: (low, high)}), 1.0, fixed=free)
    assert found.certificate.holds, found.result
    assert found.certificate.worst[f"{name}_max"][1] == pytest.approx(high, rel=1e-3)


def test_a_clothoid_is_driven_at_the_speed_of_its_curvature_rate():
    """Along a clothoid κ = σ·s, the curvature rate is σ·v: its limit is a constant speed."""
    s, sharpness = np.linspace(0.0, 60.0, 121), 4e-4
    heading = 0.5 * sharpness * s**2
    fine = np.linspace(0.0, 60.0, 12_001)
    angles = 0.5 * sharpness * fine**2
    steps = (f(0.5 * (angles[1:] + angles[:-1])) * np.diff(fine) for f in (np.cos, np.sin))
    x, y = (np.concatenate([[0.0], np.cumsum(step)]) for step in steps)
    at = 100 * np.arange(121)
    curvature = sharpness * s
    zero = 0 * s
    route = qt.Route(
        s,
        np.stack([x[at], y[at], zero], axis=1),
        np.stack([np.cos(heading), np.sin(heading), zero], axis=1),
        np.stack([-curvature * np.sin(heading), curvature * np.cos(heading), zero], axis=1),
    )
    np.testing.assert_allclose(signed(route, "sharpness", s[1:-1]), sharpness, rtol=1e-3)
    timed = qt.retime(route, qt.Limits(curvature_rate=(-1.0, 4e-3), speed=50.0))
    assert timed.certificate.holds, timed.result
    assert float(timed.duration) == pytest.approx(60.0 / 10.0, rel=2e-3)


def test_forces_with_two_sides_are_tuned():
    limits = qt.Limits(power=(-5000.0, 9000.0), normal_load=(14_400.0, None), vehicle=CAR)
    found = qt.tune(START, END, limits, motion="hermite", starts=2)
    assert found.converged, found.result
    assert set(found.certificate.names) == {"normal_load_min", "power_min", "power_max"}


def test_the_objective_has_derivatives_with_respect_to_a_lower_bound():
    def attained(low):
        return qt.tune(START, END, qt.Limits(speed=(low, 9.0)), motion="hermite", starts=1).objective

    step = 1e-4
    slope = (float(attained(6.6 + step)) - float(attained(6.6 - step))) / (2 * step)
    assert float(jax.grad(attained)(6.6)) == pytest.approx(slope, rel=1e-4)
    assert slope > 0.1


def test_advice_lowers_a_lower_bound():
    found = qt.tune(START, END, qt.Limits(slope=(0.1, None)), motion="hermite", starts=1)
    assert found.status == "infeasible"
    assert "the largest minimum found is" in found.result
    assert re.search(r"lower slope_min to 0\.05\d+", found.result)


def test_tuned_routes_satisfy_two_sides():
    number, pair, braking = (
        qt.tune_route(ROUTE, qt.Limits(longitudinal_acceleration=x), 1.0) for x in (0.2, (-0.2, 0.2), (-0.12, 0.25))
    )
    for found in (number, pair, braking):
        assert found.certificate.holds, found.result
    assert float(pair.objective) == pytest.approx(float(number.objective), rel=2e-4)
    worst = braking.certificate.worst
    assert worst["longitudinal_acceleration_min"][1] == pytest.approx(-0.12, rel=1e-4)
    assert worst["longitudinal_acceleration_max"][1] == pytest.approx(0.25, rel=1e-4)


@pytest.mark.parametrize("limits", [{"speed": (7.3, 9.9)}, {"yaw_rate": (-0.05, 0.045)}, {"slope": (-0.0045, 0.0045)}])
def test_tuned_routes_reach_both_bounds(limits):
    found = qt.tune_route(ROUTE, qt.Limits(**limits), 1.0)
    assert found.certificate.holds, found.result
    assert int(found.iterations) > 0
    used = [abs(value - limit) < 1e-3 * abs(limit) for _, value, limit in found.certificate.worst.values()]
    assert any(used)


def test_a_route_has_derivatives_with_respect_to_a_lower_bound():
    def attained(low):
        return qt.tune_route(ROUTE, qt.Limits(longitudinal_acceleration=(-low, 0.3)), 1.0).objective

    step = 1e-4
    slope = (float(attained(0.15 + step)) - float(attained(0.15 - step))) / (2 * step)
    assert float(jax.grad(attained)(0.15)) == pytest.approx(slope, rel=5e-3)
    contrary = jax.grad(lambda low: qt.tune_route(ROUTE, qt.Limits(speed=(low, 9.0)), 0.5).objective)(8.9)
    assert np.isnan(contrary)


def along_x(positions, velocities, accelerations):
    zero = np.zeros(2)
    return qt.Route([0.0, 5.0], *(np.stack([x, zero, zero], axis=1) for x in (positions, velocities, accelerations)))


@pytest.mark.parametrize("acceleration", [0.0, 2.0], ids=["smooth", "abrupt"])
def test_stops_of_a_route_have_both_limits(acceleration):
    """20 m from stop to stop: v² = 2·20/(1/4 + 1/1.5); at the end, the direction of motion is opposite to r''."""
    route = along_x([0.0, 20.0], [0.0, 0.0], [acceleration, -acceleration])
    for pair in ((-4.0, 1.5), (-1.5, 4.0)):
        timed = qt.retime(route, qt.Limits(speed=10.0, longitudinal_acceleration=pair))
        assert timed.certificate.holds, timed.result
        assert float(timed.duration) == pytest.approx(np.sqrt(2 * 20 * (1 / 4 + 1 / 1.5)), rel=1e-3)
    same = [qt.retime(route, qt.Limits(speed=10.0, longitudinal_acceleration=x)).duration for x in (4.0, (-4.0, 4.0))]
    assert float(same[0]) == pytest.approx(float(same[1]), rel=1e-4)


@pytest.mark.parametrize("name", ["yaw_rate", "vertical_speed", "curvature_rate", "longitudinal_acceleration"])
def test_bounds_on_both_sides_of_zero_are_decided_on_retimed_paths(name):
    """Also bounds that exclude zero, next to the extremes of dense samples."""
    timed = qt.retime(HELIX, qt.Limits(speed=8.0, longitudinal_acceleration=2.0))
    values = signed(timed.path, name, np.linspace(0.0, float(timed.duration) * (1 - 1e-12), 40_001))
    low, high = float(values.min()), float(values.max())
    room = 1e-4 * (high - low)
    cases = (
        ((low - room, high + room), ["proved", "proved"]),
        ((low + room, high - room), ["broken", "broken"]),
        ((high + room, high + 2 * room), ["broken", "proved"]),
        ((low - 2 * room, low - room), ["proved", "broken"]),
    )
    for pair, statuses in cases:
        found = qt.certify(timed.path, qt.Limits(**{name: pair}))
        assert list(found.status.values()) == statuses, found
        for (_, value, _), extreme in zip(found.worst.values(), (low, high), strict=True):
            assert value == pytest.approx(extreme, abs=room)


def test_speeds_at_the_ends_may_be_the_lower_bound():
    timed = qt.retime(ROUTE, qt.Limits(speed=(5.0, 30.0), longitudinal_acceleration=(-6.0, 2.0)), 5.0, 5.0)
    assert timed.certificate.holds, timed.result
    with pytest.raises(ValueError, match="on both sides"):
        qt.retime(along_x([0.0, 20.0], [0, 0], [0, 0]), qt.Limits(speed=9.0, longitudinal_acceleration=(-4.0, None)))


def test_a_lower_bound_that_contradicts_other_limits_is_named():
    timed = qt.retime(LINE, qt.Limits(speed=10.0, longitudinal_acceleration=(1.0, 2.0)), 0.0, 0.0)
    assert timed.code == qt.ResultCode.not_finite
    assert "the lower bound on longitudinal_acceleration contradicts another limit" in timed.result


def test_peaks_of_sides():
    times = np.linspace(0.0, 4.0, 100_001)
    for name in ("speed", "longitudinal_acceleration", "slope"):
        values = signed(HELIX, name, times)
        assert float(qt.peak(HELIX, f"{name}_min")[1]) == pytest.approx(values.min(), rel=1e-6)
    assert float(qt.peak(HELIX, "longitudinal_acceleration_max")[1]) == pytest.approx(2.4711328785236306, rel=1e-9)


def test_a_pair_bounds_the_speed_as_a_number_does():
    number, pair = (qt.retime(HELIX, qt.Limits(yaw_rate=x)) for x in (0.5, (-0.5, 0.5)))
    assert float(pair.duration) == pytest.approx(float(number.duration), rel=1e-6)
    found = qt.tune(START, END, qt.Limits(yaw_rate=(-0.5, 0.5)), motion="hermite", objective="fastest", starts=1)
    assert found.converged, found.result


def test_upper_bounds_on_the_power_may_be_negative():
    found = qt.tune(START, END, qt.Limits(power=(-5000.0, -100.0), vehicle=CAR), motion="hermite", starts=1)
    assert found.converged, found.result
    assert list(found.certificate.names) == ["power_min", "power_max"]


def test_a_start_above_the_limits_brakes_with_the_lower_side():
    timed = qt.retime(LINE, qt.Limits(speed=13.0, longitudinal_acceleration=(-3.0, 2.0)), 20.0, None)
    assert timed.code == qt.ResultCode.starts_above_limits
    assert float(timed.braking_time) == pytest.approx(7 / 3, rel=2e-3)
    slow = qt.retime(LINE, qt.Limits(speed=20.0, longitudinal_acceleration=(1.0, 2.0)), 2.0, duration=60.0)
    assert slow.code == qt.ResultCode.duration_too_long


def test_limits_are_shown_selected_and_stored(tmp_path):
    limits = qt.Limits(curvature=0.2, speed=(3.0, 9.0), longitudinal_acceleration=(-6.0, 2.0), slope=(None, 0.1))
    names = [
        "curvature", "speed_min", "speed", "longitudinal_acceleration_min", "longitudinal_acceleration_max", "slope_max"
    ]  # fmt: skip
    assert list(limits.given()) == names
    assert repr(limits) == (
        "Limits(curvature=0.2 1/m, speed=(3, 9), longitudinal_acceleration=(-6, 2), slope=(None, 0.1))"
    )
    assert list(limits.only(["speed", "slope_max", "longitudinal_acceleration_min"]).given()) == [
        "speed", "longitudinal_acceleration_min", "slope_max"
    ]  # fmt: skip
    assert limits_of(limits.given()).given() == limits.given()
    timed = qt.retime(HELIX, qt.Limits(speed=8.0, longitudinal_acceleration=(-3.0, 1.0)))
    timed.save(tmp_path / "timed.json")
    assert qt.load(tmp_path / "timed.json").certificate.worst == timed.certificate.worst
    margins = limits.margins(HELIX, 1.3)
    assert margins["longitudinal_acceleration_min"] == pytest.approx(1.1238399271167439 + 6.0)
    assert margins["longitudinal_acceleration_max"] == pytest.approx(2.0 - 1.1238399271167439)


def test_pairs_that_bound_nothing_are_no_limits():
    assert qt.Limits(slope=(None, None)).given() == {}
    assert qt.certify(HELIX, qt.Limits(speed=(0.0, 9.5))).holds


@pytest.mark.parametrize(
    ("make", "fragment"),
    [
        (lambda: qt.Limits(speed=(-1.0, 3.0)), "lower bound of the limit speed must not be negative"),
        (lambda: qt.Limits(curvature=(-0.1, 0.1)), "the yaw rate is signed"),
        (lambda: qt.Limits(speed=(5.0, 3.0)), "lower bound of the limit speed must be below the upper one"),
        (lambda: qt.Limits(slope=(0.1, 0.1)), "must be below the upper one"),
        (lambda: qt.Limits(slope=(1.0,)), "must be one number or a pair"),
        (lambda: qt.Limits(slope=(np.nan, 1.0)), "lower bound of the limit slope must be finite"),
        (lambda: qt.Limits(slope=("a", 1.0)), "lower bound of the limit slope must be a number"),
        (lambda: qt.Limits(tangential_moment=(1.0, 2.0), vehicle=CAR), "must be one number"),
        (lambda: qt.retime(HELIX, qt.Limits(speed=(5.0, 9.0)), start_speed=0), "the speed must be at least 5.0 m/s"),
        (
            lambda: qt.retime(HELIX, qt.Limits(speed=9.0, yaw_rate=(0.1, 0.6))),
            "on yaw_rate must allow zero",
        ),
        (lambda: qt.retime(HELIX, qt.Limits(speed=9.0, tilt=0.6)), "retime supports limits only on"),
        (lambda: qt.tune_route(ROUTE, qt.Limits(yaw_rate=(0.1, 0.6))), "two-sided limits that allow zero"),
    ],
)
def test_invalid_pairs_raise_with_a_reason(make, fragment):
    with pytest.raises(ValueError, match=fragment):
        make()
