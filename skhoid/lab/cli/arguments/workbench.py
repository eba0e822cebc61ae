"""The arguments of ``skhoid workbench``."""

from __future__ import annotations

import argparse
from typing import Any

from ..commands import add_command
from .shared import add_recording_options, add_search_options

EXAMPLES = """\
examples:
  skhoid workbench                        choose files in the browser
  skhoid workbench run*.csv               columns are guessed, and can be corrected
  skhoid workbench run*.csv --display pursuit --session friday
  skhoid workbench --session friday       go on where it ended
  skhoid workbench run*.csv --no-browser --port 8765
"""


def add_workbench(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "workbench",
        "explore recordings in the browser: fit, see where, try effects, by hand",
        "Serve a page, to this machine alone, in which a model of your recordings is fitted, "
        "compared with them and extended by hand: effects are tried and seen at once, found by a "
        "search, and kept as a report and a script. What is done is kept in a folder, the "
        'session. It needs pip install "skhoid[workbench]".',
        EXAMPLES,
        "[FILES] [OPTIONS]",
    )
    add_recording_options(command)
    add_search_options(command.section("Search"))
    add = command.section("Server")
    add(
        "--session",
        metavar="FOLDER",
        help="where all is kept, and gone on with (default: skhoid-workbench)",
    )
    add("--port", type=port, metavar="N", help="port of 127.0.0.1 (default: a free one)")
    add("--no-browser", action="store_true", help="print the address only")
    add("--debug", action="store_true", help="show tracebacks of errors (exit code 1)")


def port(text: str) -> int:
    """A port that a user may listen on."""
    if not (text.isascii() and text.isdecimal() and len(text) < 6) or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(
            f"must be a port, a whole number from 1 to 65535; got {text[:40]!r}"
        )
    return int(text)
