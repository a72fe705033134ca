"""Roll, pitch and heading, latitude and longitude: read by an explicit convention, compared with SciPy and mpmath."""

import importlib.resources
import itertools
import re

import mpmath
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.io.track.attitude_angles import BODIES, HEADINGS
from qtraj.io.track.tangent_plane import earth_fixed

AIRCRAFT = qt.AttitudeAngles(sequence="ZYX", heading="north-clockwise", unit="deg", body="forward-right-down")
EXACT = 1e-12
NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])
SEQUENCES = [*map("".join, itertools.permutations("XYZ")), *map("".join, itertools.permutations("xyz"))]
COUNT = 6


def table(tmp_path, header, rows, name="track.csv"):
    file = tmp_path / name
    file.write_text(header + "\n" + "\n".join(",".join(map(repr, map(float, row))) for row in rows) + "\n")
    return file


def random_angles(count=COUNT):
    rng = np.random.default_rng(18)
    return rng.uniform([-180, -89, -180], [180, 89, 360], (count, 3))


def same(quaternions, rotation):
    """Whether quaternions (n, 4), scalar first, equal a SciPy rotation."""
    wxyz = rotation.as_quat(scalar_first=True)
    np.testing.assert_allclose(np.abs(np.sum(np.asarray(quaternions) * wxyz, axis=1)), 1.0, atol=EXACT)


def test_angles_of_aircraft_agree_with_the_textbook(tmp_path):
    """Z-Y-X from north, east, down, written as matrices: body forward, right, down to NED, then to east, north, up."""
    angles = random_angles()
    rows = np.column_stack([np.arange(COUNT), np.zeros((COUNT, 3)), angles])
    track = qt.read_track(table(tmp_path, "t,x,y,z,roll [deg],pitch,heading", rows), angles=AIRCRAFT)
    ned = Rotation.from_euler("ZYX", angles[:, ::-1], degrees=True).as_matrix()
    same(track.attitudes, Rotation.from_matrix(NED_TO_ENU @ ned @ FLU_TO_FRD))


@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("yaw_only", [False, True])
def test_rates_are_converted_with_the_angles(tmp_path, body, yaw_only):
    """Propagating the recorded rates from the first attitude reproduces the recorded attitudes."""
    convention = qt.AttitudeAngles(sequence="ZYX", heading="north-clockwise", unit="deg", body=body)
    t = np.linspace(0, 10, 201)
    sense = 1.0 if body == "forward-right-down" else -1.0  # of the heading, clockwise, about the recorded z axis
    rates = np.stack([0.1 * np.cos(t), 0.2 * np.sin(t), 0.3 + 0.1 * t], axis=1)
    start = Rotation.from_euler("ZYX", [sense * 0.5, 0.1, -0.2])
    attitudes = qt.propagate_samples(t, rates, start.as_quat(scalar_first=True))
    yaw, pitch, roll = np.degrees(qt.rotation.to_euler(attitudes, "ZYX")).T
    rows = np.column_stack([t, np.zeros((len(t), 3)), roll, pitch, sense * yaw, rates])
    columns = {"attitude": ["roll", "pitch", "heading"], "rate": "wz" if yaw_only else ["wx", "wy", "wz"]}
    track = qt.read_track(table(tmp_path, "t,x,y,z,roll,pitch,heading,wx,wy,wz", rows), columns, angles=convention)
    if yaw_only:
        np.testing.assert_allclose(track.rates[:, 0], -sense * rates[:, 2], rtol=1e-12)
        return
    again = qt.propagate_samples(t, track.rates, track.attitudes[0])
    distance = np.abs(np.sum(np.asarray(again) * np.asarray(track.attitudes), axis=1))
    np.testing.assert_allclose(distance, 1.0, atol=1e-9)


def test_angles_named_in_another_order_are_refused(tmp_path):
    rows = np.column_stack([np.arange(COUNT), np.zeros((COUNT, 3)), random_angles()])
    file = table(tmp_path, "t,x,y,z,roll,pitch,yaw", rows)
    with pytest.raises(ValueError, match="names yaw, pitch, roll, but the order must be roll, pitch, heading"):
        qt.read_track(file, {"attitude": ["yaw", "pitch", "roll"]}, angles=AIRCRAFT)
    assert qt.read_track(file, {"attitude": ["roll", "pitch", "yaw"]}, angles=AIRCRAFT).attitudes is not None


@pytest.mark.parametrize("sequence", SEQUENCES)
@pytest.mark.parametrize("heading", HEADINGS)
@pytest.mark.parametrize("body", BODIES)
def test_every_convention_agrees_with_scipy(sequence, heading, body):
    angles = random_angles()
    by_letter = dict(zip("xyz", angles.T, strict=True))
    if (body == "forward-right-down") != (heading == "north-clockwise"):
        by_letter["z"] = -by_letter["z"]
    turned = Rotation.from_euler(sequence, np.stack([by_letter[k] for k in sequence.lower()], axis=1), degrees=True)
    flip = FLU_TO_FRD if body == "forward-right-down" else np.eye(3)
    zero = Rotation.from_euler("z", 90, degrees=True).as_matrix() if heading == "north-clockwise" else np.eye(3)
    convention = qt.AttitudeAngles(sequence=sequence, heading=heading, unit="deg", body=body)
    same(convention.quaternions(angles), Rotation.from_matrix(zero @ flip @ turned.as_matrix() @ flip))
    radians = qt.AttitudeAngles(sequence=sequence, heading=heading, unit="rad", body=body)
    np.testing.assert_allclose(radians.quaternions(np.radians(angles)), convention.quaternions(angles), atol=EXACT)


@pytest.mark.parametrize(("heading", "expected"), [("north-clockwise", [1, 0, 0]), ("x-anticlockwise", [0, 1, 0])])
@pytest.mark.parametrize("body", BODIES)
def test_a_heading_of_ninety_degrees_has_the_right_direction(heading, expected, body):
    q = qt.AttitudeAngles(sequence="ZYX", heading=heading, unit="deg", body=body).quaternions(np.array([[0, 0, 90.0]]))
    np.testing.assert_allclose(qt.quaternion.rotate(q[0], np.array([1.0, 0, 0])), expected, atol=EXACT)
    np.testing.assert_allclose(qt.quaternion.rotate(q[0], np.array([0.0, 0, 1])), [0, 0, 1], atol=EXACT)
    raised = qt.AttitudeAngles(sequence="ZYX", heading=heading, unit="deg", body=body).quaternions(
        np.array([[0, 10.0, 0]])
    )
    nose = qt.quaternion.rotate(raised[0], np.array([1.0, 0, 0]))[2]
    assert float(nose) == pytest.approx(np.sin(np.radians(10.0)) * (1 if body == "forward-right-down" else -1))


def test_angles_without_a_convention_are_refused_with_the_options(tmp_path):
    file = table(tmp_path, "t,x,y,z,roll,pitch,yaw", np.column_stack([np.arange(COUNT), np.zeros((COUNT, 6))]))
    assert qt.read_track(file).attitudes is None
    with pytest.raises(ValueError, match=r"AttitudeAngles\(sequence=.*\[track\.angles\].*'north-clockwise' or 'x-anti"):
        qt.read_track(file, {"attitude": ["roll", "pitch", "yaw"]})
    with pytest.raises(ValueError, match=r"must name 3 columns"):
        qt.read_track(file, {"attitude": ["roll", "pitch"]}, AIRCRAFT)
    without = table(tmp_path, "t,x,y,z", np.column_stack([np.arange(COUNT), np.zeros((COUNT, 3))]), "plain.csv")
    with pytest.raises(ValueError, match=r"no columns for roll, pitch and heading were found"):
        qt.read_track(without, angles=AIRCRAFT)
    radians = table(tmp_path, "t,x,y,z,roll,pitch,yaw [rad]", np.zeros((COUNT, 7)), "radians.csv")
    with pytest.raises(ValueError, match=r"'yaw \[rad\]' is in rad, but the attitude must be in deg"):
        qt.read_track(radians, angles=AIRCRAFT)
    with pytest.raises(ValueError, match=r"angles= must be a qtraj\.AttitudeAngles"):
        qt.read_track(file, angles="ZYX")
    tum = tmp_path / "track.tum"
    tum.write_text("\n".join(f"{k} {k} 2 3 0 0 0 1" for k in range(5)))
    with pytest.raises(ValueError, match="this is a TUM trajectory"):
        qt.read_track(tum, angles=AIRCRAFT)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("sequence", "ZYZ", "must be x, y and z in any order"),
        ("sequence", "ZyX", "all upper or all lower case"),
        ("heading", "north", "'north-clockwise' or 'x-anticlockwise'"),
        ("unit", "degrees", "'deg' or 'rad'"),
        ("body", "frd", "'forward-right-down' or 'forward-left-up'"),
    ],
)
def test_an_invalid_convention_is_explained(name, value, words):
    options = {"sequence": "ZYX", "heading": "north-clockwise", "unit": "deg", "body": "forward-left-up", name: value}
    with pytest.raises(ValueError, match=words):
        qt.AttitudeAngles(**options)
    with pytest.raises(TypeError):
        qt.AttitudeAngles(sequence="ZYX")


def precise(latitude, longitude, height):
    """Earth-fixed coordinates with 40 digits."""
    with mpmath.workdps(40):
        a, f = mpmath.mpf(6378137), 1 / mpmath.mpf("298.257223563")
        e2, p, q = f * (2 - f), mpmath.radians(mpmath.mpf(latitude)), mpmath.radians(mpmath.mpf(longitude))
        n = a / mpmath.sqrt(1 - e2 * mpmath.sin(p) ** 2)
        level = (n + height) * mpmath.cos(p)
        return [level * mpmath.cos(q), level * mpmath.sin(q), (n * (1 - e2) + height) * mpmath.sin(p)]


def test_earth_fixed_positions_agree_with_the_ellipsoid():
    rng = np.random.default_rng(3)
    places = rng.uniform([-90, -180, -100], [90, 180, 9000], (20, 3))
    places = np.concatenate([places, [[0, 0, 0], [90, 0, 0], [-90, 33, 0], [0, 180, 0]]])
    expected = np.array([[float(x) for x in precise(*place)] for place in places])
    np.testing.assert_allclose(earth_fixed(places), expected, atol=3e-9)
    assert earth_fixed(np.array([[90.0, 0, 0]]))[0, 2] == pytest.approx(6356752.314245, abs=1e-6)  # the semi-minor axis


@pytest.mark.filterwarnings("ignore:the (median|recorded)")
def test_a_drive_on_the_globe_becomes_metres(tmp_path):
    """East, north and up with 40-digit arithmetic; lengths are kept; velocities rotate with the local axes."""
    places = np.array([[43.78, -79.47, 150.0], [43.79, -79.47, 150.0], [43.78, -79.40, 150.0], [44.5, -79.0, 900.0]])
    speeds = np.array([[3.0, 4.0, 0.5]] * 4)
    angles = np.array([[1.0, 2.0, 30.0]] * 4)
    file = table(
        tmp_path, "t,lat,lon,alt [m],ve,vn,vu,roll,pitch,heading", np.column_stack([range(4), places, speeds, angles])
    )
    track = qt.read_track(file, angles=AIRCRAFT, projection="tangent-plane")
    with mpmath.workdps(40):
        fixed = [mpmath.matrix(precise(*place)) for place in places]
        p, q = mpmath.radians(mpmath.mpf(43.78)), mpmath.radians(mpmath.mpf(-79.47))
        s, c, sl, cl = mpmath.sin(p), mpmath.cos(p), mpmath.sin(q), mpmath.cos(q)
        axes = mpmath.matrix([[-sl, cl, 0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
        expected = [[float(x) for x in axes * (one - fixed[0])] for one in fixed]
    np.testing.assert_allclose(track.positions, expected, atol=5e-9)
    np.testing.assert_allclose(np.linalg.norm(track.velocities, axis=1), np.linalg.norm(speeds[0]))
    np.testing.assert_allclose(track.velocities[0], speeds[0], rtol=1e-15 * 4)
    # The angle of the forward axis to the velocity is unchanged, as both rotate with the local axes: here 0.6 degrees.
    forward = np.array([qt.quaternion.rotate(q, np.array([1.0, 0, 0])) for q in track.attitudes])
    np.testing.assert_allclose(np.sum(forward * np.asarray(track.velocities), axis=1), forward[0] @ speeds[0])
    assert np.degrees(np.arccos(forward[3] @ forward[0])) == pytest.approx(0.8, abs=0.2)
    other = qt.read_track(file, projection=qt.TangentPlane((43.78, -79.47, 100.0)))
    np.testing.assert_allclose(other.positions[0], [0, 0, 50.0], atol=1e-8)


def test_invalid_places_on_the_globe_are_refused(tmp_path):
    rows = np.column_stack([range(4), np.full(4, -79.0), np.full(4, 43.0), np.zeros(4)])
    file = table(tmp_path, "t,longitude,latitude,altitude", rows)
    only = table(tmp_path, "t,longitude,altitude", rows[:, [0, 1, 3]], "only.csv")
    with pytest.raises(ValueError, match=r"position are incomplete.*projection='tangent-plane'.*TangentPlane"):
        qt.read_track(only)
    with pytest.raises(ValueError, match=r"'longitude' seems to contain geographic.*projection='tangent-plane'"):
        qt.read_track(file, {"position": ["longitude", "latitude", "altitude"]})
    assert qt.read_track(file, projection="tangent-plane").positions.shape == (4, 3)
    np.testing.assert_array_equal(
        qt.read_track(file).positions, qt.read_track(file, projection="tangent-plane").positions
    )
    with pytest.raises(ValueError, match="the latitude must come first"):
        qt.read_track(file, {"position": ["longitude", "latitude", "altitude"]}, projection="tangent-plane")
    swapped = table(tmp_path, "t,lat,lon,alt", rows - [0, 40, 0, 0], "swapped.csv")
    with pytest.raises(ValueError, match=re.escape(str(swapped)) + r".*has latitude -119° .*within ±90°"):
        qt.read_track(swapped, projection="tangent-plane")
    plain = table(tmp_path, "t,x,y,z", rows, "plain.csv")
    with pytest.raises(ValueError, match="no columns for latitude, longitude and height were found"):
        qt.read_track(plain, projection="tangent-plane")
    with pytest.raises(ValueError, match=r"must be 'tangent-plane' or a qtraj\.TangentPlane"):
        qt.read_track(file, projection="utm")
    with pytest.raises(ValueError, match=r"the origin of a tangent plane must be \[latitude"):
        qt.TangentPlane((1.0, 2.0))
    with pytest.raises(ValueError, match="within ±90°"):
        qt.TangentPlane((100.0, 2.0, 0.0))


def test_a_real_recording_reveals_its_convention():
    """In the bundled turn only headings clockwise from north follow the car; the lidar is mounted to the left."""
    resource = importlib.resources.files("qtraj.io") / "data" / "boreas_right_angle.csv"
    found = {}
    for heading in HEADINGS:
        convention = qt.AttitudeAngles(sequence="ZYX", heading=heading, unit="rad", body="forward-right-down")
        with importlib.resources.as_file(resource) as file:
            found[heading] = qt.fit(qt.read_track(file, angles=convention)).attitude
    assert np.degrees(found["north-clockwise"].rms) < 4.5
    assert np.degrees(found["x-anticlockwise"].rms) > 60
    yaw, pitch, roll = np.degrees(qt.rotation.to_euler(found["north-clockwise"].mounting, "ZYX"))
    assert 40 < yaw < 50
    assert max(abs(pitch), abs(roll)) < 3
