"""Tables as programs write them: delimiters, headers, units, clocks and axes; the files are written from formulas."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from qtraj.algebra import quaternion
from qtraj.io.track.column_units import SPELLINGS, unit_of
from qtraj.io.track.track_file import read_recording, read_track
from qtraj.scenario.path_parts import TrackPart

COUNT = 12
TIMES = 0.25 * np.arange(COUNT)
POSITIONS = np.stack([20 * np.cos(0.3 * TIMES), 20 * np.sin(0.3 * TIMES), 0.5 * TIMES], axis=1)
VELOCITIES = np.stack([-6 * np.sin(0.3 * TIMES), 6 * np.cos(0.3 * TIMES), 0.5 + 0 * TIMES], axis=1)
ATTITUDES = np.stack([np.cos(0.15 * TIMES), 0.1 * np.sin(TIMES), 0.2 + 0 * TIMES, np.sin(0.15 * TIMES)], axis=1)
PRINTED = 1e-9
"""[m], [m/s] Rounding of the printed decimals."""

CLOSE = 1e-6
"""[m] Rounding of printed degrees of latitude and longitude, 1e-11°."""


def cells(*columns):
    return [[f"{x:.12f}" for x in row] for row in np.column_stack(columns)]


def write(tmp_path, lines, name="data.dat"):
    file = tmp_path / name
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file


def lines(header, rows, delimiter=","):
    return [header, *(delimiter.join(row) for row in rows)]


def check(track, times=TIMES, velocities=VELOCITIES):
    np.testing.assert_allclose(track.times, times, atol=PRINTED)
    np.testing.assert_allclose(track.positions, POSITIONS, atol=PRINTED)
    if velocities is not None:
        np.testing.assert_allclose(track.velocities, velocities, atol=PRINTED)


NAMES = ["time", "x", "y", "z", "vx", "vy", "vz"]
PREAMBLES = {
    "none": lambda header, _: [header],
    "comment": lambda header, mark: [f"{mark} recorded in 2026, by us", f"{mark}{header}"],
    "several": lambda header, _: ["robot,x", "frame,cog", header],
    "notes": lambda header, mark: [f"{mark} x, y and z in metres", "", header],
}
FORMS = [
    lambda name, unit: f"{name} [{unit}]",
    lambda name, unit: f"{name.upper()} ({unit})",
    lambda name, unit: f"{name.capitalize()}_{unit.replace('/', 'p')}",
]


@pytest.mark.parametrize("seed", range(40))
def test_variations_are_read_alike(tmp_path, seed):
    """One recording with its columns in any order, delimiter, unit, case, comment and place of the header."""
    rng = np.random.default_rng(seed)
    delimiter = ",;\t "[seed % 4]
    mark = ["#", "%", "//"][rng.integers(3)]
    place = list(PREAMBLES)[rng.integers(4)]
    units = [["s", "ms", "us", "ns"], ["m", "cm", "mm", "km"], ["m/s", "km/h", "kn", "cm/s"]]
    chosen = [str(rng.choice(group)) for group in units]
    by_column = [chosen[0], *[chosen[1]] * 3, *[chosen[2]] * 3]
    form = FORMS[rng.integers(3)]
    order = rng.permutation(7)
    table = np.column_stack([TIMES, POSITIONS, VELOCITIES]) / [float(unit_of(unit).factor) for unit in by_column]
    rows = [[repr(float(x)) for x in row[order]] for row in table]
    if delimiter != "," and rng.integers(2):
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    header = delimiter.join(form(NAMES[k], by_column[k]) for k in order)
    text = [*PREAMBLES[place](header, mark), *(delimiter.join(row) for row in rows)]
    check(read_track(write(tmp_path, text)))


@pytest.mark.parametrize(
    ("spelling", "symbol"),
    [
        ("m s^-1", "m/s"),
        ("m·s⁻¹", "m/s"),
        ("KM/H", "km/h"),
        ("Knots", "kn"),
        ("µs", "µs"),
        ("μs", "µs"),
        ("°/s", "deg/s"),
    ],
)
def test_spellings_of_units(spelling, symbol):
    assert unit_of(spelling).symbol == symbol
    assert unit_of("map") is None


@pytest.mark.parametrize(
    ("spelling", "value"),
    [("kn", 0.514444), ("km/h", 0.277778), ("mph", 0.44704), ("ft", 0.3048), ("deg/s", 0.0174533), ("rad", 57.29578)],
)
def test_factors_of_units(spelling, value):
    assert float(unit_of(spelling).factor) == pytest.approx(value, rel=2e-6)


def test_every_spelling_denotes_itself():
    assert all(unit_of(spelling) == unit for spelling, unit in SPELLINGS.items())


def test_a_row_of_units_below_the_header(tmp_path):
    rows = cells(1e3 * TIMES, 100 * POSITIONS)
    check(read_track(write(tmp_path, lines("t;x;y;z", [["ms", "cm", "cm", "cm"], *rows], ";"))), velocities=None)


def test_units_by_the_keyword(tmp_path):
    file = write(tmp_path, lines("t,x,y,z,vx,vy,vz", cells(1e3 * TIMES, 100 * POSITIONS, 3.6 * VELOCITIES)))
    check(read_track(file, units={"time": "ms", "position": "cm", "velocity": "km/h"}))
    with pytest.raises(ValueError, match=r"units\['velocity'\] must be m/s, .*km/h.*, but 'm' was given"):
        read_track(file, units={"velocity": "m"})
    with pytest.raises(ValueError, match="units= accepts the keys time, position, velocity, rate, but 'speed'"):
        read_track(file, units={"speed": "m/s"})


START = 1_714_986_000_123_456_789
"""[ns] Unix time of the first sample."""


@pytest.mark.parametrize(("unit", "digits"), [("ns", 0), ("us", 3), ("ms", 6)])
@pytest.mark.parametrize("name", ["timestamp [{}]", "timestamp_{}", "timestamp"])
def test_unix_times_keep_their_digits(tmp_path, unit, digits, name):
    """In float64 such times are multiples of 256 ns; the differences are exact to a nanosecond."""
    steps = np.cumsum(np.arange(1, COUNT + 1)) * 7
    stamps = [str(START + int(step)) for step in steps]
    stamps = [stamp if not digits else f"{stamp[:-digits]}.{stamp[-digits:]}" for stamp in stamps]
    rows = [[stamp, *row] for stamp, row in zip(stamps, cells(POSITIONS), strict=True)]
    recording = read_recording(write(tmp_path, lines(name.format(unit) + ",x,y,z", rows)))
    np.testing.assert_allclose(recording.track.times, (steps - steps[0]) * 1e-9, rtol=1e-15, atol=0)
    assert stamps[0] in recording.facts[0]


def test_times_on_their_own_clock_stay(tmp_path):
    rows = [[str(500_000_000 + 100_000 * k), *row] for k, row in enumerate(cells(POSITIONS))]
    track = read_track(write(tmp_path, lines("time_us,x,y,z", rows)))
    np.testing.assert_array_equal(track.times, [(5000 + k) / 10 for k in range(COUNT)])
    unix = [[f"{1_714_986_000 + k}.5", *row] for k, row in enumerate(cells(POSITIONS))]
    np.testing.assert_array_equal(read_track(write(tmp_path, lines("t,x,y,z", unix))).times[0], 1_714_986_000.5)


@pytest.mark.parametrize("cell", ["1e400", "nan", "9" * 400, "inf", "soon"])
def test_times_that_are_not_finite_numbers(tmp_path, cell):
    rows = [[str(k), *row] for k, row in enumerate(cells(POSITIONS))]
    rows[3][0] = cell
    with pytest.raises(ValueError, match="line 5: column 't_ms' must have finite numbers, but contains"):
        read_track(write(tmp_path, lines("t_ms,x,y,z", rows)))


STAMPS = [datetime(2026, 5, 6, 9, 0, 0, tzinfo=UTC) + timedelta(seconds=0.25 * k) for k in range(COUNT)]


@pytest.mark.parametrize(
    ("written", "words"),
    [
        (lambda s: s.strftime("%Y-%m-%dT%H:%M:%S.%fZ"), "date and time"),
        (lambda s: s.strftime("%Y-%m-%d %H:%M:%S.%f"), "date and time"),
        (lambda s: s.strftime("%Y-%m-%dT%H:%M:%S.%f000+02:00"), "date and time"),
        (lambda s: s.strftime("%Y/%m/%d %H:%M:%S.%f"), "date and time"),
        (lambda s: s.strftime("%d/%m/%Y %H:%M:%S.%f"), "read with the day before the month"),
        (lambda s: s.strftime("%d.%m.%Y %H:%M:%S.%f"), "read with the day before the month"),
        (lambda s: (s + timedelta(days=20)).strftime("%m/%d/%Y %H:%M:%S.%f"), "month before day"),
        (lambda s: s.strftime("%H:%M:%S.%f"), "time of day"),
    ],
)
def test_dates(tmp_path, written, words):
    rows = [[written(stamp), *row] for stamp, row in zip(STAMPS, cells(POSITIONS), strict=True)]
    recording = read_recording(write(tmp_path, lines("Timestamp,x,y,z", rows)))
    check(recording.track, velocities=None)
    assert words in recording.facts[0]
    rows[4][0] = "later"
    with pytest.raises(ValueError, match=r"line 6: column 'Timestamp' must have .* such as .*, but contains 'later'"):
        read_track(write(tmp_path, lines("Timestamp,x,y,z", rows)))


def test_a_time_of_day_continues_after_midnight(tmp_path):
    stamps = [f"23:59:{54 + k}" if k < 6 else f"00:00:{k - 6:02d}" for k in range(COUNT)]
    rows = [[stamp, *row] for stamp, row in zip(stamps, cells(POSITIONS), strict=True)]
    np.testing.assert_array_equal(read_track(write(tmp_path, lines("time,x,y,z", rows))).times, np.arange(COUNT))
    minutes = [[stamp[:5], *row[1:]] for stamp, row in zip(stamps, rows, strict=True)]
    with pytest.raises(ValueError, match="line 2: column 'time' must have finite numbers, but contains '23:59'"):
        read_track(write(tmp_path, lines("time,x,y,z", minutes)))


def test_dates_in_an_unknown_form_are_refused(tmp_path):
    rows = [[f"May 6 2026 9:00:{k:02d}", *row] for k, row in enumerate(cells(POSITIONS))]
    with pytest.raises(
        ValueError, match="line 2: column 'date' must have finite numbers, but contains 'May 6 2026 9:00:00'"
    ):
        read_track(write(tmp_path, lines("date,x,y,z", rows)))


def test_unknown_names_above_a_row_of_units_are_listed(tmp_path):
    rows = [["(sec)", "(m)", "(m)", "(m)"], *cells(TIMES, POSITIONS)]
    file = write(tmp_path, lines("moment,Easting,Northing,H-Ell", rows))
    with pytest.raises(ValueError, match="The columns are moment, Easting, Northing, H-Ell;"):
        read_track(file)
    check(read_track(file, {"time": "moment"}), velocities=None)


def test_a_comment_header_above_rows_that_begin_with_text(tmp_path):
    rows = [["car", *row] for row in cells(TIMES, POSITIONS)]
    check(read_track(write(tmp_path, lines("# name,t,x,y,z", rows))), velocities=None)


def degrees(positions):
    """Latitude, longitude and height near 48° N, 11° E of positions within 30 m, by the radii of curvature."""
    a, e2, latitude = 6378137.0, 0.00669437999014, np.radians(48.0)
    w = np.sqrt(1 - e2 * np.sin(latitude) ** 2)
    north, east = positions[:, 1] / (a * (1 - e2) / w**3), positions[:, 0] / (a / w * np.cos(latitude))
    return np.column_stack([48 + np.degrees(north), 11 + np.degrees(east), positions[:, 2]])


CURVATURE = 3e-4
"""[m] Second-order terms of `degrees` within 30 m."""


def test_latitude_longitude_speed_and_heading(tmp_path):
    stamps = [[s.isoformat().replace("+00:00", "Z")] for s in STAMPS]
    rows = [stamp + row for stamp, row in zip(stamps, cells(degrees(POSITIONS), 21 + TIMES, 90 + TIMES), strict=True)]
    recording = read_recording(write(tmp_path, lines("time,lat,lon,alt,speed_kmh,heading_deg", rows)))
    np.testing.assert_allclose(recording.track.positions, POSITIONS - POSITIONS[0], atol=CURVATURE)
    np.testing.assert_allclose(recording.track.times, TIMES, atol=PRINTED)
    assert recording.track.velocities is None
    assert recording.track.attitudes is None
    assert "speed 'speed_kmh' and heading 'heading_deg'" in recording.facts[3]
    assert "latitude, longitude, height" in recording.facts[1]


def test_a_position_without_height(tmp_path):
    rows = cells(TIMES, degrees(POSITIONS)[:, :2])
    recording = read_recording(write(tmp_path, lines("t,Latitude,Longitude", rows)))
    np.testing.assert_allclose(recording.track.positions[:, :2], (POSITIONS - POSITIONS[0])[:, :2], atol=CURVATURE)
    assert "height 0 m" in recording.facts[1]


NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])


def forward_right_down(attitudes):
    """Quaternions from forward, right, down to north, east, down, of quaternions from forward, left, up to z up."""
    world, body = np.array([0, np.sqrt(0.5), np.sqrt(0.5), 0]), np.array([0, 1.0, 0, 0])
    return np.array([quaternion.product(quaternion.product(world, q), body) for q in attitudes])


@pytest.mark.parametrize(
    ("header", "axes"),
    [
        ("t,north,east,down,vn,ve,vd,qw,qx,qy,qz,wx,wy,wz", None),
        ("t,x,y,z,vx,vy,vz,qw,qx,qy,qz,wx,wy,wz", "ned"),
        ("t,x,y,z,vel_n,vel_e,vel_d,qw,qx,qy,qz,wx,wy,wz", "ned"),
    ],
)
def test_north_east_down(tmp_path, header, axes):
    rates = np.column_stack([0.1 * TIMES, 0.2 * TIMES, 0.3 * TIMES])
    recorded = (POSITIONS @ NED.T, VELOCITIES @ NED.T, forward_right_down(ATTITUDES), rates * [1, -1, -1])
    recording = read_recording(write(tmp_path, lines(header, cells(TIMES, *recorded))), axes=axes)
    check(recording.track)
    signs = np.sign(np.sum(np.asarray(recording.track.attitudes) * ATTITUDES, axis=1))
    np.testing.assert_allclose(recording.track.attitudes * signs[:, None], ATTITUDES, atol=PRINTED)
    np.testing.assert_allclose(recording.track.rates, rates, atol=PRINTED)
    assert "north, east, down" in recording.facts[1]
    assert "body axes forward, right, down" in recording.facts[2]


def test_camera_axes_agree_with_a_rotation_matrix(tmp_path):
    """A camera that looks along world y and whose image is upright has forward y, left -x, up z."""
    recorded = POSITIONS @ np.array([[1, 0, 0], [0, 0, -1], [0, 1.0, 0]]).T
    file = write(tmp_path, lines("t,x,y,z,qw,qx,qy,qz", cells(TIMES, recorded, np.tile([1.0, 0, 0, 0], (COUNT, 1)))))
    track = read_track(file, axes="camera")
    check(track, velocities=None)
    for body, world in [([1.0, 0, 0], [0, 1.0, 0]), ([0, 1.0, 0], [-1.0, 0, 0]), ([0, 0, 1.0], [0, 0, 1.0])]:
        np.testing.assert_allclose(quaternion.rotate(track.attitudes[0], np.array(body)), world, atol=PRINTED)


def test_axes_that_are_not_known_are_refused(tmp_path):
    file = write(tmp_path, lines("t,x,y,z,vn,ve,vd", cells(TIMES, POSITIONS, VELOCITIES)))
    with pytest.raises(ValueError, match=r"velocity is north, east, down .*x, y, z of the position.*pass axes='ned'"):
        read_track(file)
    with pytest.raises(ValueError, match=r"axes= must be 'enu', 'ned' or 'camera', but 'flat' was given"):
        read_track(file, axes="flat")
    with pytest.raises(ValueError, match=r"vn, ve, vd are 'ned' by their names, but axes='enu' was given"):
        read_track(file, axes="enu")
    assert read_track(file, {"velocity": None}).velocities is None


def test_quaternions_with_the_scalar_last_or_first(tmp_path):
    last = write(tmp_path, lines("t x y z qx qy qz qw", cells(TIMES, POSITIONS, ATTITUDES[:, [1, 2, 3, 0]]), " "))
    first = write(tmp_path, lines("t;x;y;z;Q_W;Q_X;Q_Y;Q_Z", cells(TIMES, POSITIONS, ATTITUDES), ";"), "first.csv")
    for file in (last, first):
        np.testing.assert_allclose(read_track(file).attitudes, ATTITUDES, atol=PRINTED)


def test_a_table_without_header(tmp_path):
    file = write(tmp_path, ["# by us", *lines("", cells(TIMES, POSITIONS), ";")[1:]])
    with pytest.raises(ValueError, match=r'line 2: expected a header row .*0\.0.*columns=\{"time": "1"'):
        read_track(file)
    check(read_track(file, {"time": "1", "position": ["2", "3", "4"]}), velocities=None)


def test_unknown_columns_are_listed_with_their_first_values(tmp_path):
    file = write(tmp_path, lines("t,a,b,c", [["0", "1.5", "2", "3"]] * 5))
    with pytest.raises(ValueError, match=r"no columns for the position.* are t = 0, a = 1\.5, b = 2, c = 3\.$"):
        read_track(file)


def test_the_facts_state_what_was_read(tmp_path):
    rows = cells(1e3 * TIMES, POSITIONS, 3.6 * VELOCITIES, TIMES)
    file = write(tmp_path, lines("t_ms,x,y,z,vx [km/h],vy [km/h],vz [km/h],battery", rows))
    assert read_recording(file).facts == (
        "time: column 1 't_ms', ms",
        "position: x, y, z, m, as x, y, z with z up",
        "velocity: vx [km/h], vy [km/h], vz [km/h], km/h, as x, y, z with z up",
        "rows: 12; left out: battery",
    )


def test_a_scenario_has_the_same_keys(tmp_path):
    file = write(tmp_path, lines("t,x,y,z", cells(1e3 * TIMES, POSITIONS @ NED.T)))
    part = TrackPart(file=file.name, units={"time": "ms"}, axes="ned")
    check(part.read(lambda name: tmp_path / name).track, velocities=None)
