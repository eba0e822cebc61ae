"""The command ``skhoid diagnose``: which effects a model of recordings is missing."""

from __future__ import annotations

import argparse
from typing import Any

from .commands import add_command
from .files import new_file
from .options import refuse
from .output import add_output_options, check_tables
from .recordings import add_recording_options, read_recordings
from .telling import add_picture_options, add_search_options, leave, picture_folder, tell

EXAMPLES = """\
examples:
  skhoid diagnose                          bundled recordings of a human tracker
  skhoid diagnose run*.csv --input e --x x --target f_t --output u --time t
  skhoid diagnose runs.mat --input data.e --output data.u --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --input e --role roll=motion --time t --effects motion_feedback bias
  skhoid diagnose stick.csv --input force --output angle --time t --core arx --na 2 --nb 2 --nk 1
  skhoid diagnose run*.csv --input e --time t --report out.html --tables out
"""


def add_diagnose(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "diagnose",
        diagnose,
        "find the effects that a model of your recordings is missing",
        "Fit a model to recorded runs, compare it with them, and find out which "
        "physical effects it is missing, on runs held out of the fit. Without files it uses four "
        "bundled recordings of a person tracking a target.",
        EXAMPLES,
    )
    add = command.add_argument
    add_recording_options(add)
    add_search_options(add)
    add_picture_options(add, "skhoid-diagnose")
    add("--report", metavar="FILE", help="write a report, one HTML file")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    report = None
    if options.report is None:
        refuse(options, ["overwrite"], "is for the file of --report FILE.")
    else:
        report = new_file(options.report, options.overwrite, new_folder=True)
    folder = picture_folder(options, "skhoid-diagnose")
    check_tables(options)
    X, y, estimator, source = read_recordings(options)
    story = tell(options, estimator, X, y, source)
    leave(options, story, source, report=report, folder=folder)
    return 0
