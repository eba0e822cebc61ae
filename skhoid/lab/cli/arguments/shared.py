"""Options that several commands have."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..options import count, not_negative, order, positive, samples

OF_CORE = {"operator": ["delay"], "arx": ["na", "nb", "nk"]}
MAX_EFFECTS = 4
TABLES = "tsv"
PICTURES = ("png", "pdf", "svg")


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
    add(
        "--unit",
        action="append",
        default=[],
        metavar="NAME=UNIT",
        help="unit of a channel; 'ms' for time converts it; may be repeated",
    )
    add(
        "--resample",
        action="store_true",
        help="bring an irregular clock onto a regular grid by interpolation first",
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


def add_recording_options(command: Any) -> None:
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
    add("--max-effects", type=count, metavar="N", help=f"to add at most (default: {MAX_EFFECTS})")
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
    add("--debug", action="store_true", help="show tracebacks of errors (exit code 1)")


def add_table_format(add: Callable[..., Any], default: str) -> None:
    """The option that says in which format tables are written."""
    add(
        "--table-format",
        choices=["tsv", "csv", "parquet"],
        help=f"tab-separated or comma-separated text, or Parquet (default: {default})",
    )
