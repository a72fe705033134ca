"""The report in a real headless browser: no errors, no network, a moving trihedral."""

import base64
import itertools
import json
import re
import shutil

import matplotlib.image
import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

from qtraj.viz.report import report_page

from .report_data import CENTRE, CLIMB, HOSTILE, IMAGE, RADIUS, RATE, TIMES, closed_loop, helix, two_paths

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    CHROMIUM is None or DRIVER is None, reason="no Chromium and chromedriver here: apt-get install chromium-driver"
)
OPTIONS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--enable-unsafe-swiftshader",  # draws WebGL without a graphics card
    "--window-size=1400,1000",
]
PATIENCE = 30  # [s] a busy machine draws slowly
MILLIMETRE = 1e-3
CORNERS = """
const { model, view, projection } = document.getElementById('space')._fullLayout.scene._scene.glplot.cameraParams;
const axes = document.getElementById('space')._fullLayout.scene;
const apply = (m, v) => [0, 1, 2, 3].map((r) => v.reduce((sum, x, c) => sum + m[4 * c + r] * x, 0));
const scale = document.getElementById('space')._fullLayout.scene._scene.dataScale;
const points = [];
for (let k = 0; k < 8; k++) {
  const corner = ['x', 'y', 'z'].map((letter, n) => axes[letter + 'axis'].range[(k >> n) & 1] * scale[n]);
  const [x, y, , w] = apply(projection, apply(view, apply(model, [...corner, 1])));
  points.push([x / w, y / w]);
}
const of = (pick) => [0, 1].map((n) => pick(...points.map((point) => point[n])));
return [of(Math.min), of(Math.max)];
"""
COLOURS = {"tangent": (0, 158, 115), "normal": (204, 121, 167), "binormal": (230, 159, 0)}


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for option in (*OPTIONS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


def opened(browser, file):
    """Errors of the console, and requested addresses, while a page opens."""
    browser.get("about:blank")
    for log in ("browser", "performance"):
        browser.get_log(log)
    browser.get(file.as_uri())
    return browser


def errors(browser):
    return [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


def requests(browser):
    """Requested addresses, on any network or of any file."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [event["params"] for event in events if event["method"] == "Network.requestWillBeSent"]
    sockets = [event["params"]["url"] for event in events if event["method"] == "Network.webSocketCreated"]
    return [params["request"]["url"] for params in asked] + sockets


def shown(browser, folder, dataset):
    """A completely drawn report."""
    file = folder / "report.html"
    file.write_text(report_page(dataset), encoding="utf-8")
    opened(browser, file)
    until(browser, "return document.documentElement.dataset.ready === 'yes'")
    return file


def until(browser, script):
    WebDriverWait(browser, PATIENCE).until(lambda driver: driver.execute_script(script))


@pytest.fixture(scope="module")
def report(browser, tmp_path_factory):
    file = shown(browser, tmp_path_factory.mktemp("report"), two_paths())
    return browser, file, errors(browser), requests(browser)


def arrow(browser, letter):
    """Where an arrow begins and ends, in the coordinates of the scene."""
    points = browser.execute_script(
        "const trace = document.getElementById('space').data.find((t) => t.name === 'axis ' + arguments[0]);"
        "return [trace.x, trace.y, trace.z].map((values) => Array.from(values));",
        letter,
    )
    points = np.array(points).T
    return (points[0], points[-1]) if len(points) else None


def now(browser):
    return float(browser.find_element(By.ID, "slider").get_property("value"))


def expected(duration, t):
    """Position about the centre of the scene, and tangent, of a helix at an instant."""
    position, _, axes = helix(np.array([t]), RATE * 20 / duration)
    return position[0], axes[0]


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


@pytest.fixture
def page(browser, report):
    """The report of two paths, open, at its start."""
    browser, file, *_ = report
    if browser.current_url != file.as_uri():
        opened(browser, file)
        until(browser, "return document.documentElement.dataset.ready === 'yes'")
    browser.find_element(By.ID, "slider").send_keys(Keys.HOME)
    Select(browser.find_element(By.ID, "body")).select_by_index(1)
    Select(browser.find_element(By.ID, "body")).select_by_index(0)
    until(browser, "return document.getElementById('slider').value === '0'")
    return browser


def test_the_tools_of_the_picture_are_small_and_share_nothing(page):
    tools = page.find_elements(By.CSS_SELECTOR, "#space .modebar-btn")
    assert tools
    assert not any("hare" in tool.get_attribute("data-title") for tool in tools)
    assert max(tool.size["width"] for tool in tools) < 40
    colour = page.execute_script("return getComputedStyle(arguments[0].querySelector('path')).fill", tools[0])
    assert max(map(int, re.findall(r"\d+", colour)[:3])) < 160, colour  # on white


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


def settled(browser, letter, begin):
    """An arrow, once the scene has been drawn with it at `begin`."""
    WebDriverWait(browser, PATIENCE).until(
        lambda driver: np.abs(arrow(driver, letter)[0] - begin).max() < MILLIMETRE, f"{letter} never came to {begin}"
    )
    return arrow(browser, letter)


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
    assert page.find_element(By.ID, "state").text == "the axes are not defined at this instant"
    page.find_element(By.ID, "slider").send_keys(Keys.END)
    assert page.find_element(By.ID, "state").text == "this path has ended"
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


def frames(browser, count):
    """Wait until the browser has drawn some frames."""
    browser.execute_async_script(
        "const [count, done] = arguments;"
        "const wait = (left) => (left ? requestAnimationFrame(() => wait(left - 1)) : done());"
        "wait(count);",
        count,
    )


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


def test_the_picture_shows_the_arrows(page, tmp_path):
    (tmp_path / "space.png").write_bytes(page.find_element(By.ID, "space").screenshot_as_png)
    image = (255 * matplotlib.image.imread(tmp_path / "space.png")[..., :3]).round().astype(int)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 50  # not blank
    for name, colour in COLOURS.items():
        near = np.abs(image - np.array(colour)).max(axis=2) < 40
        assert near.sum() > 20, name


def arrow_colours(browser):
    """Number of pixels of the printed picture with the colour of each arrow."""
    pixels = browser.execute_script(
        "const p = document.getElementById('picture');"
        "return Array.from(p.getContext('2d').getImageData(0, 0, p.width, p.height).data);"
    )
    seen = np.array(pixels).reshape(-1, 4)
    near = [np.abs(seen[:, :3] - np.array(colour)).max(axis=1) < 40 for colour in COLOURS.values()]
    return [int((found & (seen[:, 3] > 200)).sum()) for found in near]


def test_paper_shows_a_picture_of_the_scene(page):
    page.execute_script("window.printing = window.print; window.print = () => { window.printed = true; }")
    page.find_element(By.ID, "print").click()
    until(page, "return window.printed === true")
    width = page.execute_script("return document.getElementById('picture').width")
    assert width == 2 * page.execute_script("return document.getElementById('space').clientWidth")
    assert min(arrow_colours(page)) > 80
    assert not page.find_element(By.ID, "picture").is_displayed()  # only in print
    page.execute_script("window.print = window.printing; window.dispatchEvent(new Event('afterprint'))")


@pytest.mark.slow
def test_paper_shows_it_also_when_the_browser_prints_by_its_own_command(browser, report, tmp_path):
    """Without a click on the button of the page."""
    _, file, *_ = report
    opened(browser, file)
    until(browser, "return document.documentElement.dataset.ready === 'yes'")
    paper = base64.b64decode(browser.execute_cdp_cmd("Page.printToPDF", {})["data"])
    assert min(arrow_colours(browser)) > 20
    assert b"/Subtype /Image" in paper
    assert "copied" in browser.find_element(By.TAG_NAME, "body").get_attribute("class")
    listed = [item.get_property("textContent") for item in browser.find_elements(By.CSS_SELECTOR, "#arrows .paper")]
    assert listed == ["recorded", *TIMES]
    assert errors(browser) == []


def test_the_letters_of_the_ends_do_not_overlap(page):
    """The letter of the upper end is above it."""
    ends = page.execute_script(
        "return document.getElementById('space').data.filter((t) => ['<b>A</b>', '<b>B</b>'].includes(t.text?.[0]))"
        ".map((t) => [t.text[0], t.textposition, t.z[0]])"
    )
    assert sorted(end[:2] for end in ends) == [["<b>A</b>", "bottom center"], ["<b>B</b>", "top center"]]


LETTERS = """
const scene = document.getElementById('space')._fullLayout.scene;
const { model, view, projection } = scene._scene.glplot.cameraParams;
const { clientWidth, clientHeight } = document.getElementById('space');
const apply = (m, v) => [0, 1, 2, 3].map((r) => v.reduce((sum, x, c) => sum + m[4 * c + r] * x, 0));
const trace = document.getElementById('space').data.find((t) => Array.isArray(t.textposition));
return trace.text.map((label, k) => {
  const point = ['x', 'y', 'z'].map((letter, n) => trace[letter][k] * scene._scene.dataScale[n]);
  const [x, y, , w] = apply(projection, apply(view, apply(model, [...point, 1])));
  return [label.replace(/<[^>]*>/g, ''), trace.textposition[k], (x / w) * clientWidth / 2, (y / w) * clientHeight / 2];
});
"""


def test_the_labels_of_arrows_do_not_overlap(browser, tmp_path):
    """Not even where an arrow points towards the viewer or away, in plotly's own projection."""
    shown(browser, tmp_path, two_paths(frame="upright"))
    slider = browser.find_element(By.ID, "slider")
    for _ in range(12):
        slider.send_keys(*[Keys.ARROW_RIGHT] * 10)
        rectangles = [rectangle(*label) for label in browser.execute_script(LETTERS)]
        assert len(rectangles) == 3
        for a, b in itertools.combinations(rectangles, 2):
            assert (a[2:] <= b[:2]).any() or (b[2:] <= a[:2]).any(), (a, b)


def rectangle(label, place, x, y):
    """The lower left and the upper right corner [px] of a bold label, from plotly's word for its place."""
    up, across = place.split()
    size = np.array([7.5 * len(label), 12.0])
    shift = np.array([("left", "center", "right").index(across), ("bottom", "middle", "top").index(up)])
    middle = np.array([x, y]) + (shift - 1) / 2 * size
    return np.concatenate([middle - size / 2, middle + size / 2])


def test_numbers_of_the_axes_do_not_reach_into_their_titles(page):
    """Upright numbers have the height of a line; rotated along an axis, long ones overlapped its title."""
    angles = page.execute_script(
        "const { xaxis, yaxis, zaxis } = document.getElementById('space')._fullLayout.scene;"
        "return [xaxis, yaxis, zaxis].map((axis) => [axis.tickangle, axis.title.font.size - axis.tickfont.size])"
    )
    assert all(angle == 0 and smaller > 0 for angle, smaller in angles)


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


@pytest.mark.parametrize("size", [1400, 900])
def test_the_axes_fill_the_picture_and_no_more(browser, report, size):
    """Their corners, in plotly's own projection, stay inside, with space for the labels."""
    _, file, *_ = report
    browser.set_window_size(size, 1000)
    opened(browser, file)
    until(browser, "return document.documentElement.dataset.ready === 'yes'")
    low, high = browser.execute_script(CORNERS)
    browser.set_window_size(1400, 1000)
    assert max(*np.abs(low), *np.abs(high)) < 0.95
    assert max(high[0] - low[0], high[1] - low[1]) > 1.4
    assert min(high[0] - low[0], high[1] - low[1]) > 1.0


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
    assert tip - origin == pytest.approx(data["space"]["length"] * axes[0][:2], abs=MILLIMETRE)


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


@pytest.mark.parametrize("along", ["x", "y"])
def test_a_long_path_fills_the_picture_whichever_way_it_runs(browser, tmp_path, along):
    dataset = two_paths()
    k = "xyz".index(along)
    dataset["position"].values[..., k] = CENTRE[k] + 30 * (dataset["position"].values[..., k] - CENTRE[k])
    dataset = dataset.drop_vars("recorded_position")
    shown(browser, tmp_path, dataset)
    low, high = browser.execute_script(CORNERS)
    assert max(*np.abs(low), *np.abs(high)) < 0.95
    assert max(high[0] - low[0], high[1] - low[1]) > 1.4
    assert min(high[0] - low[0], high[1] - low[1]) > 1.05  # the view direction suits the path


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
