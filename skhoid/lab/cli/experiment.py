"""The command ``skhoid experiment``: several people and conditions, from files to one page."""

from __future__ import annotations

import argparse
import contextlib
import io
import shlex
import shutil
import sys
import warnings
from pathlib import Path
from typing import Any

import skhoid

from .diagnose import search_for
from .files import check_tables, new_file, save_tables, show_names, without_screen
from .output import note, print_document, print_json, print_wrapped, say_files
from .parser import (
    add_command,
    add_model_options,
    add_output_options,
    add_page_options,
    add_run_in,
    add_search_options,
    add_unit,
    positive,
    read_units,
    workers,
)

ABOUT = """\
several people and conditions: check, identify, search, compare, one HTML file
Read the recordings of several people, check them, find which effects people share, identify each
run, compare the conditions, and write it all down in one HTML file with a part for each person.
Without files it simulates a small experiment."""
EXAMPLES = """\
examples:
  skhoid experiment                            a small simulated experiment
  skhoid experiment recordings/                labels by names of folders and files
  skhoid experiment "data/{subject}_{condition}_run{run}.csv" --out friday.html
  skhoid experiment all.csv --subject who --condition task --run trial
  skhoid experiment recordings/ --effects none     parameters only, no search
  skhoid experiment recordings/ --factors pace state --leave-out P07
  skhoid experiment recordings/ --jobs 4       stopped? the same line goes on where it was
"""
SIMULATED = ["dead_zone", "saturation"]  # searched for where nothing else is asked
KEPT = ".kept"  # in place of .html: the folder of what is finished
LONG, SCRIPT, WIDE = "parameters_long.csv", "mixed_models.R", "parameters_wide.csv"


def add_experiment(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, experiment, ABOUT, "[FOLDER_OR_PATTERN] [OPTIONS]", EXAMPLES)
    add = command.section("Data")
    text = "a folder, a pattern with {subject}, {condition} and {run}, or files"
    add("files", nargs="*", default=(), metavar="FOLDER_OR_PATTERN", help=text)
    text = "take the files that the pattern matches, and leave the others (default: ask)"
    add("--some", action="store_true", help=text)
    add("--input", metavar="NAME", help="column of the error (default: guessed)")
    add("--output", metavar="NAME", help="output column (default: guessed)")
    add("--x", metavar="NAME", help="the controlled element's output (default: guessed)")
    add("--target", metavar="NAME", help="the target f_t (default: guessed)")
    add("--time", metavar="NAME", help="time column, in seconds (default: guessed)")
    add("--dt", type=positive, metavar="S", help="sampling time of files without a time column")
    for level in ("subject", "condition", "run"):
        text = f"column with the {level} (default: by names)"
        text += "; several are factors: pace state" * (level == "condition")
        add(f"--{level}", nargs="+" if level == "condition" else None, metavar="NAME", help=text)
    add_unit(add)
    add_run_in(add)
    add_model_options(command.section("Model"), "people")
    add_search_options(command.section("Search"), "; none: no search")
    add = command.section("People")
    add("--reference", metavar="CONDITION", help="compare others with it (default: all pairs)")
    text = "names for what conditions combine, as fast_tired does (default: found), or none"
    add("--factors", nargs="+", metavar="NAME", help=text)
    text = (
        "whose output is inverted; also PERSON/CONDITION/RUN (default: whom the check is sure of)"
    )
    add("--invert", nargs="+", default=(), metavar="PERSON", help=text)
    text = "whom to leave out, or which condition or run of theirs (default: as above)"
    add("--leave-out", nargs="+", default=(), metavar="PERSON", help=text)
    text = "change nothing that you do not name, however sure the check is"
    add("--as-recorded", action="store_true", help=text)
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    text = "begin anew; else what a stopped call finished (kept beside the page) is taken over"
    add("--fresh", action="store_true", help=text)
    add = command.section("Output")
    add_page_options(add, "experiment.html")
    add_output_options(add)


def experiment(options: argparse.Namespace) -> int:
    """Read, check, search, identify, compare, and write the page."""
    from ...text import Document, Item, Items
    from ..experiment import mend_recordings
    from ..experiment.mixed import tell_changes
    from ..opening import make_estimator
    from ..report import report_experiment

    path = new_file(options.out, options.overwrite, new_folder=True)
    _check(options)
    X, y, source = _read(options) if options.files else _simulate(options)
    check = skhoid.check_experiment(X, y)
    if not options.json:
        print_wrapped(f"{source}\n")
        print_document(check.document(), options)
    if options.run_in:
        X = skhoid.RunInTrimmer(run_in=options.run_in).fit_transform(X)
    mended = mend_recordings(
        X,
        y,
        None if options.as_recorded else check,
        invert=options.invert,
        leave_out=options.leave_out,
    )
    X, y = mended.X, mended.y
    if not options.json:
        for text in mended.sentences:
            print_wrapped(f"- {text}.")
        if len(mended.changes):
            print_wrapped("--as-recorded changes nothing that you do not name.\n")
    _check_people(X, options)
    factors = _name_factors(X, options.factors)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of people whose delay is found as if they were one
        estimator = make_estimator(options, X, y)
    group = search = None
    if options.effects != ["none"]:
        search = search_for(options, estimator)
    kept = _open_kept(path.with_suffix(KEPT), options.fresh, X, y, search or estimator)
    shared = {"n_jobs": options.jobs, "progress": True}
    if search is not None:
        group = skhoid.GroupEffectSearch(search, folder=kept / "group", **shared).fit(X, y)
        estimator = _with_effects(estimator, group)
    people = skhoid.identify_people(estimator, X, y, folder=kept / "people", **shared)
    if group is not None:
        people = people.of_members(group.members_)
    if len(mended.changes):
        mended = mended.with_versions(people, estimator, kept / "as recorded", options.jobs)
    without_screen()
    page = report_experiment(
        people if group is None else group,
        X,
        y,
        people=people,
        check=check,
        mended=mended,
        reference=options.reference,
        factors=factors,
        title=options.title,
        source=source,
        made_with={"command": show_names([shlex.join(["skhoid", *options.command_line])])},
    )
    page.save(path)
    tables = {
        "recordings": check.table,
        "findings": check.findings,
        "parameters": people.table,
        "parameters_of_people": people.groups,
        "runs": people.runs,
        "outlying": people.outlying,
        "changes": mended.changes,
    }
    if mended.versions is not None:
        tables["with_and_without"] = mended.versions
    if group is not None:
        tables |= {
            "prevalence": group.prevalence_,
            "members": group.members_,
            "people": _name_verdicts(group),
            "effects_by_condition": group.contrasts_,
            "parameters_of_effects": group.parameters_,
        }
    files = save_tables(tables, options) + _write_for_others(options, people, page.statistics)
    written = {"report": str(path), "tables": files}
    if options.json:
        found = {name: table.to_dict("records") for name, table in tables.items()}
        found |= {
            "source": source,
            "estimator": people.estimator,
            "notes": people.notes,
            "group_effects": None if group is None else group.group_effects_,
            "statistics": {
                name: {
                    "means": result.effects.to_dict("records"),
                    "contrasts": result.contrasts.to_dict("records"),
                    "factors": result.factors.to_dict("records"),
                }
                for name, result in page.statistics.items()
            },
        }
        print_json(options, {**found, **written})
        return 0
    changes = tell_changes(page.statistics.values(), people.meanings)
    if changes:
        items = Items([Item(text) for text in changes], numbered=False)
        print_document(Document("What the conditions change, beyond chance", [items]), options)
    for result in (mended if len(mended.changes) else None, group, people):
        if result is not None:
            print()
            print_document(result.document(), options)
    print()
    say_files(written)
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse what cannot be done, before the work begins."""
    check_tables(options)
    if options.time is not None and options.dt is not None:
        raise ValueError("--time and --dt both say where time comes from: give one of them.")
    if options.tables is not None and not options.overwrite:
        for name in (LONG, SCRIPT, WIDE):
            if (Path(options.tables) / name).exists():
                raise ValueError(
                    f"{Path(options.tables) / name} exists; choose another folder, or --overwrite."
                )


def _open_kept(kept: Path, fresh: bool, X: Any, y: Any, asked: Any) -> Path:
    """The folder of finished people; emptied where these inputs are not those it was made of."""
    from ...runs import fingerprint_of
    from ..studies.identity import described, differing_parts
    from ..studies.store import Store, read_manifest

    now = {"task": "skhoid experiment", "skhoid": skhoid.__version__}
    now |= {"recordings": fingerprint_of(X, y), "model": described(asked)}
    there = read_manifest(kept)
    apart = [] if there is None else differing_parts(there, now)
    if apart:
        note(f"{kept} was kept of other recordings or options ({apart[0]}): all begins anew.")
    if there is not None and (apart or fresh):
        shutil.rmtree(kept)
    Store(kept, now)
    return kept


def _read(options: argparse.Namespace) -> tuple[Any, Any, str]:
    """The user's files; what was guessed in them is a part of the source."""
    from ..guessing.names import SomeFilesError

    named = {options.input: "e", options.x: "x", options.target: "f_t"}
    inputs = {name: role for name, role in named.items() if name is not None}
    files = options.files[0] if len(options.files) == 1 else options.files
    given = {
        "subject": options.subject,
        "condition": options.condition,
        "run": options.run,
        "inputs": inputs or None,
        "output": options.output,
        "time": options.time,
        "dt": options.dt,
        "units": read_units(options) or None,
    }
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said):
            X, y = skhoid.read_experiment(files, some=options.some, **given)
    except SomeFilesError as error:
        if not sys.stdin.isatty() or options.json:
            raise
        if input(f"{error}\nRead these files only? [y/N] ").strip().lower() not in ("y", "yes"):
            raise
        options.some = True
        return _read(options)
    guessed = " ".join(said.getvalue().split())
    return X, y, guessed or f"Files: {show_names(options.files)}"


def _simulate(options: argparse.Namespace) -> tuple[Any, Any, str]:
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


def _name_factors(X: Any, names: list[str] | None) -> Any:
    """The factors of the conditions under the user's names; None: under those of their levels."""
    from ..experiment.factors import find_factors

    if names is None or names == ["none"]:
        return names and ()
    found = find_factors(X.index.unique("condition") if "condition" in X.index.names else [])
    if len(found) != len(names):
        raise ValueError(
            f"--factors names {len(names)}, but the names of conditions have "
            f"{' and '.join(found) or 'none'}: conditions are called by all of their levels, as "
            "fast_tired, and all combinations must be there."
        )
    return dict(zip(names, found.values(), strict=True))


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


def _name_verdicts(group: Any) -> Any:
    """Everybody's row, with verdict and effects in words; nothing where there was no search."""
    verdicts = ["" if verdict is None else str(verdict) for verdict in group.people_["verdict"]]
    effects = group.people_["effects"].map(", ".join)
    return group.people_.assign(verdict=verdicts, effects=effects)


def _write_for_others(
    options: argparse.Namespace, people: Any, statistics: dict[str, Any]
) -> list[str]:
    """Files for other programs, beside the tables."""
    from ..experiment import write_long, write_wide

    if options.tables is None:
        return []
    folder = Path(options.tables)
    files: list[str] = []
    own = [r for name, r in statistics.items() if name in set(people.table["parameter"])]
    if own:
        files += map(str, write_long(own, folder, overwrite=True))
    if (people.table["parameter"] != "").any():
        files.append(str(write_wide(people.table, folder / WIDE, overwrite=True)))
    return files
