"""The arguments of ``skhoid simulate``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import at_least_one, not_negative, positive, seed
from .shared import add_output_options

EXAMPLES = """\
examples:
  skhoid simulate --condition C4 --runs 5 --remnant 0.15 --out runs.parquet
  skhoid diagnose runs.parquet
  skhoid simulate --condition C1 --remnant 0.2 --remnant-order 3 --out c1.mat
"""


def add_simulate(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "simulate",
        "simulate runs of a tracking task and write them to a file",
        "Simulate a human operator in the closed loop of the thesis, with remnant, and "
        "write the runs to a file that `skhoid identify` reads.",
        EXAMPLES,
        "--out FILE [OPTIONS]",
    )
    add = command.section("Data")
    add("--condition", default="C1", metavar="C", help="C1 to C6 (Table III; default: C1)")
    add("--runs", type=at_least_one, default=5, metavar="N", help="number of runs (default: 5)")
    add(
        "--remnant",
        type=not_negative,
        default=0.0,
        metavar="P",
        help="P_n, such as 0.15 (default: 0)",
    )
    add("--remnant-order", metavar="M", help="1, 2, 3, 4 or nm (default: 2)")
    add(
        "--channels",
        nargs="+",
        default=["e", "x", "f_t"],
        metavar="NAME",
        help="of e, x, f_t, dist (default: e x f_t)",
    )
    add("--rate", type=positive, default=100.0, metavar="HZ", help="sampling rate (default: 100)")
    add("--random-phases", action="store_true", help="new phases of the target in each run")
    add("--open-loop", action="store_true", help="remnant does not go round the loop")
    add("--seed", type=seed, metavar="N", help="the same number gives the same runs")
    add = command.section("Output")
    add("--out", required=True, metavar="FILE", help=".csv, .tsv, .parquet or .mat")
    add("--overwrite", action="store_true", help="replace files that exist")
    add("--picture", metavar="FILE", help="draw the first run and the spread (.png, .pdf, .svg)")
    add_output_options(add, tables=False)
