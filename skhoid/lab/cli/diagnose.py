"""The command ``skhoid diagnose``: which effects a model of recordings is missing."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...search.sketch import checked_name, why_no_shape, written
from .files import new_file
from .next_steps import after_diagnose
from .options import refuse
from .output import note, say_next
from .recordings import read_recordings
from .search_output import figure_folder, show_search, write_results
from .tables import check_tables


def effect_file(name: str, overwrite: bool) -> Path:
    """The file of an effect, checked before the work begins."""
    path = new_file(name, overwrite)
    if path.suffix != ".py":
        raise ValueError(f"--sketch writes a Python file, such as my_effect.py; got {name}.")
    checked_name(path.stem)
    return path


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    report = sketch = None
    if options.report is None and options.sketch is None:
        refuse(options, ["overwrite"], "is for the files of --report FILE and --sketch FILE.")
    if options.report is not None:
        report = new_file(options.report, options.overwrite, new_folder=True)
    if options.sketch is not None:
        sketch = effect_file(options.sketch, options.overwrite)
    folder = figure_folder(options, "skhoid-diagnose")
    check_tables(options)
    X, y, estimator, source = read_recordings(options)
    story = show_search(options, estimator, X, y, source)
    shape = story.search_.shape_
    if sketch is not None and shape is not None:
        written(sketch.stem, sketch, shape, overwrite=options.overwrite)
    write_results(options, story, source, report=report, folder=folder, sketch=shape and sketch)
    if sketch is not None and shape is None:
        note(f"--sketch: {why_no_shape(story.search_.best_effects_)}")
    if not options.json:
        say_next(after_diagnose(options, story.search_))
    return 0
