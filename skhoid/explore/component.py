"""The component as one script and one style sheet, from the files in ``static``."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

OFFERED = ("mount", "numbers", "wire", "staticBackend", "serverBackend", "widgetBackend")


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


def _text(name: str) -> str:
    return files(__package__).joinpath("static").joinpath(name).read_text(encoding="utf-8")
