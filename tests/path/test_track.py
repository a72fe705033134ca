"""Recorded tracks: checks of input, windows, turn and bends."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from qtraj.batch.evaluate import evaluate
from qtraj.design.fitting.fit_route import fit_route
from qtraj.foundation import document
from qtraj.io.track.track_file import read_track
from qtraj.path.bends import bends
from qtraj.path.track import Track

DATA = Path(__file__).parents[1] / "data"

ROUND_OFF = 1e-12
CHORD_ERROR = 0.01
"""Relative error of turn and length from chords on a circle: at most (turn/24)²/24."""


def recording(count=11, start=100.0):
    times = start + 0.1 * np.arange(count)
    positions = np.stack([times, times**2, -times], axis=1)
    return times, positions


def circle(turn, count=200, velocities=True, radius=20.0):
    times = np.linspace(5.0, 9.0, count)
    angle = turn * (times - 5.0) / 4.0
    positions = radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) + np.array([6e5, 4.8e6, 150.0])
    speeds = radius * turn / 4.0 * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    return Track(times, positions, speeds if velocities else None)


def test_times_of_a_track():
    track = Track(*recording())
    assert float(track.start_time) == 100.0
    np.testing.assert_allclose(track.duration, 1.0, rtol=ROUND_OFF)
    np.testing.assert_allclose(track.elapsed, 0.1 * np.arange(11), atol=ROUND_OFF)


def test_a_window_has_the_samples_of_its_closed_interval():
    times, positions = recording()
    quaternions = np.tile([1.0, 0, 0, 0], (11, 1)) + times[:, None]
    window = Track(times, positions, 2 * positions, quaternions).window(times[3], times[7])
    np.testing.assert_array_equal(window.times, times[3:8])
    np.testing.assert_array_equal(window.positions, positions[3:8])
    np.testing.assert_array_equal(window.velocities, 2 * positions[3:8])
    np.testing.assert_array_equal(window.attitudes, quaternions[3:8])


@pytest.mark.parametrize(
    ("t0", "t1", "words"),
    [
        (100.6, 100.2, "must end after it starts"),
        (100.2, 100.2, "must end after it starts"),
        (99.0, 100.5, r"extends beyond the recording; the recording runs from 100 to 101 s"),
        (100.5, 103.0, r"extends beyond the recording; the recording runs from 100 to 101 s"),
        (100.15, 100.45, r"contains 3 samples, but at least 4"),
        (100.51, 100.59, r"contains 0 samples, but at least 4"),
        (float("nan"), 100.5, "must end after it starts"),
    ],
)
def test_invalid_windows_are_errors(t0, t1, words):
    with pytest.raises(ValueError, match=words):
        Track(*recording()).window(t0, t1)


def changed(values, where, value):
    values = values.copy()
    values[where] = value
    return values


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t, p: (changed(t, 4, t[3]), p), r"times\[4\] = 100.3.* follows times\[3\] = 100.3"),
        (lambda t, p: (changed(t, 4, t[2]), p), r"times\[4\] = 100.2"),
        (lambda t, p: (changed(t, 4, np.nan), p), r"times of a track must be finite, but sample 4 is nan"),
        (lambda t, p: (t, changed(p, (2, 1), np.inf)), r"positions of a track must be finite, but sample 2 is .*inf"),
        (lambda t, p: (t, p[:-1]), r"shape \(11, 3\).*\(10, 3\)"),
        (lambda t, p: (t, p[:, :2]), r"shape \(11, 3\).*\(11, 2\)"),
        (lambda t, p: (t[:3], p[:3]), r"at least 4.*\(3,\)"),
        (lambda t, p: (t, p, p[:5]), r"velocities of a track must have shape \(11, 3\)"),
        (lambda t, p: (t, p, None, p), r"attitudes of a track must have shape \(11, 4\)"),
        (lambda t, p: (t, p, None, np.eye(11, 4)), r"nonzero quaternions, but sample 4 is zero"),
    ],
)
def test_invalid_recordings_are_errors(change, words):
    with pytest.raises(ValueError, match=words):
        Track(*change(*recording()))


def test_times_that_are_equal_in_float32_are_an_error():
    _, positions = recording()
    times = (1.6e9 + np.arange(11)).astype(np.float32)
    with pytest.raises(ValueError, match="increase strictly"):
        Track(times, positions.astype(np.float32))


def test_a_coarse_float32_track_warns():
    times, positions = recording()
    with pytest.warns(UserWarning, match=r"a recorded track in float32 has a resolution of only"):
        Track((times - times[0]).astype(np.float32), (positions + 4.8e6).astype(np.float32))


@pytest.mark.parametrize("turn", [1.5, -1.5, 7.0, -0.2])
def test_the_turn_of_a_circle(turn):
    """The direction of travel on a circle turns as far as the circle does, left positive."""
    np.testing.assert_allclose(circle(turn).turn, turn, rtol=1e-9)
    np.testing.assert_allclose(circle(turn, velocities=False).turn, turn, rtol=CHORD_ERROR)


def test_noise_hardly_changes_the_turn_from_chords():
    """Samples 4 cm apart with 1 cm of noise: single steps have no usable direction, but chords do."""
    track = circle(2.0, count=1000, velocities=False)
    noise = 0.01 * np.random.default_rng(1).normal(size=(1000, 3))
    np.testing.assert_allclose(Track(track.times, track.positions + noise).turn, 2.0, atol=0.05)


def test_a_stop_does_not_turn():
    """At rest the velocities are only noise, which must not add to the turn."""
    moving = circle(1.0, count=50)
    noise = 0.01 * np.random.default_rng(2).normal(size=(30, 3))
    track = Track(
        jnp.concatenate([moving.times, moving.times[-1] + jnp.arange(1.0, 31.0)]),
        jnp.concatenate([moving.positions, jnp.tile(moving.positions[-1:], (30, 1))]),
        jnp.concatenate([moving.velocities, jnp.asarray(noise)]),
    )
    np.testing.assert_allclose(track.turn, 1.0, rtol=1e-9)
    still = Track(np.arange(5.0), np.ones((5, 3)))
    assert float(still.turn) == 0.0


@pytest.mark.parametrize("velocities", [True, False], ids=["velocities", "positions"])
def test_a_parked_car_does_not_turn(velocities):
    """A real car that waits for 8 s: its velocities are noise of a millimetre per second in all directions."""
    track = read_track(DATA / "boreas_standing.csv")
    if not velocities:
        track = Track(track.times, track.positions)
    assert float(np.ptp(np.asarray(track.positions), axis=0).max()) < 0.002
    assert float(track.turn) == 0.0
    assert bends(track, np.radians(10.0), 2.0) == []


@pytest.mark.parametrize("size", [0.06, 0.09, 0.2, 2.0])
def test_a_track_within_a_decimetre_does_not_turn(size):
    """40 rounds on a circle with the diameter `size`: they are a turn only if the circle is larger than noise."""
    angle = np.linspace(0.0, 80 * np.pi, 2000)
    ring = 0.5 * size * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    speed = 0.5 * size * np.stack([-np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    turn = 80 * np.pi if size >= 0.2 else 0.0
    np.testing.assert_allclose(Track(angle, ring + np.array([6e5, 4.8e6, 150.0]), speed).turn, turn, rtol=1e-9)


@pytest.mark.parametrize("velocities", [True, False], ids=["velocities", "positions"])
def test_the_bends_of_a_real_drive(velocities):
    """Right and left at two crossings; each bend has about the turn of its window."""
    track = read_track(DATA / "boreas_bends.csv")
    recording = track if velocities else Track(track.times, track.positions)
    result = bends(recording, np.radians(10.0), 2.0)
    assert np.sign([bend.turn for bend in result]).tolist() == [-1.0, 1.0]
    for bend in result:
        turn = float(track.window(bend.start, bend.end).turn)
        np.testing.assert_allclose(0.9 * bend.turn, turn, atol=np.radians(6.0))
    assert result[0].start < result[0].end < result[1].start < result[1].end


def test_small_oscillations_are_not_bends():
    """A left turn with an oscillation of ±4° is one bend, and the oscillation alone is none."""
    times = np.linspace(0.0, 10.0, 400)
    for turn, count in ((1.5, 1), (0.0, 0), (-1.5, 1)):
        heading = turn * times / 10.0 + np.radians(4.0) * np.sin(6 * times)
        velocities = 8.0 * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
        positions = np.cumsum(velocities, axis=0) * (times[1] - times[0])
        result = bends(Track(times, positions, velocities), np.radians(10.0), 2.0)
        assert len(result) == count
        assert [np.sign(bend.turn) for bend in result] == [np.sign(turn)] * count


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_a_track_is_stored_exactly(tmp_path, suffix):
    track = circle(1.0, count=7)
    document.save(track, tmp_path / f"track{suffix}")
    back = document.load(tmp_path / f"track{suffix}")
    np.testing.assert_array_equal(back.positions, track.positions)
    np.testing.assert_array_equal(back.velocities, track.velocities)
    assert back.attitudes is None


START = np.datetime64("2026-05-06T09:00:00.25")


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_durations_as_times_are_seconds(unit):
    times = pd.to_timedelta([0, 1, 2, 3, 4], unit="s").as_unit(unit)
    track = Track(times, np.zeros((5, 3)))
    assert float(track.duration) == 4.0
    assert track.epoch is None


def absolute_recording():
    steps = (100 * np.arange(11)).astype("m8[ms]")
    return Track(START + steps, recording()[1])


def test_absolute_times_count_from_the_first():
    track = absolute_recording()
    assert np.datetime64(track.epoch) == START
    np.testing.assert_allclose(track.times, 0.1 * np.arange(11), atol=ROUND_OFF)
    assert track.to_xarray().attrs["epoch"] == "2026-05-06T09:00:00.250"


def test_a_window_of_absolute_times_keeps_the_clock():
    track = absolute_recording()
    window = track.window(START + np.timedelta64(200, "ms"), START + np.timedelta64(800, "ms"))
    np.testing.assert_array_equal(window.times, track.window(0.2, 0.8).times)
    assert (window.epoch, window.times.shape) == (track.epoch, (7,))
    with pytest.raises(ValueError, match="absolute time"):
        Track(*recording()).window(START, START + np.timedelta64(1, "s"))


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_the_epoch_is_stored(tmp_path, suffix):
    track = absolute_recording()
    file = tmp_path / f"track.{suffix}"
    document.save(track, file)
    assert document.load(file).epoch == track.epoch


@pytest.mark.parametrize("suffix", ["toml", "json"])
def test_a_track_without_an_epoch_is_stored_as_before(tmp_path, suffix):
    file = tmp_path / f"track.{suffix}"
    document.save(Track(*recording()), file)
    assert "epoch" not in file.read_text()
    assert document.load(file).epoch is None


def test_an_epoch_of_times_in_seconds():
    assert Track(*recording(), epoch="2026-05-06T09:00:00.25").epoch == "2026-05-06T09:00:00.250"
    with pytest.raises(ValueError, match="one absolute time"):
        Track(*recording(), epoch="noon")
    with pytest.raises(ValueError, match="omit epoch"):
        Track(START + np.arange(11), recording()[1], epoch=START)


def test_times_on_the_clock_of_a_recording_name_the_remedy():
    track = Track(*recording())
    path = fit_route(track).path
    with pytest.raises(ValueError, match=r"10[01] s was given.*track\.elapsed"):
        evaluate(path, track.times)
    assert evaluate(path, track.elapsed).position.shape == (11, 3)
