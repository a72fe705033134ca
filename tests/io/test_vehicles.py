"""Tables with a column that may name the vehicle of each row."""

import numpy as np
import pandas as pd
import pytest

from qtraj.io.track.track_file import read_track

COUNT = 12


def table(tmp_path, name, values):
    file = tmp_path / "log.csv"
    rows = [f"{value},{k},{3 * k},{k * k},0" for k, value in enumerate(values)]
    file.write_text("\n".join([f"{name},t,x,y,z", *rows]))
    return file


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("id", range(COUNT)),
        ("id", [k // 3 for k in range(COUNT)]),
        ("id", [7] * COUNT),
        ("id", [""] * COUNT),
        ("object_id", range(COUNT)),
        ("MMSI", [211] * COUNT),
        ("MMSI", [""] * 4 + [211] * (COUNT - 4)),
        ("mmsi", [211, "211.0"] * (COUNT // 2)),
        ("track_id", [5] * 4 + [""] * 3 + [5] * (COUNT - 7)),
    ],
)
def test_one_vehicle(tmp_path, name, values):
    """Rows or laps are counted, one vehicle is named, or some cells are empty."""
    assert read_track(table(tmp_path, name, values)).times.shape == (COUNT,)


@pytest.mark.parametrize(
    ("name", "values", "count"),
    [
        ("id", [1, 2] * (COUNT // 2), 2),
        ("id", [1] * 4 + [2] * 4 + [1] * 4, 2),
        ("id", [1, "", 2] * (COUNT // 3), 2),
        ("MMSI", [211] * 6 + [212] * 6, 2),
        ("MMSI", range(COUNT), COUNT),
        ("vehicle_id", ["a"] * 6 + ["b"] * 6, 2),
    ],
)
def test_several_vehicles(tmp_path, name, values, count):
    with pytest.raises(ValueError, match=f"the column '{name}' has {count} different values .* remove it"):
        read_track(table(tmp_path, name, values))


def test_missing_names_in_a_data_frame():
    k = np.arange(COUNT)
    frame = pd.DataFrame({"mmsi": np.where(k < 3, np.nan, 211.0), "t": k, "x": 3.0 * k, "y": k**2, "z": 0.0})
    assert read_track(frame).times.shape == (COUNT,)
