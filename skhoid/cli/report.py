"""The command ``skhoid report``: one HTML file about a model of recordings."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .commands import add_command
from .files import new_file
from .options import refuse
from .output import (
    add_output_options,
    check_tables,
    print_json,
    print_wrapped,
    save_tables,
    say_files,
)
from .recordings import add_recording_options, read_recordings
from .telling import add_search_options, leave, tables_of_comparison, tell, write_report
from .wording import reworded

EXAMPLES = """\
examples:
  skhoid report                            about bundled recordings of a human tracker
  skhoid report run*.csv --input e --x x --target f_t --output u --time t --out monday.html
  skhoid report run*.csv --input e --time t --effects none         the model as it is, no search
  skhoid report run*.csv --input e --time t --title "Subject 3" --overwrite --tables tables
"""
OF_SEARCH = ["display", "max_effects", "controlled_element"]


def add_report(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "report",
        report,
        "write a report on a model of your recordings, one HTML file",
        "Do what `skhoid diagnose` does, and write it down in one HTML file that needs "
        "no network: data, model, comparison, ranking, error, parameters, and what to do next. "
        "Without files it uses four bundled recordings of a person tracking a target.",
        EXAMPLES,
    )
    add = command.add_argument
    add_recording_options(add)
    add_search_options(add, "; none: no search")
    add("--title", metavar="TEXT", help="title of the report")
    add("--out", default="report.html", metavar="FILE", help="the file (default: report.html)")
    add("--overwrite", action="store_true", help="replace FILE if it exists")
    add_output_options(add)


def report(options: argparse.Namespace) -> int:
    """Report on a model of recordings, with a search for missing effects or without."""
    path = new_file(options.out, options.overwrite, new_folder=True)
    check_tables(options)
    search = options.effects != ["none"]
    if not search:
        refuse(options, OF_SEARCH, "is for the search, and --effects none makes none.")
    X, y, estimator, source = read_recordings(options)
    if search:
        story = tell(options, estimator, X, y, source, aloud=False)
        if not options.json:
            for line in story.search_.summary().splitlines():
                print_wrapped(reworded(line, options))
        leave(options, story, source, report=path)
        return 0
    return _without_search(options, path, X, y, estimator, source)


def _without_search(
    options: argparse.Namespace, path: Path, X: Any, y: Any, estimator: Any, source: str
) -> int:
    import pandas as pd

    from .._version import __version__
    from ..search.story import comparison_dict, parameter_line

    model = estimator.fit(X, y)
    page = write_report(options, path, model, X, y, source, effects=None)
    compared = page.comparison
    vaf = model.score(X, y) if compared is None else compared.vaf
    tables = {
        "parameters": model.parameters_,
        "predictions": pd.DataFrame({"measured": y, "free_run": model.predict(X)}, index=X.index),
        **tables_of_comparison(compared),
    }
    files = {"report": str(path), "pictures": [], "tables": save_tables(tables, options)}
    if options.json:
        found = {
            "skhoid": __version__,
            "source": source,
            "inputs": [str(name) for name in model.inputs_],
            "output": str(y.name),
            "parameters": model.parameters_.reset_index().to_dict("records"),
            "vaf": vaf,
            "comparison": None if compared is None else comparison_dict(compared),
        }
        print_json({**found, **files})
    else:
        print_wrapped(f"VAF {vaf:.1f} %: {parameter_line(model)}")
        for text in compared.notes if compared is not None else []:
            print_wrapped(reworded(f"  note: {text}", options))
        say_files(files)
    return 0
