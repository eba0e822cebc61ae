"""The words in the name of a column: ``Run No.`` and ``runId`` are runs, ``time_s`` is a time."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pandas as pd

from .clock import JITTER_TOLERANCE, RUN, TIME

# What rows have in common, from the shortest recording to the longest.
_SHORT: tuple[str, ...] = (RUN, "trial", "rep", "repetition", "recording")
LABEL_WORDS = (*_SHORT, "block", "session", "subject", "participant")
# Levels of the row index outside of runs.
OUTER_WORDS = {"subject": "subject", "participant": "subject", "condition": "condition"}
OUTER_WORDS |= {"session": "session", "block": "block"}
TIME_WORDS = (TIME, "timestamp", "elapsed")
SECONDS = ("second", "sec", "msec", "ms")
TICKS = 0.9  # share of a clock's steps that are alike
_UNITS = (*SECONDS, "s", "us")
_NUMBERING = ("id", "no", "nr", "num", "number", "index", "idx")
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # also those of camelCase
_SHARE = 0.1  # most stretches of labels in a row, on average


def words_of(name: Any) -> list[str]:
    """Words of a name in lower case, without figures and plurals."""
    if not isinstance(name, str):
        return []
    return [singular(word.casefold()) for word in _WORD.findall(name)]


def label_word(name: Any) -> str:
    """The word for what a column labels, if its name has no other; ``Trial No.`` is a trial."""
    words = [word for word in words_of(name) if word not in _NUMBERING]
    return words[0] if len(words) == 1 and words[0] in {*LABEL_WORDS, *OUTER_WORDS} else ""


def names_time(name: Any) -> bool:
    """Whether a column may be a clock by its name."""
    words = words_of(name)
    if len(words) == 1 and words[0] in SECONDS:
        return True
    while len(words) > 1 and words[-1] in _UNITS:
        words.pop()
    return words == ["t"] or any(word in TIME_WORDS for word in words)


def in_milliseconds(name: Any) -> bool:
    """Whether the name of a clock says that it counts milliseconds."""
    return words_of(name)[-1:] in (["ms"], ["msec"])


def labelled_stretches(values: np.ndarray, word: str) -> int:
    """Number of stretches of rows that a column labels by whole numbers or text; 0: it does not."""
    try:
        codes, labels = pd.factorize(values)
    except TypeError:  # lists, say
        return 0
    if values.dtype.kind == "f":
        whole = bool(np.all(labels == np.floor(labels)))
    else:
        whole = values.dtype.kind in "iu" or all(isinstance(label, str) for label in labels)
    stretches = 1 + int(np.count_nonzero(codes[1:] != codes[:-1]))
    # A signal may well be called block, and come back to its values.
    once = word != "block" or stretches == len(labels)
    return stretches if whole and once and stretches < _SHARE * values.size else 0


def advances_evenly(values: np.ndarray) -> bool:
    """Whether values advance by equal steps, but where runs begin anew."""
    if values.dtype.kind not in "iuf" or values.size < 3:
        return False
    step = np.diff(values.astype(float))
    typical = np.median(step)
    return bool(typical > 0 and np.mean(np.abs(step / typical - 1) <= JITTER_TOLERANCE) >= TICKS)


def singular(word: str) -> str:
    """A word without the s of a plural."""
    return word[:-1] if len(word) > 2 and word.endswith("s") else word
