"""Tables with odd rows or names: late decimal commas, too many cells, repeated names; and what is no table."""

import numpy as np
import pandas as pd
import pytest

import qtraj as qt

TIMES = np.arange(12.0)
POSITIONS = np.stack([3 * TIMES, TIMES**2 / 8, 0.5 * TIMES], axis=1)


def table(tmp_path, lines):
    file = tmp_path / "log.csv"
    file.write_text("\n".join(lines))
    return file


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
@pytest.mark.parametrize("whole", [1, 9])
def test_a_decimal_comma_after_rows_of_whole_numbers(tmp_path, delimiter, whole):
    rows = [f"{t:g};{x:g};{y:.6f};{z:g}" for t, (x, y, z) in zip(TIMES, POSITIONS, strict=True)]
    rows[:whole] = [f"{t:g};{3 * t:g};0;0" for t in TIMES[:whole]]
    file = table(tmp_path, [row.replace(".", ",").replace(";", delimiter) for row in ["t;x;y;z", *rows]])
    np.testing.assert_allclose(qt.read_track(file).positions[whole:], POSITIONS[whole:], atol=1e-6)


def test_a_separator_of_thousands_is_not_a_decimal_comma(tmp_path):
    rows = [f"{t:.1f};1,{x:03.0f};{y};0" for t, (x, y, _) in zip(TIMES, POSITIONS, strict=True)]
    with pytest.raises(ValueError, match="line 2: column 'x' must have finite numbers, but contains '1,000'"):
        qt.read_track(table(tmp_path, ["t;x;y;z", *rows]))


def test_a_row_with_more_cells_is_found_beside_a_row_with_fewer(tmp_path):
    """The number of commas in the file is that of a whole table."""
    rows = [f"{t},{x},{y},{z},1" for t, (x, y, z) in zip(TIMES, POSITIONS, strict=True)]
    rows[3], rows[4] = f"0,{rows[3]}", rows[4].removesuffix(",1")
    with pytest.raises(ValueError, match="line 5: the row has 6 cells, but there are 5 columns"):
        qt.read_track(table(tmp_path, ["t,x,y,z,count", *rows]))


def test_repeated_names_in_a_text_file(tmp_path):
    """They matter only for columns that are read."""
    rows = [f"{t},{x},{y},{z},7" for t, (x, y, z) in zip(TIMES, POSITIONS, strict=True)]
    with pytest.raises(ValueError, match=r"log\.csv: 2 columns have the name 'x': rename"):
        qt.read_track(table(tmp_path, ["t,x,y,z,x", *rows]))
    rows = [f"{row},8" for row in rows]
    assert len(qt.read_track(table(tmp_path, ["t,x,y,z,status,status", *rows])).times) == len(TIMES)


def test_repeated_names_in_a_data_frame():
    frame = pd.DataFrame(np.column_stack([TIMES, POSITIONS, TIMES]), columns=["t", "x", "y", "z", "x"])
    with pytest.raises(ValueError, match="the table has several columns with the name 'x'"):
        qt.read_track(frame)
    frame = frame.iloc[:, :4].set_axis(["t", "x", "y", "z"], axis=1)
    assert len(qt.read_track(frame).times) == len(TIMES)


@pytest.mark.parametrize("file", [None, "", 3, [1, 2], {"t": 1}, POSITIONS, pd.Series(TIMES)])
def test_what_is_neither_a_file_nor_a_table_is_refused(file):
    with pytest.raises(ValueError, match="file must be the name of a file, a data frame of pandas or polars"):
        qt.read_track(file)
