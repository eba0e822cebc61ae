"""The command ``skhoid diagnose``: which effects a model of recordings is missing."""

from __future__ import annotations

import argparse

from .files import new_file
from .options import refuse
from .recordings import read_recordings
from .tables import check_tables
from .telling import leave, picture_folder, tell


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
