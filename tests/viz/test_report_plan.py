"""The plan beside the scene, in a browser."""

import json

import numpy as np
import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from .browsing import MILLIMETRE, PATIENCE, expected, now, shown
from .report_data import closed_loop, two_paths

ARROW = 46.0  # [px] length of the arrows in the plan


def plan(browser):
    """The traces of the plan view by name, and the pixels per metre along both axes."""
    return browser.execute_script(
        "const plot = document.getElementById('plan'), { xaxis, yaxis } = plot._fullLayout;"
        "const traces = Object.fromEntries(plot.data.map((t) => [t.name, [Array.from(t.x), Array.from(t.y)]]));"
        "return [traces, xaxis._length / (xaxis.range[1] - xaxis.range[0]),"
        " yaxis._length / (yaxis.range[1] - yaxis.range[0])];"
    )


def test_a_plan_view_is_beside_the_scene_and_follows_the_slider(page):
    boxes = [page.find_element(By.ID, name).rect for name in ("space", "planview")]
    assert boxes[0]["x"] + boxes[0]["width"] <= boxes[1]["x"]  # beside
    assert abs(boxes[0]["y"] - boxes[1]["y"]) < 2
    traces, along, across = plan(page)
    assert along == pytest.approx(across, rel=1e-6)  # equal axes
    data = json.loads(page.find_element(By.ID, "data").get_property("textContent"))
    assert pytest.approx(np.array(data["bodies"][0]["position"])[:, :2]) == np.array(traces["slow"]).T
    assert len(traces["recorded"][0]) == len(data["recorded"])
    page.find_element(By.ID, "slider").send_keys(Keys.END)
    position, axes = expected(20.0, 20.0)
    origin = (position - data["space"]["centre"])[:2]
    script = "const t = document.getElementById('plan').data.find((t) => t.name === 'axis τ'); return [t.x[0], t.y[0]]"
    WebDriverWait(page, PATIENCE).until(lambda d: np.allclose(d.execute_script(script), origin, atol=MILLIMETRE))
    traces, *_ = plan(page)
    tip = np.array(traces["axis τ"])[:, 1]
    assert along * (tip - origin) == pytest.approx(ARROW * axes[0][:2], abs=0.1)  # the same length at any scale


def test_a_single_path_has_the_colours_of_its_curvature_and_a_click_moves_the_time(browser, tmp_path):
    dataset = two_paths().isel(path=[0])
    time, curvature = dataset["time"].values[0], np.linspace(0.0, 1.0, dataset.sizes["sample"])
    dataset["curvature"] = (("path", "sample"), curvature[None], {"units": "m-1"})
    shown(browser, tmp_path, dataset)
    traces, *_ = plan(browser)
    times = browser.execute_script(
        "return document.getElementById('plan').data.filter((t) => t.name.startsWith('curvature'))"
        ".map((t) => Array.from(t.customdata).filter((x) => x !== null))"
    )
    assert len(times) == 8
    assert [drawn[0] for drawn in times] == sorted(drawn[0] for drawn in times)  # dark to bright, as it increases
    assert times[0][0] == time[0]
    assert times[-1][-1] == time[-1]
    drawn = np.array([x for x in traces["curvature 3"][0] if x is not None])
    assert np.isin(drawn.round(6), np.array(traces["slow"][0]).round(6)).all()
    browser.execute_script(
        "document.getElementById('plan').emit('plotly_click', { points: [{ customdata: arguments[0] }] })", time[40]
    )
    WebDriverWait(browser, PATIENCE).until(lambda _: now(browser) == pytest.approx(time[40], abs=1e-3))


def test_a_closed_loop_has_no_plan(browser, tmp_path):
    shown(browser, tmp_path, closed_loop())
    assert not browser.find_element(By.ID, "planview").is_displayed()
    assert browser.find_element(By.ID, "space").size["width"] > 500
