"""The report as a page: contents, escaping, refused input."""

import json
import re

import numpy as np
import pytest
import xarray
from scipy.spatial.transform import Rotation

from qtraj.io.dataset import LIMIT_VARIABLES
from qtraj.viz.report import page, report_page
from qtraj.viz.report.frames import cosines
from qtraj.viz.report.model import MAX_INSTANTS

from .pages import Page
from .report_data import CENTRE, HOSTILE, IMAGE, TIMES, closed_loop, two_paths

ROUND_OFF = 1e-12
NINE_DIGITS = 1e-8


@pytest.fixture(scope="module")
def paths():
    return Page(report_page(two_paths()))


def test_nothing_from_the_input_becomes_markup(paths):
    assert len(paths.scripts) == 3  # the data, plotly, the report's own
    assert HOSTILE in paths.text  # as text, in the heading
    assert not any(name.startswith("on") for _, name, _ in paths.attributes)
    assert {tag for tag, _, _ in paths.attributes} & {"iframe", "object", "embed", "form"} == set()
    assert not any(tag == "img" for tag, _, _ in paths.attributes)
    assert "<" not in paths.scripts[0]


def test_the_page_loads_nothing(paths):
    sources = [value for _, name, value in paths.attributes if name in ("src", "href", "data", "action")]
    assert sources == ["data:,"]
    [policy] = [value for tag, name, value in paths.attributes if tag == "meta" and "default-src" in str(value)]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    assert "http" not in policy


def test_the_data_are_those_of_the_dataset(paths):
    data, dataset = json.loads(paths.scripts[0]), two_paths()
    assert [body["name"] for body in data["bodies"]] == list(TIMES)
    centre = np.array(data["space"]["centre"])
    assert np.abs(centre - CENTRE).max() < 20
    for k, body in enumerate(data["bodies"]):
        path = dataset.isel(path=k)
        assert np.array(body["time"]) == pytest.approx(path["time"].values, rel=NINE_DIGITS)
        assert np.array(body["position"]) + centre == pytest.approx(path["position"].values, abs=1e-6)
        axes = np.array(body["axes"], dtype=float).reshape(-1, 3, 3)
        defined = path["defined"].values
        assert axes[defined] == pytest.approx(path["dcm"].values[defined], abs=NINE_DIGITS)
        assert np.isnan(axes[~defined]).all()
    [panel] = [panel for panel in data["panels"] if panel["title"] == "speed"]
    assert (panel["unit"], panel["limits"]) == ("m/s", [{"value": 5.0, "text": "limit 5", "drawn": True}])
    assert len(data["recorded"]) == 9


def test_axes_in_space_are_equal_and_contain_everything(paths):
    data = json.loads(paths.scripts[0])
    low, high = np.array(data["space"]["range"]).T
    for body in data["bodies"]:
        tips = np.array(body["position"])[:, None] + data["space"]["length"] * np.array(body["axes"], float).reshape(
            -1, 3, 3
        )
        tips = tips[np.isfinite(tips)].reshape(-1, 3)
        assert len(tips) > 100
        assert (tips > low).all()
        assert (tips < high).all()


@pytest.mark.parametrize(
    ("frame", "names"),
    [
        ("natural", ["τ (tangent)", "n (normal)", "b (binormal)"]),
        ("upright", ["forward", "left", "up"]),
        ("rotation-minimizing", ["τ (tangent)", "u (first)", "v (second)"]),
    ],
)
def test_axes_and_components_are_named_after_the_frame(frame, names):
    dataset = two_paths(frame=frame)
    dataset["rate"] = (("path", "sample", "body"), dataset["velocity"].values, {"units": "rad s-1"})
    data = json.loads(Page(report_page(dataset)).scripts[0])
    shown = [x["symbol"] if x["symbol"] == x["meaning"] else f"{x['symbol']} ({x['meaning']})" for x in data["arrows"]]
    assert shown == names
    [rate] = [panel for panel in data["panels"] if panel["title"] == "rate of the frame, body axes"]
    assert [line["name"] for line in rate["series"][:3]] == [f"ω {name.split()[0]}" for name in names]


@pytest.mark.parametrize(
    ("frame", "shown"),
    [("natural", "angular rate of the natural trihedral"), ("upright", "yaw rate"), ("rotation-minimizing", None)],
)
def test_rates_have_a_panel_for_their_own_frame_only(frame, shown):
    dataset = two_paths(frame=frame)
    for name in ("angular_rate", "yaw_rate"):
        dataset[name] = dataset["speed"].assign_attrs(units="rad s-1").drop_attrs()
    titles = [panel["title"] for panel in json.loads(Page(report_page(dataset)).scripts[0])["panels"]]
    assert [title for title in titles if "rate" in title] == ([shown] if shown else [])


def test_a_limit_on_the_trihedral_is_shown_for_every_frame():
    dataset = two_paths(frame="upright")
    dataset["angular_rate"] = dataset["speed"].assign_attrs(units="rad s-1", limit=1.0)
    panels = json.loads(Page(report_page(dataset)).scripts[0])["panels"]
    [panel] = [panel for panel in panels if panel["title"] == "angular rate of the natural trihedral"]
    assert panel["limits"][0]["value"] == 1.0


def test_tables_have_the_status_of_each_limit(paths):
    text = " ".join(paths.text)
    for expected in ("Limits", "speed [m/s]", "broken", "within", "Boundary states", "600010.0000", IMAGE, "report"):
        assert expected in text
    assert "exceeded" not in text  # the same word as in the certificate, on the terminal and in JSON


def test_names_of_limits_are_words():
    words = "max_jerk by 3 %: larger max_steps, my_angular_rate, angular_rates of end.V_h"
    result = "; ".join([*LIMIT_VARIABLES, words])
    text = " ".join(Page(report_page(two_paths(tuning_result=result, rate_convention="angular_acceleration"))).text)
    for name in (*LIMIT_VARIABLES, "max_jerk"):
        assert name.replace("_", " ") in text.lower()
    assert re.findall(r"\w+_\w+", text.partition("Provenance")[0]) == [
        "max_steps",
        "my_angular_rate",
        "angular_rates",
        "V_h",
    ]
    assert "angular_acceleration" not in text
    assert "max jerk by 3 %" in " ".join(Page(report_page(closed_loop().assign_attrs(result=result))).text)


def test_a_closed_loop_is_shown_in_degrees_beside_its_closed_form():
    data = json.loads(Page(report_page(closed_loop())).scripts[0])
    assert data["kind"] == "attitude"
    assert [(body["name"], body["ghost"]) for body in data["bodies"]] == [("body", False), ("program", True)]
    panels = {panel["title"]: panel for panel in data["panels"]}
    angle = panels["error angle"]
    assert (angle["unit"], angle["logarithmic"]) == ("°", True)
    first, closed = angle["series"]
    assert (closed["name"], closed["reference"]) == ("closed form", True)
    assert first["values"][0] == closed["values"][0] == pytest.approx(np.degrees(0.4))
    assert first["values"][-1] is None
    assert first["values"][8] == pytest.approx(np.degrees(0.4 * np.exp(-1)))
    command = panels["command, body axes"]
    assert [limit["value"] for limit in command["limits"]] == pytest.approx([np.degrees(0.2)])
    assert data["bodies"][0]["axes"][-1] == [None] * 9
    turned = np.array(data["bodies"][0]["axes"][0]).reshape(3, 3)
    assert turned[0] == pytest.approx([np.cos(0.4), np.sin(0.4), 0.0], abs=NINE_DIGITS)


def test_a_limit_far_above_is_listed_but_not_drawn():
    loop = closed_loop()
    loop["command"].attrs["limit"] = np.array([0.2, 1.3])
    panels = json.loads(Page(report_page(loop)).scripts[0])["panels"]
    [command] = [panel for panel in panels if panel["title"].startswith("command")]
    assert [limit["drawn"] for limit in command["limits"]] == [True, False]
    assert {limit["text"] for limit in command["limits"]} == {"limit 11.46, 74.48"}


def test_axes_of_quaternions_are_those_of_scipy():
    q = np.random.default_rng(5).normal(size=(50, 4))
    world = Rotation.from_quat(q, scalar_first=True).as_matrix()
    assert cosines(1e-3 * q) == pytest.approx(np.swapaxes(world, 1, 2), abs=ROUND_OFF)
    assert np.isnan(cosines(np.array([[0.0, 0, 0, 0], [np.nan, 0, 0, 1]]))).all()


def test_many_instants_are_thinned_and_many_paths_omitted():
    loop = closed_loop()
    long = loop.interp(time=np.linspace(0, 5, 5 * MAX_INSTANTS))
    body = json.loads(Page(report_page(long)).scripts[0])["bodies"][0]
    assert len(body["time"]) == len(body["axes"]) == MAX_INSTANTS
    assert (body["time"][0], body["time"][-1]) == (0.0, 5.0)
    crowd = xarray.concat([two_paths().isel(path=[0]).drop_vars("path")] * 9, "path", data_vars="minimal")
    text = Page(report_page(crowd))
    assert len(json.loads(text.scripts[0])["bodies"]) == 8
    assert "8 of 9 paths are shown." in text.text


def test_a_table_with_components_first_is_the_same():
    dataset = two_paths().isel(path=0, drop=True).swap_dims(sample="time")
    turned = dataset.transpose("world", "body", "time", "record")
    assert report_page(turned) == report_page(dataset)


def test_other_input_is_refused():
    with pytest.raises(ValueError, match="needs position or quaternion over time, but the dataset contains x"):
        report_page(xarray.Dataset({"x": ("time", [1.0])}))
    with pytest.raises(ValueError, match="a dimension of the dataset is empty"):
        report_page(two_paths().isel(sample=[]))
    with pytest.raises(ValueError, match="contains neither quaternion nor dcm"):
        report_page(two_paths().drop_vars("dcm"))
    with pytest.raises(ValueError, match="needs position or quaternion"):
        report_page(two_paths().isel(world=[0, 1]))


def test_the_same_result_makes_the_same_page():
    assert report_page(closed_loop()) == report_page(closed_loop())


def test_code_in_the_page_matches_its_hash(paths):
    [policy] = [value for tag, name, value in paths.attributes if tag == "meta" and "default-src" in str(value)]
    hashes = re.findall(r"'sha256-([^']+)'", policy)
    assert hashes == [page._digest(code) for code in paths.scripts[1:]]
    assert len(paths.scripts[1]) > 10**6


def test_outliers_of_a_recording_do_not_set_the_axes():
    dataset = two_paths()
    ranges = json.loads(Page(report_page(dataset)).scripts[0])["space"]
    dataset["recorded_position"].values[3] += [5000.0, -3000.0, 900.0]
    assert json.loads(Page(report_page(dataset)).scripts[0])["space"] == ranges


def test_the_plan_shows_the_paths_closely(paths):
    space = json.loads(paths.scripts[0])["space"]
    (west, east), (south, north) = space["plan"]
    assert (east - west, north - south) == pytest.approx((20.0 * 1.08, 20.0 * 1.08), rel=0.02)
    assert space["range"][0][0] < west


@pytest.mark.parametrize("dataset", [two_paths(tuning_result="every limit holds."), closed_loop()])
def test_sentences_begin_with_a_capital(dataset):
    report = page.report_of(dataset.assign_attrs(fit_warning="the fit is poor", tuning_warning="the path is longer"))
    sentences = [*report.facts, *report.notes, *report.warnings, *(table.note for table in report.tables if table.note)]
    assert sentences
    assert [text for text in sentences if text[0].islower()] == []
