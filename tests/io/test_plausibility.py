"""Units and axes that are probably wrong are named, with what to pass instead."""

import numpy as np
import pytest

import qtraj as qt
from qtraj.design.odd_limits import odd_limits
from qtraj.io.track.track_file import read_recording

TIMES = np.arange(0.0, 40.0, 0.1)
POSITIONS = np.stack([8 * TIMES, 30 * np.sin(TIMES / 9), 0.02 * TIMES], axis=1)
VELOCITIES = np.stack([8 + 0 * TIMES, 30 / 9 * np.cos(TIMES / 9), 0.02 + 0 * TIMES], axis=1)


def read(tmp_path, header, *columns, **options):
    rows = np.column_stack(columns)
    file = tmp_path / "a.csv"
    file.write_text("\n".join([header, *(",".join(f"{x:.12g}" for x in row) for row in rows)]) + "\n")
    return read_recording(file, **options)


def test_a_plausible_recording_has_no_notes(tmp_path):
    assert read(tmp_path, "t,x,y,z,vx,vy,vz", TIMES, POSITIONS, VELOCITIES).notes == ()
    noisy = POSITIONS + np.random.default_rng(0).normal(0, 0.05, POSITIONS.shape)
    assert read(tmp_path, "t,x,y,z,vx,vy,vz", TIMES, noisy, VELOCITIES).notes == ()
    standing = np.repeat(POSITIONS[:1], len(TIMES), axis=0)
    assert read(tmp_path, "t,x,y,z,vx,vy,vz", TIMES, standing, 0 * VELOCITIES).notes == ()


@pytest.mark.parametrize(
    ("factor", "unit"), [(3.6, "km/h"), (3600 / 1852, "kn"), (1 / 0.44704, "mph"), (1 / 0.3048, "ft/s")]
)
def test_velocities_in_another_unit(tmp_path, factor, unit):
    header = "t,x,y,z,vx,vy,vz"
    [note] = read(tmp_path, header, TIMES, POSITIONS, factor * VELOCITIES).notes
    assert f"are {factor:.3g} times the velocities of the positions: if the velocity is in {unit}" in note
    assert f'units={{"velocity": "{unit}"}}' in note
    corrected = read(tmp_path, header, TIMES, POSITIONS, factor * VELOCITIES, units={"velocity": unit})
    assert corrected.notes == ()
    np.testing.assert_allclose(corrected.track.velocities, VELOCITIES, rtol=1e-9)


@pytest.mark.parametrize(("factor", "unit"), [(100, "cm"), (1000, "mm"), (0.001, "km")])
def test_positions_in_another_unit(tmp_path, factor, unit):
    notes = read(tmp_path, "t,x,y,z,vx,vy,vz", TIMES, factor * POSITIONS, VELOCITIES).notes
    assert any(f'if the position is in {unit}, pass units={{"position": "{unit}"}}' in note for note in notes)


def test_speeds_that_no_vehicle_has(tmp_path):
    [note] = read(tmp_path, "t,x,y,z", TIMES, 100 * POSITIONS).notes
    assert "the median speed is" in note
    assert 'units={"position": "cm"}' in note
    [note] = read(tmp_path, "t,x,y,z", 1000 * TIMES * 10, POSITIONS).notes
    assert 'if the times are in ms, pass units={"time": "ms"}' in note


def test_latitude_and_longitude_exchanged(tmp_path):
    places = [-79.47 + 1e-5 * POSITIONS[:, 1], 43.78 + 1e-5 * POSITIONS[:, 0]]
    [note] = read(tmp_path, "t,lat,lon", TIMES, *places).notes
    assert "starts at 79.47° S, 43.78° E: if latitude and longitude are exchanged" in note
    assert read(tmp_path, "t,lat,lon", TIMES, *places[::-1]).notes == ()


def test_axes_of_a_camera(tmp_path):
    camera = POSITIONS[:, [1, 2, 0]] * [1, -1, 1]
    curved = np.stack([50 * np.sin(TIMES / 9), camera[:, 1], 50 * np.cos(TIMES / 9)], axis=1)
    [note] = read(tmp_path, "t,x,y,z", TIMES, curved).notes
    assert "if the vertical is -y, as for a camera, pass axes='camera'" in note
    assert read(tmp_path, "t,x,y,z", TIMES, curved, axes="camera").notes == ()


def test_utm_coordinates_are_named(tmp_path):
    recording = read(tmp_path, "t,x,y,z", TIMES, POSITIONS + np.array([458000, 5430000, 120]))
    assert recording.facts[1].endswith("UTM by their size")
    assert recording.notes == ()


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"curvature": 21.5}, "is a radius of 46.51 mm: if 21.5 is a radius in m, write curvature = 0.04651"),
        ({"slope": 6}, "write slope = 0.06"),
        ({"yaw_rate": 30.0}, "write yaw_rate = 0.5236"),
        ({"speed": 50.0}, "write speed = 13.89"),
    ],
)
def test_odd_limits(limits, words):
    [text] = odd_limits(limits, qt.Track(TIMES, POSITIONS, VELOCITIES))
    assert words in text


def test_usual_limits_are_not_odd():
    limits = {"curvature": 0.05, "slope": 0.08, "speed": 13.9, "yaw_rate": 0.5, "lateral_acceleration": 2.0}
    assert odd_limits(limits, qt.Track(TIMES, POSITIONS)) == ()
    assert odd_limits({"curvature": 2.0}, qt.Track(TIMES, 0.01 * POSITIONS)) == ()


def test_rates_in_degrees(tmp_path):
    rates = np.stack([0 * TIMES, 0 * TIMES, 20 * np.cos(TIMES / 9)], axis=1)
    [note] = read(tmp_path, "t,x,y,z,wx,wy,wz", TIMES, POSITIONS, rates).notes
    assert 'pass units={"rate": "deg/s"}' in note
    assert read(tmp_path, "t,x,y,z,wx,wy,wz", TIMES, POSITIONS, rates, units={"rate": "deg/s"}).notes == ()


def test_scaled_geographic_coordinates(tmp_path):
    columns = [TIMES, 481000000 + 90 * POSITIONS[:, 1], 115000000 + 130 * POSITIONS[:, 0], 520e3 + 0 * TIMES]
    with pytest.raises(ValueError, match=r'if they are in 1e-7 degrees, pass units=\{"position": "1e-7 deg"\}'):
        read(tmp_path, "t,lat,lon,alt", *columns)
    [note] = read(tmp_path, "t,lat,lon,alt", *columns, units={"position": "1e-7 deg"}).notes
    assert "a height of 520 km: if the height is in mm" in note
    assert read(tmp_path, "t,lat,lon,alt_mm", *columns, units={"position": "1e-7 deg"}).notes == ()


def test_positions_relative_to_the_centre_of_the_earth(tmp_path):
    centre = np.array([4_182_105.0, 850_859.0, 4_724_681.0])
    [note] = read(tmp_path, "t,x,y,z", TIMES, centre + POSITIONS).notes
    assert "from the origin" in note
    assert "ECEF" in note
    assert "from_crs(4978, 4979)" in note
    gauss_krueger = np.array([3_500_000.0, 5_300_000.0, 450.0])  # the same distance from the origin
    assert read(tmp_path, "t,x,y,z", TIMES, gauss_krueger + POSITIONS).notes == ()


def test_radians_that_are_read_as_degrees(tmp_path):
    degrees = np.stack([48.1 + POSITIONS[:, 1] / 111_200, 11.5 + POSITIONS[:, 0] / 74_600], axis=1)
    [note] = read(tmp_path, "t,lat,lon", TIMES, np.radians(degrees)).notes
    assert "0.84° N, 0.20° E" in note
    assert 'units={"position": "rad"}' in note
    assert read(tmp_path, "t,lat,lon", TIMES, np.radians(degrees), units={"position": "rad"}).notes == ()
    assert read(tmp_path, "t,lat,lon", TIMES, degrees).notes == ()


def test_times_in_milliseconds_beside_velocities_have_one_note(tmp_path):
    """Not a second one about positions in km, which explain the same ratio."""
    [note] = read(tmp_path, "t,x,y,z,vx,vy,vz", 1000 * TIMES + 0.25, POSITIONS, VELOCITIES).notes
    assert 'units={"time": "ms"}' in note


@pytest.mark.parametrize("rows", [slice(0, 5), slice(100, 101)])
def test_rows_without_a_position_fix(tmp_path, rows):
    degrees = np.stack([48.1 + POSITIONS[:, 1] / 111_200, 11.5 + POSITIONS[:, 0] / 74_600], axis=1)
    degrees[rows] = 0.0
    [note] = read(tmp_path, "t,lat,lon", TIMES, degrees).notes
    assert f"are 0 in {rows.stop - rows.start} of {len(TIMES)} rows" in note
    assert "delete these rows" in note


@pytest.mark.parametrize(
    ("first", "place"), [((48.1, 11.5), "48.10° N, 11.50° E"), ((-33.4, -70.6), "33.40° S, 70.60° W")]
)
def test_the_place_of_geographic_positions_is_stated(tmp_path, first, place):
    """So that exchanged latitude and longitude, which may both be plausible, can be seen."""
    degrees = np.array(first) + POSITIONS[:, :2] / 111_200
    assert (
        read(tmp_path, "t,lat,lon", TIMES, degrees).facts[1].endswith(f"as latitude, longitude, height, from {place}")
    )
