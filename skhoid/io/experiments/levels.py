"""Levels of an experiment, and the words by which names of files and fields say them."""

from __future__ import annotations

import re

from .._header_words import label_of

__all__ = ["FIELDS", "LEVELS", "key_level", "labelled", "natural"]

LEVELS = ("subject", "condition", "run")
FIELDS = ("subject", "session", "condition", "block", "run")  # a session is put before the run
_SHORT = {
    "s": "subject",
    "p": "subject",
    "pp": "subject",
    "vp": "subject",
    "sj": "subject",
    "c": "condition",
    "r": "run",
    "t": "run",
    "ses": "session",
}
_WORD = 3  # letters, from which on a key is a word of its own and no part of the label


def key_level(word: str) -> str:
    """The level that a word before a label names, as in ``sub-01``; "" for none."""
    return _SHORT.get(word.casefold(), "") or label_of(word)


def labelled(text: str) -> tuple[str, str, str]:
    """Level, text before the label, and label of ``S01``, ``run2`` or ``task-x``.

    The level is "" where the text does not say it, and then all of it is the label.
    """
    match = re.fullmatch(r"([^\W\d_]+)([-=_ ]?)(.+)", text)
    if match and (match[2] or match[3][0].isdigit()) and (level := key_level(match[1])):
        key = match[1] + match[2]
        return (level, key, match[3]) if match[2] or len(match[1]) >= _WORD else (level, "", text)
    return "", "", text


def natural(text: object) -> list[tuple[int, int, str]]:
    """A key by which run 2 comes before run 10."""
    parts = re.split(r"(\d+)", str(text))
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts if p]
