"""How arguments are parsed: values of options, options of several commands, what is refused.

Nothing here imports NumPy, which takes seconds: help comes at once.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shlex
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable
from typing import Any, NoReturn

from ...exceptions import did_you_mean

MOST = 1_000_000  # of what is counted: runs, replications, subjects
MOST_ORDERS = 100
MOST_SAMPLES = 100_000  # of a delay
MOST_WORKERS = 8 * (os.cpu_count() or 1)
OF_CORE = {"operator": ["delay"], "arx": ["na", "nb", "nk"]}
OF_SEARCH = ["display", "max_effects", "controlled_element"]
MAX_EFFECTS = 4
TABLES = "tsv"
PICTURES = ("png", "pdf", "svg")
DOMAINS = ("human", "machine")
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
        # argparse has no other way to tell what was wrong than its message.
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


def whole(least: int, most: int | None = MOST) -> Callable[[str], int]:
    """The type of an option that takes whole numbers."""

    def read(text: str) -> int:
        # int() takes no more than 4,300 digits.
        if not (text.isascii() and text.isdecimal() and len(text) < 100) or int(text) < least:
            raise argparse.ArgumentTypeError(
                f"must be a whole number, at least {least}; got {text[:40]!r}"
            )
        if most is not None and int(text) > most:
            raise argparse.ArgumentTypeError(f"must be at most {most}; got {text!r}")
        return int(text)

    return read


at_least_one = whole(1)
order = whole(1, MOST_ORDERS)  # of an ARX model
samples = whole(0, MOST_SAMPLES)  # of a delay
seed = whole(0, None)


def workers(text: str) -> int:
    """A number of workers, or -1 for all processors, -2 for all but one, as joblib counts."""
    count = whole(1, MOST_WORKERS)
    return -count(text[1:]) if text.startswith("-") else count(text)


def _number(what: str, fits: Callable[[float], bool]) -> Callable[[str], float]:
    def read(text: str) -> float:
        number = _finite(text)
        if not fits(number):
            raise argparse.ArgumentTypeError(f"must be a number{what}; got {text!r}")
        return number

    return read


positive = _number(" above 0", lambda number: number > 0)
not_negative = _number(", at least 0", lambda number: number >= 0)
probability = _number(" above 0 and below 1", lambda number: 0 < number < 1)


def _finite(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        return math.nan
    return number if math.isfinite(number) else math.nan


def with_one_element(words: list[str]) -> list[str]:
    """Arguments in which the two numbers of a controlled element are one word.

    Two numbers and one text cannot both be an option's values, as file names may follow it.
    """
    for i, word in enumerate(words):
        numbers = words[i + 1 : i + 3]
        known = [text for text in numbers if not math.isnan(_finite(text))]
        if word == "--controlled-element" and len(known) == 2:
            return [*words[: i + 1], " ".join(numbers), *words[i + 3 :]]
    return words


def pairs(items: Iterable[str], option: str, example: str) -> dict[str, str]:
    """NAME=VALUE pairs of an option that may be repeated."""
    found: dict[str, str] = {}
    for item in items:
        name, sign, value = item.partition("=")
        if not sign:
            raise ValueError(f"{option} takes {example}; got {item!r}.")
        if name in found:
            raise ValueError(
                f"{option} says twice what {name!r} is, {found[name]!r} and {value!r}: say it once."
            )
        found[name] = value
    return found


def read_units(options: argparse.Namespace) -> dict[str, str]:
    """Units of channels, by ``--unit``."""
    return pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg")


def read_roles(options: argparse.Namespace) -> dict[str, str]:
    """Roles of channels, by ``--role``."""
    return pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")


def refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect; ``why`` completes the sentence after their name."""
    for name in names:
        value: Any = getattr(options, name, None)
        if not (value is None or value is False or value == []):  # 0 is a value
            raise ValueError(f"--{name.replace('_', '-')} {why}")


def refuse_of_other_core(options: argparse.Namespace) -> None:
    """Refuse options of a core that the model has not."""
    for core, names in OF_CORE.items():
        if core != options.core:
            refuse(options, names, f"needs --core {core}.")


ABOUT_FILES = ["time", "dt", "run", "subject", "condition", "unit", "resample"]
ABOUT_FILES += ["input", "instruments", "output", "x", "target", "role", "display"]
BUNDLED = ("identify", "diagnose", "report", "experiment")  # which have recordings of their own
NO_SEARCH = ("report", "experiment")  # which can do without


def refuse_at_once(options: argparse.Namespace) -> None:
    """Refuse options that have no effect, and effects that there are not, before the work."""
    if options.command in BUNDLED and not options.files:
        refuse(
            options,
            ABOUT_FILES,
            "is about files, and there are none. Options that take several words also take files "
            "that follow: name the files first.",
        )
    if "tables" in options and options.tables is None:
        refuse(options, ["table_format"], "needs --tables FOLDER: else no tables are written.")
    _check_effects(getattr(options, "effects", None) or ["all"], options.command)


def _check_effects(names: list[str], command: str) -> None:
    if names == ["all"] or (names == ["none"] and command in NO_SEARCH):
        return
    if "all" in names:
        raise ValueError("--effects all takes no other names: it is all of them.")
    if "none" in names:
        raise ValueError(
            "--effects none stands alone, in skhoid report and experiment, which then make no "
            "search; else name the effects to search for, or leave --effects out to search for all."
        )
    from ...effects import catalogue

    known = list(catalogue().index)
    unknown = next((name for name in names if name not in known), None)
    if unknown is not None:
        raise ValueError(
            f"No effect is called {unknown!r}. The effects are: {', '.join(known)}."
            f"{did_you_mean(unknown, known)}"
        )


# Options that several commands have.


def add_file_options(add: Callable[..., Any]) -> None:
    """Options that say which files, and what is in them."""
    add(
        "files",
        nargs="*",
        default=(),
        metavar="FILES",
        help="CSV, Parquet or MAT files, or patterns; their columns are guessed, and said",
    )
    add("--output", metavar="NAME", help="output column (default: guessed)")
    add("--time", metavar="NAME", help="time column, in seconds (default: guessed)")
    add("--run", metavar="NAME", help="column with run labels (default: guessed, or each file)")
    for level in ("subject", "condition"):
        add(
            f"--{level}",
            metavar="LABEL",
            help=f"take the runs of one {level} only (default: all)",
        )
    add(
        "--dt",
        type=positive,
        metavar="S",
        help="sampling time: of files without a time channel, or to resample to",
    )
    add_unit(add)
    add(
        "--resample",
        action="store_true",
        help="bring an irregular clock onto a regular grid by interpolation first",
    )


def add_unit(add: Callable[..., Any]) -> None:
    """The option on units of channels."""
    add(
        "--unit",
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a channel; 'ms' for time converts it; may be repeated",
    )


def add_channel_options(add: Callable[..., Any]) -> None:
    """Options that say which channels there are besides inputs and output, and the run-in."""
    add("--x", metavar="NAME", help="the controlled element's output (default: guessed)")
    add("--target", metavar="NAME", help="the target f_t (default: guessed)")
    add(
        "--role",
        action="append",
        default=[],
        metavar="NAME=ROLE",
        help="another channel, or another role: e, x, f_t, dist..., motion... or empty; may be "
        "repeated",
    )
    add_run_in(add)


def add_run_in(add: Callable[..., Any]) -> None:
    """The option that discards the start of each run."""
    add(
        "--run-in",
        type=not_negative,
        metavar="S",
        help="discard this much at the start of each run",
    )


def add_recording_options(command: Parser) -> None:
    """Options of files, their channels, and the model."""
    add = command.section("Data")
    add_file_options(add)
    add(
        "--input",
        metavar="NAME",
        help="the error, or else the target; then no other channel is guessed (default: guessed)",
    )
    add_channel_options(add)
    add(
        "--remove-means",
        action="store_true",
        help="subtract the mean of each channel first, for positions far from zero",
    )
    add_model_options(command.section("Model"), "the operator")


def add_model_options(add: Callable[..., Any], who: str) -> None:
    """Options that say what the model is, what ``who`` sees, and what is controlled."""
    add(
        "--core",
        choices=list(OF_CORE),
        default="operator",
        help="what the model is: the operator's physics, or ARX (default: operator)",
    )
    add(
        "--delay", type=not_negative, metavar="S", help="delay of the operator (default: estimated)"
    )
    add("--na", type=order, metavar="N", help="order of the ARX core (default: 2)")
    add("--nb", type=order, metavar="N", help="order of the ARX core (default: 2)")
    add("--nk", type=samples, metavar="N", help="delay of the ARX core in samples (default: found)")
    add(
        "--display",
        choices=["compensatory", "pursuit", "preview"],
        help=f"what {who} could see (default: not said)",
    )
    add(
        "--controlled-element",
        metavar="ELEMENT",
        help='what makes x of the output: "1/(s(s+1))", or the numbers K_C OMEGA_B of K_c / (s (s '
        "+ omega_b)) (default: estimated where x is given)",
    )


def add_lost_control(add: Callable[..., Any]) -> None:
    """The option on stretches in which control was lost."""
    add(
        "--lost-control",
        choices=["leave_out", "keep"],
        default="leave_out",
        help="what becomes of stretches in which control was lost: left out of fit and judgement, "
        "or kept (default: leave_out)",
    )


def add_search_options(add: Callable[..., Any], more: str = "") -> None:
    """Options of the search."""
    add("--effects", nargs="+", metavar="ID", help=f"effects to search for (default: all{more})")
    add(
        "--max-effects",
        type=whole(0),
        metavar="N",
        help=f"to add at most (default: {MAX_EFFECTS})",
    )
    add_lost_control(add)


def add_plot_options(add: Callable[..., Any], folder: str) -> None:
    """Options of the plots."""
    add("--out", metavar="FOLDER", help=f"for the plots (default: {folder})")
    add("--no-pictures", action="store_true", help="draw nothing")
    add_format(add)


def add_format(add: Callable[..., Any]) -> None:
    """The option that says in which format pictures are drawn."""
    add("--format", choices=PICTURES, help="format of the pictures (default: png)")


def add_output_options(add: Callable[..., Any], tables: bool = True) -> None:
    """Options that every command has, and those of tables."""
    if tables:
        add("--tables", metavar="FOLDER", help="write every table to FOLDER")
        add_table_format(add, TABLES)
    add("--json", action="store_true", help="print the results as JSON, and nothing else")
    add_debug(add)


def add_debug(add: Callable[..., Any]) -> None:
    """The option for those who look for an error."""
    add("--debug", action="store_true", help="show tracebacks of errors (exit code 1)")


def add_table_format(add: Callable[..., Any], default: str) -> None:
    """The option that says in which format tables are written."""
    add(
        "--table-format",
        choices=["tsv", "csv", "parquet"],
        help=f"tab-separated or comma-separated text, or Parquet (default: {default})",
    )
