"""The command ``skhoid study``: Monte-Carlo studies."""

from __future__ import annotations

import argparse
import time
from inspect import signature
from pathlib import Path
from typing import Any

from ._cli_files import add_file_options, as_json, at_least_one, read_files, without_screen

STUDY_EXAMPLES = """\
examples:
  skhoid study list
  skhoid study fig13 --replications 20 --jobs 2
  skhoid study fig13 --replications 100 --jobs 2 --out studies
                                           kept as it goes; the same command goes on where it was
  skhoid study fig9 --conditions C1 --intensities 0 0.15 0.3
  skhoid study recommend --conditions C4 --intensities 0.15 --rate 50
  skhoid study experiment                  three simulated subjects, six conditions, seven runs
  skhoid study experiment s1_*.csv --input e --output u --time t --measurement-time 81.92
"""
WHOLE = ["appG", "fig12", "fig13", "appI", "appK"]  # these have the cells of all others


def add_study_command(commands: Any) -> None:
    """Add the command to the parser."""
    command = commands.add_parser(
        "study",
        help="Monte-Carlo studies: the paper's figures, an experiment, a memory horizon",
        description="Simulate many runs, fit them all, and say how it compares with the thesis: "
        "'list' names the studies; 'all' makes every one of the paper; 'experiment' analyses "
        "subjects, conditions and runs (simulated, or your files of one subject and condition); "
        "'recommend' finds the memory horizon for an experiment to come.",
        epilog=STUDY_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(action=study)
    add = command.add_argument
    add(
        "name", metavar="NAME", help="fig9, fig10, fig12 ... (see list), all, experiment, recommend"
    )
    add_file_options(add)
    add("--replications", type=at_least_one, metavar="M", help="runs of each cell (default: 100)")
    add("--validation", type=at_least_one, metavar="V", help="validation runs (default: 10)")
    add("--conditions", nargs="+", metavar="C", help="such as C1 C4")
    add("--intensities", nargs="+", type=float, metavar="P", help="P_n, such as 0 0.15")
    add("--orders", nargs="+", metavar="M", help="of the remnant filter: 1 2 3 4 nm")
    add("--rate", type=float, default=100.0, metavar="HZ", help="of recommend (default: 100)")
    add("--gains", choices=["table", "tuned"], help="K_n: Table G.1, or found (default: table)")
    add("--subjects", type=at_least_one, default=3, metavar="N", help="of experiment (default: 3)")
    add("--runs", type=at_least_one, default=7, metavar="N", help="of experiment (default: 7)")
    add("--last", type=at_least_one, default=5, metavar="N", help="runs used (default: 5)")
    add("--input", default="e", metavar="NAME", help="input channel of files (default: e)")
    add("--measurement-time", type=float, metavar="S", help="keep the end of each run of files")
    add("--seed", type=int, default=0, metavar="N", help="default: 0")
    add("--jobs", type=int, metavar="N", help="workers (default: 1; -1: all processors)")
    add("--out", metavar="FOLDER", help="keep blocks, tables and pictures in FOLDER/NAME")
    add("--no-pictures", action="store_true", help="draw nothing")
    add("--json", action="store_true", help="print the results as JSON")
    add("--debug", action="store_true", help="show tracebacks")


def study(options: argparse.Namespace) -> int:
    """Run one study, or all of the paper."""
    from .montecarlo import PAPER_STUDIES

    if options.files and options.name != "experiment":
        raise ValueError(f"Only 'experiment' takes files; {options.name!r} simulates its runs.")
    if options.name == "list":
        for name, one in PAPER_STUDIES.items():
            print(f"{name:<11} {one.what}")
        print("experiment  subjects, conditions and runs: Figs. 16-17, App. M, Table VI")
        print("recommend   the memory horizon for an experiment to come")
        print("all         every study of the paper")
        return 0
    if options.name == "experiment":
        return _experiment(options)
    if options.name == "recommend":
        return _recommend(options)
    names = WHOLE if options.name == "all" else [options.name]
    found = [_paper(name, options) for name in names]
    if options.json:
        print(as_json(found[0] if len(found) == 1 else {"studies": found}))
    return 0


def _paper(name: str, options: argparse.Namespace) -> dict[str, Any]:
    from .montecarlo import PAPER_STUDIES, paper_study

    given = {
        "conditions": options.conditions,
        "intensities": options.intensities,
        "orders": options.orders,
        "n_validation": options.validation,
        "gains": options.gains,
    }
    given = {key: value for key, value in given.items() if value is not None}
    if name in PAPER_STUDIES:
        has = signature(PAPER_STUDIES[name].function).parameters
        stray = [key for key in given if key not in has]
        if stray and options.name != "all":
            option = "validation" if stray[0] == "n_validation" else stray[0]
            raise ValueError(f"--{option} does not apply to the study {name!r}.")
        given = {key: value for key, value in given.items() if key in has}
    folder = None if options.out is None else Path(options.out) / name
    begin = time.perf_counter()
    result = paper_study(
        name,
        options.replications or 100,
        every_figure=options.name == "all",
        random_state=options.seed,
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
        _say_files(files)
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
    return [str(path) for path in result.save(folder, figures=not options.no_pictures)]


def _recommend(options: argparse.Namespace) -> int:
    from .montecarlo import recommend_forgetting
    from .simulation import CompensatoryTask

    conditions = options.conditions or ["C4"]
    if len(conditions) > 1:
        raise ValueError("recommend takes one condition; an average over tasks suits none of them.")
    task = CompensatoryTask.of_condition(conditions[0], sampling_rate=options.rate)
    advice = recommend_forgetting(
        task,
        options.intensities or [0.15],
        n_replications=options.replications or 20,
        n_validation=options.validation or 10,
        random_state=options.seed,
        n_jobs=options.jobs,
        progress=False if options.json else None,
    )
    files = []
    if options.out is not None:
        folder = Path(options.out) / "recommend"
        folder.mkdir(parents=True, exist_ok=True)
        advice.summary.to_csv(folder / "summary.csv")
        files = [str(folder / "summary.csv")]
        if not options.no_pictures:
            without_screen()
            advice.plot().figure_.savefig(folder / "trade-off.png", dpi=120)
            files.append(str(folder / "trade-off.png"))
    if options.json:
        found = {name: getattr(advice, name) for name in ("memory_horizon", "memory_time", "gain")}
        found |= {"forgetting": advice.forgetting, "close": advice.close, "files": files}
        print(as_json(found))
    else:
        print(advice)
        _say_files(files)
    return 0


def _experiment(options: argparse.Namespace) -> int:
    from .montecarlo import analyse_experiment, simulate_experiment

    if options.files:
        X, y = read_files(options, [options.input])
        result = analyse_experiment(
            X,
            y,
            last=options.last,
            input=options.input,
            measurement_time=options.measurement_time,
            n_jobs=options.jobs,
        )
    else:
        X, y = simulate_experiment(
            options.subjects,
            options.conditions or "C1-C6",
            options.runs,
            random_state=options.seed,
            n_jobs=options.jobs,
        )
        result = analyse_experiment(X, y, last=options.last, n_jobs=options.jobs)
    files = []
    if options.out is not None:
        folder = Path(options.out) / "experiment"
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("paths", "batch", "scores", "validation", "changes", "delays", "verdicts"):
            files.append(str(folder / f"{name}.csv"))
            getattr(result, name).to_csv(files[-1], index=name == "scores")
        if not options.no_pictures:
            files += _draw_experiment(result, folder)
    if options.json:
        print(as_json({"summary": result.summary(), "files": files}))
    else:
        print(result.summary())
        _say_files(files)
    return 0


def _draw_experiment(result: Any, folder: Path) -> list[str]:
    without_screen()
    import matplotlib.pyplot as plt

    files = []
    for condition in result.conditions:
        for form in ("lambda", "Lambda"):
            for parameters in ("arx", "operator"):
                figure = result.plot(condition=condition, form=form, parameters=parameters).figure_
                files.append(str(folder / f"{condition}-{form}-{parameters}.png"))
                figure.savefig(files[-1], dpi=120)
                plt.close(figure)
    return files


def _say_files(files: list[str]) -> None:
    if files:
        print(f"  {len(files)} files in {Path(files[0]).parent}")
