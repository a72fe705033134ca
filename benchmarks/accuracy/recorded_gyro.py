"""Compare the attitude from the recorded gyro with the optical attitude."""

import numpy as np
from tests.motion.propagation import test_recorded_gyro as tests
from tests.motion.propagation.coning import angles

import qtraj as qt

from .tables import table


def recording():
    """Return times, bias-corrected gyro, bias, stride and optical attitudes of the whole recording."""
    return tests.recording.__wrapped__()


def deviations(start=0):
    """Return times [s], and angles [°] between the propagated and the optical attitude, from sample `start` on."""
    times, rates, _, every, optical = recording()
    found = qt.propagate_samples(times[start:], rates[start:], optical[start // every])[::every]
    return times[start::every], np.degrees(angles(found, optical[start // every :]))


def gyro():
    data = recording()
    times, rates, bias, _, _ = data
    rest = len(times) - tests.START
    rows = [
        ["20 s from the first movement", tests.deviation(data, rates)[0]],
        ["the same, without bias correction", tests.deviation(data, rates + bias)[0]],
        ["the whole movement, 60 s", tests.deviation(data, rates, rest)[0]],
        ["the whole recording with its rest, 74 s", float(deviations()[1].max())],
    ]
    return table(["time span", "largest error angle [°]"], [[name, f"{float(angle):.2f}"] for name, angle in rows])
