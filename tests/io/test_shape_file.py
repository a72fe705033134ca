"""Shapes in files: tables with and without headers, race tracks with widths, GeoJSON, GPX, and files that are wrong."""

import gzip
import json

import numpy as np
import pandas as pd
import pytest
from tests.io.test_gpx import COUNT, HEIGHT, LATITUDE, LONGITUDE, gpx, point, track
from tests.race_track import race_track, write_race_track

import qtraj as qt

POINTS = np.stack([np.arange(30.0), 5 * np.sin(np.arange(30) / 8), 0.1 * np.arange(30)], axis=1)


def written(tmp_path, text, name="line.csv"):
    file = tmp_path / name
    file.write_text(text)
    return file


def table(header, columns, delimiter=","):
    rows = [delimiter.join(f"{x:.9g}" for x in row) for row in np.asarray(columns)]
    return "\n".join([*([header] if header else []), *rows]) + "\n"


def test_race_track_has_widths_and_is_closed(tmp_path):
    points, widths = race_track()
    shape = qt.read_shape(write_race_track(tmp_path / "track.csv"))
    assert shape.closed
    np.testing.assert_allclose(shape.points[:-1, :2], points, atol=1e-6)
    np.testing.assert_allclose(shape.widths[:-1], widths, atol=1e-6)
    assert float(shape.length) == pytest.approx(2300.0, abs=0.5)


@pytest.mark.parametrize(
    ("text", "spatial"),
    [
        (table("x,y,z", POINTS), True),
        (table("x;y;z", POINTS, ";"), True),
        (table("# x_m y_m z_m", POINTS, " "), True),
        (table("x_m,y_m", POINTS[:, :2]), False),
        (table("", POINTS), True),
        (table("", POINTS[:, :2], " "), False),
        (table("easting,northing,elevation", POINTS), True),
        (table("x_cm,y_cm", 100 * POINTS[:, :2]), False),
        (table("time,x,y,z", np.column_stack([np.arange(30), POINTS])), True),
        (table("id,x,y,z,name", np.column_stack([np.arange(30), POINTS, np.ones(30)])), True),
        (table("north,east,down", POINTS[:, [1, 0, 2]] * [1, 1, -1]), True),
    ],
)
def test_tables(tmp_path, text, spatial):
    shape = qt.read_shape(written(tmp_path, text, "line.txt"))
    assert not shape.closed
    assert shape.widths is None
    np.testing.assert_allclose(shape.points, POINTS * ([1, 1, 1] if spatial else [1, 1, 0]), atol=1e-6)


def test_named_columns_widths_and_options(tmp_path):
    columns = np.column_stack([POINTS[:, :2], 400 + 0 * POINTS[:, :1], 300 + 0 * POINTS[:, :1]])
    file = written(tmp_path, table("a,b,r_cm,l_cm", columns))
    shape = qt.read_shape(file, columns={"position": ["a", "b"], "widths": ["r_cm", "l_cm"]}, units={"position": "km"})
    np.testing.assert_allclose(shape.points[:, :2], 1000 * POINTS[:, :2], atol=1e-6)
    np.testing.assert_allclose(shape.widths, np.tile([4.0, 3.0], (30, 1)))
    smooth = qt.read_shape(file, columns={"position": ["a", "b"]}, tolerance=0.5, closed=False)
    assert smooth.route.segments < 29


def test_frame_and_compressed_file(tmp_path):
    frame = pd.DataFrame({"x": POINTS[:, 0], "y": POINTS[:, 1]})
    np.testing.assert_allclose(qt.read_shape(frame).points[:, :2], POINTS[:, :2], atol=1e-9)
    file = tmp_path / "line.csv.gz"
    file.write_bytes(gzip.compress(table("x,y,z", POINTS).encode()))
    np.testing.assert_allclose(qt.read_shape(file).points, POINTS, atol=1e-6)


def geojson(tmp_path, value, name="road.geojson"):
    return written(tmp_path, json.dumps(value), name)


LINE = {"type": "LineString", "coordinates": np.stack([LONGITUDE, LATITUDE, HEIGHT], axis=1).tolist()}
FEATURE = {"type": "Feature", "properties": {"name": "road"}, "geometry": LINE}


def expected():
    """The positions of the generated line in the tangent plane."""
    return qt.TangentPlane().project(np.stack([LATITUDE, LONGITUDE, HEIGHT], axis=1))[0]


@pytest.mark.parametrize(
    "value",
    [
        LINE,
        FEATURE,
        {"type": "FeatureCollection", "features": [FEATURE]},
        {"type": "GeometryCollection", "geometries": [{"type": "Point", "coordinates": [9.0, 47.0]}, LINE]},
        {"type": "MultiLineString", "coordinates": [LINE["coordinates"]]},
    ],
    ids=lambda value: value["type"],
)
def test_geojson_is_projected(tmp_path, value):
    shape = qt.read_shape(geojson(tmp_path, value))
    np.testing.assert_allclose(shape.points, expected(), atol=1e-6)
    again = qt.read_shape(geojson(tmp_path, value, "road.json"), projection=qt.TangentPlane((47.0, 9.0, 500.0)))
    np.testing.assert_allclose(np.diff(again.points, axis=0), np.diff(expected(), axis=0), atol=1e-3)


def test_several_lines_need_a_choice(tmp_path):
    two = {"type": "MultiLineString", "coordinates": [LINE["coordinates"][:20], LINE["coordinates"][20:]]}
    file = geojson(tmp_path, two)
    with pytest.raises(ValueError, match=r"2 lines.*segment="):
        qt.read_shape(file)
    assert qt.read_shape(file, segment=2).route.segments == COUNT - 21
    with pytest.raises(ValueError, match="segment=3"):
        qt.read_shape(file, segment=3)


@pytest.mark.parametrize("kind", ["track", "route", "waypoints", "timed"])
def test_gpx_without_times_is_a_shape(tmp_path, kind):
    name = {"track": "trkpt", "route": "rtept", "waypoints": "wpt", "timed": "trkpt"}[kind]
    points = [point(k, name=name, time=kind == "timed") for k in range(COUNT)]
    body = {"route": "<rte>" + "".join(points) + "</rte>", "waypoints": "".join(points)}.get(kind, track(points))
    shape = qt.read_shape(gpx(tmp_path, body))
    np.testing.assert_allclose(shape.points, expected(), atol=2e-3)  # nine decimals of a degree, and two of a metre
    assert not shape.closed


def test_messages_about_points_without_times_name_read_shape(tmp_path):
    untimed = gpx(tmp_path, track([point(k, time=False) for k in range(COUNT)]))
    with pytest.raises(ValueError, match=r"no times.*qtraj\.read_shape.*qtraj retime"):
        qt.read_track(untimed)
    places = gpx(tmp_path, "".join(point(k, name="wpt", time=False) for k in range(COUNT)))
    with pytest.raises(ValueError, match=r"waypoints.*qtraj\.read_shape"):
        qt.read_track(places)
    with pytest.raises(ValueError, match=r"qtraj\.read_shape"):
        qt.read_track(write_race_track(tmp_path / "track.csv"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("x,y\n1,2\n", "two different points"),
        ("x,y\n0,0\n1,abc\n2,0\n", "line 3: column 'y'"),
        ("x,y\n0,0\n1,\n2,0\n", "line 3: the cell of column 'y' is missing"),
        ("x,y\n0,0\n1,nan\n2,0\n", "line 3"),
        ("x,y\n0,0\n1,2,3\n2,0\n", "line 3: the row has 3 cells"),
        ("a,b,c\n1,2,3\n4,5,7\n", "no columns for the position.*a, b, c"),
        ("1,2,3,4\n4,5,7,8\n", "header"),
        ("x,y\n0,0\n1,0\n0.5,0\n", "cusp"),
        ("lat,lon\n95,0\n96,0\n97,1\n", "latitude"),
        ('{"type": "Polygon", "coordinates": []}', "LineString"),
        ('{"type": "LineString", "coordinates": [[1, 2], [3]]}', "line 1 must be a list"),
        ('{"type": "LineString", "coordinates": "x"}', "line 1 must be a list"),
        ('{"type": "LineString", "coordinates": [[1, NaN], [3, 4]]}', "finite"),
        ('{"type": "LineString", "coordinates": [[1, 2], [3, 4]], "crs": "EPSG:25832"}', "EPSG:4326"),
        ('{"type": "LineString", "coordinates": ' + "[" * 100, "not valid GeoJSON"),
        ('{"type": "FeatureCollection", "features": 3}', "none"),
    ],
)
def test_wrong_files_are_refused_by_name(tmp_path, text, message):
    file = written(tmp_path, text)
    with pytest.raises(ValueError, match=message) as error:
        qt.read_shape(file)
    assert "line.csv" in str(error.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"columns": {"position": ["x", "q"]}}, "no column 'q'"),
        ({"columns": {"velocity": ["x", "y"]}}, "position and widths"),
        ({"columns": {"widths": ["x"]}}, "2 columns"),
        ({"axes": "left"}, "axes="),
        ({"units": {"position": "kg"}}, "units"),
        ({"projection": "mercator"}, "projection="),
        ({"segment": 0}, "segment="),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    file = written(tmp_path, table("x,y", POINTS[:, :2]))
    with pytest.raises(ValueError, match=message):
        qt.read_shape(file, **options)


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.csv"):
        qt.read_shape(tmp_path / "nowhere.csv")
    with pytest.raises(ValueError, match="file must be"):
        qt.read_shape(3)


def test_flipped_bits_raise_one_error_with_the_file_name(tmp_path):
    rng = np.random.default_rng(5)
    contents = [
        write_race_track(tmp_path / "a.csv", count=40).read_bytes(),
        geojson(tmp_path, FEATURE).read_bytes(),
        gpx(tmp_path, track([point(k, time=False) for k in range(COUNT)])).read_bytes(),
    ]
    for content in contents:
        for place in rng.integers(0, 8 * len(content), 60):
            data = bytearray(content)
            data[place // 8] ^= 1 << (place % 8)
            file = tmp_path / "damaged.txt"
            file.write_bytes(data)
            message = ""
            try:
                qt.read_shape(file)
            except ValueError as error:
                message = str(error)
            assert not message or "damaged.txt" in message
