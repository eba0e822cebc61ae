"""The arguments of ``skhoid demo``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import at_least_one, not_negative, seed
from .names import HIDDEN
from .shared import add_output_options, add_plot_options, add_search_options

EXAMPLES = """\
examples:
  skhoid demo                    a person with a dead zone and an offset
  skhoid demo --effect saturation --remnant 0.2 --seed 3
  skhoid demo --effect none      nothing is hidden: does it say so?
"""


def add_demo(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "demo",
        "hide an effect in a simulated person, and find it",
        "Simulate runs of a person who tracks a target, with effects hidden in them, "
        "fit a model that knows nothing of them, and find out which are missing: the whole way, "
        "with numbers at each step, and a report in the end.",
        EXAMPLES,
    )
    add = command.section("Data")
    add(
        "--effect",
        nargs="+",
        default=["dead_zone", "bias"],
        metavar="HIDDEN",
        help=f"hidden in the person: none, or of {', '.join(HIDDEN)} (default: dead_zone bias)",
    )
    add("--runs", type=at_least_one, default=4, metavar="N", help="number of runs (default: 4)")
    add("--remnant", type=not_negative, default=0.1, metavar="P", help="P_n (default: 0.1)")
    add("--seed", type=seed, default=0, metavar="N", help="of the simulation (default: 0)")
    add_search_options(command.section("Search"))
    add = command.section("Output")
    add_plot_options(add, "skhoid-demo")
    add("--no-report", action="store_true", help="do not write report.html into that folder")
    add_output_options(add)
