"""What all reports share: a page that is one file, and how it was made."""

from __future__ import annotations

import platform
import webbrowser
from datetime import UTC, datetime
from functools import cached_property
from html import escape
from importlib.metadata import version
from importlib.resources import files
from os import PathLike
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from sklearn.base import BaseEstimator

from ..._version import __version__
from ...io import written_whole
from ...runs import fingerprint_of
from ...text import rendered
from ..explore import component

LIBRARIES = ("numpy", "scipy", "scikit-learn", "pandas", "numba", "matplotlib")


def provenance(model: Any, X: Any, y: Any, made_with: dict[str, str] | None) -> dict[str, str]:
    """What is needed to make the same report again, by name."""
    stated = {name[:1].upper() + name[1:]: str(text) for name, text in (made_with or {}).items()}
    others = [f"{name} {version(name)}" for name in LIBRARIES]
    made = {
        "Date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "Python": f"{platform.python_version()} on {platform.system()} {platform.machine()}",
        "Libraries": ", ".join([f"skhoid {__version__}", *others]),
        "Data (SHA-256 of X, y)": fingerprint_of(X, y),
        **{f"Settings of {name}": text for name, text in settings(model).items()},
    }
    return stated | {name: text for name, text in made.items() if name not in stated}


def advise(what: str, why: str) -> dict[str, str]:
    """What to do next: what, and why."""
    return {"what": what, "why": why}


def settings(model: Any, name: str = "") -> dict[str, str]:
    """All parameters of the estimator and of what is inside it, by class and name there."""
    title = type(model).__name__ + (f" ({name})" if name else "")
    if not isinstance(model, BaseEstimator):
        return {title: repr(model)}
    given = model.get_params(deep=False)
    inside = {k: v for k, v in given.items() if isinstance(v, BaseEstimator)}
    inside |= {k: v for k, v in given.get("steps", []) if isinstance(v, BaseEstimator)}
    own = {k: v for k, v in given.items() if k not in inside and k != "steps"}
    found = {title: ", ".join(f"{k}={' '.join(repr(v).split())}" for k, v in own.items())}
    for key, value in inside.items():
        found |= settings(value, key)
    return found


HEIGHT = 900  # px, in a notebook


class Page:
    """One HTML file with its plots inside, which needs no network.

    Parameters
    ----------
    title : str
        Title of the page.
    content : dict
        What its template shows.

    Attributes
    ----------
    html : str
        The whole page.
    """

    template = "report"

    def __init__(self, title: str, content: dict[str, Any]):
        self.title = title
        self._content = {"found_title": False, "folded": (), **content}

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.title!r}: {self._content['in_short']}>"

    @cached_property
    def html(self) -> str:
        script = _text("page.js") + (_text("report.js") if self.template == "report" else "")
        style = _text("report.css")
        if self._content.get("payload"):
            script, style = component.script() + script, f"{style}\n{component.style()}"
        return rendered(
            __name__,
            f"{self.template}.html.j2",
            title=self.title,
            style=style,
            script=script,
            script_hash=component.hash_script(script),  # whatever a name in the data holds
            **self._content,
        )

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the page to a file; one that exists is replaced at once, when all is written.

        Parameters
        ----------
        path : str or path
            Name of the file, such as ``report.html``. Folders are made.

        Returns
        -------
        path : Path
        """
        path = Path(path)
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder; name a file in it: {path}/report.html.")
        html = self.html
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as aside:
            aside.write_text(html, encoding="utf-8")
        return path

    def open_in_browser(self) -> Path:
        """Write the page to a temporary file and show it in the browser.

        Returns
        -------
        path : Path
            The file.
        """
        path = self.save(Path(mkdtemp(prefix="skhoid-")) / "report.html")
        webbrowser.open(path.as_uri())
        return path

    def _repr_html_(self) -> str:
        # A frame of its own keeps the styles of page and notebook apart.
        return (
            f'<iframe srcdoc="{escape(self.html)}" title="{escape(self.title)}" '
            f'sandbox="allow-scripts allow-downloads" loading="lazy" '
            f'style="width: 100%; height: {HEIGHT}px; border: 1px solid #ccc"></iframe>'
        )


def _text(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")
