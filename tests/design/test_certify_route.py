"""Limits proved on every segment of a route: dense samples, planted violations, stops and straights, splines."""

import jax
import mpmath
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, make_interp_spline

import qtraj as qt
from qtraj.algebra.bounded import SLACK, UNIT
from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.proof.composed import composed_source
from qtraj.path.quantity import quantity
from qtraj.path.stops import Segments

LIMITS = qt.Limits(
    curvature=0.2,
    lateral_acceleration=4.0,
    longitudinal_acceleration=3.0,
    speed=9.0,
    jerk=30.0,
    yaw_rate=1.2,
    slope=0.3,
)


def winding(count=40, seed=0):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.8, 1.2, count))
    rows = [
        [6 * t, 4 * np.sin(0.5 * t), 0.5 * np.cos(0.2 * t)],
        [6 + 0 * t, 2 * np.cos(0.5 * t), -0.1 * np.sin(0.2 * t)],
        [0 * t, -np.sin(0.5 * t), -0.02 * np.cos(0.2 * t)],
    ]
    return qt.Route(t, *(np.array(row).T + rng.normal(0, 0.02, (count, 3)) for row in rows))


def stopping():
    """A drive to a stop, a wait, and a drive on; velocity and acceleration vanish at the stop."""
    position = [[-12.0, 0, 0], [0, 0, 0], [0, 0, 0], [12, 1, 0.5]]
    velocity = [[6.0, 0.3, 0], [0, 0, 0], [0, 0, 0], [6, 0.5, 0.2]]
    return qt.Route([0.0, 3, 8, 11], position, velocity, np.zeros((4, 3)))


@pytest.fixture(scope="module")
def certified():
    route = winding()
    return route, qt.certify(route, LIMITS)


def largest(route, names, count=100_001):
    t = np.linspace(0, float(route.duration), count)
    outputs = {name: quantity(name).variable for name in names}
    table = qt.evaluate(route, t, list(outputs.values()))
    return {name: np.asarray(table.values[output]) for name, output in outputs.items()}, t


def test_largest_values_agree_with_dense_samples(certified):
    route, certificate = certified
    assert certificate.holds
    assert certificate.result == "every limit is proved to be satisfied on the whole path."
    values, _ = largest(route, certificate.names)
    for name, seen in values.items():
        time, value, limit = certificate.worst[name]
        assert value == pytest.approx(seen.max(), rel=2e-3)  # a jump at a joint
        assert value >= seen.max() * (1 - 1e-12)
        assert limit == float(getattr(LIMITS, name))
        if name not in ("jerk", "longitudinal_acceleration"):  # these use both sides of a joint
            assert float(LIMITS.values(route, time)[name]) == pytest.approx(value, rel=1e-9)
        assert certificate.margin(name) == pytest.approx(limit - value)
        assert np.min(certificate.margins(name)) == certificate.margin(name)
        assert certificate.intervals(name) == []
    assert certificate.segments.codes.shape == (route.segments, 7)


def test_intervals_of_a_broken_limit_agree_with_dense_samples(certified):
    route, certificate = certified
    lower = {name: value * 0.9 for name, (_, value, _) in certificate.worst.items()}
    broken = qt.certify(route, qt.Limits(**lower))
    assert set(broken.status.values()) == {"broken"}
    assert not broken.holds
    values, t = largest(route, broken.names)
    for name, seen in values.items():
        inside = np.zeros(t.shape, bool)
        for a, b in broken.intervals(name):
            inside |= (t >= a) & (t <= b)
        above = seen > lower[name]
        assert np.mean(inside != above) < 2e-5  # except for samples at the ends
        assert any(a <= broken.worst[name][0] <= b for a, b in broken.intervals(name))
    with pytest.raises(RuntimeError, match="the limit on curvature is broken"):
        qt.certify(route, qt.Limits(**lower), throw=True)
    assert "is violated from" in str(broken)
    assert "intervals with a violated limit" in repr(broken)


def test_both_sides_of_a_joint_are_used():
    """The acceleration jumps at the joint: the earlier side is the larger one."""
    x = np.array([0.0, 1.0, 2.0])
    route = qt.Route.from_piecewise(make_interp_spline(x, np.stack([5 * x, [0.0, 0, 1], 0 * x], axis=1), k=1))
    bent = qt.Route([0.0, 1.0], [[0, 0, 0], [5, 0, 0]], [[5, 0, 0]] * 2, [[0, 0, 0], [0, 2, 0]])
    flat = qt.Route([0.0, 1.0], [[5, 0, 0], [10, 0, 0]], [[5, 0, 0]] * 2, np.zeros((2, 3)))
    both = qt.certify(bent + flat, qt.Limits(acceleration=1.9))
    assert both.status["acceleration"] == "broken"
    assert both.worst["acceleration"][:2] == pytest.approx((1.0, 2.0))
    assert both.segments.status["acceleration"].tolist() == ["broken", "proved"]
    assert qt.certify(route, qt.Limits(speed=5.2)).holds


def test_a_short_violation_between_samples_is_detected():
    """An oscillation of 0.2 ms in a drive of 400 s, between all samples."""
    route = winding(60)
    states = np.array(route.joints(2))
    times = np.array(route.times)
    at = 31.4159
    r = np.asarray(route.derivatives(at, 2))
    kick = r + np.array([[0, 0, 0], [0, 0, 0], [0, 3.0, 0]])
    after = np.asarray(route.derivatives(at + 2e-4, 2))
    k = int(np.searchsorted(times, at))
    times = np.insert(times, [k, k], [at, at + 2e-4])
    states = np.insert(states, [k, k], [kick, after], axis=0)
    planted = qt.Route(times, states[:, 0], states[:, 1], states[:, 2])
    limits = qt.Limits(acceleration=2.9)
    assert qt.certify(route, limits).holds
    certificate = qt.certify(planted, limits)
    assert certificate.status["acceleration"] == "broken"
    assert certificate.worst["acceleration"][0] == pytest.approx(at, abs=1e-3)
    assert any(a <= at <= b for a, b in certificate.intervals("acceleration"))
    t = np.arange(0.005, float(planted.duration), 0.01)
    seen = np.asarray(qt.evaluate(planted, t, ("acceleration_magnitude",)).acceleration_magnitude)
    assert np.max(seen) < 2.9  # samples every 10 ms miss it


def test_stops_and_waits():
    route = stopping()
    limits = qt.Limits(
        curvature=0.05, speed=8.0, acceleration=5.0, lateral_acceleration=1.0, longitudinal_acceleration=6.0, jerk=12.0,
        yaw_rate=0.5, slope=0.2,
    )  # fmt: skip
    certificate = qt.certify(route, limits)
    status = certificate.status
    assert status.pop("curvature") == "undefined"  # it grows without bound towards the stop
    assert set(status.values()) == {"proved"}
    assert certificate.segments.status["curvature"].tolist() == ["undefined", "proved", "undefined"]
    values, t = largest(route, [*status, "curvature"])
    moving = np.abs(t - 5.5) > 2.5001
    for name in status:
        seen = np.linalg.norm(values[name], axis=-1) if values[name].ndim > 1 else values[name]
        assert certificate.worst[name][1] == pytest.approx(np.max(seen[moving]), rel=1e-3), name
    assert np.isnan(certificate.worst["curvature"][1])
    assert certificate.code == qt.ResultCode.limits_undefined
    lower = qt.certify(route, qt.Limits(yaw_rate=0.06, longitudinal_acceleration=4.0))
    assert set(lower.status.values()) == {"broken"}


def test_straight_parts():
    t = np.array([0.0, 1.0, 3.0])
    straight = qt.Route(t, np.outer(t, [5.0, 1.0, 0.2]), np.tile([5.0, 1.0, 0.2], (3, 1)), np.zeros((3, 3)))
    certificate = qt.certify(straight, qt.Limits(curvature=1e-6, lateral_acceleration=0.01, yaw_rate=0.01, torsion=0.1))
    assert certificate.status["torsion"] == "undefined"
    assert [certificate.status[x] for x in ("curvature", "lateral_acceleration", "yaw_rate")] == ["proved"] * 3


def test_a_spline_with_ten_thousand_segments():
    x = np.linspace(0.0, 5000.0, 10_001)
    y = np.stack([8 * x, 30 * np.sin(0.05 * x), 2 * np.cos(0.02 * x)], axis=1)
    route = qt.Route.from_piecewise(CubicSpline(x, y))
    certificate = qt.certify(route, qt.Limits(curvature=0.01, lateral_acceleration=1.0))
    assert certificate.holds
    assert certificate.segments.codes.shape == (10_000, 2)


def exactly(c, s, order):
    """A derivative of a segment in mpmath's precision."""
    terms = [(mpmath.ff(j, order) * s ** (j - order), row) for j, row in enumerate(c) if j >= order]
    return [sum(weight * mpmath.mpf(float(row[axis])) for weight, row in terms) for axis in range(3)]


def test_proofs_agree_with_fifty_digits(certified):
    """Proved limits are satisfied at many instants, in arithmetic with fifty digits."""
    route, certificate = certified
    rng = np.random.default_rng(7)
    limit = certificate.worst["curvature"][1] * (1 + 1e-9)
    assert qt.certify(route, qt.Limits(curvature=limit)).holds
    c, starts, h = (np.asarray(x) for x in (route.coefficients, route.starts, np.diff(np.asarray(route.times))))
    worst = certificate.worst["curvature"][0]
    places = np.concatenate([rng.uniform(0, float(route.duration), 100), worst + rng.normal(0, 1e-6, 100)])
    with mpmath.workdps(50):
        for t in places:
            i = int(np.clip(np.searchsorted(starts, t, "right") - 1, 0, len(h) - 1))
            s = mpmath.mpf(t) - mpmath.mpf(float(starts[i]))
            v, a = (exactly(c[i], s, order) for order in (1, 2))
            cross = [v[1] * a[2] - v[2] * a[1], v[2] * a[0] - v[0] * a[2], v[0] * a[1] - v[1] * a[0]]
            curvature = mpmath.sqrt(sum(x * x for x in cross)) / mpmath.sqrt(sum(x * x for x in v)) ** 3
            assert curvature <= mpmath.mpf(limit)


def test_certificates_can_be_stored_and_are_empty_without_limits(certified, tmp_path):
    from qtraj.foundation import document

    route, certificate = certified
    document.save(certificate, tmp_path / "findings.json")
    again = qt.load(tmp_path / "findings.json")
    assert again.status == certificate.status
    assert again.findings((3,))[0] == certificate.findings((3,))[0]
    assert qt.certify(route, qt.Limits()).holds


def test_invalid_arguments(certified):
    route, _ = certified
    with pytest.raises(ValueError, match="certify accepts one route: call it once for each route"):
        qt.certify(jax.tree.map(lambda x: np.stack([x, x]), route), LIMITS)
    with pytest.raises(ValueError, match="a corridor is supported only for a SpiralHelix"):
        qt.certify(route, LIMITS, corridor=1.0, reference=qt.SpiralHelix([1.0], [0.0, 1.0], [0.0], 1.0))


@pytest.mark.parametrize("kind", ["path", "direction", "component", "shape"])
def test_bounded_polynomials_of_curves_with_a_progress(kind):
    """The errors of the coefficients are within their bounds, with positions as well."""
    rng = np.random.default_rng(4)
    rows, durations = np.array([0, 2]), np.array([1.0, 1.25, 1.25])
    own = np.stack([[7.2, 0.0, 0.4, 0.3], [0.0, 1.0, 0.0, 0.0], [3.0, 0.7, -0.2, 0.1]])
    curves = Segments(
        np.array([0.0, 1.0, 2.25]), rng.normal(size=(3, 6, 3)), durations, own, np.array([9.0, -7.0, 1.0])
    )
    source = composed_source(curves, rows, kind).positioned()
    found = source.bounded(4)
    for k in range(len(rows)):
        exact, unit = source.exact(k, 4), ExactPolynomial.of(1 / float(source.length[k]))
        scaled = [p * unit for row in exact.rows if row is not None for p in row]
        pairs = list(zip([p for row in found.rows if row is not None for p in row], scaled, strict=True))
        assert len(pairs) == (15 if kind == "path" else 12)
        pairs += [] if found.pace == 1 else [(found.pace, exact.pace)]
        for floats, true in pairs:
            bounds = SLACK * UNIT * floats.k * floats.m[:, k]
            errors = (true - ExactPolynomial.from_floats(floats.c[:, k])).floats()
            assert np.all(np.abs(errors) <= bounds)
            assert np.all(bounds <= 1e-9 * np.abs(floats.c[:, k]).max())
