"""The command ``skhoid study``: the paper's Monte-Carlo studies, and those of one's own plans."""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path
from typing import Any

import skhoid

from ...exceptions import did_you_mean
from .files import check_folders, read_files, save_figures, without_screen, write_tables
from .output import print_document, print_json, say_files
from .parser import (
    PICTURES,
    add_command,
    add_file_options,
    add_output_options,
    add_table_format,
    at_least_one,
    not_negative,
    positive,
    refuse,
    seed,
    workers,
)

ABOUT = """\
Monte-Carlo studies: the paper's figures, an experiment, which method to use
Simulate many runs, fit them all, and say how it compares with the thesis: 'list' names the studies;
'all' makes every one of the paper; 'experiment' analyses subjects, conditions and runs (simulated,
or your files of one subject and condition); 'recommend' finds the memory horizon for an experiment
to come, or with --question the method; 'tournament' lets all methods that follow a changing
operator compete."""
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
QUESTIONS = ("follow", "final", "detect", "predict", "delay")  # of skhoid.lab.studies
OF_EXPERIMENT = ("paths", "batch", "scores", "validation", "changes", "delays", "verdicts")
OTHERS = {
    "experiment": "subjects, conditions and runs: Figs. 16-17, App. M, Table VI",
    "recommend": "the memory horizon, or the method, for an experiment to come",
    "tournament": "methods that follow a changing operator, compared",
    "all": "every study of the paper",
}
WHOLE = ["appG", "fig12", "fig13", "appI", "appK"]  # whose cells include those of all others
# Options that a study takes; of the paper's only those that its function has.
OF_OUT = ["no_pictures", "format", "table_format"]
KEPT = ["seed", "jobs", "out", *OF_OUT]
CELLS = ["replications", "validation", "conditions", "intensities"]
OF_FILES = ["input", "output", "time", "run", "subject", "condition", "dt", "unit", "resample"]
OF_FILES += ["measurement_time"]
TAKES = {
    "list": [],
    "all": [*CELLS, "gains", *KEPT],
    "recommend": [*CELLS, "rate", "question", "causal", "methods", *KEPT],
    "tournament": [*CELLS, "methods", "size", *KEPT],
    "experiment": ["conditions", *OF_FILES, *KEPT],
}


def add_study(commands: Any) -> None:
    """Add the command to the parser."""
    command = add_command(commands, study, ABOUT, "NAME [FILES] [OPTIONS]", EXAMPLES)
    add = command.section("Data")
    text = "fig9, fig10, fig12 ... (see list), all, experiment, recommend, tournament"
    add("name", metavar="NAME", help=text)
    add_file_options(add)
    add("--input", metavar="NAME", help="input column of files (default: guessed)")
    add("--measurement-time", type=positive, metavar="S", help="keep the end of runs of files")
    add = command.section("Study")
    add("--replications", type=at_least_one, metavar="M", help="runs of each cell (default: 100)")
    add("--validation", type=at_least_one, metavar="V", help="validation runs (default: 10)")
    add("--conditions", nargs="+", metavar="C", help="such as C1 C4")
    add("--intensities", nargs="+", type=not_negative, metavar="P", help="P_n, such as 0 0.15")
    add("--gains", choices=["table", "tuned"], help="K_n: Table G.1, or found (default: table)")
    add("--rate", type=positive, metavar="HZ", help="of recommend (default: 100)")
    add("--question", choices=QUESTIONS, help="of recommend: which method answers it best")
    add("--causal", action="store_true", help="with --question: only methods without later data")
    add("--methods", nargs="+", metavar="NAME", help="of tournament and --question (default: all)")
    text = "of tournament: its cells and runs (default: full)"
    add("--size", choices=["full", "small"], help=text)
    add("--seed", type=seed, metavar="N", help="of the simulation (default: 0)")
    add("--jobs", type=workers, metavar="N", help="workers (default: 1; -1: all processors)")
    add = command.section("Output")
    add("--out", metavar="FOLDER", help="keep blocks, tables and plots in FOLDER/NAME")
    add("--no-pictures", action="store_true", help="draw nothing")
    add("--format", choices=PICTURES, help="format of the pictures (default: png)")
    add_table_format(add, TABLES)
    add_output_options(add, tables=False)


def names_of_studies() -> tuple[str, ...]:
    """What there is to choose from."""
    from ..studies.thesis import PAPER_STUDIES

    return ("list", *OTHERS, *PAPER_STUDIES)


def study(options: argparse.Namespace) -> int:
    """Run one study, or all of the paper."""
    from ..studies.thesis import PAPER_STUDIES

    _check(options)
    name = options.name
    if name == "list":
        studies = {known: one.what for known, one in PAPER_STUDIES.items()} | OTHERS
        if options.json:
            print_json(options, {"studies": studies})
        else:
            print("\n".join(f"{known:<11} {what}" for known, what in studies.items()))
        return 0
    others = {"experiment": _experiment, "tournament": _tournament, "recommend": _recommend}
    names = WHOLE if name == "all" else [name]
    found = [others[name](options)] if name in others else [_paper(n, options) for n in names]
    if options.json:
        print_json(options, {"studies": found} if name == "all" else found[0])
    return 0


def _check(options: argparse.Namespace) -> None:
    """Refuse a study that cannot run, before the work begins."""
    from ...io import check_table_format
    from ..studies.thesis import PAPER_STUDIES

    name, known = options.name, names_of_studies()
    if name not in known:
        raise ValueError(
            f"No study {name!r}; there are {', '.join(known)}.{did_you_mean(name, known)}"
        )
    if options.files and name != "experiment":
        raise ValueError(f"Only 'experiment' takes files; {name!r} does not.")
    takes = TAKES.get(name, TAKES["all"])
    if name in PAPER_STUDIES and "n_validation" not in PAPER_STUDIES[name].options:
        takes = [option for option in takes if option != "validation"]
    if name == "experiment":
        unused = ["conditions", "seed"] if options.files else OF_FILES
        takes = [option for option in takes if option not in unused]
    others = {option for some in TAKES.values() for option in some} - set(takes)
    refuse(options, sorted(others), f"does not apply to the study {name!r} here.")
    if options.question is None:
        refuse(options, ["causal"], "needs --question.")
    if options.out is None:
        refuse(options, OF_OUT, "needs --out FOLDER: else nothing is written.")
        return
    check_folders(options.out, Path(options.out) / name)
    check_table_format(options.table_format or TABLES)


def _shared(options: argparse.Namespace) -> dict[str, Any]:
    """What every study takes."""
    return {
        "random_state": options.seed or 0,
        "n_jobs": options.jobs,
        "progress": False if options.json else None,
    }


def _paper(name: str, options: argparse.Namespace) -> dict[str, Any]:
    from ..studies.thesis import PAPER_STUDIES, paper_study

    has = PAPER_STUDIES[name].options
    given = {
        "conditions": options.conditions,
        "intensities": options.intensities,
        "n_validation": options.validation,
        "gains": options.gains,
    }
    folder = None if options.out is None else Path(options.out) / name
    begin = time.perf_counter()
    result = paper_study(
        name,
        options.replications or 100,
        every_figure=options.name == "all",
        out=None if folder is None else folder / "blocks",
        **_shared(options),
        **{key: value for key, value in given.items() if value is not None and key in has},
    )
    seconds = time.perf_counter() - begin
    files = _save(result, folder, options, result.figures)
    if not options.json:
        print(f"{name}: {result.title}")
        for line in result.claims:
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


def _save(
    result: Any, folder: Path | None, options: argparse.Namespace, pictures: dict[str, Any]
) -> list[str]:
    """Write a result and its pictures, which are functions by name."""
    if folder is None:
        return []
    form = options.table_format or TABLES
    files = list(map(str, result.save(folder, figures=False, table_format=form)))
    return files + _draw(pictures, folder, options)


def _draw(
    pictures: dict[str, Any], folder: Path, options: argparse.Namespace, named: Any = None
) -> list[str]:
    if options.no_pictures:
        return []
    without_screen()
    paths = []
    for name, draw in pictures.items():  # one at a time: there may be dozens
        figure = {name: draw().figure_}
        paths += save_figures(figure, folder, "study", options.format, named=named)
    return paths


def _tournament(options: argparse.Namespace) -> dict[str, Any]:
    from ..studies import tournament_cells

    size = options.size or "full"
    folder = None if options.out is None else Path(options.out) / "tournament"
    begin = time.perf_counter()
    result = skhoid.run_tournament(
        options.methods,
        tournament_cells(size, conditions=options.conditions, intensities=options.intensities),
        size=size,
        n_replications=options.replications,
        n_validation=options.validation or 3,
        out=None if folder is None else folder / "blocks",
        **_shared(options),
    )
    seconds = time.perf_counter() - begin
    # Nothing settles where nothing changes.
    kinds = ["winners", "bias"]
    kinds += ["settling"] if (result.table["kind"] == "changing").any() else []
    files = _save(result, folder, options, {kind: partial(result.plot, kind) for kind in kinds})
    if not options.json:
        print_document(result.document(), options)
        print(f"{len(result.table)} rows in {seconds:.1f} s.")
        say_files({"files": files})
    return {"ranking": _rank(result), "notes": result.notes, "seconds": seconds, "files": files}


def _rank(result: Any) -> dict[str, Any]:
    """Methods by the question to follow K_edot, the best first."""
    return {
        kind: result.ranking(causal=causal)["loss"].to_dict()
        for kind, causal in (("causal", True), ("offline", False))
        if (~result.methods["oracle"] & (result.methods["causal"] == causal)).any()
    }


def _recommend(options: argparse.Namespace) -> dict[str, Any]:
    """A memory horizon, or with a question a method."""
    conditions = options.conditions or ["C4"]
    if len(conditions) > 1:
        raise ValueError("recommend takes one condition; an average over tasks suits none of them.")
    task = skhoid.CompensatoryTask.of_condition(conditions[0], sampling_rate=options.rate or 100.0)
    intensities = options.intensities or [0.15]
    advice: Any
    if options.question is None:
        refuse(options, ["methods"], "needs --question.")
        advice = skhoid.recommend_forgetting(
            task,
            intensities,
            n_replications=options.replications or 20,
            n_validation=options.validation or 10,
            **_shared(options),
        )
        names = ("memory_horizon", "memory_time", "gain", "forgetting", "close")
        found = {name: getattr(advice, name) for name in names}
        table, picture = {"summary": advice.summary}, "trade-off"
    else:
        advice = skhoid.recommend_method(
            task,
            intensities,
            question=options.question,
            causal=True if options.causal else None,
            methods=options.methods,
            n_replications=options.replications or 10,
            n_validation=options.validation or 3,
            **_shared(options),
        )
        found = {name: getattr(advice, name) for name in ("question", "method", "close")}
        found["estimator"] = repr(advice.estimator)
        table, picture = {"ranking": advice.ranking}, "bias"
    files = []
    if options.out is not None:
        folder = Path(options.out) / "recommend"
        files = write_tables(table, folder, options.table_format or TABLES)
        files += _draw({picture: advice.plot}, folder, options)
    if not options.json:
        print_document(advice.document(), options)
        say_files({"files": files})
    return {**found, "files": files}


def _experiment(options: argparse.Namespace) -> dict[str, Any]:
    more: dict[str, Any] = {}
    if options.files:
        named = {} if options.input is None else {options.input: "e"}
        X, y, guess = read_files(options, named, signals=options.input is None)
        more = {"input": guess.inputs[0], "measurement_time": options.measurement_time}
    else:
        conditions = options.conditions or "C1-C6"
        X, y = skhoid.simulate_experiment(
            3, conditions, 7, random_state=options.seed or 0, n_jobs=options.jobs
        )
    result = skhoid.analyse_experiment(X, y, last=5, n_jobs=options.jobs, **more)
    files = []
    if options.out is not None:
        folder = Path(options.out) / "experiment"
        tables = {name: getattr(result, name) for name in OF_EXPERIMENT}
        tables["verdicts"] = result.verdicts.assign(gains=result.verdicts["gains"].map(", ".join))
        files = write_tables(tables, folder, options.table_format or TABLES)
        pictures = {
            f"{condition}-{form}-{parameters}": partial(
                result.plot, condition=condition, form=form, parameters=parameters
            )
            for condition in result.conditions
            for form in ("lambda", "Lambda")
            for parameters in ("arx", "operator")
        }
        files += _draw(pictures, folder, options, named=(X, y))
    if not options.json:
        print_document(result.document(), options)
        say_files({"files": files})
    return {"summary": result.summary(), "files": files}
