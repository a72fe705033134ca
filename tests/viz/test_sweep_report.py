"""The report of a sweep: statuses, extreme values, histograms and failures."""

import re

import numpy as np
import pytest

import qtraj as qt
from qtraj.viz.sweep_report import sweep_page

pytest.importorskip("zarr")


def root(point):
    """The square root, an error at 7 and a constant."""
    if point["x"] == 7:
        raise ValueError("seven <is> refused")
    return {"y": np.sqrt(point["x"]) if point["x"] >= 0 else np.nan, "one": 1.0}


def page_of(folder, **options):
    parameters = {"x": np.arange(-2.0, 18.0)}
    swept = qt.sweep(root, parameters, folder, workers=0, shard=6, **options)
    return swept, sweep_page(swept, "Roots")


def bars(page, name):
    picture = page.split(f"<h2>{name}</h2>")[1].split("</svg>")[0]
    return [int(x) for x in re.findall(r"<title>(\d+)</title>", picture)]


def test_counts_extremes_and_failures(tmp_path):
    swept, page = page_of(tmp_path / "s")
    assert swept.status_counts == {"successful": 17, "not_a_number": 2, "raised_an_error": 1}
    for status, count in swept.status_counts.items():
        assert f"<td>{status.replace('_', ' ')}</td><td>{count}</td>" in page
    assert f"<td>{np.sqrt(17.0):.6g}</td><td>point 19: x = 17</td>" in page
    assert "seven &lt;is&gt; refused" in page
    with pytest.raises(ValueError, match="there is no output 'z'; the outputs are y, one"):
        next(swept.values_of("z"))
    assert "<h2>one</h2>" not in page  # a constant has no histogram


def test_outputs_that_are_arrays_are_named(tmp_path):
    """They have no row in the table of outputs, and the page says so."""

    def both(point):
        return {"y": point["x"], "v": np.full(3, point["x"])}

    page = sweep_page(qt.sweep(both, {"x": np.arange(4.0)}, tmp_path / "s", workers=0))
    assert "Not shown, because their values are arrays: v." in page
    assert "Not shown" not in page_of(tmp_path / "t")[1]


def test_histograms_count_all_successful_points(tmp_path):
    _, page = page_of(tmp_path / "s")
    found = bars(page, "y")
    expected = np.histogram(np.sqrt([x for x in range(18) if x != 7]), len(found))[0]
    np.testing.assert_array_equal(found, expected)
    _, without_points = page_of(tmp_path / "t", keep=False, histograms={"y": (0.0, 5.0)})
    assert sum(bars(without_points, "y")) == 17
    assert "<h2>y</h2>" not in page_of(tmp_path / "u", keep=False)[1]
