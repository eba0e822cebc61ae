"""The arguments of ``skhoid study``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import at_least_one, not_negative, positive, seed, workers
from .shared import add_file_options, add_format, add_output_options, add_table_format

EXAMPLES = """\
examples:
  skhoid study list
  skhoid study fig13 --replications 20 --jobs 2
  skhoid study fig13 --replications 100 --out studies    kept, and resumed
  skhoid study fig9 --conditions C1 --intensities 0 0.15 0.3
  skhoid study recommend --conditions C4 --intensities 0.15 --rate 50
  skhoid study recommend --conditions C4 --question detect --causal
  skhoid study tournament --size small
  skhoid study experiment              three simulated subjects, six conditions
  skhoid study experiment s1_*.csv --measurement-time 81.92
"""
TABLES = "csv"
QUESTIONS = (
    "follow",
    "final",
    "detect",
    "predict",
    "delay",
)  # of skhoid.lab.studies.tournament, not loaded here
SIZES = ("full", "small")


def add_study(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "study",
        "Monte-Carlo studies: the paper's figures, an experiment, which method to use",
        "Simulate many runs, fit them all, and say how it compares with the thesis: "
        "'list' names the studies; 'all' makes every one of the paper; 'experiment' analyses "
        "subjects, conditions and runs (simulated, or your files of one subject and condition); "
        "'recommend' finds the memory horizon for an experiment to come, or with --question the "
        "method; 'tournament' lets all methods that follow a changing operator compete.",
        EXAMPLES,
        "NAME [FILES] [OPTIONS]",
    )
    add = command.section("Data")
    add(
        "name",
        metavar="NAME",
        help="fig9, fig10, fig12 ... (see list), all, experiment, recommend, tournament",
    )
    add_file_options(add)
    add("--input", metavar="NAME", help="input column of files (default: guessed)")
    add("--measurement-time", type=positive, metavar="S", help="keep the end of runs of files")
    add = command.section("Study")
    add("--replications", type=at_least_one, metavar="M", help="runs of each cell (default: 100)")
    add("--validation", type=at_least_one, metavar="V", help="validation runs (default: 10)")
    add("--conditions", nargs="+", metavar="C", help="such as C1 C4")
    add("--intensities", nargs="+", type=not_negative, metavar="P", help="P_n, such as 0 0.15")
    add("--orders", nargs="+", metavar="M", help="of the remnant filter: 1 2 3 4 nm")
    add("--rate", type=positive, metavar="HZ", help="of recommend (default: 100)")
    add("--question", choices=QUESTIONS, help="of recommend: which method answers it best")
    add("--causal", action="store_true", help="with --question: only methods without later data")
    add("--methods", nargs="+", metavar="NAME", help="of tournament and --question (default: all)")
    add("--size", choices=SIZES, help="of tournament: its cells and runs (default: full)")
    add("--gains", choices=["table", "tuned"], help="K_n: Table G.1, or found (default: table)")
    add("--subjects", type=at_least_one, metavar="N", help="of experiment (default: 3)")
    add("--runs", type=at_least_one, metavar="N", help="of experiment (default: 7)")
    add("--last", type=at_least_one, metavar="N", help="runs used (default: 5)")
    add("--seed", type=seed, metavar="N", help="of the simulation (default: 0)")
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    add = command.section("Output")
    add("--out", metavar="FOLDER", help="keep blocks, tables and plots in FOLDER/NAME")
    add("--no-pictures", action="store_true", help="draw nothing")
    add_format(add)
    add_table_format(add, TABLES)
    add_output_options(add, tables=False)
