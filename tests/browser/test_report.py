"""The report in a real browser: steps by mouse and keyboard, narrow, dark, printed, attacked."""

import pytest
from support.chromium import NOTEBOOK

from skhoid import OperatorRegressor, RecursiveARX, make_tracking_runs
from skhoid.effects import Bias, DeadZone
from skhoid.lab.report import report

SCRIPT = "<script>alert(1)</script>"
IMAGE = '"><img src="x" onerror="window.hacked = true">'
BOLD = "</svg></title><b onclick='window.hacked = true'>bold</b> $x$ & {{ 7 * 7 }}"
SHOWN = "return [...document.querySelectorAll('#steps .step')].map(p => p.checkVisibility())"
SELECTED = (
    "return [...document.querySelectorAll('#steps [role=tab]')]"
    ".map(t => t.getAttribute('aria-selected') === 'true')"
)
# The size of the letters on screen; an exponent may be smaller than its base.
LETTERS = """
return [...document.querySelectorAll('svg text')]
  .filter(text => text.checkVisibility() && text.textContent.trim())
  .map(text => {
    const m = text.getScreenCTM();
    const parts = [text, ...text.querySelectorAll('tspan')];
    const size = Math.max(...parts.map(p => parseFloat(getComputedStyle(p).fontSize)));
    return [size * Math.sqrt(Math.abs(m.a * m.d - m.b * m.c)), text.textContent];
  })
"""


@pytest.fixture(scope="session")
def page():
    X, y = make_tracking_runs(
        n_runs=3,
        remnant_intensity=0.05,
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        effects=DeadZone(width=0.4) + Bias(level=0.1),
        random_state=0,
    )
    X = X.rename(columns={"x": SCRIPT, "f_t": BOLD})
    X = X.rename(index={label: f"{IMAGE} {label}" for label in X.index.unique(0)}, level=0)
    y = y.set_axis(X.index).rename(IMAGE)
    X.attrs["units"] = {"e": "deg", SCRIPT: IMAGE, BOLD: SCRIPT}
    y.attrs["units"] = {IMAGE: BOLD}
    return report(
        OperatorRegressor(),
        X,
        y,
        effects=["bias", "dead_zone"],
        title=f"Report {BOLD} {IMAGE} {SCRIPT}",
        source=f"{SCRIPT} {IMAGE}",
        made_with={SCRIPT: BOLD, IMAGE: SCRIPT},
    )


@pytest.fixture(scope="session")
def path(page, tmp_path_factory):
    return page.save(tmp_path_factory.mktemp("report") / "report.html")


def test_it_loads_without_complaint_or_network(browser, path):
    browser.open(path)
    assert browser.console() == []
    assert browser.requests() == []
    links = browser.js(
        "return [...document.querySelectorAll('[src], [href], [*|href]')]"
        ".map(l => l.getAttribute('src') ?? l.getAttribute('href') ?? l.href.baseVal)"
    )
    assert links
    assert [link for link in links if not link.startswith(("#", "data:"))] == []


def test_without_a_search_it_loads_without_complaint(browser, tmp_path):
    X, y = make_tracking_runs(n_runs=2, remnant_intensity=0.1, sampling_rate=50, random_state=0)
    model = RecursiveARX(nk=15, memory_horizon=256).fit(X, y)
    browser.open(report(model, X, y).save(tmp_path / "report.html"))
    assert browser.console() == []
    assert browser.violations() == []


def test_every_link_has_its_target(browser, path):
    browser.open(path)
    dead = browser.js(
        "return [...document.querySelectorAll('a[href^=\"#\"]')].map(a => a.hash)"
        ".filter(hash => !document.getElementById(hash.slice(1)))"
    )
    assert dead == []


def test_names_from_the_data_are_only_text(browser, path):
    browser.open(path)
    browser.js("document.querySelectorAll('b, #steps a').forEach(b => b.click())")
    assert browser.js("return document.scripts.length") == 2  # with that of the data, which is none
    assert browser.js("return document.querySelectorAll('b, img').length") == 0
    assert browser.js("return window.hacked === undefined")
    text = browser.js("return document.body.textContent")
    for name in (SCRIPT, IMAGE, BOLD):
        assert name in text


def test_one_step_at_a_time_by_mouse(browser, path):
    browser.open(path)
    tabs = browser.driver.find_elements("css selector", "#steps [role=tablist] > [role=tab]")
    assert len(tabs) == 3  # the baseline and two effects
    for n in (2, 0, 1):
        tabs[n].click()
        assert browser.js(SHOWN) == [i == n for i in range(3)]
        assert browser.js(SELECTED) == [i == n for i in range(3)]
        assert browser.js("return document.activeElement") == tabs[n]


def test_tabs_and_panels_name_each_other(browser, path):
    browser.open(path)
    pairs = browser.js(
        "return [...document.querySelectorAll('[role=tab]')].map(tab => {"
        "  const panel = document.getElementById(tab.getAttribute('aria-controls'));"
        "  return [panel.getAttribute('role'), panel.getAttribute('aria-labelledby') === tab.id];"
        "})"
    )
    assert pairs == [["tabpanel", True]] * (3 + 4)  # the steps, and those of the component


def test_steps_by_keyboard(browser, path):
    from selenium.webdriver import Keys

    browser.open(path)
    keys = "return [...document.querySelectorAll('#steps [role=tab]')].map(t => t.tabIndex)"
    assert browser.js(keys) == [-1, -1, 0]  # the result first
    while not browser.js("return document.activeElement.matches('[role=tab]')"):
        browser.press(Keys.TAB)
    for key, n in (
        (Keys.ARROW_LEFT, 1),
        (Keys.ARROW_RIGHT, 2),
        (Keys.ARROW_RIGHT, 2),
        (Keys.ARROW_LEFT, 1),
        (Keys.HOME, 0),
        (Keys.ARROW_LEFT, 0),
        (Keys.END, 2),
    ):
        browser.press(key)
        assert browser.js(SHOWN) == [i == n for i in range(3)]
        assert browser.js(SELECTED) == [i == n for i in range(3)]
        style, width = browser.js(
            "const s = getComputedStyle(document.activeElement);"
            "return [s.outlineStyle, parseFloat(s.outlineWidth)]"
        )
        assert style != "none"
        assert width >= 2
    browser.press(Keys.TAB)  # from the tab to what it shows
    assert browser.js("return document.activeElement.id") == "step-2"


def test_a_link_to_a_step_shows_that_step(browser, path):
    for address, shown in (("#step-0", 0), ("#data", 2), ("#nothing", 2)):
        browser.driver.get("about:blank")
        browser.driver.get(path.as_uri() + address)
        assert browser.js(SHOWN) == [i == shown for i in range(3)]
    browser.js("location.hash = '#step-1'")
    assert browser.js(SHOWN) == [False, True, False]


def test_arrows_walk_the_steps_from_anywhere_on_the_page(browser, path):
    from selenium.webdriver import Keys

    browser.open(path)
    browser.press(Keys.ARROW_LEFT)
    assert browser.js(SHOWN) == [False, True, False]
    browser.js("document.querySelector('.sk-tab[aria-selected=true]').focus()")
    browser.press(Keys.ARROW_RIGHT)  # the component's own tabs
    assert browser.js("return document.activeElement.textContent") == "Frequency response"
    assert browser.js(SHOWN) == [False, True, False]


def test_a_link_opens_the_part_that_it_leads_to(browser, path):
    browser.open(path)
    folded = "return document.querySelector('#ranking > details').open"
    assert browser.js(folded) is False
    browser.driver.find_element("css selector", 'nav a[href="#ranking"]').click()
    assert browser.js(folded) is True


def test_it_opens_on_fifteen_seconds(browser, path):
    from selenium.webdriver.support.ui import WebDriverWait

    browser.open(path)
    WebDriverWait(browser.driver, 20).until(
        lambda _: browser.js("return document.querySelector('.sk-row [aria-disabled=false]')")
    )
    usable = browser.js(
        "return [...document.querySelectorAll('.sk-window-row .sk-button')]"
        ".filter((b) => b.ariaDisabled !== 'true').map((b) => b.textContent)"
    )
    assert usable == ["Whole run"]


def test_without_scripts_all_steps_are_there(browser, path):
    browser.open(path, scripts=False)
    assert browser.js(SHOWN) == [True, True, True]
    assert browser.js("return document.querySelectorAll('[role=tab]').length") == 0
    assert browser.console() == []


@pytest.mark.parametrize("width", [320, 400, 768, 1400])
def test_it_fits_the_window_and_can_be_read(browser, path, width):
    browser.open(path, width=width)
    for n in range(3):
        browser.js("document.querySelectorAll('#steps [role=tab]')[arguments[0]].click()", n)
        assert browser.overflow() <= 0
        letters = browser.js(LETTERS)
        assert letters
        if width >= 400:
            assert [(size, text) for size, text in letters if size < 9] == []
    assert browser.js("return parseFloat(getComputedStyle(document.body).fontSize)") >= 14


def test_tables_are_whole_on_a_telephone(browser, path):
    browser.open(path, width=400)
    browser.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
    over = browser.js(
        "return [...document.querySelectorAll('.scroll')].map((e) => e.scrollWidth - e.clientWidth)"
    )
    assert over
    assert max(over) <= 0
    assert browser.overflow() <= 0


def test_long_names_leave_room_in_a_table(browser, path):
    browser.open(path)
    browser.js("document.querySelector('#data > details').open = true")
    of_column = browser.js(
        "const cell = document.querySelector('#data tbody th');"
        "cell.textContent = 'long_name_'.repeat(10);"
        "return cell.getBoundingClientRect().width"
    )
    assert 100 < of_column < 300


@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1400])
def test_accessible(browser, path, width, colours):
    browser.open(path, width=width, colours=colours)
    browser.js("document.querySelectorAll('details').forEach(d => { d.open = true })")
    assert browser.violations() == []


def test_printed_whole(browser, path):
    browser.open(path)
    unfolded = "return document.querySelectorAll('details[open]').length"
    before = browser.js(unfolded)
    paper = "".join(browser.paper().split())
    hidden = "return [...document.querySelectorAll('.step > p, details li strong')]"
    texts = browser.js(hidden + ".map(p => p.textContent)")
    assert [text for text in texts if "".join(text.split()) not in paper] == []
    assert browser.js(SHOWN) == [False, False, True]
    assert browser.js(unfolded) == before


def test_steps_in_a_notebook(browser, page, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(NOTEBOOK.format(page._repr_html_()), encoding="utf-8")
    browser.open(path)
    browser.driver.switch_to.frame(0)
    browser.driver.find_elements("css selector", "#steps [role=tab]")[1].click()
    assert browser.js(SHOWN) == [False, True, False]
    assert browser.console() == []
