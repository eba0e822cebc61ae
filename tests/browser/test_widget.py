"""The notebook's widget in a browser: its module, rendered, with the kernel at the other end."""

import base64
import json
import time

import pytest

from skhoid import EffectSearchCV, OperatorRegressor, compare, make_tracking_runs
from skhoid.effects import Bias

By = pytest.importorskip("selenium.webdriver.common.by").By

pytest.importorskip("anywidget")

# What anywidget does for a module, and a model whose messages wait for the test to carry them.
PAGE = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>Notebook</title><style>{css}</style></head>
<body><main><h1>Notebook</h1><div id="cell"></div></main>
<script type="module">
const listeners = new Set();
window.asked = [];
const model = {{
  get: (name) => ({{ payload: {payload}, computes: {computes} }})[name],
  send: (content) => window.asked.push(content),
  on: (_, heard) => listeners.add(heard),
  off: (_, heard) => listeners.delete(heard),
}};
window.answer = (content, text) => {{
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const whole = new Uint8Array(bytes.length + 5);
  whole.set(bytes, 5);  // as views into a longer message are
  for (const heard of listeners) heard(content, [new DataView(whole.buffer, 5)]);
}};
const source = new Blob([{esm}], {{ type: "text/javascript" }});
const widget = (await import(URL.createObjectURL(source))).default;
window.ended = await widget.render({{ model, el: document.getElementById("cell") }});
</script></body>
</html>"""


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1",
        2,
        effects=Bias(level=0.1),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        duration=40.96,
        remnant_intensity=0.05,
        random_state=3,
    )


class Cell:
    """A page with the widget; ``wait`` carries messages between page and kernel meanwhile."""

    def __init__(self, browser, widget, path):
        self.driver, self.widget, self.browser = browser.driver, widget, browser
        self.replies = []
        widget.send = lambda content, buffers=None: self.replies.append((content, buffers[0]))
        page = PAGE.format(
            css=widget._css,
            esm=in_script(widget._esm),
            payload=in_script(widget.payload),
            computes=in_script(widget.computes),
        )
        path.write_text(page, encoding="utf-8")
        browser.open(path)

    def wait(self, done):
        for _ in range(400):
            for asked in self.driver.execute_script("return window.asked?.splice(0) ?? []"):
                self.widget._handle_custom_msg(asked, [])
            while self.replies:
                content, buffer = self.replies.pop(0)
                text = base64.b64encode(buffer).decode()
                self.driver.execute_script("window.answer(...arguments)", content, text)
            if found := done():
                return found
            time.sleep(0.05)
        raise AssertionError(self.driver.find_element(By.TAG_NAME, "body").text)

    def all(self, selector):
        return [e for e in self.driver.find_elements(By.CSS_SELECTOR, selector) if e.is_displayed()]


def in_script(text):
    return json.dumps(text).replace("</", "<\\/")


@pytest.fixture
def searched(runs):
    return EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone"]).fit(*runs)


def test_the_kernel_computes_what_is_clicked(browser, searched, runs, tmp_path):
    widget = searched.explore(*runs)
    cell = Cell(browser, widget, tmp_path / "notebook.html")
    cell.wait(lambda: cell.all(".sk-plot canvas"))
    [remove] = cell.wait(lambda: cell.all('[aria-label="Remove bias"]'))  # it opens at the result
    remove.click()
    cell.wait(lambda: cell.all('[aria-label="Add bias"]'))
    assert "bias" not in widget.exploration.model.effects_.names
    vaf = widget.exploration.state()["vaf"]["train"]
    assert cell.all(".sk-step-vaf")[-1].text == f"VAF {vaf:.1f} %"
    cell.wait(lambda: not widget.exploration.state()["ceiling_pending"])
    assert browser.console() == []
    assert browser.violations() == []
    browser.js("window.ended()")
    assert cell.all(".sk-bench") == []


def test_a_saved_notebook_shows_the_combinations_until_a_kernel_answers(
    browser, searched, runs, tmp_path
):
    widget = searched.explore(*runs)
    widget._repr_html_()  # as the notebook does when it shows the cell
    cell = Cell(browser, widget, tmp_path / "notebook.html")

    browser.driver.implicitly_wait(10)  # s; nobody carries messages meanwhile
    [remove] = browser.driver.find_elements(By.CSS_SELECTOR, '[aria-label="Remove bias"]')
    browser.driver.implicitly_wait(0)
    remove.click()
    assert cell.all('[aria-label="Add bias"]')
    assert browser.console() == []
    assert browser.violations() == []
    cell.wait(
        lambda: cell.all('[aria-label="Remove bias"]')
    )  # the kernel has answered: the model is its own again
    assert "bias" in widget.exploration.model.effects_.names


def test_a_comparison_is_shown_without_the_kernel(browser, runs, tmp_path):
    widget = compare(OperatorRegressor().fit(*runs), *runs).explore()
    cell = Cell(browser, widget, tmp_path / "notebook.html")
    cell.wait(lambda: cell.all(".sk-plot canvas"))
    assert browser.js("return window.asked.length") == 0
    assert browser.console() == []
    assert browser.violations() == []


def test_where_no_kernel_is_the_combinations_are_shown(browser, searched, runs, tmp_path):
    path = tmp_path / "exported.html"
    shown = searched.explore(*runs)._repr_html_()
    head = '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>N</title></head>'
    path.write_text(f"{head}<body><main><h1>N</h1>{shown}</main></body></html>", encoding="utf-8")
    browser.open(path)
    frame = browser.driver.find_element(By.TAG_NAME, "iframe")
    browser.driver.switch_to.frame(frame)
    for _ in range(100):
        found = browser.driver.find_elements(By.CSS_SELECTOR, '[aria-label="Remove bias"]')
        if found:
            break
        time.sleep(0.05)
    found[0].click()
    assert browser.driver.find_elements(By.CSS_SELECTOR, '[aria-label="Add bias"]')
    browser.driver.switch_to.default_content()
    assert browser.console() == []
    assert browser.requests() == []
