"""The commands ``demo``, ``diagnose`` and ``report``: which effects a model is missing.

``diagnose`` and ``report`` read recordings, ``demo`` simulates them; then all three search, print
what was found, and write plots, tables and a page.
"""

from __future__ import annotations

import argparse
import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import skhoid

from .dry_run import columns_shown, show_dry_run
from .files import (
    check_folders,
    check_tables,
    describe_runs,
    figure_folder,
    find_column,
    model_file,
    new_file,
    read_files,
    save_figures,
    save_model,
    save_tables,
    show_names,
    without_screen,
)
from .output import (
    compared_next,
    free_name,
    note,
    print_document,
    print_json,
    print_source,
    print_wrapped,
    say_files,
    say_next,
    shows_progress,
    typed,
)
from .parser import (
    DOMAINS,
    MAX_EFFECTS,
    add_command,
    add_output_options,
    add_page_options,
    add_plot_options,
    add_recording_options,
    add_save,
    add_search_options,
    at_least_one,
    not_negative,
    read_roles,
    refuse,
    seed,
)
from .simulate import hidden_effects

ABOUT_DEMO = """\
hide an effect in a simulated person, and find it
Simulate runs of a person who tracks a target, with effects hidden in them, fit a model that knows
nothing of them, and find out which are missing: the whole way, with numbers at each step, and a
report in the end."""
OF_DEMO = """\
examples:
  skhoid demo                    a person with a dead zone and an offset
  skhoid demo --effect saturation --remnant 0.2 --seed 3
  skhoid demo --effect none      nothing is hidden: does it say so?
"""
ABOUT_DIAGNOSE = """\
find the effects that a model of your recordings is missing
Fit a model to recorded runs, compare it with them, and find out which physical effects it is
missing, on runs held out of the fit. Without files it uses four bundled recordings of a person
tracking a target."""
OF_DIAGNOSE = """\
examples:
  skhoid diagnose                     bundled recordings of a human tracker
  skhoid diagnose lab.mat --dry-run   what is in the file, and what would be tried
  skhoid diagnose run*.csv            columns are guessed, and said
  skhoid diagnose run*.csv --output stick --x pitch --target command
  skhoid diagnose runs.mat --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --role roll=motion --effects motion_feedback bias
  skhoid diagnose arm.csv --input force --output angle --core arx --nk 1
  skhoid diagnose run*.csv --report out.html --tables out --format pdf
"""
ABOUT_REPORT = """\
write a report on a model of your recordings, one HTML file
Do what `skhoid diagnose` does, and write it down in one HTML file that needs no network: data,
model, comparison, ranking, error, parameters, and what to do next. Without files it uses four
bundled recordings of a person tracking a target."""
OF_REPORT = """\
examples:
  skhoid report                            bundled recordings of a human tracker
  skhoid report run*.csv --out monday.html
  skhoid report run*.csv --effects none    the model as it is, no search
  skhoid report run*.csv --title "Subject 3" --overwrite --tables tables
"""
AFTER_DEMO = [
    ("skhoid diagnose", "recordings of a real person"),
    ("skhoid simulate --remnant 0.1 --out runs.csv", "a file, as yours may be"),
    ("skhoid diagnose runs.csv", "what is missing in it?"),
]
SHOWN = 3  # candidates of a step, and findings of a comparison
BUNDLED = ["phase-size 2b", "phase-size 2c", "phase-size 2d", "phase-size 2e"]
OF_COMPARISON = (
    "by_run",
    "by_time",
    "by_frequency",
    "by_operating_point",
    "tests",
    "correlations",
    "time_frequency",
)


def add_demo(commands: Any) -> None:
    """Add ``skhoid demo`` to the parser."""
    command = add_command(commands, demo, ABOUT_DEMO, "[OPTIONS]", OF_DEMO)
    add = command.section("Data")
    text = "hidden in the person: none, or ids of skhoid's catalogue (default: dead_zone bias)"
    hidden = ["dead_zone", "bias"]
    add("--effect", nargs="+", default=hidden, metavar="HIDDEN", help=text)
    add("--runs", type=at_least_one, default=4, metavar="N", help="number of runs (default: 4)")
    add("--remnant", type=not_negative, default=0.1, metavar="P", help="P_n (default: 0.1)")
    add("--seed", type=seed, default=0, metavar="N", help="of the simulation (default: 0)")
    add_search_options(command.section("Search"))
    add = command.section("Output")
    add_plot_options(add, "skhoid-demo, where report.html is too")
    add_output_options(add)


def demo(options: argparse.Namespace) -> int:
    """Hide effects in a simulated person, and find them."""
    from ...effects import titles_of

    names = [] if options.effect == ["none"] else options.effect
    if "none" in names:
        raise ValueError("--effect none hides nothing, and takes no other names.")
    hidden = hidden_effects(names)
    if options.no_pictures:
        refuse(options, ["format"], "is for the plots, and --no-pictures draws none.")
    folder = Path(options.out or "skhoid-demo")
    check_folders(folder)
    check_tables(options)
    X, y, truth = skhoid.make_tracking_runs(
        "C1",
        n_runs=options.runs,
        remnant_intensity=options.remnant,
        channels=["e", "x", "f_t"],
        sampling_rate=50.0,  # twice what the criterion looks at
        effects=hidden,
        random_state=options.seed,
        return_truth=True,
    )
    source = f"simulated runs of condition C1, remnant P_n = {options.remnant:g}"
    best = 100 * (1 - (truth.remnant**2).sum() / (y**2).sum())
    given = truth.parameters.iloc[0].to_dict()
    given |= {f"{n}__{p}": v for n, e in hidden for p, v in e.fixed.items()}
    found = show_search(options, skhoid.OperatorRegressor(), X, y, source, truth=given)
    if not options.json:
        print()
        print_wrapped(
            f"The truth: hidden {titles_of(names) if names else 'nothing'}; simulated with the "
            f"true parameters the VAF is {best:.1f} %"
        )
    write_results(
        options,
        found,
        source,
        report=folder / "report.html",
        folder=None if options.no_pictures else folder,
        head={"hidden": names, "truth_vaf": best},
    )
    if not options.json:
        say_next(AFTER_DEMO)
    return 0


def add_diagnose(commands: Any) -> None:
    """Add ``skhoid diagnose`` to the parser."""
    command = add_command(commands, diagnose, ABOUT_DIAGNOSE, "[FILES] [OPTIONS]", OF_DIAGNOSE)
    add_recording_options(command)
    text = "say what was understood, what would be tried and for how long; fit nothing"
    command.section("Data")("--dry-run", action="store_true", help=text)
    add = command.section("Search")
    add_search_options(add)
    _add_domain(add)
    add = command.section("Output")
    add_plot_options(add, "skhoid-diagnose")
    add("--report", metavar="FILE", help="write a report, one HTML file")
    text = (
        "write the shape of what has no name as an effect of your own, a Python file named after "
    )
    add("--sketch", metavar="FILE", help=text + "the effect, such as my_effect.py")
    add_save(add)
    add("--overwrite", action="store_true", help="replace these FILEs if they exist")
    add_output_options(add)


def _add_domain(add: Any) -> None:
    text = "what was recorded: it decides the words, and which effects are tried (default: machine "
    text += "for an ARX model, unless it answers the error, target or x of a loop)"
    add("--domain", choices=DOMAINS, help=text)


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    report = sketch = None
    if options.report is None and options.sketch is None and options.save is None:
        refuse(options, ["overwrite"], "is for the files of --report, --sketch and --save.")
    model = model_file(options)
    if options.report is not None:
        report = new_file(options.report, options.overwrite, new_folder=True)
    if options.sketch is not None:
        sketch = _check_sketch(options.sketch, options.overwrite)
    folder = figure_folder(options, "skhoid-diagnose")
    check_tables(options)
    if options.dry_run:
        refuse(
            options,
            ["report", "sketch", "save", "tables"],
            "is for results, and --dry-run has none.",
        )
    with columns_shown(options):
        X, y, estimator, source = read_recordings(options)
    if options.dry_run:
        return show_dry_run(options, X, y, search_for(options, estimator), source, folder)
    found = show_search(options, estimator, X, y, source)
    why_not = ""
    if sketch is not None:
        try:
            found.search.sketch_effect(sketch.stem, sketch, overwrite=options.overwrite)
        except ValueError as error:  # nothing is left without a name
            sketch, why_not = None, f"--sketch: {error}"
    kept = {"model": save_model(found.search.best_estimator_, model, options)}
    write_results(options, found, source, report=report, folder=folder, sketch=sketch, kept=kept)
    if why_not:
        note(why_not)
    if not options.json:
        say_next([*_find_next_steps(options, found.search), *compared_next(options)])
    return 0


def _check_sketch(name: str, overwrite: bool) -> Path:
    """The file of an effect, checked before the work begins."""
    from ...search import checked_name

    path = new_file(name, overwrite)
    if path.suffix != ".py":
        raise ValueError(f"--sketch writes a Python file, such as my_effect.py; got {name}.")
    checked_name(path.stem)
    return path


def add_report(commands: Any) -> None:
    """Add ``skhoid report`` to the parser."""
    command = add_command(commands, report, ABOUT_REPORT, "[FILES] [OPTIONS]", OF_REPORT)
    add_recording_options(command)
    add = command.section("Search")
    add_search_options(add, "; none: no search")
    _add_domain(add)
    add = command.section("Output")
    add_page_options(add, "report.html")
    add_output_options(add)


def report(options: argparse.Namespace) -> int:
    """Report on a model of recordings, with a search for missing effects or without."""
    path = new_file(options.out, options.overwrite, new_folder=True)
    check_tables(options)
    X, y, estimator, source = read_recordings(options)
    if options.effects == ["none"]:
        return _report_model(options, path, X, y, estimator.fit(X, y), source)
    found = show_search(options, estimator, X, y, source)
    write_results(options, found, source, report=path)
    if not options.json:
        say_next(_find_next_steps(options, found.search))
    return 0


def _report_model(
    options: argparse.Namespace, path: Path, X: Any, y: Any, model: Any, source: str
) -> int:
    """Report on a fitted model as it is."""
    import pandas as pd

    from ...pipelines import prediction_from

    compared = write_report(options, path, model, X, y, source, effects=None).comparison
    predicted = prediction_from(model, X, y)[0]
    tables = {
        "parameters": model.parameters_,
        "predictions": pd.DataFrame({"measured": y, "free_run": predicted}, index=X.index),
        **tables_of_comparison(compared),
    }
    files = {"report": str(path), "tables": save_tables(tables, options)}
    if options.json:
        found = {
            "source": source,
            "parameters": model.parameters_.reset_index().to_dict("records"),
            "comparison": None if compared is None else compared.as_dict(),
        }
        print_json(options, {**found, **files})
        return 0
    print_source(options, source)
    if compared is not None:
        print_document(compared.document(), options)
    say_files(files)
    return 0


def read_recordings(options: argparse.Namespace) -> tuple[Any, Any, Any, str]:
    """X, y, the model of them, and where they are from; the user's files, or bundled ones."""
    from ..opening import make_estimator, trimmed

    if options.files:
        X, y, roles, source = _read_own(options)
    else:
        X, y = skhoid.load_human_tracking(BUNDLED)
        # The answer to the target, which is what a pursuit display shows.
        options.display, options.remove_means, options.input, roles = "pursuit", True, "f_t", {}
        source = (
            "bundled recordings: a person follows a pseudo-random target with a mouse, four "
            "times, positions about their mean (Matic 2022, MIT licence)"
        )
    X, y = trimmed(X, y, options)
    inputs = [find_column(X, options.input)]
    return X, y, make_estimator(options, X, y, inputs=inputs, roles=roles or None), source


def _read_own(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    asked = options.input
    known = {}
    if asked is not None:  # on a pursuit display the input is the target itself
        is_target = asked in (options.target, "f_t") or asked.endswith(".f_t")
        known[asked] = "f_t" if is_target else "e"
    roles = {**known, **read_roles(options, known)}
    X, y, guess = read_files(options, roles, signals=asked is None)
    options.input = guess.inputs[0] if asked is None else find_column(X, asked)
    of_columns = guess.roles | {find_column(X, name): role for name, role in roles.items()}
    return X, y, of_columns, show_names(options.files)


def search_for(options: argparse.Namespace, estimator: Any) -> Any:
    """The search that the options ask for, unfitted."""
    from ..opening import read_element

    return skhoid.EffectSearchCV(
        estimator,
        effects="all" if options.effects in (None, ["all"]) else options.effects,
        display=getattr(options, "display", None),
        controlled_element=read_element(getattr(options, "controlled_element", None)),
        max_effects=MAX_EFFECTS if options.max_effects is None else options.max_effects,
        domain=getattr(options, "domain", None),
        lost_control=options.lost_control,
        time_limit=options.time_limit,
        exhaustive=options.exhaustive,
    )


@dataclass
class Searched:
    """A search of recordings, and beside it the model without effects, compared with them."""

    search: Any
    X: Any
    y: Any
    baseline: Any
    comparison: Any

    def as_dict(self) -> dict[str, Any]:
        """Numbers and names, for JSON."""
        from ...runs import output_name, read_layout

        layout = read_layout(self.X, dt=self.baseline.dt, run=self.baseline.run)
        return {
            "n_runs": len(layout.labels),
            "n_rows": layout.n_rows,
            "dt_s": layout.dt,
            "inputs": list(map(str, self.baseline.inputs_)),
            "output": output_name(self.y),
            "units": _read_units(self.X, self.y),
            "baseline": self.baseline.parameters_.reset_index().to_dict("records"),
            "comparison": None if self.comparison is None else self.comparison.as_dict(),
            **self.search.result_.as_dict(),
        }


def show_search(
    options: argparse.Namespace,
    estimator: Any,
    X: Any,
    y: Any,
    source: str,
    *,
    truth: dict[str, float] | None = None,
) -> Searched:
    """Search, and print what is found, beside the truth where it is known."""
    from sklearn.base import clone

    from ..._sklearn import list_progress_bars
    from ...runs import read_layout
    from ...search import control_of, without_output

    search = search_for(options, estimator)
    if shows_progress(options):
        search.set_callbacks(*list_progress_bars())
    kept = without_output(y, control_of(estimator, X, search.lost_control, search.domain))
    baseline = clone(estimator).fit(X, kept)
    if not options.json:
        print_source(options, source)
        layout = read_layout(X, dt=baseline.dt, run=baseline.run)
        print_wrapped(describe_runs(layout, baseline.inputs_, y, _read_units(X, y)))
        print_wrapped("Searching for what a linear model is missing ...")
    comparison, why_not = None, ""
    search.fit(X, y)
    if getattr(search.baseline_, "controller", None) is not None:  # the search has found
        baseline = clone(search.baseline_).fit(X, kept)
    try:
        comparison = skhoid.compare(baseline, X, kept)
    except ValueError as error:
        why_not = f"The model without effects could not be compared: {error}"
    if not options.json:
        print()
        print_document(_tell_search(search, truth), options)
        if comparison is not None:
            print()
            print_document(_tell_briefly(comparison), options)
    if why_not:
        note(why_not)
    return Searched(search, X, y, baseline, comparison)


def _tell_search(search: Any, truth: dict[str, float] | None) -> Any:
    """The search as a document, with its parameters and the best candidates of each step."""
    from ...search import parameters_table, tell_candidates, tell_search

    result = search.result_
    told = tell_search(result)
    blocks = [parameters_table(search.best_estimator_, result.added, truth), *told.blocks]
    if result.shape is not None:
        blocks += result.shape.tables()
    for step in result.ranking["step"].unique():
        blocks += tell_candidates(result, step, SHOWN)
    return replace(told, blocks=blocks)


def _tell_briefly(comparison: Any) -> Any:
    """The figures of the model without effects, and what its first findings are about."""
    from ...text import Facts, Item, Items, Paragraph, as_sentence

    told = comparison.document()
    blocks = [block for block in told.blocks if isinstance(block, Facts)]
    found = [Item(finding.title) for finding in comparison.findings[:SHOWN]]
    title = f"The model without effects against measured {comparison.output}"
    # Else its VAF contradicts that of the search, which has the least error.
    which = [Paragraph(as_sentence(str(n))) for n in comparison.notes if n.kind == "two estimates"]
    return replace(told, title=title, blocks=[*blocks, *which, Items(found)])


def _read_units(X: Any, y: Any) -> dict[str, str]:
    """Units of the channels, as far as they are known."""
    from ...regression import units_of

    return {**units_of(X), **units_of(y)}


def _find_next_steps(options: argparse.Namespace, search: Any) -> list[tuple[str, str]]:
    """What to do next: its report, its tables, and the linear model."""
    steps = []
    if not getattr(options, "report", None) and options.command != "report":
        page = f"{typed(options, 'report')} --out {free_name('report.html')}"
        steps.append((page, "the same as a page to keep"))
    names = [name for name in search.best_effects_ if name != "unknown"]
    if names:
        alone = typed(options, "diagnose", effects=list(dict.fromkeys(names)))
        if len(names) < len(search.list_effects()):
            steps.append((alone, "these effects alone, in less time"))
    steps.append((typed(options, "identify"), "the delay, and a linear model"))
    if search.shape_ is not None and getattr(options, "sketch", None) is None:
        sketch = f"{typed(options, 'diagnose')} --sketch {free_name('my_effect.py')}"
        steps.append((sketch, "what has no name as an effect of your own, in Python"))
    return steps


def write_results(
    options: argparse.Namespace,
    found: Searched,
    source: str,
    *,
    report: Path | None = None,
    folder: Path | None = None,
    sketch: Path | None = None,
    head: dict[str, Any] | None = None,
    kept: dict[str, Any] | None = None,
) -> None:
    """Write the report, the plots and the tables, and say where; or print all as JSON."""
    files: dict[str, Any] = {"report": None, "pictures": [], **(kept or {})}
    if report is not None:
        write_report(options, report, found.search, found.X, found.y, source)
        files["report"] = str(report)
    if folder is not None:
        files["pictures"] = _draw(found, folder, options)
    files["tables"] = save_tables(_gather_tables(found), options)
    if sketch is not None:
        files["effect"] = str(sketch)
    if options.json:
        print_json(options, {"source": source, **(head or {}), **found.as_dict(), **files})
    elif any(files.values()):
        print()
        say_files(files)


def write_report(
    options: argparse.Namespace,
    path: Path,
    model: Any,
    X: Any,
    y: Any,
    source: str,
    **more: Any,
) -> Any:
    """Make the report and write it; returns it."""
    made_with = {"command": show_names([shlex.join(["skhoid", *options.command_line])])}
    if getattr(options, "seed", None) is not None:
        made_with["seed"] = str(options.seed)
    without_screen()
    title = getattr(options, "title", None)
    page = skhoid.report(model, X, y, title=title, source=source, made_with=made_with, **more)
    page.save(path)
    return page


def _gather_tables(found: Searched) -> dict[str, Any]:
    """All tables of a search, by name."""
    search, shape = found.search, found.search.shape_
    of_shape = {} if shape is None else {"shape": shape.curve}
    if shape is not None and len(shape.nearest):
        of_shape["nearest"] = shape.nearest
    return {
        "ranking": search.ranking_,
        "error_path": search.error_path_,
        "baseline": found.baseline.parameters_,
        "parameters": search.best_estimator_.parameters_,
        "predictions": search.predictions_,
        "left_out": search.left_out_,
        "unexplained": search.unexplained_,
        **of_shape,
        **tables_of_comparison(found.comparison),
    }


def tables_of_comparison(found: Any) -> dict[str, Any]:
    """Tables of a comparison, if there is one."""
    import pandas as pd

    if found is None:
        return {}
    tables = {name: getattr(found, name) for name in OF_COMPARISON}
    return {**tables, "findings": pd.DataFrame([vars(finding) for finding in found.findings])}


def _draw(found: Searched, folder: Path, options: argparse.Namespace) -> list[str]:
    """Draw the results of a search into a folder; returns the paths."""
    without_screen()
    search, show = found.search, skhoid.plotting.SearchDisplay.from_estimator
    displays: dict[str, Any] = {}
    if found.comparison is not None:
        displays["comparison"] = found.comparison.plot()
    for step in search.ranking_["step"].unique():
        displays[f"ranking-{step}"] = show(search, "ranking", step=step, n_candidates=12)
    displays["error-path"] = show(search)
    displays["before-and-after"] = show(search, "steps")
    show_effect = skhoid.plotting.EffectDisplay
    for name in search.best_estimator_.effects_.names:
        displays[name] = show_effect.from_estimator(search, name, found.X, found.y)
    if search.shape_ is not None:
        displays["shape"] = show_effect.from_shape(search)
    known = list(skhoid.effects.catalogue().index)
    steps = [f"ranking-{step}" for step in range(1, len(known) + 2)]
    others = ["comparison", "shape", *known, *steps]
    figures = {name: display.figure_ for name, display in displays.items()}
    named = (found.X, found.y)
    command = options.command
    return save_figures(figures, folder, command, options.format, others=others, named=named)
