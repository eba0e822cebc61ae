"""The component as one script and one style sheet, as a page, and as a widget of a notebook."""

from __future__ import annotations

import base64
import hashlib
import threading
from collections.abc import Callable
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from ... import Comparison
from ...text import rendered
from .exploration import Exploration
from .payloads import pack, pack_text, payload_of_comparison, payload_of_exploration

HEIGHT = 900  # px, of a frame
SHOW = """
skhoidBench.wire
  .unpackText(document.querySelector(".sk-payload").textContent)
  .then((found) => {
    const host = document.querySelector(".sk-host");
    skhoidBench.mount(host, found.view, skhoidBench.staticBackend(found));
  });
"""
OFFERED = ("mount", "numbers", "wire", "staticBackend", "widgetBackend")
HOW = 'explore() needs anywidget: pip install "skhoid[notebook]".'
ENTRY = """
const PATIENCE = 3000;  // ms, in which a kernel that is not busy answers
async function render({ model, el }) {
  const host = document.createElement("div");
  const { jpThemeLight, vscodeThemeKind } = document.body.dataset;
  if (jpThemeLight || vscodeThemeKind) {
    const dark = jpThemeLight === "false" || /dark/.test(vscodeThemeKind ?? "");
    host.dataset.theme = dark ? "dark" : "light";
  }
  el.append(host);
  let mounted = null;
  let gone = false;
  const show = (view, backend) => {
    if (gone) return;
    if (mounted) mounted.destroy();
    mounted = skhoidBench.mount(host, view, backend);
  };
  const showStored = async () => {
    const found = await skhoidBench.wire.unpackText(model.get("payload"));
    if (!mounted) show(found.view, skhoidBench.staticBackend(found));
  };
  if (!model.get("computes")) await showStored();
  else {
    const backend = skhoidBench.widgetBackend(model);
    const answered = backend.call("view", {}).then(({ view }) => show(view, backend));
    await Promise.race([answered, new Promise((done) => setTimeout(done, PATIENCE))]);
    if (!mounted && model.get("payload")) await showStored();
  }
  return () => {
    gone = true;
    if (mounted) mounted.destroy();
  };
}
export default { render };
"""


@cache
def script() -> str:
    """All scripts as one, which defines ``skhoidBench``."""
    names = _text("order.txt").split()
    body = "\n".join(_text(name) for name in names)
    offered = ", ".join(OFFERED)
    return (
        f'const skhoidBench = (() => {{\n"use strict";\n{body}\nreturn {{ {offered} }};\n}})();\n'
    )


@cache
def style() -> str:
    """All style sheets as one."""
    return "\n".join(_text(name) for name in ("uplot.min.css", "bench.css"))


def page(payload: str, title: str) -> str:
    """A packed payload as a page of its own, which needs no network."""
    return rendered(
        __name__,
        "page.html.j2",
        title=title,
        style=style(),
        payload=payload,
        script=script() + SHOW,
        script_hash=hash_script(script() + SHOW),
    )


def framed(payload: str, title: str) -> str:
    """The same in a frame, for notebooks without a kernel."""
    return (
        f'<iframe srcdoc="{escape(page(payload, title))}" title="{escape(title)}" '
        f'sandbox="allow-scripts allow-downloads" loading="lazy" '
        f'style="width: 100%; height: {HEIGHT}px; border: 1px solid #ccc"></iframe>'
    )


def hash_script(text: str) -> str:
    """By which a page's policy knows the only script that may run."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _text(name: str) -> str:
    return files(__package__).joinpath("static").joinpath(name).read_text(encoding="utf-8")


# In a notebook: an anywidget whose kernel computes.


def of_exploration(exploration: Exploration) -> Any:
    """A widget that computes with the kernel."""
    widget = _widget(lambda: payload_of_exploration(exploration), computes=True)
    widget.on_msg(_Answers(widget, exploration).heard)
    widget.exploration = exploration
    return widget


def of_comparison(found: Comparison) -> Any:
    """A widget of a comparison, which needs no computing."""
    return _widget(lambda: payload_of_comparison(found), computes=False)


def _widget(payload_of: Callable[[], dict[str, Any]], computes: bool) -> Any:
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise ImportError(HOW) from error

    class Explorer(anywidget.AnyWidget):
        _esm = script() + ENTRY
        _css = style()
        payload = traitlets.Unicode("").tag(sync=True)
        computes = traitlets.Bool().tag(sync=True)

        def _repr_html_(self) -> str:
            """What is shown where no kernel is, and kept for where the state of widgets is."""
            found = payload_of()
            self.payload = pack_text(found)
            return framed(self.payload, found["view"]["title"] or "Exploration")

    return Explorer(payload="" if computes else pack_text(payload_of()), computes=computes)


class _Answers:
    """Answers what the page asks; what takes long comes later, in a thread of its own."""

    def __init__(self, widget: Any, exploration: Exploration):
        self.widget, self.exploration = widget, exploration
        self._judging = threading.Lock()

    def heard(self, _: Any, content: Any, __: Any) -> None:
        number, name, args = content["id"], content["name"], content["args"]
        reply: dict[str, Any]
        try:
            reply = {"reply": self._reply(name, args)}
        except (ValueError, OSError) as error:
            reply = {"error": str(error)}
        self._send(number, reply)
        if name not in ("drag", "preview", "trace", "script", "model", "linear"):
            threading.Thread(target=self._judge, daemon=True).start()

    def _reply(self, name: str, args: dict[str, Any]) -> dict[str, Any]:
        if name != "view":
            return self.exploration.act(name, args)
        view = self.exploration.view()
        can = {**view["can"], **dict.fromkeys(("search", "report", "session", "people"), False)}
        return {"view": {**view, "can": can}}

    def _judge(self) -> None:
        """Find the noise ceiling, unless another thread does, and tell the page."""
        with self._judging:
            revision = self.exploration.revision
            self.exploration.judge()
            if self.exploration.revision != revision:
                self._send(None, {"state": self.exploration.state()})

    def _send(self, number: int | None, value: dict[str, Any]) -> None:
        self.widget.send({"id": number}, buffers=[pack(value)])
