"""``skhoid workbench`` in a real browser, with its own server: from a file to a report and back."""

import os
import re
import resource
import signal
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support.chromium import first_written

from skhoid import (
    Decimator,
    DelayShift,
    FrequencyResponse,
    OperatorRegressor,
    RunInTrimmer,
    SimulatedARX,
    VAFScorer,
    make_tracking_runs,
    read_runs,
)
from skhoid.effects import Bias, DeadZone

By = pytest.importorskip("selenium.webdriver.common.by").By
Keys = pytest.importorskip("selenium.webdriver.common.keys").Keys
Select = pytest.importorskip("selenium.webdriver.support.ui").Select

pytest.importorskip("uvicorn")

EVIL = '"><img src=x onerror="window.hacked=1">'
PATIENCE = 120.0  # s
EFFECTS = ["--effects", "bias", "dead_zone", "saturation"]
# At once: what is drawn anew between two questions would be stale.
USABLE = """
return [...document.querySelectorAll(arguments[0])].find(
  (e) => e.checkVisibility() && !e.disabled && e.ariaDisabled !== "true") ?? null;
"""
COUNT_CLICKS = """
window.clicks = 0;
window.typed = 0;
addEventListener("click", (e) => { if (e.isTrusted && e.detail > 0) window.clicks += 1; }, true);
addEventListener("keydown", (e) => { if (e.isTrusted) window.typed += 1; }, true);
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A file as a lab has it."""
    X, y = make_tracking_runs(
        "C1",
        3,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        remnant_intensity=0.05,
        random_state=11,
    )
    table = X.assign(stick=y).reset_index()
    names = {"run": "trial", "time": "Time [s]", "e": "Tracking error (deg)"}
    path = tmp_path_factory.mktemp("lab") / "subject 7.csv"
    table.rename(columns={**names, "x": "pitch", "f_t": "target"}).to_csv(path, index=False)
    return path


def limit_files(largest):
    """No file may become larger, in bytes: the kernel refuses, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))


class Served:
    """The command in a process of its own, and the page in the browser."""

    def __init__(self, browser, session, *arguments, largest=None):
        command = [sys.executable, "-m", "skhoid", "workbench", *map(str, arguments)]
        command += ["--no-browser", "--session", str(session), *EFFECTS]
        limited = None if largest is None else partial(limit_files, largest)
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, text=True, preexec_fn=limited
        )
        self.url = re.search(r"http://\S+", self.process.stdout.readline())[0]
        self.browser, self.driver = browser, browser.driver

    def open(self, **how):
        self.browser.open(self.url, **how)
        self.browser.js(COUNT_CLICKS)
        return self

    def end(self, how=signal.SIGTERM):
        if self.process.poll() is None:
            os.kill(self.process.pid, how)
        self.process.wait()
        self.process.stdout.close()

    def wait(self, done, patience=PATIENCE):
        end = time.monotonic() + patience
        while time.monotonic() < end:
            if found := done():
                return found
            time.sleep(0.05)
        raise AssertionError(self.text())

    def text(self):
        return self.browser.js("return document.body.innerText")

    def one(self, selector):
        """The element, once it is there, seen and usable."""

        return self.wait(lambda: self.browser.js(USABLE, selector))

    def state(self):
        """VAF of each step of the stair, and all that the engine says."""
        return self.browser.driver.execute_async_script(
            "const done = arguments[0];"
            "fetch('api/state', {method: 'POST', body: '{\"run\": 0}',"
            " headers: {'Content-Type': 'application/json'}})"
            ".then((reply) => reply.arrayBuffer())"
            ".then((buffer) => skhoidBench.wire.unpack(buffer))"
            ".then(({ state }) => done(JSON.stringify(state)))"
        )

    def stair(self):
        return self.browser.js(
            "return [...document.querySelectorAll('.sk-step-vaf')].map((e) => e.textContent)"
        )

    def named(self):
        return self.wait(lambda: "Missing:" in self.text() and "Add dead zone" in self.labels())

    def labels(self):
        return self.browser.js(
            "return [...document.querySelectorAll('[aria-label]')]"
            ".filter((e) => e.checkVisibility()).map((e) => e.getAttribute('aria-label'))"
        )


@pytest.fixture
def serve(browser, tmp_path):
    running = []

    def start(*arguments, session=tmp_path / "session", **how):
        running.append(Served(browser, session, *arguments, **how))
        return running[-1]

    yield start
    for served in running:
        served.end()


def write_script(served):
    return served.driver.execute_async_script(
        "fetch('api/script.py').then((r) => r.text()).then(arguments[0])"
    )


def measure_vaf(state):
    return float(re.search(r'"vaf":\{"train":([-\d.e]+)', state)[1])


def test_from_a_csv_to_a_saved_report_and_the_same_numbers(serve, recorded, tmp_path):
    served = serve().open()
    served.one("#chooser").send_keys(str(recorded))  # the first click
    served.one("#fit-search").click()
    served.named()
    start = served.stair()
    served.wait(lambda: "The search has ended." in served.text())
    tops = served.browser.js(
        "return [...document.querySelectorAll('.sk-candidate button')]"
        ".filter((e) => e.checkVisibility()).map((e) => e.getBoundingClientRect().bottom)"
    )
    assert tops[0] <= 900  # of a window of 1400 x 900
    served.one('[data-sk-key="keep"]').click()
    add = served.one('[data-sk-key="add named"]')
    assert add.text == "Add both"
    add.click()
    served.wait(lambda: {"Remove bias", "Remove dead zone"} <= {*served.labels()})
    served.one('[data-sk-key="line 1"]').click()  # the model without, beside it
    models = served.one(".sk-models").text
    assert "this model: bias and dead zone" in models
    assert "1: baseline" in models
    served.browser.command(
        "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path)
    )
    served.one('[aria-label="Save output over time"]').click()
    served.one('[aria-label="Save output over time as SVG"]').click()
    drawn = served.wait(lambda: next(tmp_path.glob("*.svg"), None)).read_text(encoding="utf-8")
    assert all(f">{name}<" in drawn for name in ("measured", "simulated", "1: baseline"))
    assert served.one(".sk-kept-keys").text == "1: baseline"
    served.one('[data-sk-key="report"]').click()
    path = served.wait(
        lambda: re.search(r"report is saved: (\S.*report\.html)", served.text()) or None
    )[1]
    assert served.browser.js("return window.clicks") + 1 <= 8
    assert served.browser.js("return window.typed") == 0
    served.one('[data-sk-key="keep"]').click()  # and does not draw it
    served.wait(lambda: "2: bias and dead zone" in served.one(".sk-models").text)
    served.one('[aria-label="Save output over time"]').click()
    served.one('[aria-label="Save output over time as CSV"]').click()
    traces = served.wait(lambda: next(tmp_path.glob("*.csv"), None)).read_text(encoding="utf-8")
    assert '"residual","1: baseline","2: bias and dead zone",' in traces
    assert served.text().count("Found and added: bias (") == 1
    state = served.state()
    assert len(served.stair()) == 3
    script = write_script(served)
    (tmp_path / "script.py").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    printed = float(re.search(r"VAF, runs fitted: ([-\d.e]+)", done.stdout)[1])
    assert printed == measure_vaf(state)
    served.one('[data-sk-key="undo"]').click()
    served.wait(lambda: served.stair() == start)
    assert served.browser.console() == []
    origin = served.url.partition("/?")[0]
    assert [u for u in served.browser.requests() if not u.startswith((origin, "blob:"))] == []
    served.end()
    served.browser.open(tmp_path / path)
    assert "dead zone" in served.driver.find_element(By.CSS_SELECTOR, ".headline").text
    assert served.browser.console() == []


def test_files_are_dropped_on_the_page(serve, recorded):
    served = serve().open()
    served.one("#chooser")
    served.browser.js(
        "const data = new DataTransfer();"
        "data.items.add(new File([arguments[0]], 'subject 7.csv'));"
        "for (const kind of ['dragover', 'drop']) document.querySelector('main').dispatchEvent("
        "new DragEvent(kind, { dataTransfer: data, bubbles: true, cancelable: true }));",
        recorded.read_text(encoding="utf-8"),
    )
    served.one("#fit")
    assert "subject_7.csv" in served.one("#opened").text
    assert served.browser.console() == []


def test_the_linear_part_follows_the_model(serve, recorded, tmp_path):
    """What is saved is the library's to the last digit, also of a kept model and after a drag."""
    served = serve(recorded).open()
    served.one("#fit").click()
    served.one('[data-sk-key="keep"]').click()
    served.one('[aria-label="Add bias"]').click()
    served.wait(lambda: "Remove bias" in served.labels())
    served.one('[data-sk-key="line 1"]').click()
    served.browser.command(
        "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path)
    )

    def save(name):
        for old in tmp_path.glob("*.csv"):
            old.unlink()
        served.one(f'[aria-label="Save {name}"]').click()
        served.one(f'[aria-label="Save {name} as CSV"]').click()
        return pd.read_csv(served.wait(lambda: first_written(tmp_path, "*.csv")))

    served.one('[data-sk-key="tab Frequency response"]').click()
    served.wait(lambda: "The points are measured" in served.text())
    table = save("gain over frequency")
    X, y = read_runs(recorded)
    for name, effects in {"gain": ["bias"], "1: baseline: gain": None}.items():
        model = OperatorRegressor(effects=effects).fit(X, y)
        found = FrequencyResponse.of(model, table["frequency, rad/s"])
        np.testing.assert_allclose(table[name], found.magnitude, rtol=1e-12)
    assert table["from the runs: coherence"].notna().sum() > 3
    before = table["gain"]
    slider = served.one('[data-sk-key="slider K_e"]')
    served.driver.execute_script("arguments[0].focus()", slider)
    served.browser.press(*[Keys.ARROW_RIGHT] * 5)
    served.wait(lambda: "Undo: move K_e" in served.text())
    served.wait(lambda: (save("gain over frequency")["gain"] > before).all())
    assert save("gain over frequency")["gain, low (95 %)"].isna().all()
    assert served.browser.console() == []


def write(served, field, text):
    """Type into a field, and leave it."""
    box = served.one(f"#{field}")
    box.clear()
    box.send_keys(text, Keys.TAB)


@pytest.mark.slow  # a server
def test_preparation_is_shown_fitted_and_copied(serve, recorded, tmp_path):
    served = serve(recorded).open()
    served.one("#fit")
    write(served, "run_in", "90")
    served.wait(lambda: "Run 0 lasts 81.92 s: give less." in served.one("#run_in-hint").text)
    assert served.one("#run_in").get_attribute("aria-invalid") == "true"
    top = served.one("#decimate").location["y"]
    write(served, "run_in", "8")
    served.wait(lambda: served.one("#steps").text == "run-in 8 s → operator")
    assert served.one("#decimate").location["y"] == top  # nothing has moved
    assert served.one("#run_in").get_attribute("aria-invalid") == "false"
    write(served, "decimate", "2")
    Select(served.one("#core")).select_by_value("arx")
    write(served, "shift", "0.28")
    steps = "run-in 8 s → one row in 2 (25 Hz) → delay 0.28 s → ARX 2, 2, 0"
    served.wait(lambda: served.one("#steps").text == steps)
    assert served.browser.violations() == []
    served.one("#fit").click()
    assert served.one(".sk-preparation").text == steps
    fitted = measure_vaf(served.state())
    table = pd.read_csv(recorded)
    X = table.set_index(["trial", "Time [s]"]).rename_axis(["run", "time"])
    y = X.pop("stick")
    steps = RunInTrimmer(8.0), Decimator(2), DelayShift(0.28, inputs=["Tracking error (deg)"])
    roles = {"Tracking error (deg)": "e", "pitch": "x", "target": "f_t"}
    model = SimulatedARX(inputs=["Tracking error (deg)"], roles=roles)
    pipeline = make_pipeline(*steps, model).fit(X, y)
    assert fitted == pytest.approx(VAFScorer()(pipeline, X, y), abs=1e-9)
    (tmp_path / "script.py").write_text(write_script(served), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert float(re.search(r"VAF, runs fitted: ([-\d.e]+)", done.stdout)[1]) == fitted
    assert served.browser.console() == []


@pytest.mark.slow  # a server
def test_structures_stand_side_by_side(serve, recorded):
    """ARX 2, 2, 9 and the operator in one session, each with the library's VAF and its line."""
    served = serve(recorded).open()
    served.one("#fit").click()

    def choose(core, *orders):
        Select(served.one('[data-sk-key="core"]')).select_by_value(core)
        for name, order in zip(("na", "nb", "nk"), orders, strict=False):
            box = served.one(f'[data-sk-key="order {name}"]')
            box.clear()
            box.send_keys(order)

    choose("arx", "2", "2", "9")
    box = served.one('[data-sk-key="order nk"]')
    top = box.location["y"]
    box.send_keys(Keys.ENTER)
    served.wait(lambda: served.one(".sk-preparation").text == "ARX 2, 2, 9")
    assert box.location["y"] == top  # nothing has moved
    served.one('[data-sk-key="keep"]').click()
    served.wait(lambda: "1: ARX 2, 2, 9, baseline" in served.one(".sk-models").text)
    choose("operator")
    assert not box.is_enabled()
    served.one('[data-sk-key="fit structure"]').click()
    served.wait(lambda: "this model: operator, baseline" in served.one(".sk-models").text)
    served.one('[data-sk-key="line 1"]').click()
    served.wait(lambda: served.one(".sk-kept-keys").text == "1: ARX 2, 2, 9, baseline")
    X, y = read_runs(recorded)
    models = OperatorRegressor(), SimulatedARX(nk=9, settling=3.0)
    vaf = [f"{VAFScorer(run_in=3.0)(model.fit(X, y), X, y):.1f}" for model in models]
    shown = [cell.text for cell in served.driver.find_elements(By.CSS_SELECTOR, ".sk-models td")]
    assert shown == vaf
    served.one('[data-sk-key="tab Poles"]').click()
    served.wait(lambda: {"this", "1"} <= {*served.one(".sk-poles").text.split()})
    assert served.browser.violations() == []
    assert served.browser.console() == []


@pytest.mark.slow  # a server
def test_what_a_fit_refuses_is_said_beside_its_field(serve, recorded):
    served = serve(recorded).open()
    served.one("#fit")
    write(served, "decimate", "1500")
    served.one("#fit").click()
    served.wait(lambda: "Too few rows are left." in served.one("#decimate-hint").text)
    assert served.browser.js("return document.activeElement.id") == "decimate"
    assert served.browser.violations() == []
    write(served, "decimate", "1")
    served.one("#fit").click()
    served.one('[aria-label="Add bias"]')


def focus_on(served, selector, most=80):
    """Press Tab until the focus is there."""
    for _ in range(most):
        if served.browser.js("return document.activeElement.matches(arguments[0])", selector):
            return
        served.browser.press(Keys.TAB)
    raise AssertionError(f"Tab does not reach {selector}.")


@pytest.mark.slow  # a server and a search
def test_by_keyboard_alone(serve, recorded):
    served = serve(recorded).open()
    served.one("#fit-search")
    focus_on(served, "#fit-search")
    served.browser.press(Keys.ENTER)
    served.named()
    for effect in ("bias", "dead zone"):
        focus_on(served, f'[aria-label="Add {effect}"]', most=200)
        served.browser.press(Keys.ENTER)
        served.wait(lambda name=effect: f"Remove {name}" in served.labels())
    before = served.stair()
    focus_on(served, 'input[type="range"]', most=200)
    served.browser.press(Keys.ARROW_RIGHT)
    served.wait(
        lambda: served.browser.js(
            "return !document.querySelector('[data-sk-key=refit]').ariaDisabled"
            " || document.querySelector('[data-sk-key=refit]').ariaDisabled === 'false'"
        )
    )
    focus_on(served, '[data-sk-key="undo"]', most=300)
    served.browser.press(Keys.ENTER)
    served.wait(lambda: served.stair() == before)
    focus_on(served, '[data-sk-key="limits"]', most=300)
    assert "would show (90 %)" not in served.text()
    served.browser.press(Keys.ENTER)
    served.wait(lambda: "would show (90 %)" in served.text())
    assert re.search(r"at (most|least) .*points\)", served.text())
    focus_on(served, '[data-sk-key="report"]', most=300)
    served.browser.press(Keys.ENTER)
    served.wait(lambda: "report is saved" in served.text())


@pytest.mark.slow  # a server, killed
def test_killed_in_mid_search_it_comes_back_as_it_was(serve, recorded, tmp_path):
    served = serve(recorded).open()
    served.one("#fit").click()
    served.one('[aria-label="Add bias"]').click()
    served.wait(lambda: "Remove bias" in served.labels())
    before = measure_vaf(served.state())
    served.one('[data-sk-key="search"]').click()
    time.sleep(0.5)
    served.end(signal.SIGKILL)
    served.wait(lambda: "does not answer" in served.text())
    again = serve().open()
    again.wait(lambda: "Remove bias" in again.labels())
    assert measure_vaf(again.state()) == before
    assert "was not finished" in again.text()


@pytest.mark.slow  # a server with no room for a report
def test_a_report_that_finds_no_room_is_said_and_nothing_is_lost(serve, recorded, tmp_path):
    served = serve(recorded, largest=300_000).open()
    served.one("#fit").click()
    served.one('[aria-label="Add bias"]').click()
    served.wait(lambda: "Remove bias" in served.labels())
    before = served.stair()
    served.one('[data-sk-key="report"]').click()
    served.wait(lambda: "The report was not saved" in served.text())
    assert "make room" in served.text()
    left = {path.name for path in (tmp_path / "session").iterdir()}
    assert not [name for name in left if "report" in name]
    served.one('[data-sk-key="undo"]').click()  # and it goes on
    served.wait(lambda: len(served.stair()) == 1)
    served.wait(lambda: "The report was not saved" not in served.text())
    served.one('[data-sk-key="redo"]').click()
    served.wait(lambda: served.stair() == before)


@pytest.mark.slow  # a server for each
@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1400])
def test_hostile_names_at_each_stage(serve, recorded, tmp_path, width, colours):
    path = tmp_path / "hostile.csv"
    text = recorded.read_text(encoding="utf-8")
    quoted = EVIL.replace('"', '""')
    path.write_text(text.replace("pitch", f'"pitch {quoted}"', 1), encoding="utf-8")
    served = serve(path).open(width=width, colours=colours)
    served.one("#fit")
    for stage in ("columns", "model"):
        if stage == "model":
            served.one("#fit").click()
            served.one('[aria-label="Add bias"]')
            served.one('[data-sk-key="tab Frequency response"]').click()
            served.wait(lambda: "responds to" in served.text())
        assert served.browser.violations() == []
        assert served.browser.overflow() <= 0
        assert served.browser.js("return window.hacked === undefined")
    assert EVIL in served.browser.js("return document.body.textContent")
    assert served.browser.console() == []


@pytest.fixture(scope="module")
def people_recorded(tmp_path_factory):
    """Four people in one file, each with a wider dead zone than the one before."""
    parts = []
    for person in range(4):
        X, y = make_tracking_runs(
            "C1",
            2,
            duration=20.48,
            effects=DeadZone(width=0.2 + 0.1 * person),
            channels=["e", "x", "f_t"],
            sampling_rate=50,
            remnant_intensity=0.05,
            random_state=person,
        )
        parts.append(X.assign(u=y, subject=f"P{person + 1}").reset_index())
    path = tmp_path_factory.mktemp("lab") / "people.csv"
    pd.concat(parts).to_csv(path, index=False)
    return path


def shown_people(served):
    """Texts of the panels."""
    return served.browser.js(
        "return [...document.querySelectorAll('.sk-person-panel')].map((e) => e.innerText)"
    )


@pytest.mark.slow  # a server, and fits
def test_people_stand_side_by_side(serve, people_recorded, tmp_path):
    served = serve(people_recorded).open()
    served.one("#fit").click()
    served.one('[aria-label="Add dead zone"]').click()
    served.wait(lambda: "Remove dead zone" in served.labels())
    served.one('[data-sk-key="people"]').click()
    served.one('[data-sk-key="fit people"]').click()
    served.wait(lambda: "4 of 4 fitted with: dead zone." in served.text())
    served.wait(lambda: all("VAF" in text for text in shown_people(served)))
    served.browser.command(
        "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path)
    )
    served.one('[aria-label="Save the people as CSV"]').click()
    path = served.wait(lambda: next(tmp_path.glob("people*.csv"), None))
    table = pd.read_csv(path).set_index(["quantity", "person"])
    width = table.loc["dead_zone__width"]
    assert list(width.index) == ["P1", "P2", "P3", "P4"]
    assert (width["low"] < width["value"]).all()
    assert width["value"].is_monotonic_increasing
    for person, vaf in table.loc["VAF", "value"].items():
        assert any(f"{person}\nVAF {vaf:.1f} %" in text for text in shown_people(served))
    drawn = served.browser.js(
        "return [...document.querySelectorAll('.sk-dots')].map((e) => e.ariaLabel"
        " || e.getAttribute('aria-label'))"
    )
    assert any(text.startswith("dead_zone__width") for text in drawn)
    panels = served.driver.find_elements(By.CSS_SELECTOR, ".sk-person-panel")
    panels[2].click()
    served.wait(lambda: "P3" in served.one(".sk-run-title").text)
    assert served.browser.violations() == []
    served.one('[aria-label="Remove dead zone"]').click()
    served.wait(lambda: "The present model is another: fit each person again" in served.text())
    assert served.browser.console() == []


@pytest.mark.slow  # a server for each
@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [400, 1024, 1400])
def test_people_by_keyboard_at_each_width(serve, people_recorded, width, colours):
    served = serve(people_recorded).open(width=width, colours=colours)
    served.one("#fit").click()
    served.one('[data-sk-key="people"]')
    focus_on(served, '[data-sk-key="people"]', most=300)
    served.browser.press(Keys.ENTER)
    focus_on(served, '[data-sk-key="fit people"]')
    served.browser.press(Keys.ENTER)
    served.wait(lambda: "4 of 4 fitted with: baseline." in served.text())
    served.wait(lambda: all("VAF" in text for text in shown_people(served)))
    focus_on(served, '[data-sk-key="panel P4"]')
    served.browser.press(Keys.ENTER)
    served.wait(lambda: "P4" in served.one(".sk-run-title").text)
    assert served.browser.overflow() <= 0
    assert served.browser.violations() == []
    assert served.browser.console() == []
