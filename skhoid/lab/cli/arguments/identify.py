"""The arguments of ``skhoid identify``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import at_least_one, not_negative, order, positive, samples
from .shared import (
    add_file_options,
    add_lost_control,
    add_output_options,
    add_plot_options,
    add_run_in,
)

EXAMPLES = """\
examples:
  skhoid identify                        a bundled recording of a human tracker
  skhoid identify run*.csv               columns are guessed, and said
  skhoid identify runs.mat --dt 0.01 --run-in 8.08
  skhoid identify all.parquet --run trial --validate 7 --json
  skhoid identify run*.csv --na 2 --nb 2 --nk 29      nothing is searched
  skhoid identify run*.csv --method iv --instruments f_t
  skhoid identify run*.csv --memory-time 2.56         a person who adapts
"""
LONGEST_DELAY = 0.5  # s


def add_identify(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "identify",
        "find delay and orders, fit, and validate on held-out data",
        "Discard the run-in, find the delay and the orders, fit an ARX model and "
        "validate its free run on held-out data: the last run, or the second half of a single "
        "run. Without files it uses a bundled recording of a person tracking a target.",
        EXAMPLES,
        "[FILES] [OPTIONS]",
    )
    add = command.section("Data")
    add_file_options(add)
    add(
        "--input",
        nargs="+",
        metavar="NAME",
        help="input columns; then no other channel is guessed (default: guessed, the error)",
    )
    add("--x", metavar="NAME", help="the controlled element's output, for the leak test")
    add("--target", metavar="NAME", help="the target f_t, for the same")
    add_run_in(add)
    add_lost_control(add)
    add(
        "--decimate",
        type=at_least_one,
        default=1,
        metavar="D",
        help="decimation factor (default: 1)",
    )
    add = command.section("Search")
    add(
        "--longest-delay",
        type=positive,
        metavar="S",
        help=f"longest delay to try (default: {LONGEST_DELAY})",
    )
    add(
        "--least-delay",
        type=not_negative,
        metavar="S",
        help="shortest delay of e and x to try (default: 0.1 of a person, a sample of a machine)",
    )
    add(
        "--domain",
        choices=["human", "machine"],
        help="who controls (default: human where e is given with x or f_t)",
    )
    add(
        "--role",
        action="append",
        default=[],
        metavar="NAME=ROLE",
        help="role of an input of another name: e, x, f_t; may be repeated",
    )
    add(
        "--criterion",
        choices=["one_step", "vaf"],
        help="which delay to go on with (default: one_step); both are printed",
    )
    add = command.section("Model")
    several = "; one number, or one per input"
    add(
        "--nk",
        type=samples,
        nargs="+",
        metavar="N",
        help=f"delay in samples, not searched{several}",
    )
    add("--na", type=order, metavar="N", help="order, not searched (nb: 2, or as given)")
    add(
        "--nb",
        type=order,
        nargs="+",
        metavar="N",
        help=f"order, not searched (na: 2, or as given){several}",
    )
    add(
        "--method",
        choices=["ols", "iv"],
        default="ols",
        help="least squares, or instrumental variables, which remnant does not bias "
        "(default: ols); searches use least squares",
    )
    add(
        "--instruments",
        nargs="+",
        metavar="NAME",
        help="of iv: channels from outside the loop (default: f_t)",
    )
    add(
        "--memory-time",
        type=positive,
        metavar="S",
        help="also fit a model that follows changes, with a memory of this length",
    )
    add("--memory-horizon", type=positive, metavar="N", help="the same in samples of the model")
    add = command.section("Validation")
    add("--validate", nargs="+", metavar="RUN", help="runs to hold out (default: the last)")
    add(
        "--keep-means",
        action="store_true",
        help="no intercept, and VAF with the means kept, as the thesis does",
    )
    add = command.section("Output")
    add_plot_options(add, "skhoid-identify")
    add_output_options(add)
