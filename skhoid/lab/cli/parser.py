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
import textwrap
from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import Any, NoReturn

from ...exceptions import did_you_mean

MOST = 1_000_000  # of what is counted: runs, replications, subjects
MOST_ORDERS = 100
MOST_SAMPLES = 100_000  # of a delay
MOST_WORKERS = 8 * (os.cpu_count() or 1)
OF_CORE = {"operator": ["delay"], "arx": ["na", "nb", "nk"]}
OF_SEARCH = ["display", "max_effects", "time_limit", "controlled_element", "exhaustive"]
MAX_EFFECTS = 4
TABLES = "tsv"
PICTURES = ("png", "pdf", "svg")
MODELS = (".joblib", ".pkl", ".pickle")  # files that may hold one; the first is what --save writes
DOMAINS = ("human", "machine")
USED = {"files", "model", "--input", "--output", "--target", "--x", "--time", "--dt", "--run-in"}
USED |= {"--effects", "--report", "--dry-run"}  # ten of those that diagnose has, and FILES
NO_ROLES: Mapping[str, str] = MappingProxyType({})
_CHOICE = re.compile(r"invalid choice: '([^']*)' \(choose from (.*)\)")
_UNKNOWN = "unrecognized arguments: "


class Parser(argparse.ArgumentParser):
    """Remembers its arguments, for tab completion; keeps the layout of examples."""

    def __init__(self, *, description: str, **more: Any) -> None:
        self.arguments: list[argparse.Action] = []
        width = shutil.get_terminal_size().columns - 2  # as argparse
        self._used: Any = None
        super().__init__(
            description=textwrap.fill(description, width),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **more,
        )

    def section(self, title: str) -> Callable[..., argparse.Action]:
        """A function that adds arguments under a heading of the help.

        Those that people use stand before all others.
        """
        self._used = self._used or self.add_argument_group("What people use")
        group = self.add_argument_group(title)

        def add(*names: Any, **more: Any) -> argparse.Action:
            argument = (self._used if names[0] in USED else group).add_argument(*names, **more)
            self.arguments.append(argument)
            return argument

        return add

    def error(self, message: str) -> NoReturn:
        """Say what is wrong in one line, and what was meant."""
        # argparse has no other way to tell what was wrong than its message.
        wrong = _CHOICE.search(message)
        if wrong is not None:
            if self._subparsers is not None:
                message = f"There is no command {wrong[1]!r}."
            message += did_you_mean(wrong[1], re.findall(r"[\w-]+", wrong[2]))
            if os.path.exists(wrong[1]):
                message += f" To look into a file: skhoid diagnose {shlex.quote(wrong[1])}"
        elif message.startswith(_UNKNOWN):
            options = [name for a in self.arguments for name in a.option_strings]
            words = message.removeprefix(_UNKNOWN).split()
            near = [did_you_mean(word, options) for word in words if word.startswith("-")]
            message += "." + "".join(dict.fromkeys(near))
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def add_command(
    commands: Any, work: Callable[[argparse.Namespace], int], about: str, usage: str, examples: str
) -> Parser:
    """Add the command that is called as the function that does it; returns its parser.

    ``about`` is a line for the list of commands, and below it a description.
    """
    name = work.__name__
    help, _, description = about.partition("\n")
    command: Parser = commands.add_parser(
        name, help=help, description=description, epilog=examples, usage=f"skhoid {name} {usage}"
    )
    command.set_defaults(work=work)
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
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and fits(number)):
            raise argparse.ArgumentTypeError(f"must be a number{what}; got {text!r}")
        return number

    return read


positive = _number(" above 0", lambda number: number > 0)
not_negative = _number(", at least 0", lambda number: number >= 0)


def _read_pairs(items: Iterable[str], option: str, example: str) -> dict[str, str]:
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
    return _read_pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg")


def read_roles(options: argparse.Namespace, known: Mapping[str, str] = NO_ROLES) -> dict[str, str]:
    """Roles of channels, by ``--role``, ``--x`` and ``--target``; of inputs they are ``known``."""
    roles = _read_pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")
    said = {**known, **roles}
    for name, role in ((options.x, "x"), (options.target, "f_t")):
        if name is None:
            continue
        if said.setdefault(name, role) != role:
            raise ValueError(
                f"The channel {name!r} has two roles, {said[name]!r} and {role!r}: name different "
                "channels."
            )
        roles[name] = role
    return roles


def refuse(options: argparse.Namespace, names: Iterable[str], why: str) -> None:
    """Refuse options that would have no effect; ``why`` completes the sentence after their name."""
    for name in names:
        value: Any = getattr(options, name, None)
        if not (value is None or value is False or value == []):  # 0 is a value
            raise ValueError(f"--{name.replace('_', '-')} {why}")


ABOUT_FILES = ["time", "dt", "run", "sheet", "subject", "condition", "unit", "resample"]
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
    for core, names in OF_CORE.items():
        if "core" in options and core != options.core:
            refuse(options, names, f"needs --core {core}.")
    effects = getattr(options, "effects", None)
    if effects == ["none"] and options.command in NO_SEARCH:
        refuse(options, OF_SEARCH, "is for the search, and --effects none makes none.")
    elif effects is not None:
        _check_effects(effects)


def name_sheet(options: argparse.Namespace) -> None:
    """Put the sheet of --sheet behind the names of Excel files."""
    if getattr(options, "sheet", None) is not None:
        books = [name for name in options.files if name.casefold().endswith((".xlsx", ".xlsm"))]
        if not books:
            raise ValueError("--sheet is for Excel files (.xlsx), and FILES has none.")
        options.files = [f"{n}#{options.sheet}" if n in books else n for n in options.files]


def _check_effects(names: list[str]) -> None:
    if names == ["all"]:
        return
    if "all" in names or "none" in names:
        raise ValueError(
            "--effects all and --effects none (of skhoid report and experiment) stand alone: name "
            "the effects to search for, or leave --effects out to search for all."
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
    files = "CSV, MAT, Excel or Parquet files, patterns, or a folder; columns are guessed, and said"
    add("files", nargs="*", default=(), metavar="FILES", help=files)
    add("--output", metavar="NAME", help="output column (default: guessed)")
    add("--time", metavar="NAME", help="time column, in seconds (default: guessed)")
    add("--run", metavar="NAME", help="column with run labels (default: guessed, or each file)")
    sheet = "sheet of Excel files (default: all that have the same columns, each a run)"
    add("--sheet", metavar="NAME", help=sheet)
    for level in ("subject", "condition"):
        add(f"--{level}", metavar="LABEL", help=f"take the runs of one {level} only (default: all)")
    dt = "sampling time: of files without a time channel, or to resample to"
    add("--dt", type=positive, metavar="S", help=dt)
    add_unit(add)
    resample = "bring an irregular clock onto a regular grid by interpolation first"
    add("--resample", action="store_true", help=resample)


def add_unit(add: Callable[..., Any]) -> None:
    """The option on units of channels."""
    text = "unit of a channel; 'ms' for time converts it; may be repeated"
    add("--unit", action="append", default=[], metavar="NAME=UNIT", help=text)


def add_channel_options(add: Callable[..., Any]) -> None:
    """Options that say which channels there are besides inputs and output, and the run-in."""
    add("--x", metavar="NAME", help="the controlled element's output (default: guessed)")
    add("--target", metavar="NAME", help="the target f_t (default: guessed)")
    role = "another channel, or another role: e, x, f_t, dist..., motion... or empty; may be "
    add("--role", action="append", default=[], metavar="NAME=ROLE", help=role + "repeated")
    add_run_in(add)


def add_run_in(add: Callable[..., Any]) -> None:
    """The option that discards the start of each run."""
    text = "discard this much at the start of each run"
    add("--run-in", type=not_negative, metavar="S", help=text)


def add_decimate(add: Callable[..., Any]) -> None:
    """The option that thins the rows that are fitted."""
    text = "decimation factor: of N rows one is fitted; predictions keep all (default: 1)"
    add("--decimate", type=order, default=1, metavar="N", help=text)


def add_recording_options(command: Parser) -> None:
    """Options of files, their channels, and the model."""
    add = command.section("Data")
    add_file_options(add)
    text = "the error, or else the target; then no other channel is guessed (default: guessed)"
    add("--input", metavar="NAME", help=text)
    add_channel_options(add)
    add_remove_means(add)
    add_model_options(command.section("Model"), "the operator")


def add_model_options(add: Callable[..., Any], who: str) -> None:
    """Options that say what the model is, what ``who`` sees, and what is controlled."""
    core = "what the model is: the operator's physics, or ARX (default: operator)"
    add("--core", choices=list(OF_CORE), default="operator", help=core)
    text = "delay of the operator (default: estimated)"
    add("--delay", type=not_negative, metavar="S", help=text)
    add("--na", type=order, metavar="N", help="order of the ARX core (default: 2)")
    add("--nb", type=order, metavar="N", help="order of the ARX core (default: 2)")
    add("--nk", type=samples, metavar="N", help="delay of the ARX core in samples (default: found)")
    text = f"what {who} could see (default: not said)"
    add("--display", choices=["compensatory", "pursuit", "preview"], help=text)
    text = 'what makes x of the output: "1/(s(s+1))", or in quotes the numbers "K_C OMEGA_B" of '
    text += "K_c / (s (s + omega_b)) (default: estimated where x is given)"
    add("--controlled-element", metavar="ELEMENT", help=text)


def add_lost_control(add: Callable[..., Any]) -> None:
    """The option on stretches in which control was lost."""
    text = "what becomes of stretches in which control was lost: left out of fit and judgement, "
    text += "or kept (default: leave_out)"
    add("--lost-control", choices=["leave_out", "keep"], default="leave_out", help=text)


def add_search_options(add: Callable[..., Any], more: str = "") -> None:
    """Options of the search."""
    add("--effects", nargs="+", metavar="ID", help=f"effects to search for (default: all{more})")
    text = f"to add at most (default: {MAX_EFFECTS})"
    add("--max-effects", type=whole(0), metavar="N", help=text)
    text = "end the search after about so long, with what was found by then (default: no limit)"
    add("--time-limit", type=positive, metavar="S", help=text)
    text = (
        "fit every effect to the end at each step, as a check; names are the same, it takes longer"
    )
    add("--exhaustive", action="store_true", help=text)
    add_lost_control(add)


def add_save(add: Callable[..., Any]) -> None:
    """The options of the file that holds the fitted model."""
    text = "write the fitted model, without the recordings, for skhoid compare (.joblib)"
    add("--save", metavar="FILE", help=text)


def add_remove_means(add: Callable[..., Any]) -> None:
    """The option for positions that are far from zero."""
    text = "subtract the mean of each channel first, for positions far from zero"
    add("--remove-means", action="store_true", help=text)


def add_plot_options(add: Callable[..., Any], folder: str) -> None:
    """Options of the plots."""
    add("--out", metavar="FOLDER", help=f"for the plots (default: {folder})")
    add("--no-pictures", action="store_true", help="draw nothing")
    add("--format", choices=PICTURES, help="format of the pictures (default: png)")


def add_page_options(add: Callable[..., Any], page: str) -> None:
    """Options of the page that a command writes."""
    add("--title", metavar="TEXT", help="title of the page")
    add("--out", default=page, metavar="FILE", help=f"the file (default: {page})")
    add("--overwrite", action="store_true", help="replace files that exist")


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
    text = f"tab-separated or comma-separated text, or Parquet (default: {default})"
    add("--table-format", choices=["tsv", "csv", "parquet"], help=text)
