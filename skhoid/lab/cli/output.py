"""How the command line prints: text and tables that fit the terminal, JSON for programs."""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

MOST, LEAST = 100, 40  # columns of text, however wide or narrow the terminal is
_STAY = "\N{NO-BREAK SPACE}"
# A number stays with its unit or noun, and with the sign or word that relates it to another.
_JOINS = (
    re.compile(r"(?<=[\d%]) (?=(?:±|->|to (?=[-+]?\d)|%|[^\W\d]\S{0,11}))"),
    re.compile(r"(?<=[ \xa0])(=|±|->|<|to|p =|p <) (?=[-+]?[\d.])"),
    re.compile(r"(?<=\w) (?=[=<][ \xa0]?[-+]?[\d.])"),
    re.compile(r"(?<=\w:) (?=[-+]?\d+(?:\.\d+)?$)"),
    re.compile(r"(?<=\w) (?=\"\w{1,12}\")"),
)


def width() -> int:
    """Columns of the terminal, or of COLUMNS; 80 where output is piped."""
    return max(LEAST, min(shutil.get_terminal_size().columns, MOST))


def print_json(found: dict[str, Any]) -> None:
    """Print one JSON document; it has no NaN, so null stands for it."""
    print(json.dumps(_finite(found), indent=2, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "item"):  # a number of NumPy
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def say(text: str, options: argparse.Namespace) -> None:
    """Print for people; prints nothing where the output is JSON."""
    if not options.json:
        print_wrapped(text)


def note(text: str) -> None:
    """Print a note on stderr."""
    whole = f"skhoid: note: {' '.join(text.split())}"
    if sys.stderr.isatty():
        whole = textwrap.fill(
            whole, width(), subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
        )
    print(whole, file=sys.stderr)


def joined(text: str) -> str:
    """A text in which numbers stay with their units, and with what they are compared with."""
    indent = len(text) - len(text.lstrip())
    body = text[indent:]
    for pattern in _JOINS:
        body = pattern.sub(lambda match: match[0].replace(" ", _STAY), body)
    return text[:indent] + body


def wrapped(line: str, columns: int | None = None) -> str:
    """A line, wrapped under its indentation; numbers and their units stay together."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    filled = textwrap.fill(
        joined(line),
        columns or width(),
        subsequent_indent=indent,
        break_on_hyphens=False,
        break_long_words=False,
    )
    return filled.replace(_STAY, " ")


def print_wrapped(line: str) -> None:
    """Print a line that fits the terminal, at once."""
    print(wrapped(line), flush=True)


def print_bold(line: str) -> None:
    """Print a line that is to be seen first, in bold letters on a terminal."""
    text = wrapped(line)
    print(f"\x1b[1m{text}\x1b[0m" if sys.stdout.isatty() else text, flush=True)


def print_table(
    title: str,
    headings: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    left: Sequence[str] = (),
    folded: Sequence[str] = (),
) -> None:
    """Print a table that fits the terminal.

    Columns of numbers are on the right, those of ``left`` on the left; cells of ``folded`` may
    take several lines.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    if title:
        print_bold(title)
    table = Table(box=SIMPLE_HEAD, pad_edge=False, show_edge=False, header_style="")
    for heading in headings:
        side: Any = "left" if heading in left else "right"
        table.add_column(heading, justify=side, no_wrap=heading not in folded)
    for row in rows:
        table.add_row(*row)
    narrow = Console(width=width() - 2, highlight=False, markup=False, emoji=False, soft_wrap=False)
    with narrow.capture() as printed:
        narrow.print(table)
    text = "\n".join(f"  {line}".rstrip() for line in printed.get().rstrip("\n").splitlines())
    print(text, flush=True)


def say_files(files: dict[str, Any]) -> None:
    """Say what was written where."""
    if files.get("report"):
        print_wrapped(f"Report: {files['report']} (one file; open it in a browser)")
    if files.get("effect"):
        print_wrapped(f"Effect of your own: {files['effect']} (Python, to be edited)")
    for what in ("pictures", "tables", "files"):
        paths = [Path(name) for name in files.get(what, [])]
        if paths:
            names = ", ".join(path.name for path in paths)
            print_wrapped(f"{what.capitalize()} in {paths[0].parent}: {names}")


def say_next(steps: Sequence[tuple[str, str]]) -> None:
    """The last paragraph: commands that work as they are typed, and what they are for."""
    print()
    print_bold("What to do next")
    longest = max(len(command) for command, _ in steps)
    beside = longest + 4 + max(len(why) for _, why in steps) <= width()
    for command, why in steps:
        if beside:
            print(f"  {command:<{longest}}  {why}")
        else:
            print(f"  {command}")
            print(wrapped(f"      {why}"))
