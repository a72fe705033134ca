"""The report in a real headless browser: no errors, no network, a moving trihedral."""

import json
import re

import numpy as np
import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from .browsing import (
    MILLIMETRE,
    PATIENCE,
    arrow,
    errors,
    expected,
    frames,
    now,
    opened,
    requests,
    settled,
    shown,
    until,
)
from .report_data import CENTRE, CLIMB, HOSTILE, IMAGE, RADIUS, RATE, TIMES, closed_loop, two_paths


def test_it_opens_without_errors_and_without_any_request(report):
    _, file, messages, asked = report
    assert messages == []
    assert [address for address in asked if not address.startswith(("data:", "blob:"))] == [file.as_uri()]


def test_the_checks_detect_errors_and_requests(browser, tmp_path):
    file = tmp_path / "bad.html"
    file.write_text("<img src='http://127.0.0.1:9/x.png'><script>console.error('oh'); throw new Error('no')</script>")
    opened(browser, file)
    until(browser, "return document.readyState === 'complete'")
    assert len(errors(browser)) >= 2
    assert "http://127.0.0.1:9/x.png" in requests(browser)


def test_names_of_the_input_are_text(page):
    assert page.execute_script("return window.hacked") is None
    assert page.find_element(By.TAG_NAME, "h1").get_property("textContent") == HOSTILE
    assert page.title.split() == HOSTILE.split()
    options = [option.get_property("textContent") for option in page.find_elements(By.CSS_SELECTOR, "#body option")]
    assert options == list(TIMES)
    names = page.execute_script("return document.querySelector('.plot').data.map((trace) => trace.name)")
    assert not any("<" in name for name in names)
    assert page.find_elements(By.TAG_NAME, "img") == []
    keys = page.find_elements(By.CSS_SELECTOR, ".head .legend li")
    assert IMAGE.strip() in [key.get_property("textContent").strip() for key in keys]


def test_the_slider_moves_the_trihedral(page):
    length = json.loads(page.find_element(By.ID, "data").get_property("textContent"))["space"]["length"]
    centre = json.loads(page.find_element(By.ID, "data").get_property("textContent"))["space"]["centre"]
    before = page.find_element(By.ID, "space").screenshot_as_png
    for key, t in ((Keys.HOME, 0.0), (Keys.END, 20.0)):
        page.find_element(By.ID, "slider").send_keys(key)
        until(page, f"return Number(document.getElementById('slider').value) === {t}")
        position, axes = expected(20.0, t)
        for letter, axis in zip("τnb", axes, strict=True):
            until(page, "return document.getElementById('clock').value !== ''")
            begin, end = settled(page, letter, position - centre)
            assert begin == pytest.approx(position - centre, abs=MILLIMETRE)
            assert end - begin == pytest.approx(length * axis, abs=MILLIMETRE)
        assert f"t = {t:.2f} s" in page.find_element(By.ID, "clock").text
    assert page.find_element(By.ID, "space").screenshot_as_png != before


def test_the_cursor_and_the_numbers_follow(page):
    def left():
        return page.execute_script("return document.querySelector('.cursor').getBoundingClientRect().left")

    start = left()
    page.find_element(By.ID, "slider").send_keys(Keys.END)
    box = page.find_element(By.CSS_SELECTOR, ".plot").rect
    assert left() - start == pytest.approx(box["width"] - 80 - 14, abs=1.5)
    [speed] = [row.text for row in page.find_elements(By.CSS_SELECTOR, "#now tr") if row.text.startswith("speed")]
    assert float(speed.split()[1]) == pytest.approx(np.hypot(RADIUS * RATE, CLIMB), rel=1e-4)


def test_another_path_can_be_selected_and_its_gap_is_reported(page):
    Select(page.find_element(By.ID, "body")).select_by_index(1)
    page.execute_script(
        "const slider = document.getElementById('slider'); slider.value = arguments[0];"
        "slider.dispatchEvent(new Event('input'));",
        10 * 21.5 / 64,
    )
    WebDriverWait(page, PATIENCE).until(lambda driver: arrow(driver, "τ") is None)
    assert page.find_element(By.ID, "state").text == "The axes are not defined at this instant."
    page.find_element(By.ID, "slider").send_keys(Keys.END)
    assert page.find_element(By.ID, "state").text == "This path has ended."
    position, _ = expected(10.0, 10.0)
    settled(page, "τ", position - np.round(CENTRE + np.array([0, 0, 5])))


@pytest.fixture
def slowly(page):
    """Play at the lowest speed, at which the end is not reached before a slow machine presses Pause."""
    speed = Select(page.find_element(By.ID, "speed"))
    before = speed.options.index(speed.first_selected_option)
    speed.select_by_index(0)
    yield
    speed.select_by_index(before)


@pytest.mark.usefixtures("slowly")
def test_play_runs_and_pause_stops(page):
    button = page.find_element(By.ID, "play")

    def says(text):
        WebDriverWait(page, PATIENCE).until(lambda _: button.text == text)

    def runs_on(t):
        until(page, f"return Number(document.getElementById('slider').value) > {t}")

    button.click()
    says("Pause")
    runs_on(0.0)
    button.click()
    says("Play")
    stopped = now(page)
    frames(page, 3)
    assert now(page) == stopped
    assert 0.0 < stopped < 20.0
    button.click()
    runs_on(stopped)
    page.find_element(By.ID, "slider").send_keys(Keys.END)  # moving the slider stops it
    says("Play")


def test_zooming_one_panel_zooms_all(browser, tmp_path):
    shown(browser, tmp_path, closed_loop())
    ranges = "return Array.from(document.querySelectorAll('.plot')).map((plot) => plot.layout.xaxis.range)"
    assert all(limits == [0, 8] for limits in browser.execute_script(ranges))
    third = browser.find_elements(By.CSS_SELECTOR, ".plot")[2]
    drag = ActionChains(browser).move_to_element(third).click_and_hold().move_by_offset(100, 0).release()
    drag.perform()
    until(browser, f"{ranges}.every(([low, high]) => low > 3 && high < 7)")
    low, high = browser.execute_script(ranges)[0]
    width = third.rect["width"] - 80 - 14
    assert high - low == pytest.approx(8 * 100 / width, rel=0.05)
    assert all(limits == [low, high] for limits in browser.execute_script(ranges))
    assert errors(browser) == []


def test_time_is_called_time(page):
    titles = "return Array.from(document.querySelectorAll('.plot')).map((p) => [p.layout.xaxis.title.text, p])"
    assert {title for title, _ in page.execute_script(titles)} == {"time [s]"}
    assert page.find_element(By.CSS_SELECTOR, "label[for=slider]").text == "Time"
    ticks = page.find_elements(By.CSS_SELECTOR, ".plot .xtick text")
    assert all(re.fullmatch(r"[\d.]+", tick.text) for tick in ticks if tick.text)


@pytest.mark.parametrize("size", [1e-6, 1.5e-4])
def test_numbers_beside_a_panel_are_not_cut_off(browser, tmp_path, size):
    dataset = two_paths()
    speed = size * (1 + 0.35 * np.sin(dataset["time"].values))
    dataset["speed"] = (("path", "sample"), speed, {"units": "m s-1"})
    shown(browser, tmp_path, dataset)
    inside, texts = browser.execute_script(
        "const plots = Array.from(document.querySelectorAll('.plot'));"
        "const labels = plots.map((plot) => Array.from(plot.querySelectorAll('.ytick text')));"
        "const left = (part) => part.getBoundingClientRect().left;"
        "return [plots.map((plot, k) => Math.min(...labels[k].map(left)) - left(plot)),"
        " labels.flat().map((label) => label.textContent)]"
    )
    assert any(text.startswith("0.5×10") for text in texts), texts
    assert min(inside) >= 0, texts


@pytest.mark.parametrize("dataset", [two_paths, closed_loop])
def test_a_page_fits_a_telephone(browser, tmp_path, dataset):
    """At 390 pixels only scrollable tables are wider than the screen, and the views are below each other."""
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        shown(browser, tmp_path, dataset())
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
        wide = browser.execute_script(
            "return [...document.querySelectorAll('main *, header *')].filter((x) => !x.closest('.js-plotly-plot')"
            " && x.getBoundingClientRect().right > 391).map((x) => x.tagName + '#' + x.id + '.' + x.className)"
        )
        assert wide == []
        assert browser.execute_script("return document.querySelector('.plot').clientWidth") > 330
        if dataset is two_paths:
            boxes = [browser.find_element(By.ID, name).rect for name in ("space", "planview")]
            assert boxes[0]["y"] + boxes[0]["height"] <= boxes[1]["y"]
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_a_spike_is_reported_and_the_numbers_are_unchanged(browser, tmp_path):
    dataset = two_paths()
    curvature = np.full((2, 65), 0.05)
    curvature[0, 0] = 1e7
    dataset["curvature"] = (("path", "sample"), curvature, {"units": "m-1"})
    shown(browser, tmp_path, dataset)
    Select(browser.find_element(By.ID, "body")).select_by_index(0)
    panels = browser.find_elements(By.CSS_SELECTOR, ".panel")
    [panel] = [p for p in panels if p.find_element(By.TAG_NAME, "h2").text.startswith("curvature")]
    assert "larger values, up to 1e+07, are not shown" in panel.text
    top = browser.execute_script("return arguments[0].querySelector('.plot')._fullLayout.yaxis.range[1]", panel)
    assert top == pytest.approx(0.15)
    [row] = [r for r in browser.find_elements(By.CSS_SELECTOR, "#now tr") if r.text.startswith("curvature")]
    assert "1.000e+7 1/m" in row.text
