"""The catalogue of effects and a card, in a browser."""

import pytest
from support.chromium import missing
from support.places import ROOT

BUILT = ROOT / "docs" / "_build" / "html"
PAGES = ("effects", "cards/skhoid.effects.DeadZone", "trust-a-name")


@pytest.mark.parametrize("page", PAGES)
@pytest.mark.parametrize("width", [400, 1400])
def test_page(browser, page, width):
    path = BUILT / f"{page}.html"
    if not path.is_file():
        missing("the documentation (sphinx-build -b html docs docs/_build/html)")
    browser.open(path, width=width)
    assert browser.console() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
