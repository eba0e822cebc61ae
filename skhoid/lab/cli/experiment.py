"""The command ``skhoid experiment``: several people and conditions, from files to one page."""

from __future__ import annotations

import argparse
import contextlib
import io
import shlex
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import skhoid

from ... import __version__
from .diagnose import search_for
from .files import check_folders, check_tables, names_of, new_file, save_tables, without_screen
from .output import (
    print_bold,
    print_json,
    print_wrapped,
    say,
    say_files,
    shows_progress,
)
from .parser import (
    OF_SEARCH,
    add_command,
    add_model_options,
    add_output_options,
    add_run_in,
    add_search_options,
    add_unit,
    at_least_one,
    positive,
    read_units,
    refuse,
    refuse_of_other_core,
    workers,
)

EXAMPLES = """\
examples:
  skhoid experiment                            a small simulated experiment
  skhoid experiment recordings/                labels by names of folders and files
  skhoid experiment "data/{subject}_{condition}_run{run}.csv" --out friday.html
  skhoid experiment all.csv --subject who --condition task --run trial
  skhoid experiment recordings/ --effects none     parameters only, no search
  skhoid experiment recordings/ --resume kept --jobs 4
"""
SIMULATED = ["dead_zone", "saturation"]  # searched for where nothing else is asked
LONG, SCRIPT, WIDE = "parameters_long.csv", "mixed_models.R", "parameters_wide.csv"


def add_experiment(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "experiment",
        "several people and conditions: check, identify, search, compare, one HTML file",
        "Read the recordings of several people, check them, find which effects people share, "
        "identify each run, compare the conditions, and write it all down in one HTML file with a "
        "part for each person. Without files it simulates a small experiment.",
        EXAMPLES,
        "[FOLDER_OR_PATTERN] [OPTIONS]",
    )
    command.set_defaults(work=experiment)
    add = command.section("Data")
    add(
        "files",
        nargs="*",
        default=(),
        metavar="FOLDER_OR_PATTERN",
        help="a folder, a pattern with {subject}, {condition} and {run}, or files",
    )
    add("--input", metavar="NAME", help="column of the error (default: guessed)")
    add("--output", metavar="NAME", help="output column (default: guessed)")
    add("--x", metavar="NAME", help="the controlled element's output (default: guessed)")
    add("--target", metavar="NAME", help="the target f_t (default: guessed)")
    add("--time", metavar="NAME", help="time column, in seconds (default: guessed)")
    add("--dt", type=positive, metavar="S", help="sampling time of files without a time column")
    for level in ("subject", "condition", "run"):
        add(f"--{level}", metavar="NAME", help=f"column with the {level} (default: by names)")
    add_unit(add)
    add("--last", type=at_least_one, metavar="N", help="the last N runs of each (default: all)")
    add_run_in(add)
    add_model_options(command.section("Model"), "people")
    add_search_options(command.section("Search"), "; none: no search")
    add = command.section("People")
    add("--reference", metavar="CONDITION", help="compare others with it (default: all pairs)")
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    add("--resume", metavar="FOLDER", help="keep what is finished in FOLDER, and go on from there")
    add = command.section("Output")
    add("--title", metavar="TEXT", help="title of the page")
    add("--out", default="experiment.html", metavar="FILE", help="the file (default: %(default)s)")
    add("--overwrite", action="store_true", help="replace files that exist")
    add_output_options(add)


def experiment(options: argparse.Namespace) -> int:
    """Read, check, search, identify, compare, and write the page."""
    from .. import report

    path = new_file(options.out, options.overwrite, new_folder=True)
    _check(options)
    X, y, source = _recorded(options) if options.files else _simulated(options)
    say(source, options)
    check = skhoid.check_experiment(X, y)
    _print(check.summary(), options)
    if options.last is not None:
        X, y = skhoid.select_runs(X, y, last=options.last)
    if options.run_in:
        X = skhoid.RunInTrimmer(run_in=options.run_in).fit_transform(X)
    _check_people(X, options)
    estimator = _estimator(options, X, y)
    group = None if options.effects == ["none"] else _searched(options, estimator, X, y)
    if group is not None:
        told = group.document()
        _print_verdict(f"Verdict: {told.title}", options)
        _print(replace(told, title="").text(), options)
        estimator = _with_effects(estimator, group)
    people = skhoid.identify_people(
        estimator,
        X,
        y,
        folder=_kept(options, "people"),
        n_jobs=options.jobs,
        progress=shows_progress(options),
    )
    if not options.json:
        print(f"\n{people.summary()}")
    without_screen()
    page = report.report_experiment(
        people if group is None else group,
        X,
        y,
        people=people,
        check=check,
        reference=options.reference,
        title=options.title,
        source=source,
        made_with={"command": names_of([shlex.join(["skhoid", *options.command_line])])},
    )
    page.save(path)
    tables = _tables(options, check, people, group, page.statistics)
    files = {"report": str(path), "tables": tables}
    if options.json:
        found = _as_dict(source, check, people, group, page.statistics)
        print_json({"skhoid": __version__, **found, **files})
    else:
        print_wrapped("")
        say_files(files)
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse what cannot be done, before the work begins."""
    check_tables(options)
    check_folders(options.resume)
    refuse_of_other_core(options)
    if options.effects == ["none"]:
        refuse(options, OF_SEARCH, "is for the search, and --effects none makes none.")
    if options.time is not None and options.dt is not None:
        raise ValueError("--time and --dt both say where time comes from: give one of them.")
    if options.tables is not None and not options.overwrite:
        for name in (LONG, SCRIPT, WIDE):
            if (Path(options.tables) / name).exists():
                raise ValueError(
                    f"{Path(options.tables) / name} exists; choose another folder, or --overwrite."
                )


def _recorded(options: argparse.Namespace) -> tuple[Any, Any, str]:
    """The user's files; what was guessed in them is a part of the source."""
    named = {options.input: "e", options.x: "x", options.target: "f_t"}
    inputs = {name: role for name, role in named.items() if name is not None}
    files = options.files[0] if len(options.files) == 1 else options.files
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        X, y = skhoid.read_experiment(
            files,
            subject=options.subject,
            condition=options.condition,
            run=options.run,
            inputs=inputs or None,
            output=options.output,
            time=options.time,
            dt=options.dt,
            units=read_units(options) or None,
        )
    guessed = " ".join(said.getvalue().split())
    return X, y, guessed or f"Files: {names_of(options.files)}"


def _simulated(options: argparse.Namespace) -> tuple[Any, Any, str]:
    """Four people in two conditions; three of them cannot make large movements."""
    X, y = skhoid.simulate_experiment(
        4,
        ["C1", "C2"],
        runs=2,
        duration=25.0,
        run_in=5.0,
        sampling_rate=50.0,
        remnant_intensity=0.1,
        random_state=1,
    )
    for who in ("S1", "S2", "S3"):
        rows = y.index.get_level_values("subject") == who
        limit = 1.1 * float(y[rows].std())
        y[rows] = y[rows].clip(-limit, limit)
    source = (
        "simulated: four people in two conditions; the movements of S1, S2 and S3 end at 1.1 "
        "standard deviations"
    )
    if options.effects is None:
        options.effects = SIMULATED
        source += f"; searched for here: {', '.join(SIMULATED)}"
    return X, y, source


def _check_people(X: Any, options: argparse.Namespace) -> None:
    """Refuse a group of one, and a reference that there is not, before the work begins."""
    names = X.index.names
    n = X.index.unique("subject").size if "subject" in names else 1
    if n < 2 and options.effects != ["none"]:
        raise ValueError(
            "These are recordings of one person, and a group needs two: say which column, or which "
            "part of names, tells people apart (--subject NAME, or a pattern with {subject}). For "
            "one person there is skhoid diagnose; --effects none identifies without a search."
        )
    if options.reference is None:
        return
    known = list(X.index.unique("condition")) if "condition" in names else []
    found = [label for label in known if str(label) == options.reference]
    if not found:
        raise ValueError(
            f"--reference is one of {', '.join(map(str, known)) or '(no conditions)'}; got "
            f"{options.reference!r}."
        )
    options.reference = found[0]


def _estimator(options: argparse.Namespace, X: Any, y: Any) -> Any:
    """The model of each person."""
    from ..opening import estimator_of

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of people whose delay is found as if they were one
        return estimator_of(options, X, y)


def _searched(options: argparse.Namespace, estimator: Any, X: Any, y: Any) -> Any:
    group = skhoid.GroupEffectSearch(
        search_for(options, estimator),
        folder=_kept(options, "group"),
        n_jobs=options.jobs,
        progress=shows_progress(options),
    )
    return group.fit(X, y)


def _with_effects(estimator: Any, group: Any) -> Any:
    """The model with what the group has in all conditions, which else would bend its parameters.

    An effect of some conditions is left out: where people have it not, its parameters are free to
    take over those of others. The page says that it is missing.
    """
    from ..experiment.groups import ALL

    table = group.prevalence_
    for name in group.group_effects_:
        rows = table[table["effect"] == name]
        whole = rows[rows["condition"] == ALL]
        if (whole if len(whole) else rows)["group"].all():
            with contextlib.suppress(ValueError):  # an effect that needs choices of its own
                estimator = estimator.with_effect(name)
    return estimator


def _kept(options: argparse.Namespace, name: str) -> Path | None:
    return None if options.resume is None else Path(options.resume) / name


def _print(text: Any, options: argparse.Namespace) -> None:
    """Lines of a summary, whose tables stay as they are."""
    from ...text import WIDTH

    if options.json:
        return
    print()
    for line in str(text).splitlines():
        if len(line) > WIDTH:  # no row of a table
            print_wrapped(line)
        else:
            print(line)


def _print_verdict(text: str, options: argparse.Namespace) -> None:
    """Print a line in bold, unless the output is JSON."""
    if not options.json:
        print()
        print_bold(text)


def _people_of(group: Any) -> Any:
    """Everybody's row, with the verdict in words; nothing where there was no search."""
    verdicts = ["" if verdict is None else str(verdict) for verdict in group.people_["verdict"]]
    return group.people_.assign(verdict=verdicts)


def _tables(
    options: argparse.Namespace,
    check: Any,
    people: Any,
    group: Any,
    statistics: dict[str, Any],
) -> list[str]:
    """Tables in the format asked for, and the files for other programs."""
    from ..experiment import write_long, write_wide

    if options.tables is None:
        return []
    tables = {
        "recordings": check.table,
        "findings": check.findings,
        "parameters": people.table,
        "parameters_of_people": people.groups,
        "runs": people.runs,
        "outlying": people.outlying,
    }
    if group is not None:
        tables |= {
            "prevalence": group.prevalence_,
            "members": group.members_,
            "people": _people_of(group),
            "effects_by_condition": group.contrasts_,
            "parameters_of_effects": group.parameters_,
        }
    files = save_tables(tables, options)
    folder = Path(options.tables)
    own = [r for name, r in statistics.items() if name in set(people.table["parameter"])]
    if own:
        files += map(str, write_long(own, folder, overwrite=True))
    if (people.table["parameter"] != "").any():
        files.append(str(write_wide(people.table, folder / WIDE, overwrite=True)))
    return files


def _as_dict(
    source: str,
    check: Any,
    people: Any,
    group: Any,
    statistics: dict[str, Any],
) -> dict[str, Any]:
    found: dict[str, Any] = {
        "source": source,
        "recordings": check.table.to_dict("records"),
        "findings": check.findings.to_dict("records"),
        "estimator": people.estimator,
        "parameters": people.table.to_dict("records"),
        "outlying": people.outlying.to_dict("records"),
        "notes": people.notes,
        "statistics": {
            name: {
                "means": result.effects.to_dict("records"),
                "contrasts": result.contrasts.to_dict("records"),
            }
            for name, result in statistics.items()
        },
    }
    if group is not None:
        found |= {
            "group_effects": group.group_effects_,
            "prevalence": group.prevalence_.to_dict("records"),
            "members": group.members_.to_dict("records"),
            "people": _people_of(group).to_dict("records"),
            "effects_by_condition": group.contrasts_.to_dict("records"),
        }
    return found
