"""The command ``skhoid compare``: a fitted model against recordings."""

from __future__ import annotations

import argparse
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import skhoid

from .diagnose import tables_of_comparison, write_report
from .files import (
    FITTED,
    FITTED_IN_PART,
    check_plot_file,
    check_tables,
    find_column,
    new_file,
    read_files,
    save_figures,
    save_tables,
    show_names,
    without_screen,
)
from .output import (
    free_name,
    print_document,
    print_json,
    print_source,
    say_files,
    say_next,
    typed,
)
from .parser import (
    DOMAINS,
    MODELS,
    add_channel_options,
    add_command,
    add_file_options,
    add_output_options,
    add_remove_means,
    read_roles,
    refuse,
)

ABOUT = """\
compare a fitted model with recordings: how good, where bad, how much is left
Compare models, which `skhoid identify --save` or `skhoid diagnose --save` wrote, with recorded
runs: their free run, where it fails, the noise ceiling, and what to do next. Several models stand
in one table, and the best of them is told in full."""
EXAMPLES = """\
examples:
  skhoid identify old*.csv --save linear.joblib
  skhoid diagnose old*.csv --save effects.joblib
  skhoid compare linear.joblib effects.joblib new.csv
  skhoid compare model.joblib run*.csv --output stick --x pitch --run-in 5
  skhoid compare model.joblib new.csv --estimation old*.csv --out compared.png
  skhoid compare model.joblib new.csv --domain machine --json --tables tables

In Python, joblib.dump(model, "model.joblib") after fit writes such a file.
It can run any code when it is read: take it only from people you trust.
"""
UNKNOWN = "not known"  # whether the model was fitted on a run


def add_compare(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, compare, ABOUT, "MODEL... FILES [OPTIONS]", EXAMPLES)
    add = command.section("Data")
    add("model", metavar="MODEL", help="what --save wrote; may be several, before FILES")
    add_file_options(add)
    text = "columns for those that the model was fitted on, in their order (default: those of the "
    add("--input", nargs="+", metavar="NAME", help=text + "same names or roles)")
    add_channel_options(add)
    add_remove_means(add)
    text = "files that the model was fitted on, for the verdict on overfit"
    add("--estimation", nargs="+", metavar="FILES", help=text)
    text = "whose words the findings use (default: by the model and the channels)"
    add("--domain", choices=DOMAINS, help=text)
    add = command.section("Output")
    add("--out", metavar="FILE", help="draw the panels (.png, .pdf, .svg), or a page (.html)")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)


def compare(options: argparse.Namespace) -> int:
    """Compare a fitted model with recordings, and say, draw and write what is found."""
    out = None if options.out is None else Path(options.out)
    is_page = out is not None and out.suffix.lower() in (".html", ".htm")
    if options.out is None:
        refuse(options, ["overwrite"], "is for the file of --out FILE.")
    elif is_page:
        new_file(options.out, options.overwrite, new_folder=True)
    else:
        check_plot_file(options.out, options.overwrite)
    check_tables(options)
    models = [options.model, *(name for name in options.files if name.endswith(MODELS))]
    options.files = [name for name in options.files if name not in models]
    options.asked.files = options.files
    if not options.files:
        raise ValueError(
            "Name a model, and after it the recordings to compare it with, such as: skhoid compare "
            "model.joblib run*.csv"
        )
    compared = [_compare(options, name) for name in dict.fromkeys(models)]
    compared.sort(key=lambda one: -one[0].vaf)
    found, model, X, y = compared[0]
    source = show_names(options.files)
    pictures = []
    if is_page:
        write_report(options, Path(options.out), model, X, y, source, effects=None)
    elif out is not None:
        without_screen()
        figure = {out.stem: found.plot().figure_}
        pictures = save_figures(figure, out.parent, "compare", out.suffix[1:], named=(X, y))
    tables = save_tables(tables_of_comparison(found), options)
    files = {"report": options.out if is_page else None, "pictures": pictures, "tables": tables}
    if options.json:
        each = [one[0].as_dict() for one in compared]
        told = each[0] if len(each) == 1 else {"models": each}
        print_json(options, {"source": source, **told, **files})
        return 0
    print_source(options, source)
    if len(compared) > 1:
        print_document(_beside([one[0] for one in compared]), options)
        print()
    print_document(found.document(), options)
    say_files(files)
    steps = [(typed(options, "diagnose"), "which effects are missing?")]
    if out is None:
        words = ["skhoid", *options.command_line, "--out", free_name("compared.png")]
        steps.insert(0, (shlex.join(words), "the same as a picture"))
    say_next(steps)
    return 0


def _compare(options: argparse.Namespace, name: str) -> tuple[Any, Any, Any, Any]:
    """What the comparison of the model of a file says, that model, and X and y as it takes them."""
    fitted = _load_model(name)
    estimation = None
    if options.estimation:
        estimation = _read(options, fitted, options.estimation)[:2]
    X, y, roles, model = _read(options, fitted, options.files)
    found = skhoid.compare(
        model,
        X,
        y,
        estimation=estimation,
        roles=roles or None,
        run_in=options.run_in,
        domain=options.domain,
    )
    found = replace(found, model_name=Path(name).name)
    known = getattr(fitted, "fitted_runs_", None)
    if known is None and estimation is not None:  # then the user says which runs were fitted
        return found, model, X, y
    return _mark_fitted(found, known, options.recorded), model, X, y


def _mark_fitted(found: Any, known: dict[str, str] | None, recorded: dict[str, str]) -> Any:
    """Say of each compared run whether the model was fitted on it, as far as its file tells."""
    from ...text import Note, counted

    runs = found.by_run.copy()
    compared = runs["data"] == "validation"
    marks = {run: UNKNOWN if known is None else known.get(mark) for run, mark in recorded.items()}
    runs["data"] = runs["run"].map(marks).where(compared).fillna(runs["data"])
    seen = int(runs.loc[compared, "data"].isin([FITTED, FITTED_IN_PART]).sum())
    notes = list(found.notes)
    if known is None:
        text = "the model's file does not say on which recordings it was fitted: if these are "
        text += "among them, the figures flatter it"
        notes.append(Note("fitted runs", text))
    elif seen:
        text = f"the model was fitted on {seen} of {counted(int(compared.sum()), 'run')} here: "
        text += "how well it predicts, only runs marked validation show"
        notes.append(Note("fitted runs", text))
    return replace(found, views=replace(found.views, by_run=runs), notes=notes)


def _beside(compared: list[Any]) -> Any:
    """Several models beside each other, on the rows that all of them are scored on."""
    import numpy as np

    from ...text import Document, Paragraph, TextTable, number

    scored = np.logical_and.reduce([found.traces["scored"] for found in compared])
    rows = []
    for found in compared:
        measured, off = (found.traces.loc[scored, name] for name in ("measured", "residual"))
        power = float((off**2).sum())
        vaf = 100 * (1 - power / float((measured**2).sum()))
        about_mean = 100 * (1 - power / float(((measured - measured.mean()) ** 2).sum()))
        figures = [f"{vaf:.1f}", f"{about_mean:.1f}", number((power / len(off)) ** 0.5)]
        rows.append([found.model_name, *figures])
    header = ["model", "VAF, %", "about the mean, %", "RMSE"]
    table = TextTable("Free runs, the best first", header, rows, left=("model",))
    last = Paragraph(f"On the same {int(scored.sum())} rows. Below, the first in full.")
    return Document(f"{len(compared)} models against measured {found.output}", [table, last])


def _load_model(name: str) -> Any:
    """The model of a file; says what is wrong with one that holds none."""
    import joblib

    path = Path(name)
    if not path.is_file():
        raise ValueError(
            f"{path} is no file. First name what `skhoid identify --save FILE` or `skhoid diagnose "
            "--save FILE` wrote."
        )
    try:
        model = joblib.load(path)
    except Exception as error:
        of = f" that can be read ({type(error).__name__}: {error})" if name.endswith(MODELS) else ""
        raise ValueError(
            f"{path} holds no model{of}. First name what `skhoid identify --save FILE` or `skhoid "
            "diagnose --save FILE` wrote, with the versions of the packages used here."
        ) from error
    if not hasattr(model, "predict"):
        raise ValueError(
            f"{path} holds a {type(model).__name__}, which predicts nothing: name the file of "
            "a fitted model."
        )
    return model


def _read(
    options: argparse.Namespace, model: Any, files: list[str]
) -> tuple[Any, Any, dict[str, str], Any]:
    """X, y, roles of columns, and the model, which takes its own columns from X."""
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    from ...pipelines import reach_model, unwrapped
    from ...runs import role_of
    from ..opening import about_means

    own = list(map(str, getattr(unwrapped(model), "feature_names_in_", [])))
    names = options.input or own or ["e"]
    if own and len(names) != len(own):
        raise ValueError(
            f"The model was fitted on the columns {', '.join(own)}: --input names "
            f"{len(own)} channels for them, in that order; got {', '.join(names)}."
        )
    of_model = zip(names, own or names, strict=True)
    roles = read_roles(options, {name: role for name, col in of_model if (role := role_of(col))})
    there = names if options.input else [name for name in names if _has(files, name)]
    given = {name: roles.get(name, str(role_of(name))) for name in [*there, *roles]}
    chosen = argparse.Namespace(**{**vars(options), "files": files})
    X, y, options.columns = read_files(chosen, given, signals=not options.input)
    options.recorded = chosen.recorded
    if options.remove_means:
        X, y = about_means(X), about_means(y)
    roles = options.columns.roles | roles
    if not options.input:
        names = [_find_column(X, name, roles) for name in names]
    columns = [find_column(X, name) for name in names]
    renamed = dict(zip(columns, own or columns, strict=True))
    attributes = dict(X.attrs)
    X = X.rename(columns=renamed)
    X.attrs = attributes
    of_columns = {renamed.get(c := find_column(X, n), c): role for n, role in roles.items()}
    taken = list(renamed.values())
    if len(taken) < X.shape[1]:
        of_columns = (getattr(reach_model(model, X[taken])[0], "roles", None) or {}) | of_columns
        columns = FunctionTransformer(_take_columns, kw_args={"names": taken}, validate=False)
        model = make_pipeline(columns, unwrapped(model))
    return X, y, of_columns, model


def _has(files: list[str], name: str) -> bool:
    """Whether the first file has a column of this name."""
    from ...io import first_table

    try:
        first_table(files).find(name)
    except ValueError:
        return False
    return True


def _find_column(X: Any, name: str, roles: dict[str, str]) -> str:
    """A column of X for one of the model's: of its name, or else of its role."""
    from ...runs import role_of

    if find_column(X, name) in X:
        return name
    by_role = {role_of(column, roles): str(column) for column in X.columns}
    if role_of(name) in by_role:
        return by_role[role_of(name)]
    raise ValueError(
        f"The model was fitted on the column {name!r}, and the files have "
        f"{', '.join(map(repr, X.columns))}: say by --input NAME which that is."
    )


def _take_columns(X: Any, names: list[str]) -> Any:
    return X[names]
