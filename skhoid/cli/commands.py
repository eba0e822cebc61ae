"""The argument parser of skhoid, and how a command is added to it."""

from __future__ import annotations

import argparse
import shutil
import sys
import textwrap
from typing import Any


class Parser(argparse.ArgumentParser):
    """Remembers its arguments, for tab completion; keeps the layout of examples."""

    def __init__(self, *, description: str, **more: Any) -> None:
        self.arguments: list[argparse.Action] = []
        width = shutil.get_terminal_size().columns - 2  # as argparse
        super().__init__(
            description=textwrap.fill(description, width),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **more,
        )

    def add_argument(self, *names: Any, **more: Any) -> argparse.Action:
        """Add an argument, and remember it."""
        argument = super().add_argument(*names, **more)
        self.arguments.append(argument)
        return argument

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print, and let fail what argparse lets pass: that nothing can be written."""
        if file is sys.stdout:
            file.write(message)
        else:
            super()._print_message(message, file)


def add_command(
    commands: Any,
    name: str,
    help: str,
    description: str,
    examples: str,
) -> Parser:
    """Add a command to the parser; returns the parser of the command."""
    command: Parser = commands.add_parser(name, help=help, description=description, epilog=examples)
    return command
