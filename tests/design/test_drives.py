"""Drives with stops: curves next to stops in fits, proofs, tuning and retiming; the street of `drives` is known."""

import jax
import numpy as np
import pytest
from tests.design import drives

import qtraj as qt

LIMITS = qt.Limits(curvature=0.085, lateral_acceleration=1.5, longitudinal_acceleration=2.0)
OUTPUTS = (
    "curvature",
    "speed",
    "acceleration",
    "jerk",
    "lateral_acceleration",
    "longitudinal_acceleration",
    "yaw_rate",
)


SLOWEST = 1e-3
"""[m/s] At lower speeds, rounding errors of velocity and acceleration are visible in the sampled curvature."""


@pytest.fixture(scope="module")
def fitted():
    return drives.fitted()


@pytest.fixture(scope="module")
def tuned(fitted):
    return qt.tune_route(fitted.path, LIMITS, tube=0.5)


def sampled(path, count=200_001):
    """Return the largest magnitudes of quantities at many instants at which the vehicle moves."""
    t = np.linspace(0.0, float(path.duration), count)
    table = qt.evaluate(path, t, outputs=("velocity", "curvature", "acceleration", "jerk", *OUTPUTS[4:]))
    moving = np.linalg.norm(table.velocity, axis=1) > SLOWEST
    found = {name: np.asarray(getattr(table, "velocity" if name == "speed" else name))[moving] for name in OUTPUTS}
    return {name: float(np.max(np.linalg.norm(x, axis=1) if x.ndim == 2 else np.abs(x))) for name, x in found.items()}


def test_the_fit_has_the_shape_of_the_street_and_stops_where_the_vehicle_did(fitted):
    path = fitted.path
    assert path.progress is not None
    np.testing.assert_allclose(np.asarray(fitted.stops), drives.STOPS, atol=0.25)
    assert float(fitted.residual.distance_rms) < 1.05 * 0.01 * np.sqrt(2 + 0.3**2)
    t = np.linspace(0.0, float(path.duration), 5001)
    points = np.asarray(qt.evaluate(path, t, outputs=("position",)).position)
    assert np.linalg.norm(points - drives.street(drives.way(t)), axis=1).max() < 0.05
    assert np.abs(np.asarray(path.jumps())).max(axis=(0, 2)) == pytest.approx(0.0, abs=1e-11)
    np.testing.assert_allclose(path.stops, fitted.stops, atol=1e-9)
    legs = path.legs
    assert len(legs) == 3
    assert sum(float(leg.length()) for leg in legs) == pytest.approx(float(path.length()), rel=1e-6)
    for start, end in np.asarray(fitted.stops):
        for moment in (start, 0.5 * (start + end), end):
            np.testing.assert_allclose(path.derivatives(moment, 2)[1:], 0.0, atol=1e-11)
    # The street's curvature is 1/12 1/m at most; a fit in time has 1000 1/m next to the stops.
    assert qt.certify(path, qt.Limits(curvature=1.4 / drives.RADIUS)).holds


@pytest.mark.parametrize("seed", range(1, 6))
@pytest.mark.parametrize("rate", [5.0, 20.0])
def test_curvature_of_other_recordings(seed, rate):
    path = qt.fit_route(drives.recorded(seed=seed, rate=rate)).path
    certificate = qt.certify(path, qt.Limits(curvature=2.0 / drives.RADIUS))
    assert certificate.holds, certificate


def test_proofs_agree_with_dense_samples(fitted):
    largest = sampled(fitted.path)
    above = qt.certify(fitted.path, qt.Limits(**{name: 1.001 * value for name, value in largest.items()}))
    below = qt.certify(fitted.path, qt.Limits(**{name: 0.999 * value for name, value in largest.items()}))
    assert {*above.status.values()} == {"proved"}
    assert {*below.status.values()} == {"broken"}
    for name, value in largest.items():
        assert above.worst[name][1] == pytest.approx(value, rel=1e-3)  # the jerk jumps at joints
        for start, end in below.intervals(name):
            assert 0 <= start < end <= float(fitted.path.duration)


def test_limits_hold_on_every_segment_of_a_tuned_drive(fitted, tuned):
    assert tuned.code == qt.ResultCode.successful
    assert tuned.certificate.holds
    assert not np.asarray(tuned.kept).any()
    largest = sampled(tuned.path)
    for name, value in LIMITS.given().items():
        assert largest[name] <= float(value)
    t = np.linspace(0, 1, 2001)
    before, after = (
        np.asarray(qt.evaluate(x, t * float(x.duration), outputs=("position",)).position)
        for x in (fitted.path, tuned.path)
    )
    nearest = np.linalg.norm(after[:, None] - before[None, ::4], axis=2).min(axis=1)
    assert nearest.max() < 0.5
    assert np.abs(np.asarray(tuned.path.jumps())).max(axis=(0, 2)) == pytest.approx(0.0, abs=1e-10)
    stops = [
        np.diff(np.asarray(x.times))[~np.asarray(x.coefficients)[: x.segments, 1:].any(axis=(1, 2))]
        for x in (fitted.path, tuned.path)
    ]
    np.testing.assert_allclose(*stops, rtol=1e-12)
    assert float(tuned.delay) == pytest.approx(float(tuned.path.duration) - float(fitted.path.duration), abs=1e-9)
    moved = np.asarray(tuned.path.joints(0))[:, 0] - np.asarray(fitted.path.joints(0))[:, 0]
    np.testing.assert_allclose(tuned.displacement, moved, atol=1e-12)


@pytest.mark.parametrize("objective", ["smoothest", "fastest"])
def test_other_objectives(fitted, objective):
    limits = qt.Limits(curvature=0.085, lateral_acceleration=2.0, longitudinal_acceleration=2.5, speed=9.5)
    path = fitted.path.window(5.0, 25.5)  # with the first stop
    tuned = qt.tune_route(path, limits, tube=0.5, objective=objective, max_steps=2000)
    assert tuned.successful, tuned.result
    assert tuned.certificate.holds
    change = float(tuned.path.duration) - float(path.duration)
    if objective == "fastest":
        assert float(tuned.objective) == pytest.approx(float(tuned.path.duration))
        assert change < -1.0
    else:
        assert change == pytest.approx(0.0, abs=1e-9)


def test_derivatives_of_a_tuned_drive(fitted, tuned):
    path = fitted.path.window(5.0, 22.0)

    def attained(curvature):
        limits = qt.Limits(curvature=curvature, lateral_acceleration=1.5)
        return qt.tune_route(path, limits, tube=0.5).objective

    h = 1e-5
    slope = float(jax.grad(attained)(0.085))
    known = (float(attained(0.085 + h)) - float(attained(0.085 - h))) / (2 * h)
    assert slope < 0
    assert slope == pytest.approx(known, rel=0.03)  # the margins between the nodes are constant in the derivative


def test_a_retimed_drive_keeps_its_heading_at_stops(tuned):
    limits = qt.Limits(speed=9.0, lateral_acceleration=1.5, longitudinal_acceleration=1.5, jerk=0.9)
    timed = qt.retime(tuned.path, limits)
    assert timed.certificate.holds
    assert qt.certify(timed.path, limits).holds
    t = np.arange(0.0, float(timed.path.duration), 0.01)
    q = np.asarray(qt.evaluate(timed.path, t, outputs=("quaternion",)).quaternion)
    angles = 2 * np.arccos(np.clip(np.abs(np.sum(q[1:] * q[:-1], axis=1)), 0, 1))
    assert np.degrees(angles.max()) < 1.0
    program = qt.FrameProgram(timed.path)
    assert isinstance(program.frame, qt.Driving)
    step = 1e-5
    for moment in np.linspace(1.0, float(timed.path.duration) - 1.0, 23):
        before, after = (program(moment + x).quaternion for x in (-step, step))
        turned = 2 * qt.quaternion.product(qt.quaternion.conjugate(before), after)[1:] / (2 * step)
        np.testing.assert_allclose(turned, program(moment).rate, atol=1e-6)


def test_a_window_inside_a_zone_and_its_tuning(fitted):
    start = float(np.asarray(fitted.stops)[0, 0]) - 1.3
    window = fitted.path.window(start, start + 12.0)
    np.testing.assert_allclose(window.derivatives(2.0, 3), fitted.path.derivatives(start + 2.0, 3), atol=1e-10)
    tuned = qt.tune_route(window, qt.Limits(lateral_acceleration=1.5, yaw_rate=0.3), tube=0.5)
    assert tuned.certificate.holds, tuned.result
