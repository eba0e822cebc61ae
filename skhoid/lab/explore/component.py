"""The component as one script and one style sheet, from the files in ``static``."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from html import escape
from importlib.resources import files

from ...text import rendered

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
        script_hash=hash_of(script() + SHOW),
    )


def framed(payload: str, title: str) -> str:
    """The same in a frame, for notebooks without a kernel."""
    return (
        f'<iframe srcdoc="{escape(page(payload, title))}" title="{escape(title)}" '
        f'sandbox="allow-scripts" loading="lazy" '
        f'style="width: 100%; height: {HEIGHT}px; border: 1px solid #ccc"></iframe>'
    )


def hash_of(text: str) -> str:
    """By which a page's policy knows the only script that may run."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"


def _text(name: str) -> str:
    return files(__package__).joinpath("static").joinpath(name).read_text(encoding="utf-8")
