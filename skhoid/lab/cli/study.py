"""The command ``skhoid study``: the paper's Monte-Carlo studies, and those of one's own plans."""

from __future__ import annotations

import argparse
import time
from inspect import signature
from pathlib import Path
from typing import Any

from ...exceptions import did_you_mean
from ...io.tables import check_table_format
from ...simulation import CompensatoryTask
from ..experiment import analyse_experiment, recommend_forgetting, simulate_experiment
from ..studies.thesis import PAPER_STUDIES, paper_study
from ..studies.tournament import recommend_method, run_tournament, tournament_cells
from .arguments.study import TABLES
from .files import check_folders, read_files, save_figures, without_screen
from .options import refuse
from .output import print_json, say_files
from .tables import write_tables

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


def study(options: argparse.Namespace) -> int:
    """Run one study, or all of the paper."""
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
    name, known = options.name, ["list", *OTHERS, *PAPER_STUDIES]
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
    return set(signature(PAPER_STUDIES[name].function).parameters)


def _paper(name: str, options: argparse.Namespace) -> dict[str, Any]:
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
    size = options.size or "full"
    folder = None if options.out is None else Path(options.out) / "tournament"
    begin = time.perf_counter()
    result = run_tournament(
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


def _one_task(options: argparse.Namespace) -> CompensatoryTask:
    conditions = options.conditions or ["C4"]
    if len(conditions) > 1:
        raise ValueError("recommend takes one condition; an average over tasks suits none of them.")
    return CompensatoryTask.of_condition(conditions[0], sampling_rate=options.rate or 100.0)


def _recommend_method(options: argparse.Namespace) -> int:
    task = _one_task(options)
    orders = options.orders or [2]
    if len(orders) > 1:
        raise ValueError("recommend takes one order of the remnant filter.")
    advice = recommend_method(
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
    advice = recommend_forgetting(
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
        result = analyse_experiment(
            X,
            y,
            last=last,
            input=channel,
            measurement_time=options.measurement_time,
            n_jobs=options.jobs,
        )
    else:
        X, y = simulate_experiment(
            options.subjects or 3,
            options.conditions or "C1-C6",
            options.runs or 7,
            random_state=options.seed or 0,
            n_jobs=options.jobs,
        )
        result = analyse_experiment(X, y, last=last, n_jobs=options.jobs)
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
