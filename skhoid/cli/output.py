"""How the command line prints: wrapped lines and notes for people, JSON for other programs."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
from pathlib import Path
from typing import Any

WIDTH = 100  # columns


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
        print(text, flush=True)


def note(text: str) -> None:
    """Print a note on stderr, on one line."""
    print(f"skhoid: note: {' '.join(text.split())}", file=sys.stderr)


def print_wrapped(line: str) -> None:
    """Print a line, wrapped under its indentation, at once."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    print(
        textwrap.fill(
            line, WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
        ),
        flush=True,
    )


def say_files(files: dict[str, Any]) -> None:
    """Say what was written where."""
    if files.get("report"):
        print_wrapped(f"Report: {files['report']} (one file; open it in a browser)")
    for what in ("pictures", "tables", "files"):
        paths = [Path(name) for name in files.get(what, [])]
        if paths:
            names = ", ".join(path.name for path in paths)
            print_wrapped(f"{what.capitalize()} in {paths[0].parent}: {names}")
