"""The component in a notebook: an anywidget whose kernel computes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from ...diagnosis.comparison import Comparison
from . import component, wire
from .exploration import Exploration
from .payloads import payload_of_comparison, payload_of_exploration

HOW = 'explore() needs anywidget: pip install "skhoid[notebook]".'
ENTRY = """
async function render({ model, el }) {
  const host = document.createElement("div");
  el.append(host);
  const sent = model.get("payload");
  const found = sent ? await skhoidBench.wire.unpackText(sent) : null;
  const backend = found ? skhoidBench.staticBackend(found) : skhoidBench.widgetBackend(model);
  const view = found ? found.view : (await backend.call("view", {})).view;
  const mounted = skhoidBench.mount(host, view, backend);
  return () => mounted.destroy();
}
export default { render };
"""


def of_exploration(exploration: Exploration) -> Any:
    """A widget that computes with the kernel."""
    widget = _widget("", lambda: payload_of_exploration(exploration))
    widget.on_msg(_Answers(widget, exploration).heard)
    widget.exploration = exploration
    return widget


def of_comparison(found: Comparison) -> Any:
    """A widget of a comparison, which needs no computing."""
    payload = payload_of_comparison(found)
    return _widget(wire.pack_text(payload), lambda: payload)


def _widget(packed: str, payload_of: Callable[[], dict[str, Any]]) -> Any:
    try:
        import anywidget
        import traitlets
    except ImportError as error:
        raise ImportError(HOW) from error

    class Explorer(anywidget.AnyWidget):
        _esm = component.script() + ENTRY
        _css = component.style()
        payload = traitlets.Unicode("").tag(sync=True)

        def _repr_html_(self) -> str:
            """What is shown where no kernel is: in an exported notebook, say."""
            found = payload_of()
            return component.framed(wire.pack_text(found), found["view"]["title"] or "Exploration")

    return Explorer(payload=packed)


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
        if name not in ("drag", "preview", "trace", "script"):
            threading.Thread(target=self._judge, daemon=True).start()

    def _reply(self, name: str, args: dict[str, Any]) -> dict[str, Any]:
        if name != "view":
            return self.exploration.act(name, args)
        view = self.exploration.view()
        can = {**view["can"], "search": False, "report": False, "session": False}
        return {"view": {**view, "can": can}}

    def _judge(self) -> None:
        """Find the noise ceiling, unless another thread does, and tell the page."""
        with self._judging:
            revision = self.exploration.revision
            self.exploration.judge()
            if self.exploration.revision != revision:
                self._send(None, {"state": self.exploration.state()})

    def _send(self, number: int | None, value: dict[str, Any]) -> None:
        self.widget.send({"id": number}, buffers=[wire.pack(value)])
