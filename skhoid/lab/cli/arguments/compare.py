"""The arguments of ``skhoid compare``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import probability
from .shared import add_channel_options, add_file_options, add_output_options

EXAMPLES = """\
examples:
  skhoid compare model.joblib run*.csv
  skhoid compare model.joblib run*.csv --output stick --x pitch --run-in 5
  skhoid compare model.joblib new.csv --estimation old1.csv --out compared.png
  skhoid compare model.joblib new.csv --domain machine --json --tables tables

The model is what joblib.dump(model, "model.joblib") wrote after fit, in Python.
Such a file can run any code when it is read: take it only from people you
trust.
"""


def add_compare(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "compare",
        "compare a fitted model with recordings: how good, where bad, how much is left",
        "Compare a model that was fitted and saved in Python with recorded runs: its free run, "
        "where it fails, the noise ceiling, and what to do next.",
        EXAMPLES,
        "MODEL FILES [OPTIONS]",
    )
    add = command.section("Data")
    add("model", metavar="FILE", help="the fitted model, a file of joblib or pickle")
    add_file_options(add)
    add(
        "--input",
        nargs="+",
        metavar="NAME",
        help="columns for those that the model was fitted on, in their order (default: those of "
        "the same names or roles)",
    )
    add_channel_options(add)
    add(
        "--estimation",
        nargs="+",
        metavar="FILES",
        help="files that the model was fitted on, for the verdict on overfit",
    )
    add = command.section("Comparison")
    add(
        "--domain",
        choices=["human", "machine"],
        help="whose words the findings use (default: by the model and the channels)",
    )
    add(
        "--false-alarm",
        type=probability,
        default=0.01,
        metavar="P",
        help="of each test (default: 0.01)",
    )
    add = command.section("Output")
    add("--out", metavar="FILE", help="draw the panels (.png, .pdf, .svg), or a page (.html)")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)
