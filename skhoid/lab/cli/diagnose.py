"""The commands ``demo``, ``diagnose`` and ``report``: which effects a model is missing.

``diagnose`` and ``report`` read recordings, ``demo`` simulates them; then all three search, print
what was found, and write plots, tables and a page.
"""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import skhoid

from ... import __version__
from .files import (
    check_folders,
    check_tables,
    column_of,
    columns_dict,
    figure_folder,
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
    note,
    print_bold,
    print_json,
    print_source,
    print_table,
    print_wrapped,
    say_files,
    say_next,
    shows_progress,
    typed,
)
from .parser import (
    DOMAINS,
    MAX_EFFECTS,
    OF_SEARCH,
    add_command,
    add_output_options,
    add_plot_options,
    add_recording_options,
    add_search_options,
    at_least_one,
    not_negative,
    read_roles,
    refuse,
    refuse_of_other_core,
    seed,
)
from .simulate import hidden_effects

OF_DEMO = """\
examples:
  skhoid demo                    a person with a dead zone and an offset
  skhoid demo --effect saturation --remnant 0.2 --seed 3
  skhoid demo --effect none      nothing is hidden: does it say so?
"""
OF_DIAGNOSE = """\
examples:
  skhoid diagnose                     bundled recordings of a human tracker
  skhoid diagnose run*.csv            columns are guessed, and said
  skhoid diagnose run*.csv --output stick --x pitch --target command
  skhoid diagnose runs.mat --dt 0.01 --delay 0.28
  skhoid diagnose sim.csv --role roll=motion --effects motion_feedback bias
  skhoid diagnose arm.csv --input force --output angle --core arx --nk 1
  skhoid diagnose run*.csv --report out.html --tables out --format pdf
"""
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
BY_HAND = 'search.sketch_effect("my_effect", "my_effect.py")'
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


def add_demo(commands: Any) -> None:
    """Add ``skhoid demo`` to the parser."""
    command = add_command(
        commands,
        "demo",
        "hide an effect in a simulated person, and find it",
        "Simulate runs of a person who tracks a target, with effects hidden in them, "
        "fit a model that knows nothing of them, and find out which are missing: the whole way, "
        "with numbers at each step, and a report in the end.",
        OF_DEMO,
    )
    command.set_defaults(work=demo)
    add = command.section("Data")
    add(
        "--effect",
        nargs="+",
        default=["dead_zone", "bias"],
        metavar="HIDDEN",
        help="hidden in the person: none, or ids of skhoid's catalogue (default: dead_zone bias)",
    )
    add("--runs", type=at_least_one, default=4, metavar="N", help="number of runs (default: 4)")
    add("--remnant", type=not_negative, default=0.1, metavar="P", help="P_n (default: 0.1)")
    add("--seed", type=seed, default=0, metavar="N", help="of the simulation (default: 0)")
    add_search_options(command.section("Search"))
    add = command.section("Output")
    add_plot_options(add, "skhoid-demo")
    add("--no-report", action="store_true", help="do not write report.html into that folder")
    add_output_options(add)


def demo(options: argparse.Namespace) -> int:
    """Hide effects in a simulated person, and find them."""
    names = [] if options.effect == ["none"] else options.effect
    if "none" in names:
        raise ValueError("--effect none hides nothing, and takes no other names.")
    hidden = hidden_effects(names)
    if options.no_pictures and options.no_report:
        refuse(options, ["out"], "has no use: --no-pictures and --no-report leave nothing there.")
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
        _reveal(found.search, names, best)
    write_results(
        options,
        found,
        source,
        report=None if options.no_report else folder / "report.html",
        folder=None if options.no_pictures else folder,
        head={"hidden": names, "truth_vaf": best},
    )
    if not options.json:
        say_next(AFTER_DEMO)
    return 0


def _reveal(search: Any, names: list[str], best: float) -> None:
    """What was hidden, beside what was found."""
    from ...effects import titles_of

    print_wrapped("")
    found = search.best_effects_
    print_bold(f"The truth: hidden {titles_of(names) if names else 'nothing'}")
    same = "as found" if set(found) == set(names) else f"found: {titles_of(found)}"
    print_wrapped(f"  {same}; simulated with the true parameters the VAF is {best:.1f} %")


def add_diagnose(commands: Any) -> None:
    """Add ``skhoid diagnose`` to the parser."""
    command = add_command(
        commands,
        "diagnose",
        "find the effects that a model of your recordings is missing",
        "Fit a model to recorded runs, compare it with them, and find out which "
        "physical effects it is missing, on runs held out of the fit. Without files it uses four "
        "bundled recordings of a person tracking a target.",
        OF_DIAGNOSE,
        "[FILES] [OPTIONS]",
    )
    command.set_defaults(work=diagnose)
    add_recording_options(command)
    add = command.section("Search")
    add_search_options(add)
    add(
        "--domain",
        choices=DOMAINS,
        help="what was recorded: it decides the words, and which effects are tried (default: "
        "machine for an ARX model, unless it answers the error, target or x of a loop)",
    )
    add = command.section("Output")
    add_plot_options(add, "skhoid-diagnose")
    add("--report", metavar="FILE", help="write a report, one HTML file")
    add(
        "--sketch",
        metavar="FILE",
        help="write the shape of what has no name as an effect of your own, a Python file named "
        "after the effect, such as my_effect.py",
    )
    add("--overwrite", action="store_true", help="replace these FILEs if they exist")
    add_output_options(add)


def diagnose(options: argparse.Namespace) -> int:
    """Find the effects that a model of recordings is missing."""
    report = sketch = None
    if options.report is None and options.sketch is None:
        refuse(options, ["overwrite"], "is for the files of --report FILE and --sketch FILE.")
    if options.report is not None:
        report = new_file(options.report, options.overwrite, new_folder=True)
    if options.sketch is not None:
        sketch = _effect_file(options.sketch, options.overwrite)
    folder = figure_folder(options, "skhoid-diagnose")
    check_tables(options)
    X, y, estimator, source = read_recordings(options)
    found = show_search(options, estimator, X, y, source)
    search, why_not = found.search, ""
    if sketch is not None:
        try:
            search.sketch_effect(sketch.stem, sketch, overwrite=options.overwrite)
        except ValueError as error:  # nothing is left without a name
            sketch, why_not = None, f"--sketch: {error}"
    write_results(options, found, source, report=report, folder=folder, sketch=sketch)
    if why_not:
        note(why_not)
    if not options.json:
        say_next(_after_search(options, search))
    return 0


def _effect_file(name: str, overwrite: bool) -> Path:
    """The file of an effect, checked before the work begins."""
    from ...search import checked_name

    path = new_file(name, overwrite)
    if path.suffix != ".py":
        raise ValueError(f"--sketch writes a Python file, such as my_effect.py; got {name}.")
    checked_name(path.stem)
    return path


def add_report(commands: Any) -> None:
    """Add ``skhoid report`` to the parser."""
    command = add_command(
        commands,
        "report",
        "write a report on a model of your recordings, one HTML file",
        "Do what `skhoid diagnose` does, and write it down in one HTML file that needs "
        "no network: data, model, comparison, ranking, error, parameters, and what to do next. "
        "Without files it uses four bundled recordings of a person tracking a target.",
        OF_REPORT,
        "[FILES] [OPTIONS]",
    )
    command.set_defaults(work=report)
    add_recording_options(command)
    add_search_options(command.section("Search"), "; none: no search")
    add = command.section("Output")
    add("--title", metavar="TEXT", help="title of the report")
    add("--out", default="report.html", metavar="FILE", help="the file (default: report.html)")
    add("--overwrite", action="store_true", help="replace FILE if it exists")
    add_output_options(add)


def report(options: argparse.Namespace) -> int:
    """Report on a model of recordings, with a search for missing effects or without."""
    path = new_file(options.out, options.overwrite, new_folder=True)
    check_tables(options)
    searches = options.effects != ["none"]
    if not searches:
        refuse(options, OF_SEARCH, "is for the search, and --effects none makes none.")
    X, y, estimator, source = read_recordings(options)
    if not searches:
        return _report_model(options, path, X, y, estimator.fit(X, y), source)
    found = show_search(options, estimator, X, y, source, aloud=False)
    if not options.json:
        print_source(options, source)
        for line in found.search.summary().splitlines():
            print_wrapped(line)
    write_results(options, found, source, report=path)
    if not options.json:
        say_next(_after_search(options, found.search))
    return 0


def _report_model(
    options: argparse.Namespace, path: Path, X: Any, y: Any, model: Any, source: str
) -> int:
    """Report on a fitted model as it is."""
    import pandas as pd

    from ...pipelines import prediction_from
    from ...search import parameters_table

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
            "comparison": None if compared is None else _figures_of(compared),
        }
        print_json({**found, **files})
    else:
        print_source(options, source)
        print_wrapped(f"VAF {vaf:.1f} % of the simulated output on the rows of the fit")
        print_block(parameters_table(model), options)
        for each in compared.notes if compared is not None else []:
            print_wrapped(f"  note: {message_for(each, options)}")
        say_files(files)
    return 0


def read_recordings(options: argparse.Namespace) -> tuple[Any, Any, Any, str]:
    """X, y, the model of them, and where they are from; the user's files, or bundled ones."""
    from ..opening import estimator_of, trimmed

    refuse_of_other_core(options)
    X, y, roles, source = _own(options) if options.files else _bundled(options)
    X, y = trimmed(X, y, options)
    inputs = [column_of(X, options.input)]
    return X, y, estimator_of(options, X, y, inputs=inputs, roles=roles or None), source


def _own(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    # On a pursuit display the input is the target itself.
    asked = options.input
    is_target = asked in (options.target, "f_t") or (asked or "").endswith(".f_t")
    named = [
        ("--input", asked, "f_t" if is_target else "e"),
        ("--x", options.x, "x"),
        ("--target", options.target, "f_t"),
    ]
    roles = read_roles(options)
    said = dict.fromkeys(roles, "--role")
    for option, name, role in named:
        if name is None:
            continue
        if roles.setdefault(name, role) != role:
            raise ValueError(
                f"The channel {name!r} has two roles, {roles[name]!r} by {said[name]} and {role!r} "
                f"by {option}: name different channels."
            )
        said[name] = option
    options.named_input = [] if asked is None else [asked]
    found = read_files(options, roles, signals=asked is None)
    X, guess = found.X, found.guess
    of_columns = guess.roles | {column_of(X, name): role for name, role in roles.items()}
    options.input = column_of(X, asked) if asked is not None else guess.inputs[0]
    return X, found.y, of_columns, names_of(options.files)


def _bundled(options: argparse.Namespace) -> tuple[Any, Any, dict[str, str], str]:
    X, y = skhoid.load_human_tracking(BUNDLED)
    options.display, options.remove_means = "pursuit", True
    source = (
        "bundled recordings: a person follows a pseudo-random target with a mouse, four times, "
        "positions about their mean (Matic 2022, MIT licence)"
    )
    options.input = "f_t"  # the answer to the target, which is what a pursuit display shows
    return X, y, {}, source


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
    )


@dataclass
class Searched:
    """A search of recordings, and beside it the model without effects, compared with them."""

    search: Any
    X: Any
    y: Any
    baseline: Any
    comparison: Any = None

    def as_dict(self) -> dict[str, Any]:
        """Numbers and names, for JSON."""
        from ...runs import output_name, read_layout

        layout = read_layout(self.X, dt=self.baseline.dt, run=self.baseline.run)
        parameters = self.baseline.parameters_.reset_index().to_dict("records")
        compared = self.comparison
        return {
            "n_runs": len(layout.labels),
            "n_rows": layout.n_rows,
            "dt_s": layout.dt,
            "inputs": [str(name) for name in self.baseline.inputs_],
            "output": output_name(self.y),
            "units": _units(self.X, self.y),
            "baseline": parameters,
            "comparison": None if compared is None else _figures_of(compared),
            **self.search.result_.as_dict(),
        }


def show_search(
    options: argparse.Namespace,
    estimator: Any,
    X: Any,
    y: Any,
    source: str,
    *,
    aloud: bool = True,
    truth: dict[str, float] | None = None,
) -> Searched:
    """Search, and print each result as soon as it is known, beside the truth where it is."""
    from sklearn.base import clone
    from sklearn.callback import ProgressBar

    from ...search import control_of, without_output

    search = search_for(options, estimator)
    if shows_progress(options):
        search.set_callbacks(ProgressBar())
    aloud = aloud and not options.json
    lost = control_of(estimator, X, search.lost_control, search.domain)
    kept = without_output(y, lost)
    found = Searched(search, X, y, clone(estimator).fit(X, kept))
    if aloud:
        print_source(options, source)
        for line in _tell_runs(found, lost):
            print_wrapped(line)
        print_wrapped("Searching for what a linear model is missing (some 10 to 60 s) ...")
    why_not = ""
    try:
        found.comparison = skhoid.compare(found.baseline, X, kept)
    except ValueError as error:
        why_not = str(error)
    search.fit(X, y)
    if aloud:
        for part in _tell_searched(search, truth):
            print_wrapped("")
            for block in part:
                print_block(block, options)
        print_wrapped("")
        for line in _tell_baseline(found, why_not):
            print_wrapped(line)
    return found


def print_block(block: Any, options: argparse.Namespace) -> None:
    """Print a block of a document."""
    from ...text import Items, Notes, TextTable

    if isinstance(block, TextTable):
        folded = block.header if block.kind == "shape" else ("effect", "its numbers")
        print_table(block.caption, block.header, block.rows, left=block.left, folded=folded)
    elif isinstance(block, Notes):
        for each in block.notes:
            print_wrapped(f"  note: {message_for(each, options)}")
    elif isinstance(block, Items):
        for item in block.items:
            print_wrapped(f"  - {item.title}")
    else:
        show = print_bold if getattr(block, "role", "") else print_wrapped
        show(block.text)


def _tell_searched(search: Any, truth: dict[str, float] | None) -> Iterator[list[Any]]:
    """Parts of what a search found, the verdict first."""
    from ...search import (
        parameters_table,
        tell_candidates,
        tell_end,
        tell_notes,
        tell_step,
        tell_verdict,
    )

    result = search.result_
    yield [*tell_verdict(result), *tell_end(result), *tell_notes(result)]
    if result.shape is not None:
        yield result.shape.tables()
    yield [parameters_table(search.best_estimator_, result.added, truth)]
    for step in result.ranking["step"].unique():
        added = [tell_step(result, step)] if step <= len(result.added) else []
        yield [*tell_candidates(result, step, SHOWN), *added]


def _units(X: Any, y: Any) -> dict[str, str]:
    """Units of the channels, as far as they are known."""
    from ...regression import units_of

    return {**units_of(X), **units_of(y)}


def _tell_runs(found: Searched, lost: Any) -> Iterator[str]:
    """What was measured: runs, channels, and where control was lost."""
    from ...recordings import notes_of_lost
    from ...runs import output_name, read_layout
    from ...text import counted

    units = _units(found.X, found.y)

    def named(channel: str) -> str:
        return f"{channel} ({units[channel]})" if units.get(channel) else channel

    model = found.baseline
    layout = read_layout(found.X, dt=model.dt, run=model.run)
    inputs = [str(name) for name in model.inputs_]
    others = [str(c) for c in getattr(found.X, "columns", []) if str(c) not in inputs]
    yield (
        f"Measured: {counted(len(layout.labels), 'run')}, {layout.n_rows} rows at "
        f"{1 / layout.dt:.6g} Hz, {layout.n_rows * layout.dt:.0f} s in all"
    )
    text = f"  input {', '.join(map(named, inputs))}, output {named(output_name(found.y))}"
    if others:
        text += f"; channels that effects may use: {', '.join(map(named, others))}"
    yield text
    for each in notes_of_lost(lost.table):
        yield f"  {each.with_hint}"


def _tell_baseline(searched: Searched, why_not: str) -> Iterator[str]:
    """The model without effects, compared with the measurement."""
    found = searched.comparison
    yield f"Without effects: {type(searched.baseline).__name__}, linear and constant in time"
    if found is None:
        yield f"  comparison with the measurement: not possible ({why_not})"
        return
    about = ""
    if found.mean_dominates:
        about = f" about zero, which is mostly the mean: {found.vaf_about_mean:.1f} % about it"
    held_out = searched.search.error_path_["vaf"].iloc[0]
    yield (
        f"  simulated on the rows of its fit it has a VAF of {found.vaf:.1f} %{about}; held "
        f"out it has {held_out:.1f} %, where it is fitted for simulation and not by likelihood"
    )
    if math.isfinite(found.noise_ceiling):
        low, high = found.noise_ceiling_interval
        gap = max(found.explainable_gap, 0.0)
        left = f"{gap:.1f} points are left" if gap else "nothing is left, within its error"
        yield (
            f"  noise ceiling on these rows, judged by this model: "
            f"{found.noise_ceiling:.1f} % ({low:.1f} to {high:.1f}): {left}"
        )
        yield f"  the ceiling is {found.ceiling_note}"
    else:
        yield f"  how much of the rest is remnant is not known: {found.ceiling_note}"
    for finding in found.findings[:SHOWN]:
        cost = f" ({finding.severity:.1f} points)" if math.isfinite(finding.severity) else ""
        # That nothing is missing is for the search to say.
        title = "No test exceeds chance" if finding.name == "none" else finding.title
        yield f"  - {title}{cost}"
    for each in found.notes:
        yield f"  note: {each}"


def _figures_of(found: Any) -> dict[str, Any]:
    """The figures of a comparison, for JSON."""
    return {
        "vaf": found.vaf,
        "noise_ceiling": found.noise_ceiling,
        "noise_ceiling_interval": list(found.noise_ceiling_interval),
        "explainable_gap": found.explainable_gap,
        "findings": [finding.name for finding in found.findings],
    }


def _after_search(options: argparse.Namespace, search: Any) -> list[tuple[str, str]]:
    """What to do next: its report, its tables, and the linear model."""
    steps = []
    if not getattr(options, "report", None) and options.command != "report":
        page = f"{typed(options, 'report')} --out {free_name('report.html')}"
        steps.append((page, "the same as a page to keep"))
    names = [name for name in search.best_effects_ if name != "unknown"]
    if names:
        alone = f"{typed(options, 'diagnose')} --effects {' '.join(dict.fromkeys(names))}"
        steps.append((alone, "these effects alone, in less time"))
    steps.append((typed(options, "identify"), "the delay, and a linear model"))
    if search.shape_ is not None and options.command != "diagnose":
        steps.append((BY_HAND, "in Python: what has no name as an effect of your own"))
    elif search.shape_ is not None and options.sketch is None:
        words = ["skhoid", *options.command_line, "--sketch", free_name("my_effect.py")]
        steps.append((shlex.join(words), "what has no name as an effect of your own, in Python"))
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
) -> None:
    """Write the report, the plots and the tables, and say where; or print all as JSON."""
    if report is not None:
        write_report(options, report, found.search, found.X, found.y, source)
    form = getattr(options, "format", None) or "png"
    plots = _draw(found, folder, options.command, form) if folder else []
    tables = save_tables(_tables_of(found), options)
    page = None if report is None else str(report)
    files: dict[str, Any] = {"report": page, "pictures": plots, "tables": tables}
    if sketch is not None:
        files["effect"] = str(sketch)
    if options.json:
        first = {"skhoid": __version__, "source": source, "columns": columns_dict(options)}
        first |= head or {}
        print_json({**first, **found.as_dict(), **files})
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
) -> Any:
    """Make the report and write it; returns it."""
    made_with = {"command": names_of([shlex.join(["skhoid", *options.command_line])])}
    if getattr(options, "seed", None) is not None:
        made_with["seed"] = str(options.seed)
    without_screen()
    title = getattr(options, "title", None)
    page = skhoid.report(model, X, y, title=title, source=source, made_with=made_with, **more)
    page.save(path)
    return page


def _tables_of(found: Searched) -> dict[str, Any]:
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


def _draw(found: Searched, folder: Path, command: str, form: str) -> list[str]:
    """Draw the results of a search into a folder; returns the paths."""
    without_screen()
    show = skhoid.plotting
    search = found.search
    figures: dict[str, Any] = {}
    if found.comparison is not None:
        figures["comparison.png"] = found.comparison.plot().figure_
    for step in search.ranking_["step"].unique():
        display = show.SearchDisplay.from_estimator(search, "ranking", step=step, n_candidates=12)
        figures[f"ranking-{step}.png"] = display.figure_
    figures["error-path.png"] = show.SearchDisplay.from_estimator(search).figure_
    figures["before-and-after.png"] = show.SearchDisplay.from_estimator(search, "steps").figure_
    for name in search.best_estimator_.effects_.names:
        drawn = show.EffectDisplay.from_estimator(search, name, found.X, found.y)
        figures[f"{name}.png"] = drawn.figure_
    if search.shape_ is not None:
        figures["shape.png"] = show.EffectDisplay.from_shape(search).figure_
    known = list(skhoid.effects.catalogue().index)
    steps = [f"ranking-{step}" for step in range(1, len(known) + 2)]
    others = [f"{name}.png" for name in ("comparison", "shape", *known, *steps)]
    named = (found.X, found.y)
    return save_figures(figures, folder, command, others=others, named=named, form=form)
