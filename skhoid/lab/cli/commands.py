"""The argument parser of skhoid, and how a command is added to it."""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import sys
import textwrap
from collections.abc import Callable
from typing import Any, NoReturn

from ...exceptions import did_you_mean

_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")
_UNKNOWN = "unrecognized arguments: "


class Parser(argparse.ArgumentParser):
    """Remembers its arguments, for tab completion; keeps the layout of examples."""

    def __init__(self, *, description: str, usage: str | None = None, **more: Any) -> None:
        self.arguments: list[argparse.Action] = []
        width = shutil.get_terminal_size().columns - 2  # as argparse
        super().__init__(
            description=textwrap.fill(description, width),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            usage=usage,
            **more,
        )

    def add_argument(self, *names: Any, **more: Any) -> argparse.Action:
        """Add an argument, and remember it."""
        argument = super().add_argument(*names, **more)
        self.arguments.append(argument)
        return argument

    def section(self, title: str) -> Callable[..., argparse.Action]:
        """A function that adds arguments under a heading of the help."""
        group = self.add_argument_group(title)

        def add(*names: Any, **more: Any) -> argparse.Action:
            argument = group.add_argument(*names, **more)
            self.arguments.append(argument)
            return argument

        return add

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line, and what was meant."""
        wrong = _CHOICE.search(message)
        if wrong is not None and self._subparsers is not None:
            known = re.findall(r"[\w-]+", wrong[2])
            message = f"There is no command {wrong[1]!r}.{did_you_mean(wrong[1], known)}"
            if os.path.exists(wrong[1]):
                message += f" To look into a file: skhoid diagnose {shlex.quote(wrong[1])}"
            else:
                message += f" There are: {', '.join(known)}."
        elif wrong is not None:
            known = re.findall(r"[\w-]+", wrong[2])
            message += did_you_mean(wrong[1], known)
        elif message.startswith(_UNKNOWN):
            options = [name for a in self.arguments for name in a.option_strings]
            words = message.removeprefix(_UNKNOWN).split()
            near = [did_you_mean(word, options) for word in words if word.startswith("-")]
            message += "." + "".join(dict.fromkeys(near))
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")

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
    usage: str = "[OPTIONS]",
) -> Parser:
    """Add a command to the parser; returns the parser of the command."""
    command: Parser = commands.add_parser(
        name,
        help=help,
        description=description,
        epilog=examples,
        usage=f"skhoid {name} {usage}",
    )
    return command
