"""Chromium without a window, and what the tests read from a report that it shows."""

import json
import shutil

import numpy as np
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

from qtraj.viz.report import report_page

from .report_data import RATE, helix

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
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


def settled(browser, letter, begin):
    """An arrow, once the scene has been drawn with it at `begin`."""
    WebDriverWait(browser, PATIENCE).until(
        lambda driver: np.abs(arrow(driver, letter)[0] - begin).max() < MILLIMETRE, f"{letter} never came to {begin}"
    )
    return arrow(browser, letter)


def frames(browser, count):
    """Wait until the browser has drawn some frames."""
    browser.execute_async_script(
        "const [count, done] = arguments;"
        "const wait = (left) => (left ? requestAnimationFrame(() => wait(left - 1)) : done());"
        "wait(count);",
        count,
    )
