"""The arguments of ``skhoid compare``."""

from __future__ import annotations

from typing import Any

from ..commands import add_command
from ..options import probability
from .shared import add_channel_options, add_file_options, add_output_options

EXAMPLES = """\
examples:
  skhoid compare model.joblib run*.csv --time t
  skhoid compare model.joblib run*.csv --time t --output u --x x --target f_t --run-in 5
  skhoid compare model.joblib new.csv --time t --estimation old1.csv old2.csv --out compared.png
  skhoid compare model.joblib new.csv --time t --domain machine --json --tables tables

The model is what joblib.dump(model, "model.joblib") wrote after fit, in Python. Such a file can
run any code when it is read: take it only from people you trust.
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
    )
    add = command.add_argument
    add("model", metavar="FILE", help="the fitted model, a file of joblib or pickle")
    add_file_options(add)
    add(
        "--input",
        nargs="+",
        metavar="NAME",
        help="channels for the columns that the model was fitted on, in their order (default: "
        "channels of the same names)",
    )
    add_channel_options(add)
    add(
        "--estimation",
        nargs="+",
        metavar="FILES",
        help="files that the model was fitted on, for the verdict on overfit",
    )
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
    add("--out", metavar="FILE", help="draw the page of panels into this image file")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)
