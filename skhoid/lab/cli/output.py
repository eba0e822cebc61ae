"""How the command line prints: documents that fit the terminal, JSON, and what to do next."""

from __future__ import annotations

import argparse
import json
import math
import os
import shlex
import shutil
import sys
import textwrap
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

MOST, LEAST = 100, 40  # columns of text, however wide or narrow the terminal is


def width() -> int:
    """Columns of the terminal, or of COLUMNS; 80 where output is piped."""
    return max(LEAST, min(shutil.get_terminal_size().columns, MOST))


def print_json(options: argparse.Namespace, found: dict[str, Any]) -> None:
    """Print one JSON document; it has no NaN, so null stands for it."""
    from ... import __version__

    guess = getattr(options, "columns", None)
    columns = {} if guess is None else {"columns": guess.as_dict()}
    whole = {"skhoid": __version__, **columns, **found}
    print(json.dumps(_finite(whole), indent=2, allow_nan=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "item"):  # a number of NumPy
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def print_document(document: Any, options: argparse.Namespace) -> None:
    """Print a document, its title in bold letters on a terminal; hints are those of options."""
    text = document.text(width(), say=partial(message_for, options=options))
    head = "\n".join(textwrap.wrap(document.title, width()))
    print_bold(head)
    print(text.removeprefix(head).removeprefix("\n"), flush=True)


def print_source(options: argparse.Namespace, source: str) -> None:
    """Where the runs are from, and which column was taken for what."""
    print_wrapped(source)
    guess = getattr(options, "columns", None)
    if guess is not None and guess.guessed:
        print_wrapped(str(guess))


def shows_progress(options: argparse.Namespace) -> bool:
    """Whether somebody looks: bars are drawn on the output, which a pipe or a file keeps clean."""
    return not options.json and sys.stderr.isatty() and sys.stdout.isatty()


def note(text: str) -> None:
    """Print a note on stderr."""
    whole = f"skhoid: note: {' '.join(text.split())}"
    print(_wrapped(whole) if sys.stderr.isatty() else whole, file=sys.stderr)


def message_for(said: Any, options: argparse.Namespace) -> str:
    """What an error, a warning or a note says, with options of this command as its remedy.

    The hint is left out, for it is what one writes in Python. Options that this command does not
    have are left out too.
    """
    from ...text import Step, as_sentence

    if isinstance(said, Step):
        return said.typed
    message = getattr(said, "message", None) or str(said)
    known: Any = getattr(said, "options", ())
    names = [(each, "") if isinstance(each, str) else each for each in known]
    found = [as_option(options, *each) for each in names if hasattr(options, each[0])]
    if not found:
        return message
    return f"{as_sentence(message)} On the command line: {', '.join(found)}."


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


def _wrapped(line: str) -> str:
    """A line, wrapped under its indentation."""
    indent = " " * (len(line) - len(line.lstrip()) + 2)
    return textwrap.fill(
        line, width(), subsequent_indent=indent, break_on_hyphens=False, break_long_words=False
    )


def print_wrapped(line: str) -> None:
    """Print a line that fits the terminal, at once."""
    print(_wrapped(line), flush=True)


def print_bold(text: str) -> None:
    """Print what is to be seen first, in bold letters on a terminal."""
    print(f"\x1b[1m{text}\x1b[0m" if sys.stdout.isatty() else text, flush=True)


def say_files(files: dict[str, Any]) -> None:
    """Say what was written where."""
    if files.get("report"):
        print_wrapped(f"Report: {files['report']} (one file; open it in a browser)")
    if files.get("effect"):
        print_wrapped(f"Effect of your own: {files['effect']} (Python, to be edited)")
    if files.get("model"):
        print_wrapped(
            f"Model: {files['model']} (for skhoid compare; such a file can run any code when it is "
            "read: take it only from people you trust)"
        )
    for what in ("pictures", "tables", "files"):
        paths = [Path(name) for name in files.get(what, [])]
        if paths:
            names = ", ".join(path.name for path in paths)
            print_wrapped(f"{what.capitalize()} in {paths[0].parent}: {names}")


def say_next(steps: Sequence[tuple[str, str]]) -> None:
    """The last paragraph: commands that work as they are typed, and what they are for."""
    print()
    print_bold("What to do next")
    longest = max(len(command) for command, _ in steps)
    beside = longest + 4 + max(len(why) for _, why in steps) <= width()
    for command, why in steps:
        if beside:
            print(f"  {command:<{longest}}  {why}")
        else:
            print(f"  {command}")
            print(_wrapped(f"      {why}"))


# Options on what is written, which change no number.
OF_PAPER = {
    "out",
    "report",
    "sketch",
    "save",
    "overwrite",
    "title",
    "tables",
    "table_format",
    "format",
}
OF_PAPER |= {"no_pictures", "json", "debug", "time_limit", "jobs", "fresh"}


def typed(options: argparse.Namespace, command: str, **others: Any) -> str:
    """A command about the same files, with all that was said which changes the analysis.

    ``others`` are options that it has instead. What the other command cannot be told is left out.
    """
    asked = {**vars(options.asked), **others}
    parser = options.parsers[command]
    words = ["skhoid", command, *map(str, asked["files"])]
    for action in parser.arguments:
        name = action.dest
        value = asked.get(name)
        default = parser.get_default(name)
        unsaid = value is None or value == default or value == [] or value is False
        if unsaid or name in OF_PAPER or not action.option_strings:
            continue
        values = value if isinstance(value, list) else [value]
        if action.nargs is None and default != [] and len(values) > 1:
            continue  # of several the other command takes none
        option = action.option_strings[-1]
        texts = [f"{v:.12g}" if isinstance(v, float) else str(v) for v in values]
        if action.nargs == 0:
            words.append(option)
        elif default == []:  # it is repeated
            words += [word for text in texts for word in (option, text)]
        else:
            words += [option, *texts]
    return shlex.join(words)


def compared_next(options: argparse.Namespace) -> list[tuple[str, str]]:
    """What to do with a model that was kept."""
    if options.save is None or not options.files:
        return []
    command = typed(options, "compare", files=[options.save, *options.files])
    return [(command, "where the model that was kept fails; better on other recordings")]


def free_name(name: str) -> str:
    """A file name that is not taken yet."""
    stem, ending = os.path.splitext(name)
    number, free = 2, name
    while Path(free).exists():
        free, number = f"{stem}-{number}{ending}", number + 1
    return free
