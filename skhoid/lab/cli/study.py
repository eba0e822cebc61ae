"""The command ``skhoid study``: the paper's Monte-Carlo studies, and those of one's own plans."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import skhoid

from ...exceptions import did_you_mean
from .files import check_folders, read_files, save_figures, without_screen, write_tables
from .output import print_json, say_files
from .parser import (
    add_command,
    add_file_options,
    add_format,
    add_output_options,
    add_table_format,
    at_least_one,
    not_negative,
    positive,
    refuse,
    seed,
    workers,
)

EXAMPLES = """\
examples:
  skhoid study list
  skhoid study fig13 --replications 20 --jobs 2
  skhoid study fig13 --replications 100 --out studies    kept, and resumed
  skhoid study fig9 --conditions C1 --intensities 0 0.15 0.3
  skhoid study recommend --conditions C4 --intensities 0.15 --rate 50
  skhoid study recommend --conditions C4 --question detect --causal
  skhoid study tournament --size small
  skhoid study experiment              three simulated subjects, six conditions
  skhoid study experiment s1_*.csv --measurement-time 81.92
"""
TABLES = "csv"
QUESTIONS = (
    "follow",
    "final",
    "detect",
    "predict",
    "delay",
)  # of skhoid.lab.studies, not loaded here
SIZES = ("full", "small")
OF_EXPERIMENT = ("paths", "batch", "scores", "validation", "changes", "delays", "verdicts")
OTHERS = {
    "experiment": "subjects, conditions and runs: Figs. 16-17, App. M, Table VI",
    "recommend": "the memory horizon, or the method, for an experiment to come",
    "tournament": "methods that follow a changing operator, compared",
    "all": "every study of the paper",
}
PARTS = {  # options of a paper's study, as far as its function has them
    "conditions": "conditions",
    "intensities": "intensities",
    "orders": "orders",
    "validation": "n_validation",
    "gains": "gains",
}
OF_OUT = ["no_pictures", "format", "table_format"]
KEPT = ["jobs", "out", *OF_OUT]
OF_FILES = ["input", "output", "time", "run", "subject", "condition", "dt", "unit", "resample"]
OF_FILES += ["measurement_time"]
APPLY = {
    "list": [],
    "all": ["replications", *PARTS, "seed", *KEPT],
    "recommend": ["replications", "validation", "conditions", "intensities", "rate", "seed", *KEPT],
    "recommend with --question": [
        *("question", "causal", "methods", "replications", "validation", "conditions"),
        *("intensities", "orders", "rate", "seed", *KEPT),
    ],
    "tournament": [
        *("methods", "size", "replications", "validation", "conditions", "intensities", "orders"),
        *("seed", *KEPT),
    ],
    "experiment": ["subjects", "conditions", "runs", "last", "seed", *KEPT],
    "experiment with files": [*OF_FILES, "last", *KEPT],
}
WHOLE = ["appG", "fig12", "fig13", "appI", "appK"]  # whose cells include those of all others


def add_study(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(
        commands,
        "study",
        "Monte-Carlo studies: the paper's figures, an experiment, which method to use",
        "Simulate many runs, fit them all, and say how it compares with the thesis: "
        "'list' names the studies; 'all' makes every one of the paper; 'experiment' analyses "
        "subjects, conditions and runs (simulated, or your files of one subject and condition); "
        "'recommend' finds the memory horizon for an experiment to come, or with --question the "
        "method; 'tournament' lets all methods that follow a changing operator compete.",
        EXAMPLES,
        "NAME [FILES] [OPTIONS]",
    )
    command.set_defaults(work=study)
    add = command.section("Data")
    add(
        "name",
        metavar="NAME",
        help="fig9, fig10, fig12 ... (see list), all, experiment, recommend, tournament",
    )
    add_file_options(add)
    add("--input", metavar="NAME", help="input column of files (default: guessed)")
    add("--measurement-time", type=positive, metavar="S", help="keep the end of runs of files")
    add = command.section("Study")
    add("--replications", type=at_least_one, metavar="M", help="runs of each cell (default: 100)")
    add("--validation", type=at_least_one, metavar="V", help="validation runs (default: 10)")
    add("--conditions", nargs="+", metavar="C", help="such as C1 C4")
    add("--intensities", nargs="+", type=not_negative, metavar="P", help="P_n, such as 0 0.15")
    add("--orders", nargs="+", metavar="M", help="of the remnant filter: 1 2 3 4 nm")
    add("--rate", type=positive, metavar="HZ", help="of recommend (default: 100)")
    add("--question", choices=QUESTIONS, help="of recommend: which method answers it best")
    add("--causal", action="store_true", help="with --question: only methods without later data")
    add("--methods", nargs="+", metavar="NAME", help="of tournament and --question (default: all)")
    add("--size", choices=SIZES, help="of tournament: its cells and runs (default: full)")
    add("--gains", choices=["table", "tuned"], help="K_n: Table G.1, or found (default: table)")
    add("--subjects", type=at_least_one, metavar="N", help="of experiment (default: 3)")
    add("--runs", type=at_least_one, metavar="N", help="of experiment (default: 7)")
    add("--last", type=at_least_one, metavar="N", help="runs used (default: 5)")
    add("--seed", type=seed, metavar="N", help="of the simulation (default: 0)")
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    add = command.section("Output")
    add("--out", metavar="FOLDER", help="keep blocks, tables and plots in FOLDER/NAME")
    add("--no-pictures", action="store_true", help="draw nothing")
    add_format(add)
    add_table_format(add, TABLES)
    add_output_options(add, tables=False)


def study(options: argparse.Namespace) -> int:
    """Run one study, or all of the paper."""
    from ..studies import PAPER_STUDIES

    _check(options)
    if options.name == "list":
        studies = {name: one.what for name, one in PAPER_STUDIES.items()} | OTHERS
        if options.json:
            print_json({"studies": studies})
        else:
            print("\n".join(f"{name:<11} {what}" for name, what in studies.items()))
        return 0
    if options.name == "experiment":
        return _experiment(options)
    if options.name == "tournament":
        return _tournament(options)
    if options.name == "recommend":
        return _recommend(options) if options.question is None else _recommend_method(options)
    names = WHOLE if options.name == "all" else [options.name]
    found = [_paper(name, options) for name in names]
    if options.json:
        print_json(found[0] if len(found) == 1 else {"studies": found})
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse a study that cannot run, before the work begins."""
    from ...io import check_table_format

    name, known = options.name, names_of_studies()
    if name not in known:
        raise ValueError(
            f"No study {name!r}; there are {', '.join(known)}.{did_you_mean(name, known)}"
        )
    if options.files and name != "experiment":
        raise ValueError(f"Only 'experiment' takes files; {name!r} does not.")
    what, applying = _applying(options)
    others = {option for some in APPLY.values() for option in some if option not in applying}
    refuse(options, sorted(others), f"does not apply to {what}.")
    if options.out is None:
        refuse(options, OF_OUT, "needs --out FOLDER: else nothing is written.")
        return
    check_folders(options.out, Path(options.out) / name)
    check_table_format(options.table_format or TABLES)


def names_of_studies() -> tuple[str, ...]:
    """What there is to choose from."""
    from ..studies import PAPER_STUDIES

    return ("list", *OTHERS, *PAPER_STUDIES)


def _applying(options: argparse.Namespace) -> tuple[str, list[str]]:
    """A name for what is asked for, and the options that it takes."""
    name = options.name
    if name == "experiment":
        if options.files:
            return "'experiment' with files", APPLY["experiment with files"]
        return "'experiment' without files: name them first", APPLY["experiment"]
    if name == "recommend" and options.question is not None:
        return "'recommend' with --question", APPLY["recommend with --question"]
    if name in APPLY:
        return repr(name), APPLY[name]
    missing = {part for part, key in PARTS.items() if key not in _parameters(name)}
    return f"the study {name!r}", [option for option in APPLY["all"] if option not in missing]


def _parameters(name: str) -> set[str]:
    from ..studies import PAPER_STUDIES

    return set(PAPER_STUDIES[name].options)


def _paper(name: str, options: argparse.Namespace) -> dict[str, Any]:
    from ..studies import paper_study

    given = {key: getattr(options, part) for part, key in PARTS.items()}
    has = _parameters(name)
    given = {key: value for key, value in given.items() if value is not None and key in has}
    folder = None if options.out is None else Path(options.out) / name
    begin = time.perf_counter()
    result = paper_study(
        name,
        options.replications or 100,
        every_figure=options.name == "all",
        random_state=options.seed or 0,
        n_jobs=options.jobs,
        out=None if folder is None else folder / "blocks",
        progress=False if options.json else None,
        **given,
    )
    seconds = time.perf_counter() - begin
    files = [] if folder is None else _save(result, folder, options)
    if not options.json:
        print(f"{name}: {result.title}")
        for line in [*result.claims, *result.notes]:
            print(f"  {line}")
        print(f"  {result.table['error'].isna().sum()} rows in {seconds:.1f} s.")
        say_files({"files": files})
    return {
        "study": name,
        "title": result.title,
        "seconds": seconds,
        "claims": [vars(claim) for claim in result.claims],
        "failed": int(result.table["error"].notna().sum()),
        "files": files,
    }


def _save(result: Any, folder: Path, options: argparse.Namespace) -> list[str]:
    without_screen()
    files = result.save(folder, figures=False, table_format=options.table_format or TABLES)
    pictures = []
    if not options.no_pictures:
        figures = {f"{name}.png": draw().figure_ for name, draw in result.figures.items()}
        pictures = save_figures(figures, folder, "study", form=options.format or "png")
    return [*map(str, files), *pictures]


def _tournament(options: argparse.Namespace) -> int:
    from ..studies import tournament_cells

    size = options.size or "full"
    folder = None if options.out is None else Path(options.out) / "tournament"
    begin = time.perf_counter()
    result = skhoid.run_tournament(
        options.methods,
        tournament_cells(
            size,
            conditions=options.conditions,
            intensities=options.intensities,
            orders=options.orders,
        ),
        size=size,
        n_replications=options.replications,
        n_validation=options.validation or 3,
        random_state=options.seed or 0,
        out=None if folder is None else folder / "blocks",
        n_jobs=options.jobs,
        progress=False if options.json else None,
    )
    seconds = time.perf_counter() - begin
    files = []
    if folder is not None:
        files = [
            str(path)
            for path in result.save(
                folder, figures=False, table_format=options.table_format or TABLES
            )
        ]
        if not options.no_pictures:
            without_screen()
            figures = _pictures(result)
            files += save_figures(figures, folder, "study", form=options.format or "png")
    if options.json:
        print_json(
            {
                "ranking": _rankings(result),
                "notes": result.notes,
                "seconds": seconds,
                "files": files,
            }
        )
    else:
        print(result)
        print(f"{len(result.table)} rows in {seconds:.1f} s.")
        say_files({"files": files})
    return 0


def _pictures(result: Any) -> dict[str, Any]:
    """The figures of a tournament; nothing settles where nothing changes."""
    changing = (result.table["kind"] == "changing").any()
    kinds = ["winners", "bias", *(["settling"] if changing else [])]
    return {f"{kind}.png": result.plot(kind).figure_ for kind in kinds}


def _rankings(result: Any) -> dict[str, Any]:
    """Methods by the question to follow K_edot, the best first."""
    return {
        kind: result.ranking(causal=causal)["loss"].to_dict()
        for kind, causal in (("causal", True), ("offline", False))
        if (~result.methods["oracle"] & (result.methods["causal"] == causal)).any()
    }


def _one_task(options: argparse.Namespace) -> Any:
    conditions = options.conditions or ["C4"]
    if len(conditions) > 1:
        raise ValueError("recommend takes one condition; an average over tasks suits none of them.")
    return skhoid.CompensatoryTask.of_condition(conditions[0], sampling_rate=options.rate or 100.0)


def _recommend_method(options: argparse.Namespace) -> int:
    task = _one_task(options)
    orders = options.orders or [2]
    if len(orders) > 1:
        raise ValueError("recommend takes one order of the remnant filter.")
    advice = skhoid.recommend_method(
        task,
        options.intensities or [0.15],
        question=options.question,
        causal=True if options.causal else None,
        methods=options.methods,
        remnant_order=int(orders[0]) if str(orders[0]).isdigit() else orders[0],
        n_replications=options.replications or 10,
        n_validation=options.validation or 3,
        random_state=options.seed or 0,
        n_jobs=options.jobs,
        progress=False if options.json else None,
    )
    files = []
    if options.out is not None:
        folder = Path(options.out) / "recommend"
        files = write_tables({"ranking": advice.ranking}, folder, options.table_format or TABLES)
        if not options.no_pictures:
            without_screen()
            figures = {"bias.png": advice.plot().figure_}
            files += save_figures(figures, folder, "study", form=options.format or "png")
    if options.json:
        found = {name: getattr(advice, name) for name in ("question", "method", "close")}
        print_json(found | {"estimator": repr(advice.estimator), "files": files})
    else:
        print(advice)
        say_files({"files": files})
    return 0


def _recommend(options: argparse.Namespace) -> int:
    advice = skhoid.recommend_forgetting(
        _one_task(options),
        options.intensities or [0.15],
        n_replications=options.replications or 20,
        n_validation=options.validation or 10,
        random_state=options.seed or 0,
        n_jobs=options.jobs,
        progress=False if options.json else None,
    )
    files = []
    if options.out is not None:
        folder = Path(options.out) / "recommend"
        files = write_tables({"summary": advice.summary}, folder, options.table_format or TABLES)
        if not options.no_pictures:
            without_screen()
            figures = {"trade-off.png": advice.plot().figure_}
            files += save_figures(figures, folder, "study", form=options.format or "png")
    if options.json:
        found = {name: getattr(advice, name) for name in ("memory_horizon", "memory_time", "gain")}
        found |= {"forgetting": advice.forgetting, "close": advice.close, "files": files}
        print_json(found)
    else:
        print(advice)
        say_files({"files": files})
    return 0


def _experiment(options: argparse.Namespace) -> int:
    last = options.last or 5
    if options.files:
        named = {} if options.input is None else {options.input: "e"}
        found = read_files(options, named, signals=options.input is None)
        X, y = found.X, found.y
        channel = found.guess.inputs[0]
        result = skhoid.analyse_experiment(
            X,
            y,
            last=last,
            input=channel,
            measurement_time=options.measurement_time,
            n_jobs=options.jobs,
        )
    else:
        X, y = skhoid.simulate_experiment(
            options.subjects or 3,
            options.conditions or "C1-C6",
            options.runs or 7,
            random_state=options.seed or 0,
            n_jobs=options.jobs,
        )
        result = skhoid.analyse_experiment(X, y, last=last, n_jobs=options.jobs)
    files = []
    if options.out is not None:
        folder = Path(options.out) / "experiment"
        tables = {name: getattr(result, name) for name in OF_EXPERIMENT}
        files = write_tables(tables, folder, options.table_format or TABLES)
        if not options.no_pictures:
            files += _draw_experiment(result, folder, X, y, options.format or "png")
    if options.json:
        print_json({"summary": result.summary(), "files": files})
    else:
        print(result.summary())
        say_files({"files": files})
    return 0


def _draw_experiment(result: Any, folder: Path, X: Any, y: Any, ending: str) -> list[str]:
    without_screen()
    files = []
    for condition in result.conditions:
        for form in ("lambda", "Lambda"):
            for parameters in ("arx", "operator"):
                display = result.plot(condition=condition, form=form, parameters=parameters)
                name = f"{condition}-{form}-{parameters}.png"
                files += save_figures(
                    {name: display.figure_}, folder, "study", named=(X, y), form=ending
                )
    return files
