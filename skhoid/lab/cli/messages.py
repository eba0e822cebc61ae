"""Messages of the package, with the command-line options that do what they say in Python."""

from __future__ import annotations

import argparse
import shlex
from typing import Any

from ...text import as_sentence

__all__ = ["as_option", "message_for"]


def message_for(said: Any, options: argparse.Namespace) -> str:
    """What an error, a warning or a note says, with options of this command as its remedy.

    The hint is left out, for it is what one writes in Python. Options that this command does not
    have are left out too.
    """
    message = getattr(said, "message", None) or str(said)
    names = [(each, "") if isinstance(each, str) else each for each in _options(said)]
    found = [as_option(options, *each) for each in names if hasattr(options, each[0])]
    if not found:
        return message
    return f"{as_sentence(message)} On the command line: {', '.join(found)}."


def _options(said: Any) -> Any:
    return getattr(said, "options", ())


def as_option(options: argparse.Namespace, name: str, value: str = "") -> str:
    """What settles a question, as one types it; as for an argument where there is no option."""
    if name == "files":
        return "leave it out of FILES"
    if not hasattr(options, name):
        name, value = "role", f"{value}={name}"
    option = f"--{name.replace('_', '-')}"
    if name == "resample" or not value:
        return option
    return f"{option} {value if value in ('NAME', 'SECONDS') else shlex.quote(value)}"
