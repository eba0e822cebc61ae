"""Check the links inside the built documentation, and those of README.md to files.

    python tools/check_links.py [FOLDER]

Prints each link whose file or anchor is missing, and fails if there is one. Links to other sites:
``sphinx-build -b linkcheck docs docs/_build/linkcheck``, which needs a network.
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(__file__).resolve().parents[1]


class Page(HTMLParser):
    """The links and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors = {"", "top"}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value for name, value in attrs if value is not None}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        self.links += [values[name] for name in ("href", "src") if name in values]


def broken_links(folder: Path) -> list[str]:
    folder = folder.resolve()
    found = sorted(path for path in folder.rglob("*.html") if path.parts[-2] != "_static")
    pages = {path: Page(path) for path in found}
    broken = []
    for path, page in pages.items():
        for link in dict.fromkeys(page.links):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            # Pages of source name what they document by its module; at worst it is the page's top.
            known = "_modules" in path.parts or target not in pages
            known = known or unquote(parts.fragment) in pages[target].anchors
            if not (target.exists() and known):
                broken.append(f"{path.relative_to(folder)}: {link}")
    return broken


def broken_in_readme() -> list[str]:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#:]+)[^):]*\)", text)
    return [f"README.md: {link}" for link in links if not (ROOT / link).exists()]


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "_build" / "html"
    if not (folder / "index.html").is_file():
        sys.exit(f"{folder} holds no index.html; build the documentation first.")
    broken = broken_links(folder) + broken_in_readme()
    print("\n".join(broken) or "All links lead somewhere.")
    sys.exit(bool(broken))
