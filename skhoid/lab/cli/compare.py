"""The command ``skhoid compare``: a fitted model against recordings."""

from __future__ import annotations

import argparse
import shlex
from functools import partial
from pathlib import Path
from typing import Any

import skhoid

from ... import __version__
from .diagnose import tables_of_comparison, write_report
from .files import (
    check_plot_file,
    check_tables,
    column_of,
    columns_dict,
    names_of,
    new_file,
    read_files,
    save_figures,
    save_tables,
    without_screen,
)
from .output import (
    free_name,
    message_for,
    print_json,
    print_source,
    say_files,
    say_next,
    typed,
    width,
)
from .parser import (
    DOMAINS,
    add_channel_options,
    add_command,
    add_file_options,
    add_output_options,
    probability,
    read_roles,
    refuse,
)

EXAMPLES = """\
examples:
  skhoid compare model.joblib run*.csv
  skhoid compare model.joblib run*.csv --output stick --x pitch --run-in 5
  skhoid compare model.joblib new.csv --estimation old1.csv --out compared.png
  skhoid compare model.joblib new.csv --domain machine --json --tables tables

The model is what joblib.dump(model, "model.joblib") wrote after fit, in Python.
Such a file can run any code when it is read: take it only from people you
trust.
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
        "MODEL FILES [OPTIONS]",
    )
    command.set_defaults(work=compare)
    add = command.section("Data")
    add("model", metavar="FILE", help="the fitted model, a file of joblib or pickle")
    add_file_options(add)
    add(
        "--input",
        nargs="+",
        metavar="NAME",
        help="columns for those that the model was fitted on, in their order (default: those of "
        "the same names or roles)",
    )
    add_channel_options(add)
    add(
        "--estimation",
        nargs="+",
        metavar="FILES",
        help="files that the model was fitted on, for the verdict on overfit",
    )
    add = command.section("Comparison")
    add(
        "--domain",
        choices=DOMAINS,
        help="whose words the findings use (default: by the model and the channels)",
    )
    add(
        "--false-alarm",
        type=probability,
        default=0.01,
        metavar="P",
        help="of each test (default: 0.01)",
    )
    add = command.section("Output")
    add("--out", metavar="FILE", help="draw the panels (.png, .pdf, .svg), or a page (.html)")
    add("--overwrite", action="store_true", help="replace that FILE if it exists")
    add_output_options(add)


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
    found = skhoid.compare(
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
        print_json({**head, **found.as_dict(), **files})
    else:
        print_source(options, source)
        say = partial(message_for, options=options)
        print(found.document().text(width(), say=say))
        say_files(files)
        say_next(_after_compare(options))
    return 0


def _is_page(name: str) -> bool:
    return Path(name).suffix.lower() in (".html", ".htm")


def _after_compare(options: argparse.Namespace) -> list[tuple[str, str]]:
    """What to do next: its picture, and what is missing."""
    steps = []
    if options.out is None:
        words = [*options.command_line, "--out", free_name("compared.png")]
        steps.append((shlex.join(["skhoid", *words]), "the same as a picture"))
    steps.append((typed(options, "diagnose"), "which effects are missing?"))
    return steps


def _model(name: str) -> Any:
    """The model of a file; says what is wrong with one that holds none."""
    import joblib

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
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import FunctionTransformer

    from ...pipelines import reach_model, unwrapped
    from ...runs import role_of

    own = _columns_of(model)
    names = options.input or own
    if names is None:
        names = ["e"]
    if own is not None and len(names) != len(own):
        raise ValueError(
            f"The model was fitted on the columns {', '.join(own)}: --input names "
            f"{len(own)} channels for them, in that order; got {', '.join(names)}."
        )
    roles = read_roles(options)
    for name, role in ((options.x, "x"), (options.target, "f_t")):
        if name is None:
            continue
        by_name = role_of((own or names)[names.index(name)]) if name in names else ""
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
    from ...io import first_table

    try:
        first_table(files).find(name)
    except ValueError:
        return False
    return True


def _as_in(X: Any, name: str, roles: dict[str, str]) -> str:
    """A column of X for one of the model's: of its name, or else of its role."""
    from ...runs import role_of

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
    from ...pipelines import unwrapped

    names = getattr(unwrapped(model), "feature_names_in_", None)
    return None if names is None else [str(name) for name in names]


def _draw(found: Any, path: Path, X: Any, y: Any) -> list[str]:
    without_screen()
    return save_figures({path.name: found.plot().figure_}, path.parent, "compare", named=(X, y))
