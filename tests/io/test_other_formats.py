"""Files of formats that are not read are refused by name, in a short message, with a way to convert them."""

import io

import numpy as np
import pandas as pd
import pytest

import qtraj as qt

TIMES = np.arange(50.0)
FRAME = pd.DataFrame({"t": TIMES, "x": 3 * TIMES, "y": TIMES**2, "z": 0 * TIMES})

MAX_LENGTH = 300
"""Maximum number of characters of a message about a file of another format, without the name of the file."""


def saved(save):
    buffer = io.BytesIO()
    save(buffer)
    return buffer.getvalue()


FILES = {
    "a JSON file": (FRAME.to_json(orient="records").encode(), "write the times and positions to a CSV file"),
    "a JSON": (FRAME.to_json(orient="records", lines=True).encode(), "CSV"),
    "a KML file": (b'<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"></kml>', "as GPX"),
    "a TCX file": (b'<?xml version="1.0"?>\n<TrainingCenterDatabase/>', "as GPX"),
    "an XML file, but not GPX": (b"\xef\xbb\xbf<?xml version='1.0'?><log/>", "as GPX or CSV"),
    "a NumPy array": (saved(lambda f: np.save(f, FRAME.to_numpy())), "numpy.savetxt"),
    "a ZIP archive": (saved(lambda f: np.savez(f, t=TIMES)), "CSV"),
    "a Parquet file": (b"PAR1....", "read_parquet"),
    "an HDF5 or netCDF file": (b"\x89HDF\r\n\x1a\n....", "xarray.open_dataset"),
    "a FIT file": (b"\x0e\x20\x00\x00\x00\x00\x00\x00.FIT\x00", "as GPX"),
    "a PX4 log": (b"ULog\x01\x12\x35\x01....", "ulog2csv"),
    "a ROS bag": (b"#ROSBAG V2.0\n....", "rostopic echo"),
}


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_format_is_named(tmp_path, name):
    data, remedy = FILES[name]
    file = tmp_path / "recording.dat"
    file.write_bytes(data)
    with pytest.raises(ValueError, match=f"recording.dat: {name}.*cannot be read as a recording: .*{remedy}") as caught:
        qt.read_track(file)
    assert len(str(caught.value)) < MAX_LENGTH + len(str(file))


def test_a_message_about_a_wide_table_is_short(tmp_path):
    file = tmp_path / "wide.csv"
    names = [f"channel {k} {'of the long name ' * 5}" for k in range(400)]
    file.write_text("\n".join([",".join(names), *[",".join(["1.5"] * 400)] * 9]))
    with pytest.raises(ValueError, match=r"no columns for the time were found.*, …; name the columns") as caught:
        qt.read_track(file)
    assert len(str(caught.value)) < 3500


def test_rows_that_are_all_comments(tmp_path):
    """A receiver that begins each row with #."""
    file = tmp_path / "a.txt"
    file.write_text("#BESTPOSA,1,2,3\n" * 5)
    with pytest.raises(ValueError, match=r"all lines are comments.*remove these marks"):
        qt.read_track(file)
