"""The command ``skhoid completion``: prints a shell script for completion by the tab key."""

from __future__ import annotations

import argparse
from typing import Any

import skhoid

from .parser import add_command, add_debug
from .study import names_of_studies

CONDITIONS = ("C1", "C2", "C3", "C4", "C5", "C6")  # of the thesis, its Table III
ABOUT = """\
print the script of tab completion for a shell
Print a script for your shell, with which the tab key completes commands, options, files and names.
Open a new shell afterwards."""
EXAMPLES = """\
examples:
  skhoid completion bash > ~/.local/share/bash-completion/completions/skhoid
  skhoid completion zsh > ~/.zfunc/_skhoid
                        with fpath=(~/.zfunc $fpath) before compinit in ~/.zshrc
  skhoid completion tcsh > ~/.skhoid.tcsh
                        with `source ~/.skhoid.tcsh` in ~/.tcshrc
"""


def add_completion(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, completion, ABOUT, "SHELL", EXAMPLES)
    command.add_argument("shell", choices=["bash", "zsh", "tcsh"], help="your shell")
    add_debug(command.add_argument)


def completion(options: argparse.Namespace) -> int:
    """Print the script."""
    from ...io import require
    from . import make_parsers

    require("shtab", "Completion", "completion")
    import shtab

    effects = tuple(skhoid.effects.catalogue().index)
    # Not choices of the parser: a wrong name gets a better answer than argparse's.
    names: dict[Any, tuple[str, ...]] = {
        "effects": effects,
        "effect": (*effects, "none"),
        "condition": CONDITIONS,
        "conditions": CONDITIONS,
        "name": names_of_studies(),
    }
    parser, commands = make_parsers()
    actions: list[Any] = [action for command in commands.values() for action in command.arguments]
    places = {"FILE": shtab.FILE, "FILES": shtab.FILE, "FOLDER": shtab.DIRECTORY}
    for action in actions:
        if action.metavar in places:
            action.complete = places[action.metavar]
        elif action.dest in names:
            action.choices = names[action.dest]
    print(shtab.complete(parser, options.shell))
    return 0
