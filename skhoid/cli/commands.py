"""How a command becomes words of the parser."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any


class Help(argparse.HelpFormatter):
    """Wraps descriptions, and leaves examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if text.startswith("examples:") else super()._fill_text(text, width, indent)


def add_command(
    commands: Any,
    name: str,
    action: Callable[[argparse.Namespace], int],
    help: str,
    description: str,
    examples: str,
) -> argparse.ArgumentParser:
    """Add a command to the parser; returns its own."""
    command: argparse.ArgumentParser = commands.add_parser(
        name, help=help, description=description, epilog=examples, formatter_class=Help
    )
    command.set_defaults(action=action)
    return command
