"""One Chromium for all tests of what skhoid shows in a browser."""

import shutil
from pathlib import Path

import pytest
from support.chromium import Browser, missing


@pytest.fixture(scope="session")
def axe():
    path = Path(__file__).parent / "node_modules" / "axe-core" / "axe.min.js"
    if not path.is_file():
        missing("axe-core (npm install --prefix tests/browser)")
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="session")
def browser(axe, tmp_path_factory):
    try:
        from selenium import webdriver
    except ImportError:
        missing('selenium (pip install -e ".[browser]")')
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    chromedriver = shutil.which("chromedriver")
    if chromium is None or chromedriver is None:
        missing("Chromium or its driver (apt-get install chromium chromium-driver)")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in (
        "--headless=new",
        "--no-sandbox",  # CI is root
        "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",  # no network
        f"--user-data-dir={tmp_path_factory.mktemp('chromium')}",
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "WARNING", "performance": "ALL"})
    driver = webdriver.Chrome(options, webdriver.ChromeService(chromedriver))
    yield Browser(driver, axe)
    driver.quit()
