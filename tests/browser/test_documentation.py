"""The main pages of the built documentation, on a telephone in the dark and on a desktop."""

import pytest
from support.chromium import missing
from support.places import ROOT

BUILT = ROOT / "docs" / "_build" / "html"
PAGES = [
    "index",
    "start",
    "install",
    "command-line",
    "effects",
    "compare",
    "find-what-is-missing",
    "noise-ceiling",
    "theory",
    "glossary",
    "api",
    "generated/skhoid.ARXRegressor",
    "gallery/index",
    "gallery/identify/plot_free_run",
]
FOLD = 900  # height of a window, of which the start page needs no more


def opened(browser, name, **how):
    path = BUILT / f"{name}.html"
    if not path.is_file():
        missing("the documentation (sphinx-build -b html docs docs/_build/html)")
    browser.open(path, **how)
    browser.js("return window.MathJax?.startup.promise")  # equations are set


# Contrast depends on the colours, overflow on the width: two windows show both.
@pytest.mark.parametrize(("width", "colours"), [(400, "dark"), (1400, "light")])
@pytest.mark.parametrize("name", PAGES)
def test_page(browser, name, width, colours):
    opened(browser, name, width=width, colours=colours)
    assert browser.console() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []


def test_start_page_tells_all_at_once(browser):
    opened(browser, "index", width=1400)
    for part in ("h1", ".start-page pre", "img.front:last-of-type", ".outcomes"):
        bottom = browser.js(
            "return document.querySelector(arguments[0]).getBoundingClientRect().bottom", part
        )
        assert 0 < bottom <= FOLD, part


@pytest.mark.parametrize("width", [400, 1400])
def test_code_of_the_start_page_is_not_cut(browser, width):
    opened(browser, "index", width=width)
    cut = (
        "return [...document.querySelectorAll('.start-page pre')]"
        ".map(code => code.scrollWidth - code.clientWidth)"
    )
    assert max(browser.js(cut)) <= 0


def test_the_api_has_a_filter(browser):
    opened(browser, "api", width=1400)
    shown = (
        "return [...document.querySelectorAll('table.autosummary tr')]"
        ".filter(row => row.getClientRects().length).map(row => row.textContent.toLowerCase())"
    )
    everything = browser.js(shown)
    field = browser.driver.find_element("css selector", "#api-filter input")
    field.send_keys("delay search")
    found = browser.js(shown)
    assert 0 < len(found) < len(everything)
    assert all("delay" in row and "search" in row for row in found)
    said = browser.js("return document.querySelector('#api-filter output').textContent")
    assert said == f"{len(found)} of {len(everything)} names"
    field.clear()
    field.send_keys(" ")
    assert browser.js(shown) == everything


def test_equations_are_set_without_a_network(browser):
    opened(browser, "theory")
    assert browser.js(
        "const set = document.querySelectorAll('.math mjx-container').length;"
        "return set > 0 && set === document.querySelectorAll('.math').length"
    )
