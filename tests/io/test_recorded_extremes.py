"""Gaps, restarted clocks, standstills, large and fine times: each has a stated outcome."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import qtraj as qt
from qtraj.io.track.track_file import read_recording, read_track

TIMES = np.arange(0.0, 60.0, 0.1)
POSITIONS = np.stack([8 * TIMES, 30 * np.sin(TIMES / 9), 0.02 * TIMES], axis=1)
LENGTH = np.linalg.norm(np.diff(POSITIONS, axis=0), axis=1).sum()

HOUR_ROWS, HOUR_SECONDS, HOUR_GIGABYTES = 3_600_000, 10.0, 2.0
"""One hour at 1 kHz, and the time and memory in which it is read on an idle core."""


def write(tmp_path, times, positions, name="a.csv"):
    file = tmp_path / name
    rows = [",".join([str(t), *(f"{x:.6f}" for x in row)]) for t, row in zip(times, positions, strict=True)]
    file.write_text("\n".join(["t,x,y,z", *rows]) + "\n")
    return file


def test_a_gap_of_minutes_is_stated_and_bridged(tmp_path):
    times = np.concatenate([TIMES[:300], TIMES[300:] + 240])
    noisy = POSITIONS + np.random.default_rng(4).normal(0, 0.02, POSITIONS.shape)
    recording = read_recording(write(tmp_path, times, noisy))
    assert "largest gap 240.1 s after 29.9 s" in recording.facts[3]
    fitted = qt.fit_route(recording.track)
    assert len(fitted.gaps) == 1
    np.testing.assert_allclose(fitted.path.duration, times[-1])


def test_a_restarted_clock_divides_the_recording(tmp_path):
    file = write(tmp_path, np.concatenate([TIMES[:300], TIMES[:300]]), POSITIONS)
    with pytest.raises(ValueError, match=r"line 302: .* 0\.0 follows 29\.9.*segment=1 \(line 2 to line 301\)"):
        read_track(file)
    for segment, rows in ((1, slice(0, 300)), (2, slice(300, 600))):
        np.testing.assert_allclose(read_track(file, segment=segment).positions, POSITIONS[rows], atol=1e-6)


def test_rows_that_are_not_sorted_are_refused(tmp_path):
    order = np.random.default_rng(3).permutation(len(TIMES))
    with pytest.raises(ValueError, match=r"the times decrease at \d+ places: sort the rows by their times"):
        read_track(write(tmp_path, TIMES[order], POSITIONS[order]))


def test_a_vehicle_that_stands_at_both_ends(tmp_path):
    """Positions equal to the micrometre for three minutes; the drive between them starts and ends at rest."""
    ramp = TIMES - 60 / (2 * np.pi) * np.sin(2 * np.pi * TIMES / 60)
    moving = np.stack([8 * ramp, 30 * np.sin(ramp / 9), 0.02 * ramp], axis=1)
    positions = np.concatenate([np.repeat(moving[:1], 1800, 0), moving, np.repeat(moving[-1:], 1200, 0)])
    recording = read_recording(write(tmp_path, np.round(0.1 * np.arange(len(positions)), 3), positions))
    assert "stands for the first 18" in recording.facts[3]
    assert "stands for the last 12" in recording.facts[3]
    fitted = qt.fit_route(recording.track)
    assert len(fitted.stops) == 2
    np.testing.assert_allclose(fitted.path.length(), np.linalg.norm(np.diff(moving, axis=0), axis=1).sum(), rtol=1e-3)


def test_unix_nanoseconds_keep_their_digits(tmp_path):
    """Near 1.7e18 a float64 has steps of 256 ns; the times are subtracted before."""
    start = 1_714_986_000_123_456_789
    stamps = [start + 123 * k for k in range(len(TIMES))]
    recording = read_recording(write(tmp_path, stamps, POSITIONS * 1e-6))
    np.testing.assert_allclose(recording.track.times, 123e-9 * np.arange(len(TIMES)), rtol=1e-12)
    assert recording.facts[0] == f"time: column 1 't', ns, in seconds after {start} ns"


def test_one_point_a_minute(tmp_path):
    minutes = 60.0 * np.arange(200)
    positions = np.stack([5 * minutes, 900 * np.sin(minutes / 900), 0 * minutes], axis=1)
    recording = read_recording(write(tmp_path, minutes, positions))
    assert recording.notes == ()
    fitted = qt.fit_route(recording.track)
    assert bool(fitted.successful)
    assert float(fitted.residual.maximum) < 0.1
    np.testing.assert_allclose(
        fitted.path.length(), np.linalg.norm(np.diff(positions, axis=0), axis=1).sum(), rtol=1e-3
    )


def test_memory_and_time_are_proportional_to_the_rows(tmp_path):
    file = hour(tmp_path, 100_000)
    start = time.perf_counter()
    assert read_track(file).positions.shape == (100_000, 3)
    assert time.perf_counter() - start < HOUR_SECONDS / 4


def hour(tmp_path, count):
    t = np.arange(count) / 1000
    block = [f"{a:.3f},{8 * a:.4f},{b:.4f},0,8,{c:.4f},0" for a, b, c in zip(t, np.sin(t), np.cos(t), strict=True)]
    file = tmp_path / "hour.csv"
    file.write_text("\n".join(["t,x,y,z,vx,vy,vz", *block]) + "\n")
    return file


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux reports the peak of a process's memory")
def test_an_hour_at_1_khz(tmp_path):
    # VmHWM is the peak of this process alone; ru_maxrss begins with that of its parent.
    code = (
        "import sys, time, qtraj as qt; s = time.perf_counter(); n = qt.read_track(sys.argv[1]).times.size; "
        "peak = [x for x in open('/proc/self/status') if x.startswith('VmHWM')][0].split()[1]; "
        "print(n, time.perf_counter() - s, int(peak) / 2**20)"
    )
    file = hour(tmp_path, HOUR_ROWS)
    shown = subprocess.run([sys.executable, "-c", code, str(file)], capture_output=True, text=True, check=True)
    count, seconds, gigabytes = map(float, shown.stdout.split())
    assert count == HOUR_ROWS
    assert seconds < 2 * HOUR_SECONDS  # other processes may run
    assert gigabytes < HOUR_GIGABYTES


@pytest.mark.parametrize("count", [6, 100, 600])
def test_a_vehicle_that_never_moves(tmp_path, count):
    """Equal positions to the last digit: one stop, without NaN and warnings, and said in one line."""
    recording = read_recording(write(tmp_path, TIMES[:count], 0 * POSITIONS[:count] + [3.0, 4.0, 5.0]))
    assert "the vehicle never moves" in recording.facts[3]
    fitted = qt.fit_route(recording.track)
    assert float(fitted.path.length()) == 0
    np.testing.assert_array_equal(fitted.path.position(TIMES[count // 2]), [3, 4, 5])
    assert len(fitted.stops) == 1
    near = POSITIONS[:count] / 1e5
    assert "stays within" in read_recording(write(tmp_path, TIMES[:count], near)).facts[3]
