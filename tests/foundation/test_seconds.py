"""Times of NumPy, pandas and Python in seconds, in every public call that takes times."""

import datetime

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import qtraj as qt
from qtraj.foundation.seconds import absolute, first_time, seconds, since_first

WHOLE = np.arange(5)
START = np.datetime64("2026-05-06T09:00:00")
PATH = qt.SpiralHelix([20.0], [0.0, 0.3], [0.0, 0.5], 10.0)

DURATIONS = {
    **{f"numpy {unit}": (1000 * WHOLE).astype("m8[ms]").astype(f"m8[{unit}]") for unit in ("s", "ms", "us", "ns")},
    "pandas index": pd.to_timedelta(WHOLE, unit="s"),
    "pandas series": pd.Series(pd.to_timedelta(WHOLE, unit="s"), index=WHOLE + 7),
    "pyarrow": pd.Series(pd.to_timedelta(WHOLE, unit="s")).astype("duration[ns][pyarrow]"),
    "objects": np.array([datetime.timedelta(seconds=int(t)) for t in WHOLE], object),
    "list": [datetime.timedelta(seconds=int(t)) for t in WHOLE],
    "list of pandas": [pd.Timedelta(int(t), "s") for t in WHOLE],
    "list of numpy": [np.timedelta64(int(t), "s") for t in WHOLE],
}
ABSOLUTE = {
    **{f"numpy {unit}": (START + WHOLE).astype(f"M8[{unit}]") for unit in ("s", "ms", "us", "ns")},
    "pandas index": pd.to_datetime(START + WHOLE),
    "with a zone": pd.to_datetime(START + WHOLE).tz_localize("UTC").tz_convert("Europe/Berlin"),
    "list": [datetime.datetime(2026, 5, 6, 9, 0, int(t)) for t in WHOLE],
    "list with a zone": [datetime.datetime(2026, 5, 6, 9, 0, int(t), tzinfo=datetime.UTC) for t in WHOLE],
}
NUMBERS = (2.5, 3, [0.0, 1.0], [[0, 1]], WHOLE, jnp.ones(3), np.float32(2), pd.Series([0.5, 1.0]), None, "3 s", [])


@pytest.mark.parametrize("times", DURATIONS.values(), ids=DURATIONS)
def test_durations_are_seconds(times):
    converted = seconds(times)
    assert converted.dtype == np.float64
    np.testing.assert_array_equal(converted, WHOLE)
    assert first_time(times) is None


@pytest.mark.parametrize(("unit", "length"), [("W", 604800.0), ("D", 86400.0), ("h", 3600.0), ("m", 60.0)])
def test_long_units(unit, length):
    assert seconds(np.timedelta64(2, unit)) == 2 * length


@pytest.mark.parametrize("times", ABSOLUTE.values(), ids=ABSOLUTE)
def test_absolute_times_count_from_the_origin(times):
    assert first_time(times) == START
    np.testing.assert_array_equal(since_first(times), WHOLE)
    np.testing.assert_array_equal(seconds(times, START - np.timedelta64(1, "m")), WHOLE + 60)
    with pytest.raises(ValueError, match=r"absolute time 2026-05-06T09:00.*track\.elapsed"):
        seconds(times)


@pytest.mark.parametrize("times", NUMBERS, ids=lambda x: type(x).__name__)
def test_other_input_is_unchanged(times):
    assert seconds(times) is times
    assert since_first(times) is times


def test_traced_times_are_unchanged():
    np.testing.assert_allclose(jax.jit(lambda t: PATH.position(seconds(t)))(2.0), PATH.position(2.0), rtol=1e-12)


def test_nanoseconds_of_long_recordings_are_kept():
    far = np.datetime64("1700-01-01") + np.array([0, 1]).astype("m8[ns]")
    np.testing.assert_array_equal(since_first(far), [0.0, 1e-9])
    assert seconds(np.datetime64("2300-01-01"), np.datetime64("1600-01-01T00:00:00", "us")) == 22089888000.0


@pytest.mark.parametrize(
    ("times", "text"),
    [
        (np.array([0, 1], "m8[M]"), "no fixed number of seconds"),
        (np.array([0, 1], "m8"), "no fixed number of seconds"),
        (np.array([0, "NaT"], "m8[s]"), "NaT"),
        (pd.to_datetime(["2026-05-06", None]), "NaT"),
    ],
)
def test_times_that_have_no_seconds(times, text):
    with pytest.raises(ValueError, match=text):
        since_first(times)


@pytest.mark.parametrize("time", ["yesterday", "NaT", 3.0, START + WHOLE])
def test_an_absolute_time_is_one_time(time):
    with pytest.raises(ValueError, match="one absolute time"):
        absolute(time)


DELTA = DURATIONS["pandas index"]
LAW = qt.AccelerationLaw(1.0, 1.0)
RATES = np.tile([0.0, 0.0, 0.1], (5, 1))
QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])
STATES = np.stack([WHOLE, WHOLE**2, 0 * WHOLE], axis=1)
ZEROS = np.zeros((5, 3))
ROUTE = qt.Route(WHOLE, STATES, ZEROS, ZEROS)
PROGRAM = qt.FrameProgram(PATH)

CALLS = {
    "evaluate": lambda t: qt.evaluate(PATH, t).position,
    "evaluate a program": lambda t: qt.evaluate(PROGRAM, t).quaternion,
    "position": lambda t: PATH.position(t[1]),
    "trihedral": lambda t: qt.trihedral(PATH, t[1]).tangent,
    "program": lambda t: PROGRAM(t[1]).rate,
    "table program": lambda t: qt.TableProgram(t, np.tile(QUATERNION, (5, 1)))(t[2]).rate,
    "propagate": lambda t: qt.propagate(lambda t: 0.1 * jnp.ones(3), QUATERNION, t),
    "propagate_samples": lambda t: qt.propagate_samples(t, RATES, QUATERNION),
    "simulate": lambda t: qt.simulate(PROGRAM, LAW, PROGRAM(0.0).quaternion, PROGRAM(0.0).rate, t).times,
    "error_response": lambda t: qt.error_response(LAW, 0.9 * QUATERNION, np.zeros(4), t),
    "route": lambda t: qt.Route(t, STATES, ZEROS, ZEROS).times,
    "window of a route": lambda t: ROUTE.window(t[1], t[3]).duration,
    "segment of a route": lambda t: ROUTE.index(t[2]),
    "distance along a route": lambda t: ROUTE.arc_length(t[2]),
    "window of a track": lambda t: qt.Track(WHOLE, STATES).window(t[0], t[3]).times,
    "sample_times": lambda t: qt.sample_times(t[4], step=t[1]),
    "duration of a path": lambda t: qt.SpiralHelix([20.0], [0.0, 0.3], [0.0], t[4]).duration,
    "duration of a curve": lambda t: qt.Curve(lambda t: jnp.stack([t, t, t]), t[4]).duration,
    "label": lambda t: np.asarray(qt.label(t, angle=np.ones(5)).time),
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_every_call_converts_durations(call):
    np.testing.assert_array_equal(call(DELTA), call(1.0 * WHOLE))


@pytest.mark.parametrize("call", [CALLS[name] for name in ("evaluate", "position", "propagate", "label")])
def test_a_path_has_no_absolute_times(call):
    with pytest.raises(ValueError, match=r"absolute time .*track\.elapsed"):
        call(START + WHOLE)


@pytest.mark.parametrize("call", [CALLS[name] for name in ("propagate_samples", "route")])
def test_recorded_times_may_be_absolute(call):
    np.testing.assert_array_equal(call(START + WHOLE), call(1.0 * WHOLE))


MIXED = [
    [np.timedelta64(200, "ms"), 1],
    [datetime.timedelta(0), datetime.datetime(2020, 1, 1)],
    np.array([datetime.timedelta(0), datetime.datetime(2020, 1, 1)]),
]


@pytest.mark.parametrize("times", MIXED)
def test_times_of_several_kinds_are_refused(times):
    with pytest.raises(ValueError, match="all durations, all absolute times, or all numbers"):
        seconds(times, np.datetime64("2020-01-01"))


def test_no_absolute_times_are_no_seconds():
    assert seconds(np.array([], "M8[s]")).shape == (0,)
