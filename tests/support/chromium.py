"""A page in a headless Chromium, for the tests in ``browser``."""

import base64
import io
import json
import os
import unicodedata

import pytest

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]


NOTEBOOK = """<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>Notebook</title></head>
<body><main><h1>Notebook</h1>{}</main></body>
</html>"""


def missing(what):
    """Skip, but fail where SKHOID_BROWSER=required: CI must not skip unnoticed."""
    if os.environ.get("SKHOID_BROWSER") == "required":
        pytest.fail(f"missing: {what}")
    pytest.skip(f"missing: {what}")


def first_written(folder, pattern):
    """The first file that the browser has saved there; it begins with an empty one."""
    return next((path for path in folder.glob(pattern) if path.stat().st_size), None)


class Browser:
    """One page at a time: what it logs, what it asks the network for, how it looks."""

    def __init__(self, driver, axe):
        self.driver = driver
        self._axe = axe

    def open(self, page, *, width=1400, colours="light", scripts=True):
        """Load a file or an address; console and network are of this page from here on."""
        from selenium.webdriver.support.ui import WebDriverWait

        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        self.command("Emulation.setScriptExecutionDisabled", value=not scripts)
        self.emulate(colours)
        self.driver.get("about:blank")  # the page before may be of the same file
        for log in ("browser", "performance"):
            self.driver.get_log(log)
        self.driver.get(page if isinstance(page, str) else page.as_uri())
        WebDriverWait(self.driver, 60).until(
            lambda _: self.js("return document.readyState") == "complete"
        )

    def emulate(self, colours="light"):
        features = [{"name": "prefers-color-scheme", "value": colours}]
        self.command("Emulation.setEmulatedMedia", media="", features=features)

    def command(self, name, **parameters):
        return self.driver.execute_cdp_cmd(name, parameters)

    def js(self, code, *arguments):
        return self.driver.execute_script(code, *arguments)

    def press(self, *keys):
        from selenium.webdriver import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()

    def console(self):
        """Warnings and errors."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self):
        """What was asked for beside the page itself and what is inside it."""
        events = [json.loads(e["message"])["message"] for e in self.driver.get_log("performance")]
        page = self.driver.current_url.partition("#")[0]
        urls = [
            event["params"]["request"]["url"]
            for event in events
            if event["method"] == "Network.requestWillBeSent"
        ]
        return [url for url in urls if not url.startswith((page, "data:", "about:"))]

    def overflow(self):
        """Pixels by which the page is wider than the window."""
        return self.js("const e = document.documentElement; return e.scrollWidth - e.clientWidth")

    def violations(self):
        """What axe-core objects to, with the first elements concerned."""
        self.js(self._axe)
        found = self.driver.execute_async_script(
            "const done = arguments[1];"
            "axe.run({runOnly: arguments[0]}).then(r => done(r.violations), e => done(String(e)))",
            RULES,
        )
        assert isinstance(found, list), found
        return [
            (rule["id"], rule["help"], [node["html"][:200] for node in rule["nodes"][:3]])
            for rule in found
        ]

    def paper(self):
        """The text of the printed page."""
        from pypdf import PdfReader

        pdf = base64.b64decode(self.command("Page.printToPDF")["data"])
        text = "\n".join(page.extract_text() for page in PdfReader(io.BytesIO(pdf)).pages)
        return unicodedata.normalize("NFKD", text)  # ligatures apart
