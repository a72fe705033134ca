"""The scene of a report in a browser: arrows, letters, axes, and how it is printed."""

import base64
import itertools
import re

import matplotlib.image
import numpy as np
import pytest
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from .browsing import (
    errors,
    opened,
    shown,
    until,
)
from .report_data import CENTRE, TIMES, two_paths

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


def test_the_tools_of_the_picture_are_small_and_share_nothing(page):
    tools = page.find_elements(By.CSS_SELECTOR, "#space .modebar-btn")
    assert tools
    assert not any("hare" in tool.get_attribute("data-title") for tool in tools)
    assert max(tool.size["width"] for tool in tools) < 40
    colour = page.execute_script("return getComputedStyle(arguments[0].querySelector('path')).fill", tools[0])
    assert max(map(int, re.findall(r"\d+", colour)[:3])) < 160, colour  # on white


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
        slider.send_keys(Keys.PAGE_UP)
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
