"""The start page of the built documentation."""

import pytest
from support.chromium import missing
from support.places import ROOT

START = ROOT / "docs" / "_build" / "html" / "index.html"


@pytest.mark.parametrize("width", [400, 1400])
def test_start_page(browser, width):
    if not START.is_file():
        missing("the documentation (sphinx-build -b html docs docs/_build/html)")
    browser.open(START, width=width)
    assert browser.console() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
