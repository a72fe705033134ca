"""Routes of windows: as good at their ends as inside, because the samples beyond are used."""

import numpy as np
import pytest

import qtraj as qt

TIMES = np.arange(0.0, 90.0, 0.1)
NOISE = 0.02


def drive(order):
    """Derivatives (n, 3) of a drive of which 1.5 minutes are recorded."""
    t = TIMES
    parts = {
        0: [8 * t, 30 * np.sin(t / 9), 0.02 * t],
        1: [8 + 0 * t, 30 / 9 * np.cos(t / 9), 0.02 + 0 * t],
        2: [0 * t, -30 / 81 * np.sin(t / 9), 0 * t],
    }
    return np.stack(parts[order], axis=1)


def recorded(seed):
    noise = NOISE * np.random.default_rng(seed).standard_normal((len(TIMES), 3))
    return qt.Track(TIMES, drive(0) + noise)


def scores(route, states, offset):
    """The errors at both ends of a route, divided by their standard deviations: (end, order, axis)."""
    covariance = np.asarray(route.covariance())
    found = []
    for knot, t in ((0, 0.0), (-1, float(route.path.duration))):
        errors = np.asarray(route.path.derivatives(t, 2)) - states[round((t + offset) * 10)]
        found.append(errors / np.sqrt(np.diag(covariance[knot]))[:, None])
    return np.array(found)


STATES = np.stack([drive(k) for k in range(3)], axis=1)


def test_a_window_agrees_with_the_route_of_the_whole_recording():
    whole = qt.fit_route(recorded(0))
    part = qt.fit_route(recorded(0), window=(30.0, 60.0))
    assert float(part.path.duration) == pytest.approx(30.0)
    for t in (0.0, 0.05, 15.0, 29.9, 30.0):
        a, b = np.asarray(part.path.derivatives(t, 2)), np.asarray(whole.path.derivatives(t + 30.0, 2))
        np.testing.assert_allclose(a[0], b[0], atol=0.02)
        np.testing.assert_allclose(a[1], b[1], atol=0.03)
        np.testing.assert_allclose(a[2], b[2], atol=0.06)


def test_the_end_of_a_window_is_better_than_the_end_of_a_recording():
    errors = {"beyond": [], "cut": []}
    for seed in range(8):
        track = recorded(seed)
        for name, fitted in (
            ("beyond", qt.fit_route(track, window=(30.0, 60.0))),
            ("cut", qt.fit_route(track.window(30.0, 60.0))),
        ):
            errors[name].append(np.asarray(fitted.path.derivatives(0.0, 2))[2] - STATES[300, 2])
    rms = {name: np.sqrt(np.mean(np.square(x))) for name, x in errors.items()}
    assert rms["beyond"] < 0.6 * rms["cut"]


def test_the_ends_of_noisy_tracks_are_as_accurate_as_the_covariance_states():
    for window, offset in ((None, 0.0), ((30.0, 60.0), 30.0)):
        z = np.array([scores(qt.fit_route(recorded(seed), window=window), STATES, offset) for seed in range(16)])
        rms = np.sqrt(np.mean(z**2, axis=(0, 1, 3)))
        assert (rms[:2] < 2.0).all(), (window, rms)
        assert rms[2] < 2.0, (window, rms)


def test_stops_gaps_and_outliers_are_those_of_the_window():
    positions = np.array(recorded(1).positions)
    kept = (TIMES < 40.0) | (TIMES > 46.0)
    positions[350] += [0.0, 20.0, 0.0]
    positions[100] += [0.0, 20.0, 0.0]
    fitted = qt.fit_route(qt.Track(TIMES[kept], positions[kept]), window=(30.0, 60.0))
    assert fitted.outliers.tolist() == [50]
    [[start, end]] = np.asarray(fitted.gaps)
    assert start == pytest.approx(9.9, abs=0.11)
    assert end == pytest.approx(16.1, abs=0.11)
    assert len(fitted.stops) == 0


def test_a_window_within_a_stop():
    way = np.cumsum(np.where((TIMES > 30) & (TIMES < 60), 0.0, 0.8))
    positions = np.stack([way, 0 * way, 0 * way], axis=1)
    fitted = qt.fit_route(qt.Track(TIMES, positions), window=(20.0, 45.0))
    assert len(fitted.stops) == 1
    assert np.linalg.norm(np.asarray(fitted.path.velocity(24.0))) < 1e-6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"window": (30.0, 20.0)}, "must end after it starts"),
        ({"window": (30.0, 200.0)}, "extends beyond the recording"),
        ({"window": 30.0}, "two times"),
        ({"window": (30.0, 60.0), "knots": [0.0, 15.0, 30.0]}, "must be a spacing"),
    ],
)
def test_a_wrong_window_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.fit_route(recorded(0), **arguments)


def test_standard_deviations_of_samples_are_those_of_the_window():
    sigma = np.where(TIMES < 45, 0.02, 0.04)
    fitted = qt.fit_route(recorded(2), window=(30.0, 60.0), position_sigma=sigma)
    covariance = np.asarray(fitted.covariance())
    assert covariance[-1, 0, 0] > 2 * covariance[0, 0, 0]


def test_a_window_that_starts_with_outliers_has_the_error_of_the_others():
    track = recorded(3)
    positions = np.array(track.positions)
    positions[300:312] += [0.0, 60.0, 0.0]
    fitted = qt.fit_route(qt.Track(TIMES, positions), window=(30.0, 60.0))
    assert fitted.outliers.tolist() == list(range(12))
    assert float(fitted.residual.distance_rms) < 0.05


@pytest.mark.parametrize("count", [301, 900 - 1])
def test_standard_deviations_belong_to_the_samples_of_the_recording(count):
    with pytest.raises(ValueError, match=r"shape \(900,\)"):
        qt.fit_route(recorded(0), window=(30.0, 60.0), position_sigma=np.full(count, 0.02))
