"""The component by hand: effects, brushes, keyboard, hostile names, narrow and dark."""

import copy
import io
import re
import time
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from support.chromium import first_written

from skhoid import EffectSearchCV, OperatorRegressor, compare, make_tracking_runs, vaf_score
from skhoid.effects import Bias, DeadZone
from skhoid.interpret import FrequencyResponse, pole_table, step_response
from skhoid.lab.explore import component
from skhoid.lab.explore import payloads as wire
from skhoid.lab.explore.payloads import payload_of, payload_of_comparison
from skhoid.lab.explore.view import AWAY

ActionChains = pytest.importorskip("selenium.webdriver").ActionChains
By = pytest.importorskip("selenium.webdriver.common.by").By
Keys = pytest.importorskip("selenium.webdriver.common.keys").Keys

EVIL = "\"><img src=x onerror='window.hacked=1'></script>\u202e"
LONG = "very " * 60


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1",
        3,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        remnant_intensity=0.05,
        random_state=3,
    )


@pytest.fixture(scope="module")
def search(runs):
    return EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone"]).fit(*runs)


@pytest.fixture(scope="module")
def fitted(search):
    return search.best_estimator_


@pytest.fixture(scope="module")
def payload(search, runs):
    payload = payload_of(search, None, *runs)
    payload["view"]["title"] = "A person"  # which a report says itself
    return payload


class Hand:
    """A page with the component, and what hands and eyes do in it."""

    def __init__(self, browser, path, payload, **how):
        path.write_text(component.page(wire.pack_text(payload), "Bench"), encoding="utf-8")
        self.browser, self.driver = browser, browser.driver
        browser.open(path, **how)
        self.wait(lambda: self.all(".sk-plot .uplot canvas"))

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def wait(self, done):
        for _ in range(200):
            if found := done():
                return found
            time.sleep(0.05)
        raise AssertionError("It did not come.")

    def labelled(self, label):
        [one] = self.all(f'[aria-label="{label}"]')
        return one

    def plot(self, name):
        [one] = self.all(f'.sk-plot[data-sk-key="plot {name}"]')
        return one

    def sentences(self):
        return [one.text for one in self.all(".sk-sentence")]

    def said(self, pattern):
        """The groups of a pattern in what is said below the plots, once it is there."""
        found = self.wait(
            lambda: next((m for s in self.sentences() if (m := re.search(pattern, s))), None)
        )
        return found.groups()

    def chord(self, *keys):
        """Press keys together."""
        *held, last = keys
        actions = ActionChains(self.driver)
        for key in held:
            actions.key_down(key)
        actions.send_keys(last)
        for key in held:
            actions.key_up(key)
        actions.perform()

    def type_range(self, name, low, high):
        for end, value in (("from", low), ("to", high)):
            box = next(
                one
                for one in self.all(".sk-range input")
                if one.get_attribute("aria-label").startswith(f"{name} {end}")
            )
            box.clear()
            box.send_keys(f"{value}", Keys.TAB)

    def stair(self):
        return [
            float(re.search(r"VAF ([\d.]+) %", one.text)[1]) for one in self.all(".sk-step-vaf")
        ]


@pytest.fixture
def hand(browser, tmp_path, payload):
    return Hand(browser, tmp_path / "page.html", payload)


def shown(states, key):
    return [round(step["vaf"], 1) for step in states[key]["stair"]]


def test_effects_are_taken_away_and_added_again(hand, payload):
    states = payload["states"]
    assert hand.stair() == shown(states, "bias,dead_zone")
    hand.labelled("Remove bias").click()
    hand.wait(lambda: hand.stair() == shown(states, "dead_zone"))
    hand.labelled("Remove dead zone").click()
    hand.wait(lambda: hand.stair() == shown(states, ""))
    hand.labelled("Add bias").click()
    hand.wait(lambda: hand.stair() == shown(states, "bias"))
    for _ in range(3):
        hand.chord(Keys.CONTROL, "z")
    hand.wait(lambda: hand.stair() == shown(states, "bias,dead_zone"))
    hand.chord(Keys.CONTROL, Keys.SHIFT, "z")
    hand.wait(lambda: hand.stair() == shown(states, "dead_zone"))
    assert hand.browser.console() == []


def test_what_happened_is_said(hand):
    hand.labelled("Remove bias").click()
    [status] = hand.all("[role=status]")
    hand.wait(lambda: "bias" in status.text)


def test_a_window_has_the_vaf_of_the_library(hand, runs, payload):
    hand.type_range("Window", 30, 60)
    _, y = (part.loc[[0]] for part in runs)
    simulated = payload["traces"][0]["simulated"]["bias,dead_zone"]
    time_of = y.index.get_level_values("time")
    rows = (time_of >= 30 - 1e-9) & (time_of <= 60 + 1e-9)
    expected = vaf_score(y[rows], simulated[rows])
    found = float(hand.said(r"VAF ([\d.]+) %.* 1,50\d rows")[0])
    assert found == pytest.approx(expected, abs=0.11)


def test_a_window_is_dragged_and_cleared(hand):
    hand.said("Whole run: ")
    plot = hand.plot("time")
    ActionChains(hand.driver).move_to_element_with_offset(plot, -50, 0).click_and_hold().pause(
        0.05
    ).move_by_offset(120, 0).release().perform()
    hand.wait(lambda: not any(s.startswith("Whole run") for s in hand.sentences()))
    boxes = [one.get_attribute("value") for one in hand.all(".sk-window-row input")]
    assert all(boxes)
    hand.browser.press(Keys.ESCAPE)
    hand.said("Whole run: ")


def test_a_window_is_moved_by_keyboard(hand):
    plot = hand.plot("time")
    hand.driver.execute_script("arguments[0].focus()", plot)
    hand.browser.press(Keys.ARROW_RIGHT)
    first = hand.wait(
        lambda: [
            float(v) for b in hand.all(".sk-window-row input") if (v := b.get_attribute("value"))
        ]
    )

    def values():
        return [float(b.get_attribute("value")) for b in hand.all(".sk-window-row input")]

    # Pressed until it moves: while an answer is drawn, a key may come to nothing.
    hand.wait(lambda: hand.browser.press(Keys.ARROW_RIGHT) or values()[0] > first[0])
    wide = np.ptp(values())
    hand.chord(Keys.SHIFT, Keys.ARROW_RIGHT)
    hand.wait(lambda: np.ptp(values()) > wide)
    hand.browser.press(Keys.ESCAPE)
    hand.said("Whole run: ")


def test_a_band_is_linked_to_time(hand, runs, payload):
    hand.type_range("Band", 1.0, 4.0)
    share = float(hand.said(r"([\d.]+) % of the residual")[0])
    r = runs[1].loc[0].to_numpy() - payload["traces"][0]["simulated"]["bias,dead_zone"]
    spectrum = np.abs(np.fft.rfft(r - r.mean(), 4096)) ** 2
    omega = 2 * np.pi * np.fft.rfftfreq(4096, 0.02)
    inside = (omega >= 1.0) & (omega <= 4.0)
    assert share == pytest.approx(100 * spectrum[inside].sum() / spectrum.sum(), abs=1.0)


def test_the_residual_over_lag_is_that_of_numpy(hand, runs, payload, saved):
    hand.said("Whole run: ")
    hand.browser.js("arguments[0].value = 'lag 0'", select := hand.all(".sk-pair select")[0])
    hand.browser.js("arguments[0].dispatchEvent(new Event('change'))", select)
    hand.wait(lambda: any(s.startswith("It follows e most after") for s in hand.sentences()))
    assert hand.browser.violations() == []
    hand.labelled("Save residual over lag").click()
    content = saved("Save residual over lag as CSV", "*.csv")
    table = pd.read_csv(io.BytesIO(content))
    trace = payload["traces"][0]
    scored = np.flatnonzero(trace["scored"])
    rows = slice(scored[0], scored[-1] + 1)
    r = (trace["measured"] - trace["simulated"]["bias,dead_zone"])[rows]
    e = runs[0]["e"].loc[0].to_numpy()[rows]
    r, e = r - r.mean(), e - e.mean()
    scale = np.sqrt((r @ r) * (e @ e))
    assert table["lag, s"].iloc[-1] == pytest.approx(2.0)
    for k in (0, 10, 50):  # at 50 Hz
        row = table.iloc[(table["lag, s"] - 0.02 * k).abs().argmin()]
        assert row["with e"] == pytest.approx(r[k:] @ e[: len(e) - k] / scale, abs=0.003)
        assert row["with itself"] == pytest.approx(r[k:] @ r[: len(r) - k] / (r @ r), abs=0.003)


def test_amplitudes_are_linked_to_time(hand):
    hand.type_range("Amplitudes", 0.5, 5.0)
    rows, share = hand.said(r"([\d,]+) rows.*?([\d.]+) %|([\d.]+) %.*?([\d,]+) rows")[:2]
    assert rows is not None or share is None


def test_runs_are_shown_one_after_the_other(hand):
    hand.labelled("Next run").click()
    hand.wait(lambda: "1" in hand.all(".sk-run-title")[0].text)
    hand.all("button.sk-run")[2].click()
    hand.wait(lambda: "2" in hand.all(".sk-run-title")[0].text)


def test_window_and_zoom_stay_from_run_to_run(hand):
    hand.type_range("Window", 30, 60)
    [zoom] = [b for b in hand.all(".sk-window-row .sk-button") if b.text == "Zoom to window"]
    zoom.click()
    hand.labelled("Next run").click()
    hand.wait(lambda: "1" in hand.all(".sk-run-title")[0].text)
    hand.said("Window, 30 to 60 s: ")
    [whole] = [b for b in hand.all(".sk-window-row .sk-button") if b.text == "Whole run"]
    assert whole.get_attribute("aria-disabled") == "false"


def test_keyboard_reaches_everything_and_the_focus_is_seen(hand):
    """Tab from the top meets all that can be operated, each with an outline."""
    hand.browser.js("document.body.tabIndex = -1; document.body.focus()")
    keys, seen = set(), 0
    wanted = hand.browser.js(
        "return [...document.querySelectorAll('button, input, select, summary, [tabindex=\"0\"]')]"
        ".filter(e => e.checkVisibility({visibilityProperty: true}) && !e.disabled)"
        ".filter(e => e.tabIndex === 0).length"
    )
    for _ in range(wanted + 5):
        hand.browser.press(Keys.TAB)
        label, outline = hand.browser.js(
            "const e = document.activeElement; const s = getComputedStyle(e);"
            "e.dataset.met ??= Math.random(); return [e === document.body ? '' : e.dataset.met,"
            "s.outlineStyle !== 'none' && parseFloat(s.outlineWidth) > 0 || s.boxShadow !== 'none']"
        )
        if label and label not in keys:
            keys.add(label)
            seen += outline
    assert len(keys) >= wanted
    assert seen == len(keys)


@pytest.fixture
def saved(hand, tmp_path):
    """Saves something, and returns the text or bytes of its file."""
    folder = tmp_path / "saved"
    hand.browser.command("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder))

    def save(label, name):
        hand.labelled(label).click()
        return hand.wait(lambda: first_written(folder, name)).read_bytes()

    return save


def test_a_plot_is_saved_as_picture_and_as_numbers(hand, payload, saved):
    for kind in ("SVG", "PNG", "CSV"):
        hand.labelled("Save output over time").click()
        if kind == "SVG":
            assert hand.browser.violations() == []
        content = saved(f"Save output over time as {kind}", f"*.{kind.lower()}")
        if kind == "SVG":
            drawn = ElementTree.fromstring(content)
            words = " ".join(drawn.itertext())
            assert all(name in words for name in ("measured", "simulated", "u, deg"))
            lines = [one.get("d", "") for one in drawn.iter("{http://www.w3.org/2000/svg}path")]
            assert sum(line.count("L") > 500 for line in lines) == 2  # 15 s at 50 Hz each
        elif kind == "PNG":
            assert content.startswith(b"\x89PNG")
        else:
            table = pd.read_csv(io.BytesIO(content))
            assert [*table] == ["time, s", "measured u", "simulated", "residual", "e", "x", "f_t"]
            measured = payload["traces"][0]["measured"]
            np.testing.assert_allclose(table["measured u"], measured, atol=1e-4)
    assert hand.browser.console() == []


def test_tables_are_saved_as_csv(hand, payload, saved):
    runs = pd.read_csv(io.BytesIO(saved("Save the runs as CSV", "runs.csv")))
    assert [*runs["use"]] == ["fitted"] * 3
    assert [*runs["VAF, %"]] == pytest.approx(payload["states"]["bias,dead_zone"]["run_vaf"])
    table = pd.read_csv(io.BytesIO(saved("Save the parameters as CSV", "parameters.csv")))
    assert {"K_e", "tau_e", "dead_zone__width"} <= {*table["parameter"]}
    assert table.set_index("parameter")["value"]["dead_zone__width"] == pytest.approx(0.3, abs=0.03)


def test_the_curve_of_an_effect_and_the_stair_are_saved(hand, payload, saved):
    state = payload["states"]["bias,dead_zone"]
    words = {"curve of dead zone": "without it", "error that remains": "noise ceiling"}
    for what, word in words.items():
        for kind in ("SVG", "PNG"):
            hand.labelled(f"Save {what}").click()
            content = saved(f"Save {what} as {kind}", f"{what.replace(' ', '-')}.{kind.lower()}")
            drawn = " ".join(ElementTree.fromstring(content).itertext()) if kind == "SVG" else word
            assert word in drawn
    hand.labelled("Save curve of dead zone").click()
    table = pd.read_csv(io.BytesIO(saved("Save curve of dead zone as CSV", "curve*.csv")))
    [line] = state["effects"][1]["curve"]["lines"]
    np.testing.assert_allclose(table.iloc[:, 1], line["y"], atol=np.ptp(line["y"]) / 65_533)
    hand.labelled("Save error that remains").click()
    table = pd.read_csv(io.BytesIO(saved("Save error that remains as CSV", "error*.csv")))
    assert [*table["step"]] == ["baseline", "bias", "dead zone"]
    assert [*table["VAF, %"]] == [step["vaf"] for step in state["stair"]]
    assert hand.browser.console() == []


def chosen_tab(hand):
    """The tab that is chosen, and the names of the panels that are seen."""
    seen = "return [...document.querySelectorAll('[role=tabpanel]')].filter("
    seen += "(e) => e.checkVisibility({visibilityProperty: true})).map("
    seen += "(e) => document.getElementById(e.getAttribute('aria-labelledby')).textContent)"
    [tab] = hand.all('[role="tab"][aria-selected="true"]')
    return tab.text, hand.browser.js(seen)


def test_tabs_by_mouse_and_by_keyboard(hand):
    """One panel is seen at a time, none moves what is below, and arrows go round."""
    names = [tab.text for tab in hand.all('[role="tab"]')]
    assert names == ["Spectrum and residual", "Frequency response", "Poles", "Step response"]
    below = "return [document.documentElement.scrollHeight, document.body.scrollWidth]"
    before = hand.browser.js(below)
    for tab, name in zip(hand.all('[role="tab"]'), names, strict=True):
        tab.click()
        assert chosen_tab(hand) == (name, [name])
        hand.wait(lambda: hand.sentences())
        assert hand.browser.js(below) == before
    hand.browser.press(Keys.ARROW_RIGHT)
    assert chosen_tab(hand) == (names[0], [names[0]])
    hand.browser.press(Keys.END)
    hand.browser.press(Keys.ARROW_LEFT)
    assert chosen_tab(hand) == (names[2], [names[2]])
    assert hand.browser.js("return document.activeElement.textContent") == names[2]


def test_the_linear_part_is_read_and_saved_as_the_library_has_it(hand, fitted, saved):
    hand.all('[role="tab"]')[1].click()
    hand.wait(lambda: "gain" in (hand.plot("gain").get_attribute("aria-label") or ""))
    hand.browser.js("arguments[0].focus()", hand.plot("gain"))
    hand.browser.press(Keys.HOME)
    first = FrequencyResponse.of(fitted, [0.1])
    said = hand.wait(lambda: hand.all(".sk-status")[0].text)
    assert float(re.search(r"gain ([\d.]+)", said)[1]) == pytest.approx(
        first.magnitude[0], rel=6e-3
    )
    hand.labelled("Save gain over frequency").click()
    table = pd.read_csv(io.BytesIO(saved("Save gain over frequency as CSV", "gain*.csv")))
    found = FrequencyResponse.of(fitted, table["frequency, rad/s"])
    np.testing.assert_allclose(table["gain"], found.magnitude, rtol=1e-5)
    np.testing.assert_allclose(table["phase, deg"], found.phase, rtol=1e-4, atol=1e-2)
    high = found.magnitude * np.exp(1.96 * found.magnitude_sd / found.magnitude)
    np.testing.assert_allclose(table["gain, high (95 %)"], high, rtol=1e-5)
    hand.all('[role="tab"]')[2].click()
    hand.labelled("Save poles").click()
    table = pd.read_csv(io.BytesIO(saved("Save poles as CSV", "poles*.csv")))
    poles = pole_table(fitted)
    np.testing.assert_allclose(table["frequency, rad/s"], poles["frequency"])
    np.testing.assert_allclose(table["standard error of the damping"], poles["sd_damping"])
    hand.all('[role="tab"]')[3].click()
    hand.labelled("Save step response").click()
    table = pd.read_csv(io.BytesIO(saved("Save step response as CSV", "step*.csv")))
    step = step_response(fitted, table["time, s"])["output"]
    np.testing.assert_allclose(table["response"], step, atol=1e-5)
    hand.labelled("Save step response").click()
    drawn = ElementTree.fromstring(saved("Save step response as SVG", "step*.svg"))
    assert "95 % interval" in " ".join(drawn.itertext())
    assert hand.browser.console() == []


def test_a_comparison_of_any_model_has_no_tabs(browser, tmp_path, runs):
    found = compare(OperatorRegressor().fit(*runs), *runs)
    hand = Hand(browser, tmp_path / "page.html", payload_of_comparison(found))
    assert hand.all('[role="tab"]') == []
    assert hand.plot("spectrum").is_displayed()


def test_what_the_operator_saw_is_beside_the_output(hand):
    """Inputs stand on the same axis of time: what is brushed there is brushed everywhere."""
    key = hand.all(".sk-toggle")
    assert [one.text for one in key] == ["e", "x", "f_t"]
    key[1].click()
    assert key[1].get_attribute("aria-pressed") == "false"
    hand.browser.js("arguments[0].scrollIntoView({block: 'center'})", hand.plot("inputs"))
    ActionChains(hand.driver).move_to_element_with_offset(
        hand.plot("inputs"), -60, 0
    ).click_and_hold().pause(0.05).move_by_offset(120, 0).release().perform()
    hand.said(r"Window, ([\d.]+) to")
    shades = [one.get_attribute("style") for one in hand.all(".sk-window")[:3]]
    assert len({*shades}) == 1
    assert "width" in shades[0]


@pytest.fixture(scope="module")
def hostile(runs):
    X, y = runs
    X = X.rename(columns={"x": EVIL, "f_t": LONG})
    X = X.rename(index={0: EVIL, 1: LONG, 2: "\u202e \U0001f600"}, level=0)
    y = y.set_axis(X.index).rename(EVIL)
    X.attrs["units"], y.attrs["units"] = {"e": EVIL, LONG: LONG}, {EVIL: LONG}
    return payload_of_comparison(compare(OperatorRegressor(effects=["bias"]).fit(X, y), X, y))


@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1400])
@pytest.mark.parametrize("which", ["payload", "hostile"])
def test_all_can_be_read(browser, tmp_path, request, which, width, colours):
    payload = request.getfixturevalue(which)
    hand = Hand(browser, tmp_path / "page.html", payload, width=width, colours=colours)
    assert browser.console() == []
    assert browser.requests() == []
    assert browser.overflow() <= 0
    assert browser.violations() == []
    for tab in hand.all('[role="tab"]')[1:]:
        tab.click()
        time.sleep(0.2)  # it is drawn in a later frame
        assert browser.violations() == []
        assert browser.overflow() <= 0
    assert browser.js("return window.hacked === undefined")
    sizes = browser.js(
        "return [...document.querySelectorAll('.sk-bench *')].filter(e => e.checkVisibility() &&"
        "[...e.childNodes].some(c => c.nodeType === 3 && c.textContent.trim()))"
        ".map(e => parseFloat(getComputedStyle(e).fontSize))"
    )
    assert min(sizes) >= 12
    assert hand.all(".sk-alert")[0].text == ""


def test_holes_in_the_data(browser, tmp_path, runs):
    X, y = (part.loc[[0]].copy() for part in runs)
    model = OperatorRegressor().fit(X, y)
    y.iloc[1000:2500] = np.nan
    X.iloc[500:505] = np.nan
    with pytest.warns(UserWarning, match="NaN"):
        payload = payload_of_comparison(compare(model, X, y))
    hand = Hand(browser, tmp_path / "page.html", payload)
    assert browser.console() == []
    hand.type_range("Window", 22, 28)
    hand.wait(
        lambda: any("no row" in s.lower() or "nothing" in s.lower() for s in hand.sentences())
    )
    assert len(hand.all("button.sk-run")) == 1


@pytest.mark.slow  # large pages
def test_a_million_rows_and_a_hundred_runs(browser, tmp_path, payload):
    """What the component is told directly, larger than a report would be."""
    few = payload["traces"][0]
    n = 1_000_000
    rng = np.random.default_rng(0)
    big = {
        **few,
        "measured": rng.normal(size=n),
        "scored": np.ones(n, dtype=bool),
        "channels": {"e": rng.normal(size=n)},
        "simulated": dict.fromkeys(payload["states"], rng.normal(size=n) * 0.1),
    }
    view = {**payload["view"]}
    view["runs"] = [{"label": f"run {i}", "n": n, "person": None} for i in range(100)]
    states = {
        key: {**state, "uses": ["train"] * 100, "run_vaf": [50.0] * 100}
        for key, state in payload["states"].items()
    }
    empty = {**few, **dict.fromkeys(["measured", "scored", "channels", "simulated"])}
    view["state"] = states[payload["start"]]
    large = {"view": view, "start": payload["start"], "states": states}
    hand = Hand(browser, tmp_path / "page.html", {**large, "traces": [big] + [empty] * 99})
    assert len(hand.all("button.sk-run")) == 100
    hand.said(r"1,000,000 rows|999,\d+ rows")
    hand.type_range("Window", 100, 9000)
    hand.said(r"VAF -?[\d.]+|VAF −[\d.]+")
    assert browser.console() == []


def test_a_model_that_runs_away_is_said_and_drawn_in_bounds(browser, tmp_path, payload):
    key = payload["start"]
    state = {**payload["states"][key], "impossible": AWAY, "vaf": {"train": -1000.0, "hold": None}}
    state["stair"] = [*state["stair"][:-1], {**state["stair"][-1], "vaf": -1000.0}]
    traces = [
        {**trace, "simulated": {**trace["simulated"], key: 1e100 * trace["measured"]}}
        for trace in payload["traces"]
    ]
    view = {**payload["view"], "state": state}
    states = {**payload["states"], key: state}
    hand = Hand(
        browser,
        tmp_path / "page.html",
        {"view": view, "start": key, "states": states, "traces": traces},
    )
    assert AWAY in hand.all(".sk-stair")[0].text
    assert browser.console() == []
    hand.labelled("Remove bias").click()
    hand.wait(lambda: AWAY not in hand.all(".sk-stair")[0].text)


def test_people_stand_above_their_runs(browser, tmp_path, payload):
    view = {
        **payload["view"],
        "people": [{"name": EVIL, "runs": [0, 1]}, {"name": "B", "runs": [2]}],
    }
    view["runs"] = [{**run, "person": EVIL if i < 2 else "B"} for i, run in enumerate(view["runs"])]
    hand = Hand(browser, tmp_path / "page.html", {**payload, "view": view})
    assert EVIL.split("\u202e")[0] in hand.all(".sk-runs")[0].text
    assert isinstance(pd.Series(hand.stair()).sum(), float)


def shade_and_window(hand):
    """Left and right of the brush on screen, and where its seconds are on the axis that is seen."""
    seen = hand.browser.js(
        "const over = document.querySelector('.sk-plot[data-sk-key=\"plot time\"] .u-over');"
        "const shade = over.querySelector('.sk-window').getBoundingClientRect();"
        "const box = over.getBoundingClientRect();"
        "return [shade.left - box.left, shade.right - box.left, box.width]"
    )
    return np.array(seen)


def test_the_brush_is_where_its_seconds_are_after_a_zoom(hand):
    """Drag a window, zoom to it, zoom out again: the shade follows the axis at once."""
    plot = hand.plot("time")
    ActionChains(hand.driver).move_to_element_with_offset(plot, -60, 0).click_and_hold().pause(
        0.05
    ).move_by_offset(120, 0).release().perform()
    hand.wait(lambda: any(s.startswith("Window") for s in hand.sentences()))
    [zoom] = [b for b in hand.all(".sk-window-row .sk-button") if b.text == "Zoom to window"]
    zoom.click()
    hand.browser.js("return new Promise((go) => requestAnimationFrame(() => setTimeout(go, 50)))")
    left, right, width = shade_and_window(hand)
    assert (left, right) == pytest.approx((0, width), abs=3)
    hand.browser.js("arguments[0].focus()", plot)
    hand.browser.press("-")  # twice as much of the run: the window is its middle half
    hand.browser.js("return new Promise((go) => requestAnimationFrame(() => setTimeout(go, 50)))")
    left, right, width = shade_and_window(hand)
    assert (left, right) == pytest.approx((width / 4, 3 * width / 4), abs=3)


WHERE = """
const top = (e) => e.getBoundingClientRect().top;
const kinds = '.sk-part :is(.sk-plot, .sk-card, .sk-steps, .sk-head, .sk-group)';
const parts = [...document.querySelectorAll(kinds)]
  .filter((e) => e.checkVisibility())
  .map((e) => [e.className, Math.round(top(e) - top(e.closest('.sk-part')))]);
return [document.documentElement.scrollHeight, ...parts];
"""


def test_no_word_of_a_name_and_no_figure_is_cut(browser, tmp_path, payload):
    payload = copy.deepcopy(payload)
    for state in payload["states"].values():
        state["stair"][-1]["title"] = "second neuromuscular mode"
    hand = Hand(browser, tmp_path / "page.html", payload, width=1024)
    ActionChains(hand.driver).move_to_element(hand.plot("time")).perform()
    hand.wait(lambda: hand.all(".sk-readout")[0].text)
    cut = "return [...document.querySelectorAll(arguments[0])].filter("
    cut += "(e) => e.scrollWidth > e.clientWidth || e.scrollHeight > e.clientHeight + 1).length"
    assert hand.all(".sk-step-name")[-1].text == "second neuromuscular mode"
    assert browser.js(cut, ".sk-step-name, .sk-number, .sk-readout") == 0


def test_a_tall_stair_does_not_cover_the_cards(browser, tmp_path, payload):
    payload = copy.deepcopy(payload)
    for state in payload["states"].values():
        state["ceiling"]["note"] = "Of the best model of the search. " * 6
    hand = Hand(browser, tmp_path / "page.html", payload, width=1400)
    placed = "return getComputedStyle(document.querySelector('.sk-stair')).position"
    assert browser.js(placed) == "sticky"
    [about] = [one for one in hand.all(".sk-stair summary") if one.text.startswith("About")]
    about.click()
    hand.wait(lambda: browser.js(placed) == "static")
    about.click()
    hand.wait(lambda: browser.js(placed) == "sticky")


@pytest.mark.parametrize("width", [400, 1024, 1400])
def test_nothing_moves_under_the_pointer(browser, tmp_path, payload, width):
    """The read-out, a preview and a window leave everything in its place, so that clicks hit."""
    hand = Hand(browser, tmp_path / "page.html", payload, width=width)
    hand.labelled("Remove dead zone").click()
    hand.wait(lambda: len(hand.stair()) == 2)
    before = browser.js(WHERE)
    for over in (hand.plot("time"), hand.plot("residual"), hand.all(".sk-candidate")[0]):
        ActionChains(hand.driver).move_to_element(over).perform()
        hand.wait(
            lambda: "VAF" in hand.all(".sk-reserved")[0].text or hand.all(".sk-readout")[0].text
        )
        assert browser.js(WHERE) == before
    plot = hand.plot("time")
    ActionChains(hand.driver).move_to_element_with_offset(plot, -60, 0).click_and_hold().pause(
        0.05
    ).move_by_offset(120, 0).release().perform()
    hand.wait(lambda: any(s.startswith("Window") for s in hand.sentences()))
    assert browser.js(WHERE) == before
