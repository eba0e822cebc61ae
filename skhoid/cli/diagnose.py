"""The command ``skhoid diagnose``: which effects a model of recordings is missing."""

from __future__ import annotations

import argparse

from .files import new_file
from .next_steps import after_diagnose
from .options import refuse
from .output import say_next
from .recordings import read_recordings
from .search_output import figure_folder, show_search, write_results
from .tables import check_tables


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    report = None
    if options.report is None:
        refuse(options, ["overwrite"], "is for the file of --report FILE.")
    else:
        report = new_file(options.report, options.overwrite, new_folder=True)
    folder = figure_folder(options, "skhoid-diagnose")
    check_tables(options)
    X, y, estimator, source = read_recordings(options)
    story = show_search(options, estimator, X, y, source)
    write_results(options, story, source, report=report, folder=folder)
    if not options.json:
        say_next(after_diagnose(options, story.search_))
    return 0
