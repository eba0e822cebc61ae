"""The start page of the built documentation."""

from pathlib import Path

import pytest
from chromium import missing

START = Path(__file__).parents[2] / "docs" / "_build" / "html" / "index.html"


@pytest.mark.parametrize("width", [400, 1400])
def test_start_page(browser, width):
    if not START.is_file():
        missing("the documentation (sphinx-build -b html docs docs/_build/html)")
    browser.open(START, width=width)
    assert browser.console() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
