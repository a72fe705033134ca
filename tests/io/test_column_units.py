"""Units in the names of columns: only times are in milliseconds; variables of xarray have units, too."""

import numpy as np
import pytest
import xarray as xr

import qtraj as qt
from qtraj.io.track.track_file import read_recording

TIMES = 0.5 * np.arange(12)
POSITIONS = np.stack([8 * TIMES, TIMES**2, 0.5 * TIMES], axis=1)
VELOCITIES = np.stack([8 + 0 * TIMES, 2 * TIMES, 0.5 + 0 * TIMES], axis=1)
SPEEDS = {"ms": 1.0, "mps": 1.0, "m_s": 1.0, "m/s": 1.0, "kmh": 3.6, "km_h": 3.6, "kph": 3.6}


def table(tmp_path, header, *columns):
    file = tmp_path / "log.csv"
    rows = [",".join(map(repr, row)) for row in np.column_stack(columns).tolist()]
    file.write_text("\n".join([header, *rows]))
    return file


@pytest.mark.parametrize("form", ["v{}_{}", "v{} [{}]", "vel_{}({})"])
@pytest.mark.parametrize("unit", SPEEDS)
def test_velocities(tmp_path, form, unit):
    names = ",".join(form.format(axis, unit) for axis in "xyz")
    track = qt.read_track(table(tmp_path, f"t,x,y,z,{names}", TIMES, POSITIONS, SPEEDS[unit] * VELOCITIES))
    np.testing.assert_allclose(track.velocities, VELOCITIES, rtol=1e-12)


@pytest.mark.parametrize("unit", SPEEDS)
def test_speeds_of_a_race_line(tmp_path, unit):
    line = np.stack([8 * TIMES, 0 * TIMES], axis=1)
    file = table(tmp_path, f"s_m,x_m,y_m,speed_{unit}", 8 * TIMES, line, SPEEDS[unit] * np.full(len(TIMES), 8.0))
    np.testing.assert_allclose(qt.read_track(file).times, TIMES, rtol=1e-12)


def test_times_are_in_milliseconds(tmp_path):
    track = qt.read_track(table(tmp_path, "t_ms,x,y,z", 1000 * TIMES, POSITIONS))
    np.testing.assert_allclose(track.times, TIMES, rtol=1e-12)


def test_undecoded_times_of_xarray_have_the_unit_before_since():
    for unit, factor in (("days", 86400.0), ("hours", 3600.0), ("seconds", 1.0)):
        times = ("time", TIMES, {"units": f"{unit} since 2026-05-06"})
        dataset = xr.Dataset({"p": (("time", "axis"), POSITIONS)}, coords={"time": times, "axis": list("xyz")})
        np.testing.assert_allclose(qt.read_track(dataset).times, factor * TIMES, rtol=1e-12)


@pytest.mark.parametrize("unit", ["ms", "mps", "kmh", "rad/s"])
def test_positions_have_a_unit_of_length(tmp_path, unit):
    with pytest.raises(ValueError, match="but the position must be in m"):
        qt.read_track(table(tmp_path, f"t,x [{unit}],y [{unit}],z [{unit}]", TIMES, POSITIONS))


def test_variables_of_xarray():
    """A variable with components has its unit; dimensionless numbers, such as quaternions, have none."""
    quaternions = np.stack([np.cos(TIMES), np.sin(TIMES), 0 * TIMES, 0 * TIMES], axis=1)
    dataset = xr.Dataset(
        {
            "position": (("time", "world"), POSITIONS / 1000, {"units": "km"}),
            "velocity": (("time", "world"), 3.6 * VELOCITIES, {"units": "km h-1"}),
            "q": (("time", "part"), quaternions, {"units": "1"}),
        },
        coords={"time": ("time", 1000 * TIMES, {"units": "ms"}), "world": ["x", "y", "z"], "part": list("wxyz")},
    )
    recording = read_recording(dataset)
    np.testing.assert_allclose(recording.track.times, TIMES, rtol=1e-12)
    np.testing.assert_allclose(recording.track.positions, POSITIONS, rtol=1e-12)
    np.testing.assert_allclose(recording.track.velocities, VELOCITIES, rtol=1e-12)
    np.testing.assert_array_equal(recording.track.attitudes, quaternions)
    assert "km" in recording.facts[1]
