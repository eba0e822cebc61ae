"""The command ``skhoid completion``: the tab key knows commands, options, files and names."""

from __future__ import annotations

import argparse
from typing import Any

from .commands import add_command

EXAMPLES = """\
examples:
  skhoid completion bash > ~/.local/share/bash-completion/completions/skhoid
  skhoid completion zsh > ~/.zfunc/_skhoid          with fpath=(~/.zfunc $fpath) before compinit
  skhoid completion tcsh > ~/.skhoid.tcsh           and `source ~/.skhoid.tcsh` in ~/.tcshrc
"""


def add_completion(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "completion",
        completion,
        "print the script of tab completion for a shell",
        "Print a script for your shell, with which the tab key completes commands, "
        "options, files and names. Open a new shell afterwards.",
        EXAMPLES,
    )
    command.add_argument("shell", choices=["bash", "zsh", "tcsh"], help="your shell")
    command.add_argument(
        "--debug", action="store_true", help="show tracebacks of errors (exit code 1)"
    )


def completion(options: argparse.Namespace) -> int:
    """Print the script."""
    try:
        import shtab
    except ImportError as error:
        raise ImportError(
            'Completion needs the package shtab: pip install "skhoid[completion]"'
        ) from error
    from .parser import make_parsers

    parser, commands = make_parsers()
    places = {"FILE": shtab.FILE, "FILES": shtab.FILE, "FOLDER": shtab.DIRECTORY}
    names = _names()
    for command in commands.values():
        for action in command.arguments:
            if action.metavar in places:
                action.complete = places[action.metavar]  # type: ignore[attr-defined]
            elif (command.prog, action.dest) in names:
                action.choices = names[command.prog, action.dest]
            elif action.dest in names:
                action.choices = names[action.dest]
    print(shtab.complete(parser, options.shell))
    return 0


def _names() -> dict[Any, list[str]]:
    """Names that options take, by option; not choices of the parser, which would import all."""
    from ..effects.catalogue import BY_NAME
    from ..search.story import HIDDEN
    from ..thesis.studies import PAPER_STUDIES
    from ..thesis.study_result import CONDITIONS
    from .study import OTHERS

    return {
        "effects": list(BY_NAME),
        "effect": [*HIDDEN, "none"],
        "condition": list(CONDITIONS),
        "conditions": list(CONDITIONS),
        ("skhoid study", "name"): ["list", *OTHERS, *PAPER_STUDIES],
    }
