"""`qtraj report`: what it reads, what it writes, what it refuses."""

import json
import re
import shutil

import pytest
import xarray

import qtraj as qt
from qtraj.io.dataset import path_dataset
from qtraj.viz.report import page


@pytest.fixture(scope="module")
def path():
    return qt.SpiralHelix([10.0], [0.2, 0.4], [1.0, 0.5], 5.0, qt.Placement())


@pytest.fixture(scope="module")
def tuned(path):
    """A tuning as it would be stored, its curvature above the limit."""
    found = qt.certify(path, qt.Limits(curvature=0.09))
    ends = path.state(0.0), path.state(path.duration)
    return qt.Tuned(path, *ends, 0.0, found, 1, 3, advice="the limit <b>cannot</b> be met")


@pytest.fixture(scope="module")
def results(path, tuned, tmp_path_factory):
    """A folder as `qtraj tune` leaves it."""
    folder = tmp_path_factory.mktemp("results")
    dataset = path_dataset({"before": path, "after": path}, qt.Limits(curvature=0.09), samples=17)
    qt.save_dataset(dataset, folder / "paths.nc")
    tuned.save(folder / "tuning.toml")
    return folder


def data(file):
    text = file.read_text(encoding="utf-8")
    return json.loads(text.partition('id="data">')[2].partition("</script>")[0])


def test_a_folder_is_reported_with_the_certificate_that_lies_in_it(qtraj, results, tmp_path):
    result = qtraj("report", results, "--json", "--out", tmp_path / "new")
    assert (result.exit_code, result.stderr) == (0, "")
    content = json.loads(result.stdout)
    assert content["files"] == [str(tmp_path / "new" / "report.html")]
    assert content["result"] == str(results / "paths.nc")
    assert [(body["name"], body["instants"], body["duration"]) for body in content["bodies"]] == [
        ("before", 17, 5.0),
        ("after", 17, 5.0),
    ]
    assert {"Limits", "Boundary velocities about the axis of the path"} <= set(content["tables"])
    text = (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    assert '<td class="bad">broken</td>' in text
    assert "Broken: the limit is violated at the time shown" in text
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["report.html"]


def test_boundary_velocities_are_those_before_and_after(qtraj, path, tuned, tmp_path):
    before = qt.SpiralHelix([10.0], [0.2, 0.3], [1.0, 0.2], 6.0, qt.Placement())
    qt.save_dataset(path_dataset({"before": before, "after": path}, samples=17), tmp_path / "paths.nc")
    tuned.save(tmp_path / "tuning.toml")
    assert qtraj("report", tmp_path).exit_code == 0
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    table = text.partition("Boundary velocities about the axis of the path")[2].partition("</table>")[0]
    rows = [re.findall(r"<td[^>]*>([^<]*)", row) for row in re.findall(r"<tr>.*?</tr>", table, flags=re.S)]
    ends = [["before", 3.0, 0.2], ["after", 4.0, 0.5]]
    expected = [[f"{name} {letter}", 10.0, 0.0, about, along] for name, about, along in ends for letter in "AB"]
    found = [[name, *(float(cell.replace("−", "-")) for cell in cells)] for name, *cells in filter(None, rows)]
    assert found == expected


def test_a_recording_is_sent_to_tune(qtraj, tmp_path):
    (tmp_path / "drive.csv").write_text("t,x,y,z\n0,1,2,3\n")
    result = qtraj("report", tmp_path / "drive.csv")
    assert result.exit_code == 2
    assert "write a scenario" in result.stderr
    assert "run `qtraj tune`" in result.stderr


def test_a_certificate_of_another_path_is_not_taken(qtraj, results, path, tmp_path):
    dataset = xarray.load_dataset(results / "paths.nc")
    dataset["duration"] = 2 * dataset["duration"]
    qt.save_dataset(dataset, tmp_path / "paths.nc")
    (tmp_path / "tuning.toml").write_bytes((results / "tuning.toml").read_bytes())
    result = qtraj("report", tmp_path, "--json")
    assert "Boundary velocities about the axis of the path" not in json.loads(result.stdout)["tables"]


@pytest.mark.parametrize("suffix", [".nc", ".zarr", ".parquet", ".csv"])
def test_every_kind_of_dataset_makes_the_same_page(qtraj, results, suffix, tmp_path):
    qt.save_dataset(xarray.load_dataset(results / "paths.nc"), tmp_path / f"mine{suffix}")
    result = qtraj("report", tmp_path / f"mine{suffix}")
    assert result.exit_code == 0
    assert str(tmp_path / "mine.html") in result.stdout.replace("\n", "")
    alone = page.report_page(xarray.load_dataset(results / "paths.nc"))
    assert (tmp_path / "mine.html").read_text(encoding="utf-8") == alone


@pytest.mark.parametrize(
    ("name", "expected"), [("", "report.html"), ("paths.nc", "report.html"), ("tuning.toml", "tuning.html")]
)
def test_a_single_file_leaves_the_page_of_its_folder_alone(qtraj, results, name, expected, tmp_path):
    folder = tmp_path / "results"
    shutil.copytree(results, folder)
    before = {file.name for file in folder.iterdir()}
    assert qtraj("report", folder / name).exit_code == 0
    assert {file.name for file in folder.iterdir()} - before == {expected}


def test_saved_paths_and_tunings_are_reported(qtraj, path, tuned, tmp_path):
    path.save(tmp_path / "mine.json")
    tuned.save(tmp_path / "tuning.toml")
    for name, body, limits in (("mine.json", "path", []), ("tuning.toml", "after", [0.09])):
        result = qtraj("report", tmp_path / name)
        assert result.exit_code == 0, result.stderr
        found = data((tmp_path / name).with_suffix(".html"))
        assert [entry["name"] for entry in found["bodies"]] == [body]
        assert [limit["value"] for panel in found["panels"] for limit in panel["limits"]] == limits
    assert "the limit <b>cannot</b> be met" in " ".join(result.stdout.split())
    assert "&lt;b&gt;cannot&lt;/b&gt;" in (tmp_path / "tuning.html").read_text(encoding="utf-8")


def test_a_turn_is_reported(qtraj, tmp_path):
    assert qtraj("slew", "--samples", 11, "--out", tmp_path).exit_code == 0
    result = qtraj("report", tmp_path)
    assert result.exit_code == 0
    assert "Slew of a spacecraft by 90°" in result.stdout
    found = data(tmp_path / "report.html")
    assert (found["kind"], len(found["bodies"][0]["time"])) == ("attitude", 11)
    limits = {panel["title"]: [limit["value"] for limit in panel["limits"]] for panel in found["panels"]}
    assert limits["angle rate"] == pytest.approx([1.0])  # [°/s]
    assert limits["angle acceleration"] == pytest.approx([0.05, -0.05])
    table = xarray.load_dataset(tmp_path / "table.nc")
    assert (table.attrs["dtype"], table.attrs["versions"].split(",")[0]) == ("float64", f"qtraj {qt.__version__}")


def test_what_is_no_result_is_refused(qtraj, results, path, tmp_path):
    (tmp_path / "two").mkdir()
    for name in ("paths.nc", "table.nc"):
        (tmp_path / "two" / name).write_bytes((results / "paths.nc").read_bytes())
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.nc").write_text("nothing")
    (tmp_path / "a.toml").write_text("[limits]\n")
    (tmp_path / "a.png").write_text("")
    qt.EulerTurn([1.0, 0, 0, 0], [0, 1.0, 0, 0], qt.Quintic(duration=1.0)).save(tmp_path / "turn.toml")
    qt.save_dataset(xarray.Dataset({"x": ("time", [1.0])}, {"time": [0.0]}), tmp_path / "x.nc")
    expected = {
        "nothing": "this file or folder does not exist",
        "two": "contains several results: pass one of",
        "empty": "contains none of the files that qtraj writes",
        "a.nc": "not a netCDF-4 file",
        "a.toml": "not a qtraj document",
        "a.png": "must end in",
        "turn.toml": "a saved path, tuning or retiming was expected, but the file contains an object of type EulerTurn",
        "x.nc": "a report needs position or quaternion over time",
    }
    for name, fragment in expected.items():
        result = qtraj("report", tmp_path / name, "--out", tmp_path / "out")
        assert result.exit_code == 2
        assert result.stdout == ""
        assert fragment in result.stderr, name
        assert str(tmp_path / name) in result.stderr, name
    assert not (tmp_path / "out").exists()


def test_a_missing_plotly_is_told(qtraj, results, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "plotly.offline", None)
    result = qtraj("report", results, "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert "pip install 'qtraj[viz]'" in result.stderr
    assert list(tmp_path.iterdir()) == []


def axes_of_page(file):
    return [arrow["symbol"] for arrow in data(file)["arrows"]]


@pytest.mark.parametrize(
    ("options", "axes"),
    [
        ((), ["forward", "left", "up"]),
        (("--frame", "natural"), ["τ", "n", "b"]),
        (("--frame", "rotation-minimizing"), ["τ", "u", "v"]),
    ],
)
@pytest.mark.parametrize("kind", ["path", "tuned"])
def test_a_saved_path_is_shown_upright_unless_another_frame_is_asked_for(
    qtraj, path, tuned, tmp_path, kind, options, axes
):
    (path if kind == "path" else tuned).save(tmp_path / "saved.toml")
    assert qtraj("report", tmp_path / "saved.toml", *options).exit_code == 0
    assert axes_of_page(tmp_path / "saved.html") == axes


def test_a_dataset_keeps_its_frame_and_says_so(qtraj, results, tmp_path):
    assert qtraj("report", results, "--out", tmp_path, "--frame", "natural").exit_code == 0
    assert axes_of_page(tmp_path / "report.html") == ["τ", "n", "b"]
    refused = qtraj("report", results, "--out", tmp_path, "--frame", "upright")
    assert refused.exit_code == 2
    assert "refer to the natural frame. Pass the saved path in the same folder" in refused.stderr
    assert "--frame upright" in refused.stderr
