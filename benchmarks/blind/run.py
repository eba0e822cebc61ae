"""Run the blind trial of EffectSearchCV.

    pip install -e .
    python benchmarks/blind/run.py --suite main --cases 448 --seed 1 --jobs 2

One JSON line for each case goes to ``--out`` as soon as it is there; a run that was broken off goes
on where it was. The table is printed at the end, and appended to RESULTS.md with ``--log``.
"""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
import sys
import time
import warnings
from datetime import date
from importlib import import_module
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from generator import BEYOND, EFFECTS, SUITES, Case, effect_of, make_case
from joblib import Parallel, delayed, parallel_config
from rich.progress import Progress
from scorer import Answer, by_effect, confusion, grade, table
from shapes import Shape
from standins import STAND_INS
from world import HopelessError

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "RESULTS.md"


def answer(case: Case, n_jobs: int = 1) -> Answer:
    """Ask the search, through its public names."""
    import skhoid

    element = case.controlled_element and skhoid.ControlledElement(*case.controlled_element)
    effects: Any = "all"
    if case.left_out is not None:
        effects = [name for name in EFFECTS if name != case.left_out]
    start = time.perf_counter()
    model = skhoid.OperatorRegressor(delay=case.delay)
    search = skhoid.EffectSearchCV(
        model,
        effects=effects,
        display=case.display,
        controlled_element=element,
        n_jobs=n_jobs,
    )
    search.fit(case.X, case.y)
    prediction = np.asarray(search.predict(case.X_test))
    seconds = time.perf_counter() - start
    ranking = search.ranking_
    if "step" in ranking:
        ranking = ranking[ranking["step"] == ranking["step"].min()]
    parameters = search.best_estimator_.parameters_
    return Answer(
        names=list(search.best_effects_),
        ranking=[str(name) for name in ranking["effect"]],
        prediction=prediction,
        seconds=seconds,
        explainable_gap=float(search.explainable_gap_),
        parameters={
            str(name): (float(row["value"]), float(row["low"]), float(row["high"]))
            for name, row in parameters.iterrows()
        },
        baseline_vaf=float(search.error_path_["vaf"].iloc[0]),
        left={
            f"{row.where} {row.at}": float(row.points) for row in search.unexplained_.itertuples()
        },
        forms={name: getattr(e, "form", None) for name, e in search.best_estimator_.effects_},
        shape=shape_of(search, case),
    )


def shape_of(search: Any, case: Case) -> Shape | None:
    """What the search offers where no name fits; versions before free forms offer nothing."""
    found = getattr(search, "shape_", None)
    if found is None:
        return None
    near = found.nearest
    return Shape(
        id=str(found.id),
        place=str(found.place),
        over=str(found.over),
        curve=found.curve,
        prediction=np.asarray(found.estimator.predict(case.X_test)),
        sentence=str(found.sentence),
        channel=getattr(found, "channel", None),
        dof=float(found.dof),
        gain=float(found.gain),
        closed=float(found.closed),
        nearest=[str(name) for name in near.get("effect", near.index)],
        recordings=[str(words) for words in found.recordings],
    )


def ask(suite: str, number: int, seed: int, who: str, n_jobs: int = 1) -> dict[str, Any]:
    """Make a case, have it answered, and grade it; a failure of either is a record too."""
    try:
        case = make_case(suite, number, seed)
    except HopelessError as error:
        return {"suite": suite, "number": number, "seed": seed, "hopeless": str(error)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            said = answer(case, n_jobs) if who == "search" else _asked(who)(case)
            return grade(case, said)
        except Exception as error:
            said = Answer(["failed"], [], case.baseline_prediction, 0.0)
            return {**grade(case, said), "error": f"{type(error).__name__}: {error}"}


def _asked(who: str) -> Any:
    """A stand-in, or ``module:function``."""
    if ":" in who:
        module, function = who.split(":")
        return getattr(import_module(module), function)
    return STAND_INS[who]


def numbers_of(suite: str, effect: str | None, cases: int, first: int) -> list[int]:
    """Numbers of the cases to run; those of one effect only, where one is given."""
    if effect is None or suite in ("null", "pairs"):
        return list(range(first, first + cases))
    return list(islice((n for n in count(first) if effect_of(n, suite) == effect), cases))


def git(*command: str) -> str:
    return subprocess.run(
        ["git", "-C", str(HERE), *command], capture_output=True, text=True, check=True
    ).stdout.strip()


def verdict_seed() -> int:
    """The seed that the commit gives; an error where the tree is not what was committed."""
    top = Path(git("rev-parse", "--show-toplevel"))
    own = RESULTS.relative_to(top).as_posix()
    changed = [
        line for line in git("status", "--porcelain").splitlines() if line.split()[-1] != own
    ]
    if changed:
        raise SystemExit(
            "--verdict: the tree has changes that are not committed:\n" + "\n".join(changed)
        )
    return int(git("rev-parse", "HEAD")[:8], 16)


def _known(out: Path, suite: str, seed: int) -> dict[int, dict[str, Any]]:
    if not out.exists():
        return {}
    records = [json.loads(line) for line in out.read_text().splitlines()]
    return {r["number"]: r for r in records if r["suite"] == suite and r["seed"] == seed}


def _plain(value: Any) -> Any:
    """What JSON does not know, NumPy's scalars."""
    return value.item()


def report(records: list[dict[str, Any]]) -> str:
    """The table as Markdown, and the effects one by one."""
    lines = ["| figure | value |", "| --- | --- |"]
    lines += [f"| {name} | {value} |" for name, value in table(records)]
    effects = by_effect(records)
    if len(effects):
        lines += ["", "| effect | " + " | ".join(effects.columns) + " |"]
        lines += ["| " + " | ".join(["---"] * (1 + len(effects.columns))) + " |"]
        lines += [f"| {name} | " + " | ".join(row) + " |" for name, row in effects.iterrows()]
    failed = [r for r in records if "error" in r]
    if failed:
        lines += ["", f"{len(failed)} failed, the first with: {failed[0]['error'][:300]}"]
    return "\n".join(lines)


def _confused(matrix: pd.DataFrame) -> str:
    """The matrix without rows where all is right and columns that are empty then."""
    right = [row.get(name, 0) == row.sum() for name, row in matrix.iterrows()]
    matrix = matrix.loc[[not r for r in right]]
    return matrix.loc[:, matrix.any()].to_string() if len(matrix) else "none"


def main() -> int:
    parser = argparse.ArgumentParser(description="Blind trial of EffectSearchCV.")
    parser.add_argument("--suite", choices=SUITES, default="main")
    parser.add_argument("--cases", type=int, default=448)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effect", choices=(*EFFECTS, *BEYOND), help="only cases of this effect")
    parser.add_argument("--jobs", type=int, default=2, help="cases at a time")
    parser.add_argument("--n-jobs", type=int, default=1, help="processes of one search")
    parser.add_argument("--out", type=Path, help="JSON lines; what it has is not run again")
    parser.add_argument("--confusion", type=Path, help="write the confusion matrix as CSV")
    parser.add_argument("--verdict", action="store_true", help="take the seed from the commit")
    parser.add_argument("--log", action="store_true", help="append the table to RESULTS.md")
    who = f"search, {', '.join(STAND_INS)} or module:function"
    parser.add_argument("--who", default="search", help=who)
    options = parser.parse_args()
    if options.effect and (options.effect in BEYOND) is not (options.suite == "beyond"):
        parser.error(f"--suite {options.suite} has no effect {options.effect}.")
    seed = verdict_seed() if options.verdict else options.seed
    numbers = numbers_of(options.suite, options.effect, options.cases, options.first)
    known = _known(options.out, options.suite, seed) if options.out else {}
    left = [n for n in numbers if n not in known]
    tasks = (delayed(ask)(options.suite, n, seed, options.who, options.n_jobs) for n in left)
    start = time.perf_counter()
    config = parallel_config(backend="loky", inner_max_num_threads=1)
    with config, Progress(disable=not sys.stderr.isatty()) as progress:
        bar = progress.add_task(options.suite, total=len(left))
        for record in Parallel(options.jobs, return_as="generator_unordered")(tasks):
            known[record["number"]] = record
            progress.advance(bar)
            if options.out:
                with options.out.open("a") as file:
                    file.write(json.dumps(record, default=_plain) + "\n")
    records = [known[n] for n in numbers if "hopeless" not in known[n]]
    hopeless = [known[n]["hopeless"] for n in numbers if "hopeless" in known[n]]
    text = report(records) + "".join(f"\n\nNot made: {reason}" for reason in hopeless)
    print(text)
    print(f"\n{len(records)} cases, {time.perf_counter() - start:.0f} s, seed {seed}")
    if options.suite != "pairs":
        matrix = confusion(records)
        print("\nFirst names, of effects that were not always named:\n")
        print(_confused(matrix))
        if options.confusion:
            matrix.to_csv(options.confusion)
    if options.log:
        commit = git("rev-parse", "--short=12", "HEAD") + (
            " (changed)" if git("status", "--porcelain") else ""
        )
        kind = "verdict" if options.verdict else "tuning"
        head = (
            f"\n## {date.today()}, {kind}, {options.suite}, seed {seed}, {len(records)} cases\n\n"
        )
        command = f"`python benchmarks/blind/run.py {shlex.join(sys.argv[1:])}` at {commit}\n\n"
        with RESULTS.open("a") as file:
            file.write(head + command + text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
