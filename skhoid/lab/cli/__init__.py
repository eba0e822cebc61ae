"""Entry point of the command line: parses the arguments, runs the command, prints errors."""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from typing import Any

from ..._machine import ended_by_signals
from ...exceptions import Hinted
from .at_once import refuse_at_once
from .commands import Parser
from .messages import as_option, message_for
from .options import with_one_element
from .output import note
from .parser import make_parsers

__all__ = ["main"]

BAD_INPUT = 2  # as argparse
UNEXPECTED = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str or None, default=None
        Arguments after ``skhoid``; None means those of the process.

    Returns
    -------
    exit_code : int
        0 on success, 2 on bad input, 1 on an error nobody expected, 129 when the terminal
        is closed, 130 when interrupted, 141 when nobody reads the output any more, 143 when
        terminated.

    Examples
    --------
    >>> from skhoid.lab.cli import main
    >>> main(["identify", "nothing-here.csv", "--time", "t"])  # says so on stderr
    2
    """
    _open_streams()
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser, commands = make_parsers()
    if not given:
        parser.print_help(sys.stderr)
        return BAD_INPUT
    options = argparse.Namespace()
    try:
        _parse(parser, commands, given, options)
        with ended_by_signals(), warnings.catch_warnings():
            if not options.debug:
                warnings.showwarning = _show_warning(options)
            refuse_at_once(options)
            code = _run(options)
            sys.stdout.flush()
            return code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return _nobody_reads()
    except SystemExit as stop:
        if isinstance(stop.__context__, BrokenPipeError):  # rich ends the process with 1
            return _nobody_reads()
        raise
    except Exception as error:
        if options.debug:
            raise
        return _explain(error, options)


def _parse(
    parser: Parser, commands: dict[str, Parser], given: list[str], options: argparse.Namespace
) -> None:
    """Parse the arguments; --help and --version print, and end, here."""
    options.debug = False
    try:
        _, unknown = parser.parse_known_args(with_one_element(given), options)
        if unknown:
            commands[options.command].error(f"unrecognized arguments: {' '.join(unknown)}")
    except SystemExit:
        sys.stdout.flush()  # argparse does not notice that nothing can be written
        raise
    options.command_line = given


def _open_streams() -> None:
    """Put nothing in the place of streams that were closed, and print names as they can be."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            # Takes the number of the closed one too, which else would be that of a file to write.
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _run(options: argparse.Namespace) -> int:
    """Import the module of the command, and NumPy with it, now that the arguments are valid."""
    module = import_module(f".{options.command}", __package__)
    return int(getattr(module, options.command)(options))


def _nobody_reads() -> int:
    """Keep Python from complaining once more when it flushes at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 141


def _explain(error: Exception, options: argparse.Namespace) -> int:
    """Print an error in one line; returns the exit code."""
    try:
        sys.stdout.flush()
    except OSError:
        _nobody_reads()
    text = " ".join(str(error).split())
    if hasattr(error, "said_by"):  # all that is wrong with a file, in a list
        print(f"skhoid: error: {error.said_by(partial(as_option, options))}", file=sys.stderr)
        return BAD_INPUT
    own = type(error).__module__.startswith("skhoid.")
    if isinstance(error, MemoryError):
        print(f"skhoid: error: The memory does not suffice. {text}".rstrip(), file=sys.stderr)
        return BAD_INPUT
    if not own and not isinstance(error, ValueError | OSError | ImportError):
        print(
            f"skhoid: unexpected error: {type(error).__name__}: {text} (run again with --debug to "
            "see where, and please report it)",
            file=sys.stderr,
        )
        return UNEXPECTED
    if isinstance(error, OSError) and error.strerror:
        text = f"{error.filename or 'the output'}: {error.strerror}"
    if isinstance(error, Hinted):
        text = message_for(error, options)
    print(f"skhoid: error: {text}", file=sys.stderr)
    return BAD_INPUT


def _show_warning(options: argparse.Namespace) -> Callable[..., None]:
    """Print each warning once, however many fits give it."""
    shown = set()

    def show(message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            note(message_for(message, options))

    return show
