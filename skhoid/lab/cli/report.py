"""The command ``skhoid report``: one HTML file about a model of recordings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import pandas as pd

from ..._version import __version__
from ...pipelines import prediction_from
from ...search.story import comparison_dict, parameters_table
from .files import columns_dict, new_file
from .messages import message_for
from .next_steps import after_diagnose
from .options import refuse
from .output import print_json, print_wrapped, say_files, say_next
from .recordings import read_recordings
from .search_output import (
    print_block,
    print_source,
    show_search,
    tables_of_comparison,
    write_report,
    write_results,
)
from .tables import check_tables, save_tables

OF_SEARCH = ["display", "max_effects", "controlled_element"]


def report(options: argparse.Namespace) -> int:
    """Report on a model of recordings, with a search for missing effects or without."""
    path = new_file(options.out, options.overwrite, new_folder=True)
    check_tables(options)
    search = options.effects != ["none"]
    if not search:
        refuse(options, OF_SEARCH, "is for the search, and --effects none makes none.")
    X, y, estimator, source = read_recordings(options)
    if search:
        story = show_search(options, estimator, X, y, source, aloud=False)
        if not options.json:
            print_source(options, source)
            for line in story.search_.summary().splitlines():
                print_wrapped(line)
        write_results(options, story, source, report=path)
        if not options.json:
            say_next(after_diagnose(options, story.search_))
        return 0
    return _without_search(options, path, X, y, estimator, source)


def _without_search(
    options: argparse.Namespace, path: Path, X: Any, y: Any, estimator: Any, source: str
) -> int:
    model = estimator.fit(X, y)
    page = write_report(options, path, model, X, y, source, effects=None)
    compared = page.comparison
    vaf = model.score(X, y) if compared is None else compared.vaf
    tables = {
        "parameters": model.parameters_,
        "predictions": pd.DataFrame(
            {"measured": y, "free_run": prediction_from(model, X, y)[0]}, index=X.index
        ),
        **tables_of_comparison(compared),
    }
    files = {"report": str(path), "pictures": [], "tables": save_tables(tables, options)}
    if options.json:
        found = {
            "skhoid": __version__,
            "source": source,
            "columns": columns_dict(options),
            "inputs": [str(name) for name in model.inputs_],
            "output": str(y.name),
            "parameters": model.parameters_.reset_index().to_dict("records"),
            "vaf": vaf,
            "comparison": None if compared is None else comparison_dict(compared),
        }
        print_json({**found, **files})
    else:
        print_source(options, source)
        print_wrapped(f"VAF {vaf:.1f} % of the simulated output on the rows of the fit")
        print_block(parameters_table(model), options, None)
        for each in compared.notes if compared is not None else []:
            print_wrapped(f"  note: {message_for(each, options)}")
        say_files(files)
    return 0
