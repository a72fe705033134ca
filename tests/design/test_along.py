"""Limits that change along the way: steps and linear values over the distance."""

import jax
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import qtraj as qt
from qtraj.design.tuning_route import rounds
from qtraj.foundation import document
from qtraj.io.dataset import path_dataset
from qtraj.path.distances import distances
from qtraj.viz.history import limits_figure

LINE = qt.Shape.through([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0], [70.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
HELIX = qt.SpiralHelix.hermite(
    qt.BoundaryState([20.0, 0.0, 0.0], [1.0, 7.0, 0.3]), qt.BoundaryState([0.0, 28.0, 1.5], [-9.8, -1.0, 0.1]), 4.6
)
ZONES = qt.Along([0.0, 40.0, 60.0], [12.0, 5.0, 12.0])


def random_route(rng, points=8):
    t = np.arange(points) * 2.0
    return qt.Route.from_piecewise(
        CubicSpline(t, np.cumsum(rng.normal([12.0, 0.0, 0.0], [3.0, 6.0, 0.5], (points, 3)), 0))
    )


def sampled(path, name, count=20001):
    """Return distances and values at many instants; the distances by the trapezoidal rule."""
    t = np.linspace(0.0, float(path.duration), count)
    table = qt.evaluate(path, t, ("velocity", name))
    speed = np.linalg.norm(np.asarray(table.velocity), axis=1)
    s = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    return t, s, np.asarray(table.values[name])


def test_strictest_values_agree_with_samples():
    rng = np.random.default_rng(0)
    for kind in ("step", "linear"):
        for _ in range(50):
            d = np.append(0.0, np.cumsum(rng.uniform(0.1, 5.0, rng.integers(1, 6))))
            along = qt.Along(d, rng.uniform(1.0, 9.0, d.size), kind)
            low = rng.uniform(0.0, d[-1] + 3, 20)
            high = low + rng.uniform(0.0, 6.0, 20)
            dense = np.asarray(along.at(low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 4001)))
            tolerance = 0.0 if kind == "step" else 0.02
            for side, extreme in ((1, dense.min(axis=1)), (-1, dense.max(axis=1))):
                found = along.strictest(low, high, side)
                assert (side * (found - extreme) <= 1e-12).all()
                assert (abs(found - extreme) <= tolerance).all()


def test_where_a_step_changes_both_values_hold():
    assert ZONES.strictest(np.array([40.0, 60.0, 60.1]), np.array([40.0, 60.0, 70.0]), 1).tolist() == [5.0, 5.0, 12.0]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["step", "linear"])
@pytest.mark.parametrize("name", ["speed", "lateral_acceleration", "longitudinal_acceleration", "curvature"])
def test_certificates_of_routes_agree_with_samples(seed, kind, name):
    """Where the limits are factors of the values, the status follows; within rounding errors it may be either."""
    rng = np.random.default_rng(seed)
    route = random_route(rng)
    output = "longitudinal_acceleration_magnitude" if name == "longitudinal_acceleration" else name
    t, s, values = sampled(route, output)
    d = np.array([0.0, 0.31, 0.64]) * s[-1]
    usual = np.quantile(values, 0.98)
    along = qt.Along(d, usual * rng.uniform(0.6, 1.6, 3), kind)
    limits = np.asarray(along.at(s))
    worst = np.max(values / limits)
    certificate = qt.certify(route, qt.Limits(**{name: along}))
    if abs(worst - 1) > 1e-3:  # the trapezoidal rule is not more precise
        assert certificate.status[name] == ("proved" if worst < 1 else "broken")
    time, value, limit = certificate.worst[name]
    assert value == pytest.approx(np.interp(time, t, values), rel=2e-3)
    assert limit == pytest.approx(float(along.at(np.interp(time, t, s))), rel=2e-3) or kind == "step"
    inside = np.zeros(t.size, bool)
    for a, b in certificate.intervals(name):
        inside |= (t >= a) & (t <= b)
    clear = abs(values / limits - 1) > 1e-2
    away = np.min(abs(s[:, None] - d[1:]), axis=1) > 0.05 * (kind == "step")
    assert (inside == (values > limits))[clear & away].all()


def test_limits_next_to_the_largest_value_of_a_zone_are_decided():
    """The zone from 40 m to 60 m has the largest speed at its end, and the whole path at another place."""
    route = qt.Route([0.0, 10.0], [[0, 0, 0], [100, 0, 0]], [[5, 0, 0], [15, 0, 0]], np.zeros((2, 3)))
    on = distances(route)
    end = float(np.linalg.norm(route.velocity(on.parameters(np.array([60.0]))[0])))
    for factor, status in ((1 + 1e-8, "proved"), (1 - 1e-8, "broken")):
        limits = qt.Limits(speed=qt.Along([0.0, 40.0, 60.0], [None, factor * end, 16.0]))
        assert qt.certify(route, limits).status["speed"] == status


def test_distances_of_a_path_agree_with_closed_forms():
    circle = qt.SpiralHelix([10.0], [0.0, 0.5], [0.0, 3.0], 4.0)
    on = distances(circle)
    pace = np.hypot(5.0, 3.0)
    assert on.length == pytest.approx(4 * pace, rel=1e-14)
    np.testing.assert_allclose(on.at(np.array([1.0, 2.5])), pace * np.array([1.0, 2.5]), rtol=1e-13)
    np.testing.assert_allclose(on.parameters(np.array([0.0, 7.0, 99.0])), [0.0, 7.0 / pace, 4.0], rtol=1e-13)


def test_a_spiral_helix_a_curve_and_a_shape_have_zones():
    on = distances(HELIX)
    _, s, speed = sampled(HELIX, "speed")
    for limits, status in (([9.0, 10.0], "proved"), ([7.5, 10.0], "broken")):
        certificate = qt.certify(HELIX, qt.Limits(speed=qt.Along([0.0, 0.4 * on.length], limits), curvature=0.1))
        assert certificate.status == {"speed": status, "curvature": "proved"}
        assert list(certificate.names) == ["curvature", "speed"]
    first = speed[s < 0.4 * on.length].max()
    assert certificate.worst["speed"][1] == pytest.approx(first, rel=1e-4)
    curve = qt.Curve(HELIX.position, 4.6)
    found = qt.certify(curve, qt.Limits(speed=qt.Along([0.0, 20.0], [9.2, 10.0])))
    assert found.status["speed"] == "sampled"
    bend = qt.Shape.through(50.0 * np.stack([np.cos(np.arange(0, 3, 0.1)), np.sin(np.arange(0, 3, 0.1))], axis=1))
    shape = qt.certify(bend, qt.Limits(curvature=qt.Along([0.0, 70.0], [0.03, 0.019])))
    assert shape.status["curvature"] == "broken"
    assert shape.intervals("curvature")[0][0] == pytest.approx(70.0, abs=0.1)


def leg(length, start, end, most, accelerate=2.0, brake=6.0):
    """Return the least time of a straight with two-sided accelerations and a limit on the speed."""
    square = (length + start**2 / (2 * accelerate) + end**2 / (2 * brake)) / (0.5 / accelerate + 0.5 / brake)
    top = min(np.sqrt(square), most)
    cruise = length - (top**2 - start**2) / (2 * accelerate) - (top**2 - end**2) / (2 * brake)
    return (top - start) / accelerate + (top - end) / brake + cruise / top


def test_zones_on_a_straight_take_the_time_of_the_closed_form():
    limits = qt.Limits(longitudinal_acceleration=(-6.0, 2.0), speed=ZONES)
    timed = qt.retime(LINE, limits, 0.0, 0.0)
    exact = leg(40.0, 0.0, 5.0, 12.0) + 20.0 / 5.0 + leg(40.0, 5.0, 0.0, 12.0)
    assert float(timed.duration) == pytest.approx(exact, rel=1e-3)
    assert timed.duration >= exact
    assert timed.certificate.holds
    assert qt.certify(timed.path, limits).holds
    assert float(timed.gap) < 1e-3
    profile = qt.speed_profile(timed)
    s, bound = np.asarray(profile.distance), np.asarray(profile.bounds)[list(profile.names).index("speed")]
    assert (bound[(s > 40.1) & (s < 59.9)] == 5.0).all()
    assert (bound[(s < 39.9) | (s > 60.1)] == 12.0).all()
    assert (np.asarray(profile.speed) <= bound * (1 + 1e-9)).all()


def fastest(s, highest, lowest, most):
    """Return the least time for squared speeds up to `highest`² and accelerations in [lowest, most], in two passes."""
    w, ds = highest**2, np.diff(s)
    for k in range(ds.size):
        w[k + 1] = min(w[k + 1], w[k] + 2 * most[k] * ds[k])
    for k in range(ds.size)[::-1]:
        w[k] = min(w[k], w[k + 1] - 2 * lowest[k] * ds[k])
    return np.sum(2 * ds / (np.sqrt(w[1:]) + np.sqrt(w[:-1])))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", ["step", "linear"])
def test_random_zones_are_timed_as_fast_as_by_two_passes(seed, kind):
    rng = np.random.default_rng(seed)
    route = random_route(rng, 6)
    _, s, curvature = sampled(route, "curvature", 40001)
    d = s[-1] * np.array([0.0, 0.2, 0.45, 0.5, 0.8])
    speed = qt.Along(d, rng.uniform(4.0, 14.0, 5), kind)
    lateral = qt.Along(d[[0, 2]], rng.uniform(1.0, 3.0, 2))
    brake = qt.Along(d[[0, 3]], [-3.0, -1.0])
    limits = qt.Limits(speed=speed, lateral_acceleration=lateral, longitudinal_acceleration=(brake, 2.0))
    timed = qt.retime(route, limits)
    assert timed.certificate.holds
    assert qt.certify(timed.path, limits).holds
    highest = np.minimum(np.asarray(speed.at(s)), np.sqrt(np.asarray(lateral.at(s)) / np.maximum(curvature, 1e-9)))
    exact = fastest(s, highest, np.asarray(brake.at(s)), np.full(s.size, 2.0))
    assert -1e-4 < float(timed.duration) / exact - 1 < 2e-3
    _, along, speeds = sampled(timed.path, "speed")
    assert (speeds <= np.asarray(speed.strictest(along - 1e-3, along + 1e-3, -1)) * (1 + 1e-6)).all()


def test_a_route_is_tuned_to_zones():
    t = np.arange(0.0, 31.0, 2.0)
    route = qt.Route.from_piecewise(CubicSpline(t, np.stack([8 * t, 30 * np.sin(t / 9), 0.02 * t], axis=1)))
    for limits in (
        qt.Limits(speed=qt.Along([0.0, 100.0, 180.0], [9.0, 7.0, None]), lateral_acceleration=1.0),
        qt.Limits(speed=qt.Along([0.0, 100.0, 240.0], [9.0, 7.0, 9.0], "linear"), acceleration=1.0),
        qt.Limits(speed=(qt.Along([0.0, 100.0], [5.0, 8.2]), 12.0)),
    ):
        assert not qt.certify(route, limits).holds
        tuned = qt.tune_route(route, limits, 1.0)
        assert tuned.certificate.holds, tuned.result
        assert qt.certify(tuned.path, limits).holds


def test_zones_that_contradict_the_ends_are_named():
    t = np.arange(0.0, 21.0, 2.0)
    route = qt.Route.from_piecewise(CubicSpline(t, np.stack([8 * t, 0 * t, 0 * t], axis=1)))
    tuned = qt.tune_route(route, qt.Limits(speed=qt.Along([0.0, 20.0], [7.0, 9.0])), 1.0)
    assert not tuned.certificate.holds
    assert "speed" in tuned.certificate.unmet


@pytest.mark.parametrize("kind", ["step", "linear"])
def test_a_batch_of_paths_has_the_certificates_of_its_paths(kind):
    paths = [qt.SpiralHelix([20.0 + k], [0.0, 0.3], [0.0, 0.5], 9.0) for k in range(3)]
    batch = jax.tree.map(lambda *x: np.stack(x), *paths)
    speed, curvatures = qt.Along([0.0, 15.0, 25.0], [6.4, 6.1, 6.6], kind), np.array([0.1, 0.02, 0.05])
    limits = jax.vmap(lambda c: qt.Limits(speed=speed, curvature=c))(curvatures)
    found = qt.certify(batch, limits)
    shared = qt.certify(batch, qt.Limits(speed=speed))
    for k, path in enumerate(paths):
        alone = qt.certify(path, qt.Limits(speed=speed, curvature=curvatures[k]))
        assert {name: status[k] for name, status in found.status.items()} == alone.status
        assert shared.status["speed"][k] == alone.status["speed"]
        for name in ("speed", "curvature"):
            assert [x[k] for x in found.worst[name]] == pytest.approx(list(alone.worst[name]))
    assert set(found.status["speed"]) == {"proved", "broken"}


@pytest.mark.parametrize("kind", ["step", "linear"])
def test_margins_are_mapped_compiled_and_differentiated(kind):
    values = np.array([9.0, 8.0, 7.0])

    def margin(values, t, path=HELIX):
        return qt.Limits(speed=qt.Along([0.0, 10.0, 20.0], values, kind)).margins(path, t)["speed"]

    times = np.array([0.5, 2.0, 3.0])
    alone = [float(margin(values, t)) for t in times]
    assert jax.vmap(lambda t: margin(values, t))(times) == pytest.approx(alone, abs=1e-9)
    compiled = jax.jit(margin)
    assert [float(compiled(values, t)) for t in times] == pytest.approx(alone, abs=1e-9)
    pair = jax.tree.map(lambda x: np.stack([x, x]), HELIX)
    assert jax.vmap(lambda path: margin(values, 2.0, path))(pair) == pytest.approx([alone[1]] * 2, abs=1e-9)
    step = 1e-6 * np.eye(3)
    differences = [(margin(values + h, 2.0) - margin(values - h, 2.0)) / 2e-6 for h in step]
    by_values, by_time = jax.jit(jax.grad(margin, (0, 1)))(values, 2.0)
    assert by_values == pytest.approx(np.array(differences), abs=1e-6)
    change = (margin(values, 2.0 + 1e-6) - margin(values, 2.0 - 1e-6)) / 2e-6
    assert float(by_time) == pytest.approx(float(change), rel=1e-5)


def test_recorded_values_are_steps_of_the_distance():
    t = np.linspace(0.0, 4.6, 24)
    s = distances(HELIX).at(t)
    found = qt.Along.from_samples(HELIX, t, np.where(t < 1.1, 9.0, np.where(t < 3.1, 7.0, np.nan)))
    assert np.asarray(found.distance) == pytest.approx([0.0, s[6], s[16]], rel=1e-9)
    np.testing.assert_array_equal(found.values, [9.0, 7.0, np.nan])
    before = qt.Along.from_samples(HELIX, [-2.0, -1.0, 1.0, 9.0], [1.0, 2.0, 3.0, 4.0])
    assert np.asarray(before.values)[:2].tolist() == [2.0, 3.0]


def test_at_a_stop_the_last_value_counts():
    rows = [[0, 0, 0], [9, 0, 0], [9, 0, 0], [18, 0, 0]]
    route = qt.Route([0.0, 3.0, 5.0, 8.0], rows, np.zeros((4, 3)), np.zeros((4, 3)))
    found = qt.Along.from_samples(route, [0.0, 3.2, 4.0, 4.9, 6.5], [9.0, 1.0, 2.0, 5.0, 5.0])
    assert repr(found) == "Along([0, 9], [9, 5])"


def test_margins_are_those_of_the_zone():
    limits = qt.Limits(speed=ZONES, longitudinal_acceleration=(qt.Along([0.0, 50.0], [-6.0, -3.0]), 2.0))
    route = qt.Route([0.0, 10.0], [[0, 0, 0], [100, 0, 0]], [[10, 0, 0]] * 2, np.zeros((2, 3)))
    for t, speed, brake in ((1.0, 2.0, 6.0), (5.5, -5.0, 3.0), (9.0, 2.0, 3.0)):
        margins = limits.margins(route, t)
        assert float(margins["speed"]) == pytest.approx(speed, abs=1e-9)
        assert float(margins["longitudinal_acceleration_min"]) == pytest.approx(brake, abs=1e-9)
    of_helix = jax.jit(lambda t: limits.margins(HELIX, t))(2.0)
    assert float(of_helix["speed"]) == pytest.approx(float(limits.margins(HELIX, 2.0)["speed"]), abs=1e-9)


def test_limits_timings_and_datasets_are_stored(tmp_path):
    limits = qt.Limits(speed=ZONES, longitudinal_acceleration=qt.Along([0.0, 50.0], [(-6.0, 2.0), (-3.0, None)]))
    timed = qt.retime(LINE, qt.Limits(speed=ZONES, longitudinal_acceleration=2.0))
    for k, given in enumerate((limits, timed)):
        document.save(given, tmp_path / f"{k}.json")
        found = qt.load(tmp_path / f"{k}.json")
        assert all(
            np.array_equal(a, b, equal_nan=True) for a, b in zip(*map(jax.tree.leaves, (given, found)), strict=True)
        )
    data = path_dataset({"timed": timed.path}, qt.Limits(speed=ZONES))
    assert {5.0, 12.0} == set(np.unique(data["speed_limit"].values))
    assert "limit" not in data["speed"].attrs


def test_figures_draw_limits_along_the_way():
    timed = qt.retime(LINE, qt.Limits(speed=ZONES, longitudinal_acceleration=2.0), 0.0, 0.0)
    figure = qt.speed_profile(timed).plot()
    drawn = [line.get_ydata() for line in figure.axes[0].lines]
    assert any(np.nanmin(y) == 5.0 and len(set(y[np.isfinite(y)])) >= 2 for y in drawn if len(y) > 10)
    data = path_dataset({"timed": timed.path}, qt.Limits(speed=ZONES))
    history = limits_figure(data, ["speed"])
    assert any(set(np.unique(line.get_ydata())) == {5.0, 12.0} for line in history.axes[0].lines)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: qt.Along([1.0, 2.0], [1, 2]), "start with 0"),
        (lambda: qt.Along([0.0, 2.0, 2.0], [1, 2, 3]), "ascending"),
        (lambda: qt.Along([0.0, 2.0], [1, 2, 3]), "each of the 2 distances"),
        (lambda: qt.Along([0.0, 2.0], [1, None], "linear"), "use steps"),
        (lambda: qt.Along([0.0, 2.0], [1, 2], "cubic"), "'step' or 'linear'"),
        (lambda: qt.Along("far", [1, 2]), "must contain numbers"),
        (lambda: qt.Limits(speed=qt.Along([0.0, 1.0], [1.0, -2.0])), "must be positive"),
        (lambda: qt.Limits(speed=(qt.Along([0.0, 1.0], [5.0, 12.0]), 10.0)), "at 1 m"),
        (lambda: qt.Limits(binormal_moment=qt.Along([0.0], [(1.0, 2.0)])), "must be one number"),
        (lambda: jax.vmap(lambda r: qt.certify(qt.SpiralHelix([r], [0.0, 1.0], [0.0], 1.0), qt.Limits(speed=ZONES))
                          .codes)(np.array([5.0, 6.0])), "concrete values"),
        (lambda: qt.Along.from_samples(HELIX, [0.0, 2.0, 1.0], [1, 2, 3]), "do not decrease"),
        (lambda: qt.Along.from_samples(HELIX, [0.0, 2.0], [1, 2, 3]), "one for each value"),
        (lambda: jax.jit(lambda v: qt.retime(LINE, qt.Limits(speed=qt.Along([0.0, 50.0], v))).duration)(
            np.array([9.0, 5.0])), "concrete values"),
        (lambda: qt.retime(LINE, qt.Limits(speed=9.0, yaw_rate=(qt.Along([0.0, 9.0], [-1.0, 0.1]), 1.0))), "zero"),
    ],
)  # fmt: skip
def test_bad_input_is_named(make, text):
    with pytest.raises(ValueError, match=text):
        make()


@pytest.mark.parametrize("ramp", [1e-9, 1e-7, 3e-7, 1e-5, 1e-2])
def test_a_steep_ramp_is_never_missed(ramp):
    """A ramp as narrow as the uncertainty of distances must not shift the limit on other parts of the path."""
    line = qt.Route([0.0, 10.0], [[0, 0, 0], [100, 0, 0]], [[10, 0, 0]] * 2, np.zeros((2, 3)))
    along = qt.Along([0.0, 50.0, 50.0 + ramp, 100.0], [12.0, 12.0, 3.0, 12.0], "linear")
    certificate = qt.certify(line, qt.Limits(speed=along))
    assert certificate.status["speed"] == "broken"
    assert 3.0 <= certificate.worst["speed"][2] <= 10.0
    timed = qt.retime(line, qt.Limits(speed=along, longitudinal_acceleration=2.0), 0.0, 0.0)
    assert timed.certificate.holds
    _, s, speed = sampled(timed.path, "speed")
    assert speed[np.argmin(abs(s - 50.0 - ramp))] < 3.001
    at_end = timed.timing.time((50.0 + ramp) / 10.0)
    assert 2.99 < np.linalg.norm(timed.path.velocity(at_end)) < 3.0 + 1e-9


def test_a_path_without_motion_and_the_end_of_a_path_have_values():
    still = qt.Route([0.0, 10.0], *np.zeros((3, 2, 3)))
    for kind in ("step", "linear"):
        found = qt.certify(still, qt.Limits(speed=(qt.Along([0.0, 10.0], [5.0, 6.0], kind), 10.0)))
        assert found.status == {"speed_min": "broken", "speed": "proved"}
    line = qt.Route([0.0, 10.0], [[0, 0, 0], [100, 0, 0]], [[10, 0, 0]] * 2, np.zeros((2, 3)))
    assert qt.certify(line, qt.Limits(speed=qt.Along([0.0, 100.0], [12.0, 5.0]))).status["speed"] == "proved"


def test_a_lower_speed_limit_holds_only_in_its_zone():
    limits = qt.Limits(speed=(qt.Along([0.0, 10.0, 20.0], [None, 3.0, None]), 9.0), longitudinal_acceleration=2.0)
    assert qt.retime(LINE, limits, 0.0, 0.0).certificate.holds
    with pytest.raises(ValueError, match="must be at least 3"):
        qt.retime(LINE, qt.Limits(speed=(qt.Along([0.0, 1.0], [3.0, 3.0]), 9.0), longitudinal_acceleration=2.0), 0.0)
    faster = qt.Limits(speed=(qt.Along([0.0, 50.0], [3.0, 4.0]), 9.0), longitudinal_acceleration=2.0)
    assert qt.retime(LINE, faster, 3.0, 5.0).certificate.holds


@pytest.mark.parametrize("width", [1e-9, 1e-6, 1e-3])
def test_a_narrow_zone_is_timed(width):
    limits = qt.Limits(
        speed=qt.Along([0.0, 50.3, 50.3 + width], [12.0, 3.0, 12.0]), longitudinal_acceleration=(-6.0, 2.0)
    )
    timed = qt.retime(LINE, limits, 0.0, 0.0)
    exact = leg(50.3, 0.0, 3.0, 12.0) + leg(49.7, 3.0, 0.0, 12.0)
    assert timed.certificate.holds
    assert float(timed.duration) == pytest.approx(exact, rel=1e-3)
    assert float(timed.gap) < 1e-3


def square(x, y, half):
    return [(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)]


def test_regions_are_steps_along_a_path():
    """A circle of 30 m through a square: the crossings in closed form."""
    circle = qt.SpiralHelix([30.0], [0.0, 0.2], [0.0], 10 * np.pi)
    regions = qt.Regions([(square(30.0, 0.0, 10.0), 4.0), (square(-30.0, 0.0, 5.0), 5.0)], outside=9.0)
    along = regions.along(circle)
    first, second = 30 * np.arcsin(10 / 30), 30 * np.arcsin(5 / 30)
    ends = [0.0, first, 30 * np.pi - second, 30 * np.pi + second, 60 * np.pi - first]
    np.testing.assert_allclose(along.distance, ends, atol=1e-6)
    assert along.values.tolist() == [4.0, 9.0, 5.0, 9.0, 4.0]
    assert qt.certify(circle, qt.Limits(speed=regions)).status["speed"] == "broken"
    assert qt.certify(circle, qt.Limits(speed=qt.Regions([(square(30.0, 0.0, 10.0), 6.1)]))).holds


def test_regions_limit_timings_and_routes():
    zones = qt.Regions([(square(50.0, 0.0, 10.0), 5.0), (square(62.5, 0.0, 7.5), 3.0)], outside=12.0)
    limits = qt.Limits(speed=zones, longitudinal_acceleration=(-6.0, 2.0))
    timed = qt.retime(LINE, limits, 0.0, 0.0)
    steps = qt.Along([0.0, 40.0, 55.0, 70.0], [12.0, 5.0, 3.0, 12.0])
    same = qt.retime(LINE, qt.Limits(speed=steps, longitudinal_acceleration=(-6.0, 2.0)), 0.0, 0.0)
    assert timed.certificate.holds
    assert float(timed.duration) == pytest.approx(float(same.duration), rel=1e-3)
    assert qt.certify(timed.path, limits).holds
    t = np.arange(0.0, 31.0, 2.0)
    route = qt.Route.from_piecewise(CubicSpline(t, np.stack([8 * t, 30 * np.sin(t / 9), 0.02 * t], axis=1)))
    tuned = qt.tune_route(route, qt.Limits(speed=qt.Regions([(square(120.0, 25.0, 35.0), 7.0)], outside=9.0)), 1.0)
    assert tuned.certificate.holds
    assert float(limits.margins(LINE.route, 50.0)["speed"]) == pytest.approx(5.0 - 1.0, abs=1e-6)


@pytest.mark.parametrize("form", ["toml", "json"])
@pytest.mark.parametrize("pair", [(None, 2.0), (-3.0, None), (qt.Along([0.0, 9.0], [-3.0, -2.0]), None)])
def test_limits_on_one_side_are_stored(tmp_path, form, pair):
    given = qt.Limits(longitudinal_acceleration=pair)
    document.save(given, tmp_path / f"limits.{form}")
    found = qt.load(tmp_path / f"limits.{form}")
    assert jax.tree.structure(found) == jax.tree.structure(given)
    jax.tree.map(np.testing.assert_array_equal, found, given)


@pytest.mark.parametrize("form", ["toml", "json"])
@pytest.mark.parametrize("values", [(8.3, 12.0), (8.3, None), ((2.0, 8.3), (None, 12.0)), ((1.0, 2.0), None)])
def test_regions_are_stored(tmp_path, form, values):
    given = qt.Limits(speed=qt.Regions([([(0, 0), (9, 0), (9, 9)], values[0])], values[1]))
    document.save(given, tmp_path / f"limits.{form}")
    found = qt.load(tmp_path / f"limits.{form}")
    assert jax.tree.structure(found) == jax.tree.structure(given)
    jax.tree.map(np.testing.assert_array_equal, found, given)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: qt.Regions([]), "at least one pair"),
        (lambda: qt.Regions([(square(0, 0, 1), 5.0), 3.0]), "list of pairs"),
        (lambda: qt.Regions([([(0, 0), (1, 1)], 5.0)]), "three corners"),
        (lambda: qt.Regions([(square(0, 0, 1), "slow")]), "one number"),
        (lambda: qt.Limits(speed=(qt.Along([0.0, 9.0], [np.inf, np.inf]), None)), "finite, or None"),
        (lambda: qt.Limits(speed=(qt.Along([0.0, 50.0], [1.0, 7.0]), qt.Along([0.0, 50.0], [5.0, 10.0]))), "at 50 m"),
    ],
)
def test_bad_regions_are_named(make, text):
    with pytest.raises(ValueError, match=text):
        make()


@pytest.mark.parametrize("none", [np.nan, np.inf])
def test_a_limit_without_any_value_does_not_bound_a_timing(none):
    route = qt.Route([0.0, 10.0], [[0.0, 0, 0], [50.0, 0, 0]], np.zeros((2, 3)), np.zeros((2, 3)))
    limits = qt.Limits(speed=qt.Along([0.0, 10.0, 20.0], [none] * 3), longitudinal_acceleration=1.0)
    timed = qt.retime(route, limits, 0.0, 0.0)
    assert float(timed.duration) == pytest.approx(2 * np.sqrt(50.0), rel=1e-3)
    assert "speed not limited anywhere on the path: proved" in str(timed.certificate)


@pytest.mark.parametrize(("kind", "searches"), [("linear", 1), ("step", 2)])
def test_only_steps_are_imposed_on_whole_segments_after_a_failure(monkeypatch, kind, searches):
    """The duration is fixed, so the speed cannot be halved."""
    times = np.arange(4.0)
    line = qt.Route(times, np.outer(10 * times, [1.0, 0.0, 0.0]), np.tile([10.0, 0.0, 0.0], (4, 1)), np.zeros((4, 3)))
    calls, solved = [], rounds.solved
    monkeypatch.setattr(rounds, "solved", lambda *x: calls.append(1) or solved(*x))
    tuned = qt.tune_route(line, qt.Limits(speed=qt.Along([0.0, 14.0], [5.0, 4.0], kind)), 0.5)
    assert not tuned.successful
    assert len(calls) == searches
