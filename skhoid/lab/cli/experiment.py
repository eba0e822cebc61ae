"""The command ``skhoid experiment``: several people and conditions, from files to one page."""

from __future__ import annotations

import argparse
import contextlib
import io
import shlex
import warnings
from pathlib import Path
from typing import Any

from ..._version import __version__
from ...arx.batch import ARXRegressor
from ...arx.searches import DelaySearchCV
from ...human.controlled_element import element_of
from ...io._paths import shown
from ...io.experiments import read_experiment
from ...model import OperatorRegressor
from ...preprocessing import RunInTrimmer
from ...recordings.experiment_check import ExperimentCheck, check_experiment
from ...runs import select_runs
from ...search import EffectSearchCV
from ...text import WIDTH
from ..experiment import simulate_experiment
from ..experiment.group import GroupEffectSearch
from ..experiment.people import PeopleResult, identify_people
from ..experiment.read import ALL
from ..experiment.statistics import MixedModelResult, write_long, write_wide
from ..report import report_experiment
from .arguments.shared import MAX_EFFECTS, OF_CORE
from .files import check_folders, new_file, without_screen
from .options import pairs, refuse
from .output import print_bold, print_json, print_wrapped, say, say_files
from .search_output import shows_progress, wanted_effects
from .tables import check_tables, save_tables

SIMULATED = ["dead_zone", "saturation"]  # searched for where nothing else is asked
OF_SEARCH = ["display", "max_effects", "controlled_element"]
LONG, SCRIPT, WIDE = "parameters_long.csv", "mixed_models.R", "parameters_wide.csv"


def experiment(options: argparse.Namespace) -> int:
    """Read, check, search, identify, compare, and write the page."""
    path = new_file(options.out, options.overwrite, new_folder=True)
    _check(options)
    X, y, source = _recorded(options) if options.files else _simulated(options)
    say(source, options)
    check = check_experiment(X, y)
    _print(check.summary(), options)
    if options.last is not None:
        X, y = select_runs(X, y, last=options.last)
    if options.run_in:
        X = RunInTrimmer(run_in=options.run_in).fit_transform(X)
    _check_people(X, options)
    estimator = _estimator(options, X, y)
    group = None if options.effects == ["none"] else _searched(options, estimator, X, y)
    if group is not None:
        _print_verdict(f"Verdict: {str(group.summary()).splitlines()[0]}", options)
        _print("\n".join(str(group.summary()).splitlines()[1:]), options)
        estimator = _with_effects(estimator, group)
    people = identify_people(
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
    page = report_experiment(
        people if group is None else group,
        X,
        y,
        people=people,
        check=check,
        reference=options.reference,
        title=options.title,
        source=source,
        made_with={"command": shlex.join(["skhoid", *map(shown, options.command_line)])},
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
    for core, names in OF_CORE.items():
        if core != options.core:
            refuse(options, names, f"needs --core {core}.")
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
        X, y = read_experiment(
            files,
            subject=options.subject,
            condition=options.condition,
            run=options.run,
            inputs=inputs or None,
            output=options.output,
            time=options.time,
            dt=options.dt,
            units=pairs(options.unit, "--unit", "NAME=UNIT, such as e=deg") or None,
        )
    guessed = " ".join(said.getvalue().split())
    return X, y, guessed or f"Files: {', '.join(map(shown, options.files))}"


def _simulated(options: argparse.Namespace) -> tuple[Any, Any, str]:
    """Four people in two conditions; three of them cannot make large movements."""
    X, y = simulate_experiment(
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
    if options.core == "operator":
        return OperatorRegressor(delay=options.delay)
    orders = {name: getattr(options, name) for name in OF_CORE["arx"]}
    arx = ARXRegressor(**{name: value for name, value in orders.items() if value is not None})
    if options.nk is not None:
        return arx
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of people that are fitted as one
        return arx.set_params(nk=DelaySearchCV(arx).fit(X, y).best_nk_)


def _searched(options: argparse.Namespace, estimator: Any, X: Any, y: Any) -> GroupEffectSearch:
    search = EffectSearchCV(
        estimator,
        effects=wanted_effects(options),
        display=options.display,
        controlled_element=element_of(options.controlled_element),
        max_effects=MAX_EFFECTS if options.max_effects is None else options.max_effects,
        lost_control=options.lost_control,
    )
    group = GroupEffectSearch(
        search,
        folder=_kept(options, "group"),
        n_jobs=options.jobs,
        progress=shows_progress(options),
    )
    return group.fit(X, y)


def _with_effects(estimator: Any, group: GroupEffectSearch) -> Any:
    """The model with what the group has in all conditions, which else would bend its parameters.

    An effect of some conditions is left out: where people have it not, its parameters are free to
    take over those of others. The page says that it is missing.
    """
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


def _tables(
    options: argparse.Namespace,
    check: ExperimentCheck,
    people: PeopleResult,
    group: GroupEffectSearch | None,
    statistics: dict[str, MixedModelResult],
) -> list[str]:
    """Tables in the format asked for, and the files for other programs."""
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
            "people": group.people_,
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
    check: ExperimentCheck,
    people: PeopleResult,
    group: GroupEffectSearch | None,
    statistics: dict[str, MixedModelResult],
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
            "people": group.people_.to_dict("records"),
            "effects_by_condition": group.contrasts_.to_dict("records"),
        }
    return found
