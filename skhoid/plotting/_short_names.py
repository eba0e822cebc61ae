"""Names of people and conditions in small places.

Open it to change how long names are cut in pictures of experiments with people.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any


def short_names(names: Iterable[Any], most: int) -> list[str]:
    """Names of at most so many letters; what all have in common is left out where one is longer."""
    whole = [str(name) for name in names]
    if all(len(name) <= most for name in whole):
        return whole
    if len(set(whole)) > 1:
        start = _in_common(whole)
        end = _in_common([name[start:][::-1] for name in whole])
        if start > most // 2:
            whole = ["…" + name[start:] for name in whole]
        if end > 2:
            whole = [name[: len(name) - end] + "…" for name in whole]
    return [cut(name, most) for name in whole]


def cut(text: str, most: int) -> str:
    """A text of at most so many letters."""
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"


def _in_common(names: list[str]) -> int:
    """Letters at the start that are the same in all names, but not a part of a number."""
    same = 0
    for letters in zip(*names, strict=False):
        if len(set(letters)) > 1:
            break
        same += 1
    while same and names[0][same - 1].isdigit():
        same -= 1
    return same
