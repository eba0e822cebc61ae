"""Text files in any encoding, and what one pass over their bytes tells about them."""

from __future__ import annotations

import codecs
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

__all__ = ["Text", "survey"]

_CHUNK = 1 << 20  # bytes
_MARKS = {  # the marks of UTF-32 begin with those of UTF-16
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
# Which of the first four bytes are not 0 in a text without a mark that begins in ASCII.
_BYTES = {
    "0001": "utf-32-be",
    "1000": "utf-32-le",
    "0101": "utf-16-be",
    "1010": "utf-16-le",
}


@dataclass(frozen=True)
class Text:
    """A text file: its encoding, and how many lines, quotes, points and commas it has.

    Blank lines at the end do not count; with mixed line endings the number of lines may be too
    small.
    """

    path: Path
    encoding: str
    n_lines: int
    quotes: int
    points: int
    commas: int

    def open(self, skip: int = 0) -> TextIO:
        r"""Open the file after some lines; every line ends in ``\n``."""
        errors = "replace" if self.encoding == "cp1252" else "strict"
        file = self.path.open(encoding=self.encoding, errors=errors)
        for _ in range(skip):
            file.readline()
        return file


def survey(path: Path) -> Text:
    """Find the encoding of a text file, and count what decides how its numbers are read."""
    with path.open("rb") as file:
        head = file.read(4)
        wide = next((name for mark, name in _MARKS.items() if head.startswith(mark)), None)
        wide = wide or _BYTES.get("".join("01"[byte > 0] for byte in head))
        decoder = codecs.getincrementaldecoder(wide or "utf-8")()
        file.seek(0)
        counts = dict.fromkeys(b'\n\r",.', 0)
        is_ascii = is_utf8 = True
        ended = False
        last = b""
        while not ended:
            chunk = file.read(_CHUNK)
            ended = not chunk  # a last call tells whether the last character is whole
            try:
                if wide:
                    chunk = decoder.decode(chunk, final=ended).encode("utf-8")
                elif is_utf8 and not (is_ascii := is_ascii and chunk.isascii()):
                    decoder.decode(chunk, final=ended)
            except UnicodeDecodeError as error:
                if wide:
                    raise ValueError(
                        f"{path} begins as {wide.upper()} text but does not continue as such "
                        f"({error.reason}). Save it as UTF-8."
                    ) from error
                # Western European Windows: what spreadsheets write for the degree sign in "e [°]".
                is_utf8 = False
            if b"\0" in chunk:
                lines = counts[ord("\n")] + chunk[: chunk.index(b"\0")].count(b"\n")
                raise ValueError(
                    f"{path} has a zero byte in line {lines + 1}, which no text has: it is "
                    "damaged, or not a text file. Save it again, as UTF-8."
                )
            for sign in counts:
                counts[sign] += chunk.count(sign)
            last = chunk or last
    blank = last[len(last.rstrip(b" \r\n")) :]
    for sign in b"\n\r":
        counts[sign] -= blank.count(sign)
    line_feeds, returns, quotes, commas, points = counts.values()
    encoding = wide or ("utf-8-sig" if is_utf8 else "cp1252")
    ends = line_feeds if line_feeds == returns else line_feeds + returns
    return Text(path, encoding, ends + 1, quotes, points, commas)
