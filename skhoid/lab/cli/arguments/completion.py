"""The arguments of ``skhoid completion``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command

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
    command = add_command(
        commands,
        "completion",
        "print the script of tab completion for a shell",
        "Print a script for your shell, with which the tab key completes commands, "
        "options, files and names. Open a new shell afterwards.",
        EXAMPLES,
        "SHELL",
    )
    command.add_argument("shell", choices=["bash", "zsh", "tcsh"], help="your shell")
    command.add_argument(
        "--debug", action="store_true", help="show tracebacks of errors (exit code 1)"
    )
