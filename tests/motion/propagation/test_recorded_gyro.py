"""A recorded gyro compared with an optical reference: the error is the sensor's, not the integration's.

The bias is estimated from the rest at the beginning. tests/data/README.md describes the recording.
"""

from importlib.resources import files

import numpy as np
import pytest

import qtraj as qt

from .coning import angles

RECORDING = files("qtraj.io") / "data" / "broad_02_slow_rotation.npz"
START, SPAN = 4000, 5715
"""The first sample of the movement, and the number of samples of 20 s."""
WITHIN = 3.0
"""[deg] Largest error over 20 s from the first optical attitude on; measured: 2.1°."""
WHOLE = 4.5
"""[deg] Largest error over the 60 s of movement; measured: 4.04°."""


@pytest.fixture(scope="module")
def recording():
    """Times [s], gyro without its bias, bias [rad/s], the spacing of the optical samples, and their attitudes."""
    with np.load(RECORDING) as file:
        gyro = file["gyro"].astype(float)
        bias = gyro[: int(file["rest"])].mean(axis=0)
        times = np.arange(len(gyro)) / float(file["sampling_rate"])
        return times, gyro - bias, bias, int(file["every"]), file["quaternion"].astype(float)


def deviation(recording, rates, span=SPAN, **how):
    """The largest angles [deg] between propagated and optical attitude, and between optical and initial attitude."""
    times, _, _, every, optical = recording
    part, reference = slice(START, START + span), optical[START // every :][: 1 + (span - 1) // every]
    propagated = np.asarray(qt.propagate_samples(times[part], rates[part], reference[0], **how))[::every]
    rotated = angles(reference, np.broadcast_to(reference[0], reference.shape))
    return np.degrees(angles(propagated, reference)).max(), np.degrees(rotated).max()


def test_twenty_seconds_stay_near_the_optical_attitude(recording):
    _, rates, _, _, _ = recording
    error, rotated = deviation(recording, rates)
    assert error < WITHIN
    assert rotated > 90  # the unit moved


def test_the_whole_movement(recording):
    times, rates, _, _, _ = recording
    assert deviation(recording, rates, len(times) - START)[0] < WHOLE


def test_wrong_input_exceeds_the_tolerance(recording):
    """With the bias, with the opposite sign, or in the other axes, the error exceeds three degrees."""
    _, rates, bias, _, _ = recording
    assert deviation(recording, rates + bias)[0] > 1.5 * WITHIN
    assert deviation(recording, -rates)[0] > 90
    assert deviation(recording, rates, axes="inertial")[0] > 5 * WITHIN


def test_the_method_does_not_contribute_to_the_error(recording):
    """Other polynomials through the samples give the same attitude to a hundredth of the sensor's error."""
    times, rates, _, _, optical = recording
    part = slice(START, START + SPAN)
    by_default, linear = (
        qt.propagate_samples(times[part], rates[part], optical[0], degree=degree) for degree in (None, 1)
    )
    assert np.degrees(angles(by_default, linear)).max() < WITHIN / 100
