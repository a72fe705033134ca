"""Recognise files of formats that are not read, and say how to convert them."""

import re

START = 4096
"""Number of bytes at the start of a file among which an XML element is sought."""

TABLE = "write the times and positions to a CSV file"
_TOOL = "export the recording as CSV with the program that wrote it"

_SIGNATURES = (
    (b"\x93NUMPY", "a NumPy array", f"{TABLE} with numpy.savetxt, or pass the arrays to qtraj.Track"),
    (b"PK\x03\x04", "a ZIP archive, such as an Excel workbook, a KMZ or a NumPy .npz file", TABLE),
    (b"\xd0\xcf\x11\xe0", "an Excel workbook", "save the table as CSV"),
    (b"PAR1", "a Parquet file", "pass the data frame of pandas.read_parquet to qtraj.read_track, or write it as CSV"),
    (b"ARROW1", "an Arrow file", "pass the data frame of pandas.read_feather to qtraj.read_track, or write it as CSV"),
    (b"\x89HDF", "an HDF5 or netCDF file", "pass the dataset of xarray.open_dataset to qtraj.read_track"),
    (b"CDF\x01", "a netCDF file", "pass the dataset of xarray.open_dataset to qtraj.read_track"),
    (b"CDF\x02", "a netCDF file", "pass the dataset of xarray.open_dataset to qtraj.read_track"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file", "write a table in MATLAB with writetable"),
    (
        b"ULog\x01\x12\x35",
        "a PX4 log (ULog)",
        "convert it with ulog2csv, and read vehicle_local_position or a GPS topic",
    ),
    (b"#ROSBAG", "a ROS bag", "write a topic to a CSV file, for example with rostopic echo -p"),
    (b"SQLite format 3", "a database, such as a ROS 2 bag", _TOOL),
    (b"\x89MCAP", "an MCAP recording", _TOOL),
    (b"\xa3\x95\x80\x80", "an ArduPilot log", "convert it with mavlogdump.py --format csv --types GPS"),
)
"""The first bytes of files, the name of the format, and what to do."""

_ELEMENTS = (
    (b"kml", "a KML file", "export the track as GPX; paths in KML have no times"),
    (b"TrainingCenterDatabase", "a TCX file", "export the activity as GPX"),
    (b"", "an XML file, but not GPX", "export the recording as GPX or CSV"),
)

_JSON = re.compile(rb"\s*(\{\s*\"|\[\s*(\{\s*\"|\[\s*[-\d\"]))")
_XML = re.compile(rb"\s*<(\?xml|!|kml|TrainingCenterDatabase|html|svg|osm)")


def other_format(data: bytes) -> tuple[str, str] | None:
    """Return the format of a file that is no table, TOML or GPX file, and what to do with it; otherwise None."""
    if data[8:12] == b".FIT":
        return "a FIT file", "export the activity as GPX"
    for start, name, remedy in _SIGNATURES:
        if data.startswith(start):
            return name, remedy
    head = data[:START].removeprefix(b"\xef\xbb\xbf")
    if _XML.match(head):
        return next((name, remedy) for element, name, remedy in _ELEMENTS if not element or b"<" + element in head)
    if _JSON.match(head):
        return "a JSON file", f"{TABLE}, for example with pandas"
    return None


def require_known_format(name: object, data: bytes) -> None:
    """Raise a ValueError for a file of a format that is not read; `name` is the file for the message."""
    if (found := other_format(data)) is not None:
        raise ValueError(f"{name}: {found[0]}, which cannot be read as a recording: {found[1]}")
