"""Names of files that come from a browser, made safe."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Container

from ...io._formats import READERS

__all__ = ["free_name", "safe_name"]

LONGEST = 80  # characters before the ending
RESERVED = {"con", "prn", "aux", "nul", *(f"{p}{n}" for p in ("com", "lpt") for n in range(10))}


def safe_name(name: str) -> str:
    """A name for a file in a folder of ours, with the ending of a format that can be read.

    Whatever looks like a folder is cut off, and what is no letter, digit or one of ``-_.`` becomes
    an underscore.
    """
    last = re.split(r"[/\\]", unicodedata.normalize("NFC", name))[-1]
    stem, dot, ending = last.rpartition(".")
    suffix = f".{ending.lower()}"
    if not dot or suffix not in READERS:
        raise ValueError(
            f"{name[:LONGEST]!r} cannot be read: skhoid reads files that end in "
            f"{', '.join(READERS)}. Save it in one of these formats, such as CSV."
        )
    stem = re.sub(r"[^\w.-]+", "_", stem)[:LONGEST].strip("._-") or "file"
    if stem.partition(".")[0].casefold() in RESERVED:  # which Windows keeps for devices
        stem = f"file-{stem}"
    return stem + suffix


def free_name(name: str, taken: Container[str]) -> str:
    """The name, or with a number: file-2.csv."""
    stem, _, ending = name.rpartition(".")
    free, number = name, 2
    while free in taken:
        free, number = f"{stem}-{number}.{ending}", number + 1
    return free
