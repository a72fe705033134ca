"""A browser, and a report of two paths in it."""

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select

from .browsing import CHROMIUM, DRIVER, OPTIONS, errors, opened, requests, shown, until
from .report_data import two_paths


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("no Chromium and chromedriver here: apt-get install chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for option in (*OPTIONS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(option)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def report(browser, tmp_path_factory):
    file = shown(browser, tmp_path_factory.mktemp("report"), two_paths())
    return browser, file, errors(browser), requests(browser)


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
