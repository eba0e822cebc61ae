"""Paths with named fields, such as ``"data/sub-{subject}_run-{run}.csv"``."""

from __future__ import annotations

import glob
import os
import re
from pathlib import Path

from .levels import FIELDS

__all__ = ["has_fields", "match_pattern"]

_FIELD = re.compile(r"\{([^{}/\\]*)\}")
_SHOWN = 5  # files in a message


def has_fields(text: str) -> bool:
    """Whether a path is a pattern with named fields."""
    return bool(_FIELD.search(text)) and not os.path.exists(text)


def match_pattern(text: str) -> tuple[list[Path], list[dict[str, str]]]:
    """The files that match a pattern, and the labels that their names give."""
    text = os.path.expanduser(text)
    fields = _FIELD.findall(text)
    unknown = [name for name in fields if name not in FIELDS]
    if unknown:
        raise ValueError(
            f"The pattern {text!r} has the field {{{unknown[0]}}}; fields are "
            f"{', '.join(f'{{{name}}}' for name in FIELDS)}. Write * for a part that varies and "
            "means nothing."
        )
    pieces = _FIELD.split(text)
    search, expression, seen = "", "", set[str]()
    for number, piece in enumerate(pieces):
        if number % 2 == 0:
            search += "".join(c if c in "*?" else glob.escape(c) for c in piece)
            expression += "".join(_wild(c) for c in piece)
        else:
            search += "*"
            expression += f"(?P={piece})" if piece in seen else f"(?P<{piece}>[^/]+?)"
            seen.add(piece)
    form = re.compile(expression.replace(re.escape(os.sep), "/"))
    found = []
    for name in glob.glob(search):
        match = form.fullmatch(name.replace(os.sep, "/"))
        if match and os.path.isfile(name):
            found.append((Path(name), match.groupdict()))
    if not found:
        raise FileNotFoundError(
            f"No file matches the pattern {text!r} (working folder: {Path.cwd()}).{_near(text)}"
        )
    return [path for path, _ in found], [labels for _, labels in found]


def _wild(character: str) -> str:
    return {"*": "[^/]*", "?": "[^/]"}.get(character) or re.escape(character)


def _near(text: str) -> str:
    """What there is where the pattern stops to match."""
    folder = Path(text.split("{", maxsplit=1)[0])
    folder = folder if text.split("{", maxsplit=1)[0].endswith(("/", os.sep)) else folder.parent
    while not folder.is_dir() and folder != folder.parent:
        folder = folder.parent
    names = sorted(path.name for path in folder.iterdir())
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    listed = ", ".join(map(repr, names[:_SHOWN]))
    return f" {str(folder)!r} has: {listed}{more}." if names else f" {str(folder)!r} is empty."
