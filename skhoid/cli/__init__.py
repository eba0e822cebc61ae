"""Entry point of the command line: parses the arguments, runs the command, prints errors."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

from .options import with_one_element
from .output import note
from .parser import make_parser
from .wording import reworded

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
        0 on success, 2 on bad input, 1 on an error nobody expected, 130 when interrupted, 141
        when nobody reads the output any more.

    Examples
    --------
    >>> from skhoid.cli import main
    >>> main(["identify", "nothing-here.csv", "--time", "t"])  # says so on stderr
    2
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser = make_parser()
    if not given:
        parser.print_help(sys.stderr)
        return BAD_INPUT
    options = parser.parse_args(with_one_element(given))
    options.command_line = given
    if options.debug:
        return _run(options)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning(options)
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
        return _explain(error, options)


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
    text = " ".join(str(error).split())
    own = type(error).__module__.startswith("skhoid.")
    if not own and not isinstance(error, ValueError | OSError | ImportError):
        print(
            f"skhoid: unexpected error: {type(error).__name__}: {text} (run again with --debug to "
            "see where, and please report it)",
            file=sys.stderr,
        )
        return UNEXPECTED
    if isinstance(error, OSError) and error.strerror and error.filename:
        text = f"{error.filename}: {error.strerror}"
    print(f"skhoid: error: {reworded(text, options)}", file=sys.stderr)
    return BAD_INPUT


def _show_warning(options: argparse.Namespace) -> Callable[..., None]:
    """Print each warning once, however many fits give it."""
    shown = set()

    def show(message: Any, *_: Any, **__: Any) -> None:
        if str(message) not in shown:
            shown.add(str(message))
            note(reworded(str(message), options))

    return show
