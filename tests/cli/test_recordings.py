"""Recordings with attitudes or on the globe, as scenarios name them."""

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt

NED_TO_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])


def table(tmp_path, header, rows, name="track.csv"):
    file = tmp_path / name
    file.write_text(header + "\n" + "\n".join(",".join(map(repr, map(float, row))) for row in rows) + "\n")


def test_the_commands_read_and_report_attitudes(qtraj, tmp_path):
    """A scenario names the convention; terminal, JSON and report say how the recorder is mounted."""
    helix = qt.SpiralHelix([20.0], [0.0, 0.4], [1.0, 0.3], 4.0)
    times = np.linspace(0, 4, 41)
    program, mounting = qt.FrameProgram(helix, qt.Upright()), Rotation.from_euler("ZYX", [10, -4, 2], degrees=True)
    flat = Rotation.from_quat([program(t).quaternion for t in times], scalar_first=True) * mounting
    ned = Rotation.from_matrix(NED_TO_ENU.T @ flat.as_matrix() @ FLU_TO_FRD)
    positions = np.array([helix.position(t) for t in times])
    rows = np.column_stack([times, positions, ned.as_euler("ZYX", degrees=True)[:, ::-1]])
    table(tmp_path, "t,x,y,z,roll,pitch,heading", rows)
    text = (
        "[track]\nfile = 'track.csv'\n[track.angles]\nsequence = 'ZYX'\nheading = 'north-clockwise'\nunit = 'deg'\n"
        "body = 'forward-right-down'\n[limits]\ncurvature = 0.06\n"
    )
    (tmp_path / "s.toml").write_text(text)
    result = qtraj("evaluate", tmp_path / "s.toml", "--samples", 3, "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    assert "yaw 10.00°, pitch -4.00° (nose up), roll 2.00° (Z-Y-X)" in result.stdout
    assert all(len(line) <= 80 for line in result.stdout.splitlines() if "s.toml" not in line and "table." not in line)
    fit = json.loads(qtraj("evaluate", tmp_path / "s.toml", "--samples", 3, "--json").stdout)["fit"]
    assert np.degrees(fit["mounting_yaw"]) == pytest.approx(10.0, abs=1e-2)
    assert np.degrees(fit["attitude_rms"]) < 1e-2
    (tmp_path / "s.toml").write_text(text.replace("unit = 'deg'\n", ""))
    refused = qtraj("evaluate", tmp_path / "s.toml")
    assert refused.exit_code == 2
    assert "track.angles" in refused.stderr
    assert "unit" in refused.stderr


def test_a_scenario_reads_latitudes_and_longitudes(qtraj, tmp_path):
    """A circle of 30 m on the globe is fitted as such, with a projection or by the column names."""
    t = np.linspace(0.0, 5.0, 51)
    degrees = np.degrees(1 / 6371000.0)
    rows = np.column_stack([t, 10.0 + 30 * np.sin(0.3 * t) * degrees, 20.0 + 30 * np.cos(0.3 * t) * degrees, 0 * t])
    table(tmp_path, "t,lat,lon,height", rows)
    text = "[track]\nfile = 'track.csv'\nprojection = 'tangent-plane'\n[limits]\ncurvature = 0.06\n"
    (tmp_path / "s.toml").write_text(text)
    fit = json.loads(qtraj("evaluate", tmp_path / "s.toml", "--samples", 3, "--json").stdout)["fit"]
    assert fit["successful"]
    assert fit["radius_max"] == pytest.approx(30.0, rel=0.05)  # degrees of longitude are 1.5 % shorter here
    (tmp_path / "s.toml").write_text(text.replace("projection = 'tangent-plane'\n", ""))
    by_names = json.loads(qtraj("evaluate", tmp_path / "s.toml", "--samples", 3, "--json").stdout)["fit"]
    assert by_names["radius_max"] == fit["radius_max"]
    (tmp_path / "s.toml").write_text(text.replace("projection = 'tangent-plane'", "origin = [1, 2, 3]"))
    assert "is valid only with projection" in qtraj("evaluate", tmp_path / "s.toml").stderr


def test_the_mounting_of_a_recorder_is_named(qtraj, tmp_path):
    """A camera that looks to the left and slightly up, on an S-shaped drive, with noise of 2° about each axis."""
    t = np.linspace(0, 20, 401)
    positions = np.stack([8 * t, 20 * np.sin(0.3 * t), 0 * t], axis=1)
    heading = np.arctan2(6 * np.cos(0.3 * t), 8)
    noise = Rotation.from_rotvec(np.radians(2) * np.random.default_rng(1).normal(size=(401, 3)))
    mounted = Rotation.from_euler("Z", heading[:, None]) * Rotation.from_euler("ZYX", [92.1, -3, 0], degrees=True)
    rows = np.column_stack([t, positions, (mounted * noise).as_quat(scalar_first=True)])
    table(tmp_path, "t,x,y,z,qw,qx,qy,qz", rows)
    result = qtraj("route", tmp_path / "track.csv", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    text = " ".join(result.stdout.split())
    found = re.search(
        r"mounted at yaw ([\d.]+)°, pitch ([-\d.]+)° \(nose up\), roll ([-\d.]+)°; beyond that ([\d.]+)° RMS", text
    )
    assert found is not None, text
    np.testing.assert_allclose([float(x) for x in found.groups()], [92.1, -3, 0, 2 * np.sqrt(3)], atol=0.4)


def test_named_columns_are_geographic_by_their_unit(qtraj, tmp_path):
    t = np.linspace(0.0, 20.0, 41)
    table(tmp_path, "Time,INS_Lat,INS_Long,INS_Height", np.column_stack([t, 48 + 1e-4 * t, 11 + 0 * t, 500 + 0 * t]))
    names = "position=INS_Lat,INS_Long,INS_Height"
    command = ("route", tmp_path / "track.csv", "--columns", names, "--out", tmp_path / "out", "--quiet")
    refused = qtraj(*command)
    assert refused.exit_code == 2
    assert "--units position=deg" in " ".join(refused.stderr.split())
    result = qtraj(*command, "--units", "position=deg")
    assert result.exit_code == 0, result.output
    assert re.search(r"length\s+222\.\d m in 20 s", result.stdout), result.stdout


def test_a_vehicle_that_never_moves_is_a_stop(qtraj, tmp_path):
    t = np.arange(0.0, 60.0, 0.1)
    table(tmp_path, "t,x,y,z", np.column_stack([t, *(0 * t + k for k in (3, 4, 5))]))
    result = qtraj("route", tmp_path / "track.csv", "--out", tmp_path / "out", "--quiet")
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    assert "the vehicle never moves" in result.stdout
    assert re.search(r"stops\s+1, 59.9 s in total", result.stdout), result.stdout


def test_a_file_of_another_format_is_refused_by_name(qtraj, tmp_path):
    file = tmp_path / "path.kml"
    file.write_text('<?xml version="1.0"?><kml><coordinates>11.5,48.1,500 11.6,48.2,500</coordinates></kml>')
    refused = qtraj("route", file)
    assert refused.exit_code == 2
    assert "a KML file, which cannot be read as a recording: export the track as GPX" in " ".join(
        refused.stderr.split()
    )


@pytest.mark.parametrize(
    ("header", "row", "encoding"),
    [
        ("time,lat,lon", "{t},{lat:.8f},11", "utf-8"),
        ("time,x,y,z\n[ms],[cm],[cm],[cm]", "{ms},{cm},0,0", "utf-8"),
        ("valid;time;x;y;z;note", "TRUE;{t};{m};0;0;battery=90", "utf-8"),
        ("t\tx\ty\tz", "{t}\t{m}\t0\t0", "utf-16"),
    ],
)
def test_a_recording_is_recognised_whatever_its_suffix(qtraj, tmp_path, header, row, encoding):
    """By its header, also if it has three columns, units in brackets or an equals sign, or is in UTF-16."""
    degrees = np.degrees(1 / 6367000.0)  # of latitude in a metre, at 48°
    rows = [row.format(t=t, ms=1000 * t, m=8 * t, cm=800 * t, lat=48 + 8 * t * degrees) for t in range(20)]
    (tmp_path / "log.dat").write_text("\n".join([header, *rows]), encoding=encoding)
    result = qtraj("route", tmp_path / "log.dat", "--out", tmp_path / "out", "--quiet")
    assert result.exit_code == 0, result.output
    assert re.search(r"length +15[12]\.?\d* m in 19 s", result.stdout), result.stdout
