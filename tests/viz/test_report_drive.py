"""The report of a changed drive in a browser: turns, lateral distance, sticky scene, dark colours, no WebGL."""

import json

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from .browsing import CHROMIUM, DRIVER, OPTIONS, PATIENCE, errors, opened, shown, until
from .drives import before_and_after
from .report_data import closed_loop

ALONG = "[...document.querySelectorAll('.plot')].find((p) => p.layout.xaxis.title.text.startsWith('distance'))"
GROUND = "return getComputedStyle(document.body).backgroundColor"


@pytest.fixture(scope="module")
def file(browser, tmp_path_factory):
    dataset = before_and_after()
    points = dataset["position"].sel(path="before").values[::4]
    dataset["recorded_position"] = (("record", "world"), points, {"units": "m"})
    return shown(browser, tmp_path_factory.mktemp("drive"), dataset)


@pytest.fixture
def drive(browser, file):
    opened(browser, file)
    until(browser, "return document.documentElement.dataset.ready === 'yes'")
    return browser


def data(browser):
    return json.loads(browser.find_element(By.ID, "data").get_property("textContent"))


def time(browser):
    """The time [s] that the page shows."""
    return float(browser.find_element(By.ID, "slider").get_attribute("aria-valuetext").split()[0])


def axis_range(browser, place, axis="xaxis"):
    return browser.execute_script(f"return document.getElementById('{place}')._fullLayout.{axis}.range")


def test_a_turn_of_the_table_moves_the_time_and_the_plan(drive):
    buttons = drive.find_elements(By.CSS_SELECTOR, ".jump")
    assert [button.text for button in buttons] == ["1", "2"]
    times = [json.loads(button.get_attribute("data-times")) for button in buttons]
    assert axis_range(drive, "plan")[1] > 60
    for button, (before, after) in zip(buttons, times, strict=True):
        button.click()
        assert time(drive) == pytest.approx(after, abs=0.05)  # the selected path
        assert before < after
    path = data(drive)["bodies"][1]
    x = np.interp(times[1][1], path["time"], np.array(path["position"])[:, 0])
    low, high = axis_range(drive, "plan")
    assert (low + high) / 2 == pytest.approx(x, abs=0.5)
    Select(drive.find_element(By.ID, "body")).select_by_index(0)
    drive.find_elements(By.CSS_SELECTOR, ".jump")[0].click()
    assert time(drive) == pytest.approx(times[0][0], abs=0.05)
    assert errors(drive) == []


def test_the_lateral_distance_is_drawn_against_the_distance_travelled(drive):
    title, x, y = drive.execute_script(
        f"const plot = {ALONG};"
        "return [plot.layout.xaxis.title.text, Array.from(plot.data[0].x), Array.from(plot.data[0].y)]"
    )
    assert title == "distance travelled [m]"
    assert x[-1] == pytest.approx(60 + 15 * np.pi / 2 + 80 + 10 * np.pi + 60, rel=1e-3)
    assert max(y) == pytest.approx(3.0, abs=0.1)
    cursor = (
        "const panel = [...document.querySelectorAll('.panel')].find((p) => p.innerText.includes('lateral distance'));"
        "const [low, high] = panel.querySelector('.plot').layout.xaxis.range;"
        "return (parseFloat(panel.querySelector('.cursor').style.left) + 1 - 80) /"
        " (panel.querySelector('.plot').clientWidth - 94) * (high - low) + low"
    )
    drive.find_elements(By.CSS_SELECTOR, ".jump")[0].click()
    assert drive.execute_script(cursor) == pytest.approx(6.0 * time(drive), abs=1.5)


def test_zooming_the_distance_zooms_the_times_too(drive):
    drive.execute_script(
        f"const plot = {ALONG};Plotly.relayout(plot, {{ 'xaxis.range[0]': 60, 'xaxis.range[1]': 120 }})"
    )
    until(drive, "return document.querySelector('.plot').layout.xaxis.range[0] > 1")
    low, high = drive.execute_script("return document.querySelector('.plot').layout.xaxis.range")
    assert (low, high) == (pytest.approx(60 / 6.0, rel=1e-3), pytest.approx(120 / 6.0, rel=1e-3))


def test_the_scene_and_its_controls_stay_while_the_panels_scroll(drive):
    drive.execute_script("document.getElementById('panels').lastElementChild.scrollIntoView({ block: 'end' })")
    inside = (
        "const { top, bottom } = document.getElementById(arguments[0]).getBoundingClientRect();"
        "return top >= 0 && bottom <= window.innerHeight"
    )
    assert drive.execute_script("return window.scrollY") > 300
    assert all(drive.execute_script(inside, name) for name in ("space", "plan", "play", "slider"))


def test_the_slider_has_round_steps_and_says_the_time(drive):
    slider = drive.find_element(By.ID, "slider")
    step = float(slider.get_attribute("step"))
    duration = max(body["time"][-1] for body in data(drive)["bodies"])
    assert step == pytest.approx(0.02)
    slider.send_keys(Keys.ARROW_RIGHT)
    assert slider.get_attribute("aria-valuetext") == f"{step:.2f} s of {duration:.2f} s"
    assert float(slider.get_property("value")) == pytest.approx(step)
    slider.send_keys(Keys.END)
    assert time(drive) == pytest.approx(duration, abs=0.005)


def test_space_plays_and_pauses_also_on_the_slider(drive):
    button, slider = drive.find_element(By.ID, "play"), drive.find_element(By.ID, "slider")
    Select(drive.find_element(By.ID, "speed")).select_by_index(0)
    for key, text in ((Keys.SPACE, "Pause"), (Keys.SPACE, "Play")):
        slider.send_keys(key)
        WebDriverWait(drive, PATIENCE).until(lambda _, text=text: button.text == text)


def test_the_recorded_points_are_under_the_paths_from_every_side(drive):
    """They are moved along the direction of view only, away from the viewer."""
    for eye in (None, {"x": 1.5, "y": 0.4, "z": 0.8}):
        if eye:
            drive.execute_script("Plotly.relayout('space', { 'scene.camera.eye': arguments[0] })", eye)
        drawn, seen = drive.execute_script(
            "const plot = document.getElementById('space'), t = plot.data[0], { eye } = plot._fullLayout.scene.camera;"
            "return [t.x.map((x, k) => [x, t.y[k], t.z[k]]), [eye.x, eye.y, eye.z]]"
        )
        moved = np.array(drawn) - np.array(data(drive)["recorded"])
        direction = np.array(seen) / np.linalg.norm(seen)
        along = moved @ direction
        assert (along < -1.0).all()
        assert moved == pytest.approx(along[:, None] * direction, abs=1e-6)


@pytest.fixture
def dark(browser):
    browser.execute_cdp_cmd(
        "Emulation.setEmulatedMedia", {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    )
    yield
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def luminance(colour):
    """Luminance of "rgb(r, g, b)" by WCAG 2."""
    levels = np.array([float(x) for x in colour[colour.index("(") + 1 : -1].split(",")[:3]]) / 255
    linear = np.where(levels <= 0.03928, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


STROKES = (
    "return [...document.querySelectorAll('.plot .scatterlayer .js-line')].map((x) => getComputedStyle(x).stroke)"
    ".concat([...document.querySelectorAll('.plot .xtick text, .plot .infolayer text')].map((x) =>"
    " getComputedStyle(x).fill))"
)


@pytest.mark.usefixtures("dark")
@pytest.mark.parametrize("loop", [False, True])
def test_in_the_dark_scheme_everything_is_light_on_dark(drive, tmp_path, loop):
    if loop:
        shown(drive, tmp_path, closed_loop())
    ground = luminance(drive.execute_script(GROUND))
    assert ground < 0.02
    colours = drive.execute_script(STROKES)
    assert len(colours) > 20
    assert min((luminance(colour) + 0.05) / (ground + 0.05) for colour in colours) > 3.0
    assert errors(drive) == []


def test_the_scheme_can_change_while_the_page_is_open(drive):
    light = set(drive.execute_script(STROKES))
    media = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    drive.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    until(drive, "return document.getElementById('space').layout.paper_bgcolor !== '#ffffff'")
    assert set(drive.execute_script(STROKES)) != light
    drive.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    until(drive, "return document.getElementById('space').layout.paper_bgcolor === '#ffffff'")
    assert set(drive.execute_script(STROKES)) == light


@pytest.mark.parametrize("dataset", [before_and_after, closed_loop])
@pytest.mark.skipif(CHROMIUM is None or DRIVER is None, reason="no Chromium and chromedriver here")
def test_without_webgl_the_scene_is_drawn_flat(tmp_path, dataset):
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    flags = [option for option in OPTIONS if "swiftshader" not in option]
    for option in (*flags, "--disable-3d-apis", f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    flat = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        shown(flat, tmp_path, dataset())
        scene = flat.find_element(By.ID, "space")
        assert "WebGL" not in scene.text
        lines = "return document.querySelectorAll('#space .scatterlayer .js-line').length"
        assert flat.execute_script(lines) >= 3 + len(dataset().get("path", [0]))
        before = flat.execute_script("return document.querySelector('#space .scatterlayer').innerHTML")
        flat.find_element(By.ID, "slider").send_keys(Keys.PAGE_UP)
        changed = "return document.querySelector('#space .scatterlayer').innerHTML !== arguments[0]"
        WebDriverWait(flat, PATIENCE).until(lambda driver: driver.execute_script(changed, before))
        assert errors(flat) == []
    finally:
        flat.quit()
