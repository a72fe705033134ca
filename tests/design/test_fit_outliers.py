"""Outliers of recordings: single ones, many, and blocks after a jump of the receiver; the route stays where it was."""

import numpy as np
import pytest

import qtraj as qt

TIMES = np.arange(0.0, 60.0, 0.1)
DRIVE = np.stack([8 * TIMES, 30 * np.sin(TIMES / 9), 0.02 * TIMES], axis=1)
NOISE = 0.02


def circle(times, radius, rate):
    return radius * np.stack([np.cos(rate * times), np.sin(rate * times), 0 * times], axis=1)


def fraction(part, size):
    def disturb(random, positions):
        bad = np.flatnonzero(random.random(len(positions)) < part)
        positions[bad] += size * random.standard_normal((len(bad), 3))
        return bad

    return disturb


def block(random, positions):
    start, shift = random.integers(50, 500), random.standard_normal(3)
    positions[start : start + 20] += 15 * shift / np.linalg.norm(shift)
    return np.arange(start, start + 20)


def spikes(random, positions):
    bad = random.choice(len(positions), 5, replace=False)
    positions[bad] += 50 * random.standard_normal((5, 3))
    return bad


CASES = {
    "one in ten by 20 m": fraction(0.1, 20.0),
    "three in ten by 20 m": fraction(0.3, 20.0),
    "one in five by 1 m": fraction(0.2, 1.0),
    "a block of 20 by 15 m": block,
    "five spikes of 50 m": spikes,
    "none": lambda random, positions: np.array([], int),
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", CASES)
def test_the_drive_is_recovered(case, seed):
    random = np.random.default_rng(seed)
    positions = DRIVE + NOISE * random.standard_normal(DRIVE.shape)
    bad = CASES[case](random, positions)
    fitted = qt.fit_route(qt.Track(TIMES, positions))
    assert not np.setdiff1d(fitted.outliers, bad).size
    far = bad[np.linalg.norm(positions[bad] - DRIVE[bad], axis=1) > 0.5]
    assert not np.setdiff1d(far, fitted.outliers).size
    errors = np.linalg.norm(np.stack([fitted.path(t) for t in TIMES]) - DRIVE, axis=1)
    assert np.sqrt(np.mean(errors**2)) < 0.03
    assert errors.max() < 0.08


@pytest.mark.parametrize("count", [100, 300])
def test_exact_data_have_no_outliers(count):
    fitted = qt.fit_route(qt.Track(TIMES[:count], DRIVE[:count]))
    assert fitted.outliers.size == 0


def test_a_lasting_jump_is_part_of_the_way():
    """A correction of the receiver without a jump back: no sample is left out because it comes later."""
    positions = DRIVE + NOISE * np.random.default_rng(0).standard_normal(DRIVE.shape)
    positions[300:] += [0.0, 2.0, 0.0]
    fitted = qt.fit_route(qt.Track(TIMES, positions))
    assert len(fitted.outliers) < 20
    assert np.linalg.norm(fitted.path(50.0) - DRIVE[500] - np.array([0.0, 2.0, 0.0])) < 0.05


@pytest.mark.parametrize("gap", [(10.15, 14.75), (10.35, 14.65), (20.0, 22.0)])
@pytest.mark.parametrize("digits", [3, 12])
def test_samples_beside_a_gap_in_a_bend_are_no_outliers(gap, digits):
    start, end = gap
    times = np.concatenate([np.arange(0.0, start, 0.1), np.arange(np.ceil(10 * end) / 10, 60.0, 0.1)])
    positions = np.round(circle(times, 5.0, 2.0), digits)
    fitted = qt.fit_route(qt.Track(times, positions))
    assert len(fitted.outliers) == 0
    errors = np.linalg.norm(np.stack([fitted.path(t) for t in times]) - positions, axis=1)
    assert errors.max() < 0.3


@pytest.mark.parametrize("arguments", [{"tolerance": 1e-3}, {"knots": 1.0}])
def test_a_coarse_fit_has_no_outliers(arguments):
    fitted = qt.fit_route(qt.Track(TIMES, circle(TIMES, 50.0, 0.3)), **arguments)
    assert len(fitted.outliers) == 0


@pytest.mark.parametrize("index", [0, 1, 300, 598, 599])
def test_a_single_outlier_is_found_anywhere(index):
    positions = DRIVE + NOISE * np.random.default_rng(0).standard_normal(DRIVE.shape)
    positions[index] += [0.0, 3.0, 0.0]
    assert qt.fit_route(qt.Track(TIMES, positions)).outliers.tolist() == [index]


@pytest.mark.parametrize("noise", [0.0, NOISE])
@pytest.mark.parametrize("parked", [0.5, 0.8, 0.95])
def test_a_vehicle_that_is_parked_most_of_the_time(parked, noise):
    """The positions at rest are exactly equal, and say nothing about the noise while it moves."""
    times = np.arange(0.0, 900.0, 0.1)
    driven = np.clip(times - 900 * parked, 0, None)
    moving = driven > 0
    way = np.where(driven < 10, 0.5 * driven**2, 50 + 10 * (driven - 10))
    right = np.stack([40 * np.sin(way / 40), 40 - 40 * np.cos(way / 40), 0 * way], axis=1)
    positions = right + noise * moving[:, None] * np.random.default_rng(0).standard_normal(right.shape)
    fitted = qt.fit_route(qt.Track(times, positions))
    errors = np.linalg.norm(np.asarray(qt.evaluate(fitted.path, times, ("position",)).position) - right, axis=1)
    assert errors.max() < 0.08
    assert len(fitted.outliers) <= 8
    [[start, end]] = np.asarray(fitted.stops)
    assert (start, end) == pytest.approx((0.0, 900 * parked), abs=1.0)


@pytest.mark.parametrize("gap", [600.0, 2000.0, 1e5])
def test_a_gap_of_any_length_is_bridged(gap):
    times = np.concatenate([TIMES, TIMES + 60 + gap])
    positions = np.concatenate([DRIVE, DRIVE + np.array([600.0, 50.0, 0.0])])
    positions = positions + NOISE * np.random.default_rng(0).standard_normal(positions.shape)
    fitted = qt.fit_route(qt.Track(times, positions))
    assert len(fitted.gaps) == 1
    assert float(fitted.residual.maximum) < 0.2


@pytest.mark.parametrize("count", [8, 10, 15, 20])
@pytest.mark.parametrize("rate", [0.15, 0.3])
def test_a_short_recording_at_one_hertz(count, rate):
    times = np.arange(float(count))
    right = circle(times, 40.0, rate)
    positions = right + NOISE * np.random.default_rng(1).standard_normal(right.shape)
    fitted = qt.fit_route(qt.Track(times, positions))
    errors = np.linalg.norm(np.stack([fitted.path(t) for t in times]) - right, axis=1)
    assert errors.max() < 0.15
    assert len(fitted.outliers) == 0
