"""The search of ``demo``, ``diagnose`` and ``report``: what it prints, plots and writes."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import Any

import pandas as pd
from sklearn.callback import ProgressBar

from ..._version import __version__
from ...diagnosis import Comparison
from ...effects.catalogue import BY_NAME
from ...human.controlled_element import element_of
from ...io._paths import shown
from ...search import EffectSearchCV
from ...search.story import Story, StoryTable
from ..report import Report, report
from .arguments.shared import MAX_EFFECTS
from .files import check_folders, columns_dict, save_figures, without_screen
from .options import refuse
from .output import print_bold, print_json, print_table, print_wrapped, say_files
from .tables import save_tables

OF_COMPARISON = (
    "by_run",
    "by_time",
    "by_frequency",
    "by_operating_point",
    "tests",
    "correlations",
    "cusum",
    "time_frequency",
    "remnant_spectrum",
)


def figure_folder(options: argparse.Namespace, default: str) -> Path | None:
    """The folder for the plots, if any are drawn, checked before the work begins."""
    if options.no_pictures:
        refuse(options, ["out", "format"], "is for the plots, and --no-pictures draws none.")
        return None
    folder = Path(options.out or default)
    check_folders(folder)
    return folder


def wanted_effects(options: argparse.Namespace) -> Any:
    """The effects to search for, known by name."""
    return "all" if options.effects in (None, ["all"]) else options.effects


def show_search(
    options: argparse.Namespace,
    estimator: Any,
    X: Any,
    y: Any,
    source: str,
    *,
    aloud: bool = True,
    truth: dict[str, float] | None = None,
) -> Story:
    """Search, and print each result as soon as it is known, beside the truth where it is."""
    search = EffectSearchCV(
        estimator,
        effects=wanted_effects(options),
        display=getattr(options, "display", None),
        controlled_element=element_of(getattr(options, "controlled_element", None)),
        max_effects=MAX_EFFECTS if options.max_effects is None else options.max_effects,
        domain=getattr(options, "domain", None),
        lost_control=options.lost_control,
    )
    if shows_progress(options):
        search.set_callbacks(ProgressBar())
    story = Story(search, X, y)
    aloud = aloud and not options.json
    if aloud:
        print_source(options, source)
    for block in story.tell():
        if aloud:
            print_block(block, options, truth)
    return story


def shows_progress(options: argparse.Namespace) -> bool:
    """Whether somebody looks: bars are drawn on the output, which a pipe or a file keeps clean."""
    return not options.json and sys.stderr.isatty() and sys.stdout.isatty()


def print_source(options: argparse.Namespace, source: str) -> None:
    """Where the runs are from, and which column was taken for what."""
    print_wrapped(source)
    guess = getattr(options, "columns", None)
    if guess is not None and guess.guessed:
        print_wrapped(str(guess))


def print_block(block: str, options: argparse.Namespace, truth: dict[str, float] | None) -> None:
    """Print a line or a table of a story."""
    if not isinstance(block, StoryTable):
        show = print_bold if block.startswith("Verdict: ") else print_wrapped
        show(block)
        return
    headings, rows = list(block.headings), [list(row) for row in block.rows]
    if block.kind == "parameters" and truth:
        headings.insert(1, "truth")
        for row, name in zip(rows, block.ids, strict=True):
            row.insert(1, f"{truth[name]:.4g}" if name in truth else "")
    left = ("effect", "parameter", "unit", "its numbers", "band", "")
    folded = headings if block.kind == "shape" else ("effect",)
    print_table(block.caption, headings, rows, left=left, folded=folded)


def write_results(
    options: argparse.Namespace,
    story: Story,
    source: str,
    *,
    report: Path | None = None,
    folder: Path | None = None,
    sketch: Path | None = None,
    head: dict[str, Any] | None = None,
) -> None:
    """Write the report, the plots and the tables, and say where; or print all as JSON."""
    if report is not None:
        write_report(options, report, story.search_, story.X, story.y, source)
    plots = (
        draw(story, folder, options.command, getattr(options, "format", None) or "png")
        if folder
        else []
    )
    tables = save_tables(tables_of(story), options)
    page = None if report is None else str(report)
    files: dict[str, Any] = {"report": page, "pictures": plots, "tables": tables}
    if sketch is not None:
        files["effect"] = str(sketch)
    if options.json:
        first = {"skhoid": __version__, "source": source, "columns": columns_dict(options)}
        first |= head or {}
        print_json({**first, **story.as_dict(), **files})
    elif any(files.values()):
        print_wrapped("")
        say_files(files)


def write_report(
    options: argparse.Namespace,
    path: Path,
    model: Any,
    X: Any,
    y: Any,
    source: str,
    **more: Any,
) -> Report:
    """Make the report and write it."""
    made_with = {"command": shlex.join(["skhoid", *map(shown, options.command_line)])}
    if getattr(options, "seed", None) is not None:
        made_with["seed"] = str(options.seed)
    without_screen()
    title = getattr(options, "title", None)
    page = report(model, X, y, title=title, source=source, made_with=made_with, **more)
    page.save(path)
    return page


def tables_of(story: Story) -> dict[str, Any]:
    """All tables of a story, by name."""
    search, shape = story.search_, story.search_.shape_
    of_shape = {} if shape is None else {"shape": shape.curve}
    if shape is not None and len(shape.nearest):
        of_shape["nearest"] = shape.nearest
    return {
        "ranking": search.ranking_,
        "error_path": search.error_path_,
        "baseline": story.baseline_.parameters_,
        "parameters": search.best_estimator_.parameters_,
        "predictions": search.predictions_,
        "left_out": search.left_out_,
        "unexplained": search.unexplained_,
        **of_shape,
        **tables_of_comparison(story.comparison_),
    }


def tables_of_comparison(found: Comparison | None) -> dict[str, Any]:
    """Tables of a comparison, if there is one."""
    if found is None:
        return {}
    tables = {name: getattr(found, name) for name in OF_COMPARISON}
    return {**tables, "findings": pd.DataFrame([vars(finding) for finding in found.findings])}


def draw(story: Story, folder: Path, command: str, form: str = "png") -> list[str]:
    """Draw the results of a search into a folder; returns the paths."""
    without_screen()
    from ...plotting import (
        EffectRankingDisplay,
        EffectStepsDisplay,
        ErrorPathDisplay,
        IdentifiedEffectDisplay,
        ShapeDisplay,
    )

    search = story.search_
    figures: dict[str, Any] = {}
    if story.comparison_ is not None:
        figures["comparison.png"] = story.comparison_.plot().figure_
    for step in search.ranking_["step"].unique():
        name = f"ranking-{step}.png"
        figures[name] = EffectRankingDisplay.from_estimator(
            search, step=step, n_candidates=12
        ).figure_
    figures["error-path.png"] = ErrorPathDisplay.from_estimator(search).figure_
    figures["before-and-after.png"] = EffectStepsDisplay.from_estimator(search).figure_
    for name in search.best_estimator_.effects_.names:
        display = IdentifiedEffectDisplay.from_estimator(search, name, story.X, story.y)
        figures[f"{name}.png"] = display.figure_
    if search.shape_ is not None:
        figures["shape.png"] = ShapeDisplay.from_estimator(search).figure_
    others = [
        "comparison",
        "shape",
        *BY_NAME,
        *(f"ranking-{step}" for step in range(1, len(BY_NAME) + 2)),
    ]
    return save_figures(
        figures,
        folder,
        command,
        others=[f"{name}.png" for name in others],
        named=(story.X, story.y),
        form=form,
    )
