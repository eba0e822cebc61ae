"""The command ``skhoid completion``: prints a shell script for completion by the tab key."""

from __future__ import annotations

import argparse
from typing import Any

from .arguments.names import CONDITIONS, EFFECTS, HIDDEN, STUDIES
from .parser import make_parsers

# Not choices of the parser: a wrong name gets a better answer than argparse's.
NAMES: dict[Any, tuple[str, ...]] = {
    "effects": EFFECTS,
    "effect": (*HIDDEN, "none"),
    "condition": CONDITIONS,
    "conditions": CONDITIONS,
    ("skhoid study", "name"): STUDIES,
}


def completion(options: argparse.Namespace) -> int:
    """Print the script."""
    try:
        import shtab
    except ImportError as error:
        raise ImportError(
            'Completion needs the package shtab: pip install "skhoid[completion]"'
        ) from error
    parser, commands = make_parsers()
    places = {"FILE": shtab.FILE, "FILES": shtab.FILE, "FOLDER": shtab.DIRECTORY}
    for command in commands.values():
        for action in command.arguments:
            if action.metavar in places:
                action.complete = places[action.metavar]  # type: ignore[attr-defined]
            elif (command.prog, action.dest) in NAMES:
                action.choices = NAMES[command.prog, action.dest]
            elif action.dest in NAMES:
                action.choices = NAMES[action.dest]
    print(shtab.complete(parser, options.shell))
    return 0
