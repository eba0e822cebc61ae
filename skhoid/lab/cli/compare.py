"""The command ``skhoid compare``: a fitted model against recordings."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import joblib
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from ..._version import __version__
from ...diagnosis import Comparison
from ...diagnosis import compare as compare_runs
from ...io.readers import first_table
from ...pipelines import reach_model, unwrapped
from ...runs.roles import OTHER, role_of
from ...search.story import comparison_dict
from .files import (
    check_plot_file,
    column_of,
    columns_dict,
    names_of,
    new_file,
    read_files,
    save_figures,
    without_screen,
)
from .messages import message_for
from .next_steps import after_compare
from .options import pairs, refuse
from .output import print_json, print_wrapped, say_files, say_next
from .search_output import print_source, tables_of_comparison, write_report
from .tables import check_tables, save_tables


def compare(options: argparse.Namespace) -> int:
    """Compare a fitted model with recordings, and say, draw and write what is found."""
    if options.out is None:
        refuse(options, ["overwrite"], "is for the file of --out FILE.")
    elif _is_page(options.out):
        new_file(options.out, options.overwrite, new_folder=True)
    else:
        check_plot_file(options.out, options.overwrite)
    check_tables(options)
    if not options.files:
        raise ValueError("Name the files of recordings to compare the model with, after the model.")
    fitted = _model(options.model)
    X, y, roles, model = _recordings(options, fitted, options.files)
    estimation = None
    if options.estimation:
        estimation = _recordings(options, fitted, options.estimation)[:2]
    found = compare_runs(
        model,
        X,
        y,
        estimation=estimation,
        roles=roles or None,
        run_in=options.run_in,
        false_alarm=options.false_alarm,
        domain=options.domain,
    )
    source = names_of(options.files)
    page, pictures = None, []
    if options.out is not None and _is_page(options.out):
        page = options.out
        write_report(options, Path(page), model, X, y, source, effects=None)
    elif options.out is not None:
        pictures = _draw(found, Path(options.out), X, y)
    tables = save_tables(tables_of_comparison(found), options)
    files = {"report": page, "pictures": pictures, "tables": tables}
    if options.json:
        head = {"skhoid": __version__, "source": source, "columns": columns_dict(options)}
        print_json({**head, **_as_dict(found), **files})
    else:
        print_source(options, source)
        for line in found.summary().splitlines()[: -len(found.notes) or None]:
            print_wrapped(line)
        for each in found.notes:
            print_wrapped(f"Note: {message_for(each, options)}")
        say_files(files)
        say_next(after_compare(options))
    return 0


def _is_page(name: str) -> bool:
    return Path(name).suffix.lower() in (".html", ".htm")


def _model(name: str) -> Any:
    """The model of a file; says what is wrong with one that holds none."""
    path = Path(name)
    if not path.is_file():
        raise ValueError(f"{path} is no file; name what joblib.dump(model, {name!r}) wrote.")
    try:
        model = joblib.load(path)
    except Exception as error:
        raise ValueError(
            f"{path} holds no model that can be read ({type(error).__name__}: {error}). Write it "
            "by joblib.dump(model, FILE) after fit, with the versions of the packages used here."
        ) from error
    if not hasattr(model, "predict"):
        raise ValueError(
            f"{path} holds a {type(model).__name__}, which predicts nothing. Save the fitted "
            "model, a pipeline or a search."
        )
    return model


def _recordings(
    options: argparse.Namespace, model: Any, files: list[str]
) -> tuple[Any, Any, dict[str, str], Any]:
    """X, y, roles of columns, and the model, which takes its own columns from X."""
    own = _columns_of(model)
    names = options.input or own
    if names is None:
        names = ["e"]
    if own is not None and len(names) != len(own):
        raise ValueError(
            f"The model was fitted on the columns {', '.join(own)}: --input names "
            f"{len(own)} channels for them, in that order; got {', '.join(names)}."
        )
    roles = pairs(options.role, "--role", "NAME=ROLE, such as roll=motion")
    for name, role in ((options.x, "x"), (options.target, "f_t")):
        if name is None:
            continue
        by_name = role_of((own or names)[names.index(name)]) if name in names else OTHER
        if roles.setdefault(name, by_name or role) != role:
            raise ValueError(
                f"The channel {name!r} has two roles, {roles[name]!r} and {role!r}: name different "
                "channels."
            )
    chosen = argparse.Namespace(**{**vars(options), "files": files})
    there = names if options.input else [name for name in names if _has(files, name)]
    given = {name: roles.get(name, str(role_of(name))) for name in [*there, *roles]}
    recorded = read_files(chosen, given, signals=not options.input)
    X, y = recorded.X, recorded.y
    options.columns = chosen.columns
    roles = recorded.guess.roles | roles
    if not options.input:
        names = [_as_in(X, name, roles) for name in names]
    others = [name for name in X.columns if name not in map(partial(column_of, X), names)]
    own = own or [column_of(X, name) for name in names]
    renamed = {column_of(X, name): new for name, new in zip(names, own, strict=True)}
    attributes = dict(X.attrs)
    X = X.rename(columns=renamed)
    X.attrs = attributes
    of_columns = {}
    for name, role in roles.items():
        column = column_of(X, name)
        of_columns[renamed.get(column, column)] = role
    said = getattr(reach_model(model, X[own])[0], "roles", None) if others else None
    if others:
        columns = FunctionTransformer(_taken, kw_args={"names": own}, validate=False)
        model = make_pipeline(columns, unwrapped(model))
    return X, y, {**(said or {}), **of_columns}, model


def _has(files: list[str], name: str) -> bool:
    """Whether the first file has a column of this name."""
    try:
        first_table(files).find(name)
    except ValueError:
        return False
    return True


def _as_in(X: Any, name: str, roles: dict[str, str]) -> str:
    """A column of X for one of the model's: of its name, or else of its role."""
    if column_of(X, name) in X:
        return name
    by_role = {role_of(column, roles): str(column) for column in X.columns}
    if role_of(name) in by_role:
        return by_role[role_of(name)]
    raise ValueError(
        f"The model was fitted on the column {name!r}, and the files have "
        f"{', '.join(map(repr, X.columns))}: say by --input NAME which that is."
    )


def _taken(X: Any, names: list[str]) -> Any:
    return X[names]


def _columns_of(model: Any) -> list[str] | None:
    """Columns that a model was fitted on; None where it does not say."""
    first = unwrapped(model)
    names = getattr(first, "feature_names_in_", None)
    return None if names is None else [str(name) for name in names]


def _draw(found: Comparison, path: Path, X: Any, y: Any) -> list[str]:
    without_screen()
    return save_figures({path.name: found.plot().figure_}, path.parent, "compare", named=(X, y))


def _as_dict(found: Comparison) -> dict[str, Any]:
    leak = found.leak
    return {
        "model": found.model_name,
        "output": found.output,
        "dt_s": found.dt,
        "domain": found.domain,
        **comparison_dict(found),
        "vaf_about_mean": found.vaf_about_mean,
        "mean_share": found.mean_share,
        "one_step_vaf": found.one_step_vaf,
        "rmse": found.rmse,
        "estimation_vaf": found.estimation_vaf,
        "overfit": found.overfit,
        "ceiling_route": found.ceiling_route,
        "ceiling_note": found.ceiling_note,
        "leak": None if leak is None else vars(leak),
        "findings": [vars(finding) for finding in found.findings],
        "notes": list(map(str, found.notes)),
    }
