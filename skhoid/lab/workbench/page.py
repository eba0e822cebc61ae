"""The page around the component."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from ..._version import __version__
from ...text import rendered

__all__ = ["page", "static"]


@cache
def page() -> str:
    """The page, the same for every session: what is open is asked for by its script."""
    return rendered(__name__, "static/index.html.j2", version=__version__)


@cache
def static(name: str) -> str:
    """A file of the page."""
    return files(__package__).joinpath("static").joinpath(name).read_text(encoding="utf-8")
