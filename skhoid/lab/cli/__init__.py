"""The command line, ``skhoid``: parses the arguments, runs the command, prints errors.

``parser`` holds what commands share in reading options, ``files`` what they share in reading and
writing files, ``output`` in printing; each other file is a command, or a family of them, with its
own options.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from ... import __version__
from ..._machine import ended_by_signals
from ...exceptions import Hinted
from . import compare, completion, diagnose, experiment, identify, simulate, study, workbench
from .output import as_option, message_for, note
from .parser import Parser, name_sheet, refuse_at_once

__all__ = ["main", "make_parsers"]

BAD_INPUT = 2  # as argparse
UNEXPECTED = 1
EXAMPLES = """\
examples:
  skhoid demo                hide effects in a simulated person, and find them
  skhoid diagnose run*.csv --dry-run         what is in the files? nothing is fitted
  skhoid diagnose run*.csv   what is missing? columns are guessed, and said
  skhoid identify run*.csv   the delay, the orders, and a linear model
  skhoid report run*.csv     the same as diagnose, as a page to keep
  skhoid simulate --remnant 0.1 --out runs.csv
  skhoid experiment recordings/     several people and conditions, on one page
  skhoid workbench run*.csv  fit, try effects and watch the error, in the browser
  skhoid compare model.joblib run*.csv
  skhoid study fig13 --replications 20
  skhoid completion bash

`skhoid COMMAND --help` has more. Without files, identify, diagnose and report
use bundled recordings, and experiment simulates one.
"""


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
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names are printed as they can be
    given = list(sys.argv[1:] if arguments is None else arguments)
    parser, commands = make_parsers()
    if not given:
        parser.print_help(sys.stderr)
        return BAD_INPUT
    options = argparse.Namespace(debug=False, command_line=given)
    try:
        _, unknown = parser.parse_known_args(given, options)
        if unknown:
            commands[options.command].error(f"unrecognized arguments: {' '.join(unknown)}")
        with ended_by_signals(), warnings.catch_warnings():
            if not options.debug:
                warnings.showwarning = _show_warning(options)
            options.asked, options.parsers = argparse.Namespace(**vars(options)), commands
            refuse_at_once(options)
            name_sheet(options)
            code = int(options.work(options))
            sys.stdout.flush()
            return code
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        return _nobody_reads()
    except Exception as error:
        if options.debug:
            raise
        return _explain(error, options)


def make_parsers() -> tuple[Parser, dict[str, Parser]]:
    """The parser of all commands, and those of each by name."""
    parser = Parser(
        prog="skhoid",
        description="Model human operators from recorded control loops.",
        epilog=EXAMPLES,
    )
    parser.add_argument("--version", action="version", version=f"skhoid {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", title="commands"
    )
    for add in (
        diagnose.add_demo,
        identify.add_identify,
        compare.add_compare,
        diagnose.add_diagnose,
        simulate.add_simulate,
        study.add_study,
        diagnose.add_report,
        experiment.add_experiment,
        workbench.add_workbench,
        completion.add_completion,
    ):
        add(commands)
    return parser, dict(commands.choices)


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
        text = " ".join(message_for(error, options).split())
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
