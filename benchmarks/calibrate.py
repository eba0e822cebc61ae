"""Find what evidence is worth: how often a name is right, by what its judges grant it.

    python -m benchmarks.calibrate collect --cases 300 --jobs 2
    python -m benchmarks.calibrate fit

``collect`` searches in development cases of both trials, as far as names go, and adds a line to
``calibration.jsonl`` for each: the evidence of every step, and which names are right. What the file
has is not run again. ``fit`` reads it, fits the map of ``skhoid.search.probability``, and writes
its table, with the figures of cases whose element or hidden form the fit never saw.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Iterable, Sequence
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import binomtest
from sklearn.base import clone
from threadpoolctl import threadpool_limits

from benchmarks.second.cases import DRAWN, build
from benchmarks.second.judge import controlled_element, stops_reached
from skhoid import ControlledElement, EffectSearchCV, OperatorRegressor
from skhoid.effects.catalogue import BY_NAME
from skhoid.model.model import Model
from skhoid.search.effect_search import search_effects
from skhoid.search.judging import CLAIM
from skhoid.search.probability import (
    COEFFICIENTS,
    N_APPLYING,
    TABLE,
    Alternative,
    alike,
    describe_features,
    find_chances,
    name_probability,
)
from skhoid.search.steps import Search, SearchStep

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "blind"))

from generator import EFFECTS, make_case  # noqa: E402
from run import git  # noqa: E402
from sets import NEAR, NONE, UNKNOWN, right_answers, right_without  # noqa: E402
from world import HopelessError  # noqa: E402

CASES = HERE / "calibration.jsonl"
BLIND_SEED, SECOND_SEED = 5000, 50_000  # of development, which no verdict uses
# Cases in a turn of 39: nine have nothing hidden, and a third of the others what no catalogue has,
# as a stranger's world did (`second:held_back` is for verdicts: no fit has it).
MIX = {"main": 8, "null": 4, "left_out": 2, "beyond": 3, "pairs": 1, "one_run": 1}
MIX |= {"second:hidden": 7, "second:null": 4, "second:leaks": 2, "second:strange": 7}
STRIDE = 7  # prime to the numbers of effects, so that effects change from case to case
NOTHING, ELSE = "nothing", "something else"
SAID = {NONE: NOTHING, UNKNOWN: ELSE}  # as the trials call them
KNOWN = {name: kind() for name, kind in BY_NAME.items()}
LEAST_GAP = 1.0  # points of VAF, below which the trials ask for no name
SD = 4.0  # wide: it keeps coefficients finite where a part of the cases is left out
BINS = (0.5, 0.75, 0.9, 0.97, 1.0)
FOLDS = 3


def plan(cases: int) -> list[tuple[str, int]]:
    """Suite and number of each case, mixed evenly, so that an early stop leaves a fair sample."""
    turns = -(-cases // sum(MIX.values()))
    numbered = [(suite, i, (i + 0.5) / n) for suite, n in MIX.items() for i in range(n * turns)]
    return [(suite, i) for suite, i, _ in sorted(numbered, key=lambda one: one[2])][:cases]


def collect_case(suite: str, number: int) -> dict[str, Any]:
    """The ranking of a search and the right names, as a line of JSON."""
    started = time.process_time()
    trial, _, kind = suite.rpartition(":")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            steps, truth = (search_second if trial else search_blind)(kind, number)
    except (HopelessError, RuntimeError) as reason:
        return {"suite": suite, "number": number, "error": f"not built: {reason}"}
    except Exception as reason:  # a search that breaks off is no reason to stop
        return {"suite": suite, "number": number, "error": f"{type(reason).__name__}: {reason}"}
    return {
        "suite": suite,
        "number": number,
        **truth,
        "steps": steps,
        "seconds": round(time.process_time() - started, 1),
    }


def steps_of(hidden: Sequence[Any], number: int) -> int:
    """How many effects may be added: in every other case one, which is what takes least time."""
    return len(hidden) + 1 if number % 2 else 1


def find_steps(search: EffectSearchCV, X: pd.DataFrame, y: pd.Series, most: int) -> list[Any]:
    """What each step of a search finds."""
    model = clone(search.estimator)
    with threadpool_limits(1):
        data = search.read_data(model, X, y)
        within = Search(data.prepared.core, data.record, search.list_effects(), data.folds)
        output = y.to_numpy(float)
        found = search_effects(within, model, data, output, most, search.tries_all)
    path = found.numbers.path
    after = [*(step.at_likelihood for step in path.steps[1:]), path.model]
    return [describe_step(*one) for one in zip(path.steps, after, strict=True)]


def describe_step(step: SearchStep, after: Model) -> list[dict[str, Any]]:
    """What the map needs of a step: what has evidence, a shape too, and which effect was added."""
    names = [
        {
            "effect": c.effect.name,
            "evidence": round(c.least, 2),
            "judge": c.judge,
            "added": c.name in after.effects.names,
        }
        for c in step.candidates
        if c.evidence and c.least > 0
    ]
    others = [
        {"effect": ELSE, "evidence": round(max(one.evidence, 0.0), 2), "left": round(one.left, 2)}
        for one in step.other
    ]
    return [*names, *others]


def said_of(wanted: Sequence[Iterable[str]]) -> list[list[str]]:
    """Right answers to each effect, as the map calls them."""
    return [sorted(SAID.get(name, name) for name in right) for right in wanted]


def search_blind(suite: str, number: int) -> tuple[list[Any], dict[str, Any]]:
    """A case of the first trial, searched in some of its runs."""
    case = make_case(suite, number * STRIDE, BLIND_SEED)
    first = case.X.index.get_level_values("run") <= 2 + number % 4
    names, gap = case.truth["effects"], case.gap
    if suite == "left_out":
        wanted = [{*right_without(names[0])}]
    elif suite == "beyond":
        wanted = [{*NEAR.get(names[0], ()), ELSE}]
    else:
        wanted = [{*right_answers(name, gap if len(names) == 1 else 2.0)} for name in names]
    element = case.controlled_element and ControlledElement(*case.controlled_element)
    tried: Any = "all"
    if case.left_out is not None:
        tried = [name for name in EFFECTS if name != case.left_out]
    search = EffectSearchCV(
        OperatorRegressor(delay=case.delay),
        effects=tried,
        display=case.display,
        controlled_element=element,
    )
    steps = find_steps(search, case.X[first], case.y[first], steps_of(names, number))
    form = "+".join(f"{name}/{case.truth['form'].get(name, '')}" for name in names)
    return steps, {
        "element": f"blind {case.truth['plant']}",
        "form": form or f"nothing, {case.truth['variant']}",
        "gap": round(gap, 2),
        "wanted": said_of(wanted),
        "also": [],
    }


def search_second(suite: str, number: int) -> tuple[list[Any], dict[str, Any]]:
    """A case of the second trial, searched."""
    case = build(suite, DRAWN, SECOND_SEED + number * STRIDE)
    X, y, _, _ = case.tables()
    search = EffectSearchCV(
        OperatorRegressor(),
        display=case.world.display,
        controlled_element=controlled_element(case.world.element),
    )
    hidden = case.hidden
    steps = find_steps(search, X, y, steps_of([] if hidden is None else hidden.each, number))
    stops = ["saturation"] if suite == "leaks" and stops_reached(case) else []
    return steps, {
        "element": case.world.element.name,
        "form": "nothing" if hidden is None else f"{hidden.effect}/{hidden.name}",
        "gap": round(case.gap, 2),
        "wanted": [] if hidden is None else said_of(hidden.each),
        "also": [*case.also, *stops],
    }


def collect(keys: list[tuple[str, int]], jobs: int, out: Path) -> None:
    """Run what is not in the file yet."""
    known = {(one["suite"], one["number"]) for one in read_cases([out])}
    left = [key for key in keys if key not in known]
    found = Parallel(jobs, return_as="generator_unordered")(
        delayed(collect_case)(*key) for key in left
    )
    for one in found:
        with out.open("a") as file:
            file.write(json.dumps(one, default=lambda v: v.item()) + "\n")


def read_cases(files: list[Path]) -> list[dict[str, Any]]:
    """Lines of files that exist."""
    texts = [file.read_text() for file in files if file.exists()]
    return [json.loads(line) for text in texts for line in text.splitlines()]


class Step(NamedTuple):
    """A step of a search whose truth is known."""

    case: dict[str, Any]
    number: int
    tried: list[Alternative]
    right: set[str]  # names, "nothing", "something else"

    @property
    def names(self) -> list[str]:
        return [ELSE if one.effect is None else one.effect.name for one in self.tried]

    @property
    def mask(self) -> np.ndarray:
        """Which rows of ``describe_features`` are right."""
        at, _ = describe_features(self.tried)
        names = [self.names[i] for i in at]
        if not self.right & {*names, NOTHING, ELSE}:  # it is there, and nobody sees it
            return np.array([*(False for _ in names), True, True])
        return np.array([name in self.right for name in (*names, NOTHING, ELSE)])


def read_steps(cases: list[dict[str, Any]]) -> list[Step]:
    """Steps up to the first whose parent has a name that is wrong: behind it nothing is certain."""
    found = []
    for case in cases:
        if "error" in case:
            continue
        left, also = [{*one} for one in case["wanted"]], {*case["also"]}
        for number, rows in enumerate(case["steps"]):
            added = next((row["effect"] for row in rows if row.get("added")), "")
            alone = not added and {row["effect"] for row in rows} <= {CLAIM, ELSE}
            if alone and number + 1 < len(case["steps"]):  # a given delay, which is judged first
                continue
            right = set().union(*left) | also if left else also | {NOTHING}
            if case["gap"] < LEAST_GAP or all(NOTHING in one for one in left):
                right.add(NOTHING)
            tried = [
                Alternative(KNOWN.get(row["effect"]), row["evidence"], row.get("left", 0.0))
                for row in rows
            ]
            found.append(Step(case, number, tried, right))
            served = next((one for one in left if added in one), None)
            if served is not None:
                left.remove(served)
                if ELSE in served:  # an equal of what was struck may leave something, or not
                    also |= {NOTHING, ELSE}
            elif added not in also:
                break
    return found


def fit_map(steps: list[Step]) -> np.ndarray:
    """Coefficients at the largest posterior: normal priors of standard deviation SD, and signs."""
    parts = [(describe_features(step.tried)[1], step.mask) for step in steps]

    def loss(theta: np.ndarray) -> tuple[float, np.ndarray]:
        total, slope = theta @ theta / (2 * SD**2), theta / SD**2
        for features, mask in parts:
            utility = features @ theta
            of_all, of_right = logsumexp(utility), logsumexp(utility[mask])
            total += of_all - of_right
            slope += np.exp(utility - of_all) @ features
            slope -= np.exp(utility[mask] - of_right) @ features[mask]
        return total, slope

    ends = {1: (0, None), 0: (None, None), -1: (None, 0)}
    bounds = [ends[sign] for sign in COEFFICIENTS.values()]
    return minimize(loss, np.zeros(len(COEFFICIENTS)), jac=True, bounds=bounds, method="L-BFGS-B").x


class Given(NamedTuple):
    """The name with the most evidence, its probability, and whether it or one like it is right."""

    step: Step
    name: str
    probability: float
    right: bool


def judge_names(steps: list[Step], theta: np.ndarray) -> tuple[list[Given], float]:
    """The first name of each step, and the sum of the log losses."""
    given: list[Given] = []
    loss = 0.0
    for step in steps:
        chances = find_chances(step.tried, dict(zip(COEFFICIENTS, theta, strict=True)))
        at, _ = describe_features(step.tried)
        if at:
            best = max(at, key=lambda i: step.tried[i].evidence)
            effect = step.tried[best].effect
            right = any(alike(effect, KNOWN[n]) for n in step.right & KNOWN.keys())
            chance = name_probability(step.tried, chances, best)
            given.append(Given(step, step.names[best], chance, right))
        shares = [*(chances.names[i] for i in at), chances.nothing, chances.something_else]
        loss -= np.log(np.array(shares)[step.mask].sum())
    return given, loss


def judge_left_out(steps: list[Step], what: str) -> tuple[list[Given], float]:
    """Names of steps whose element or form (``what``) the fit never saw, a third at a time."""
    groups = {group: i % FOLDS for i, group in enumerate(sorted({s.case[what] for s in steps}))}
    given: list[Given] = []
    loss = 0.0
    for fold in range(FOLDS):
        out = [step for step in steps if groups[step.case[what]] == fold]
        theta = fit_map([step for step in steps if groups[step.case[what]] != fold])
        of_fold, more = judge_names(out, theta)
        given, loss = given + of_fold, loss + more
    return given, loss


def reliability(given: list[Given]) -> pd.DataFrame:
    """Of names by their probability: how many, their mean probability, and the share right."""
    rows = []
    for low, high in pairwise(BINS):
        of_bin = [g for g in given if low <= g.probability < high + (high == 1)]
        row = {"from": low, "to": high, "names": len(of_bin)}
        if of_bin:
            right = sum(g.right for g in of_bin)
            ends = binomtest(right, len(of_bin)).proportion_ci()
            mean = float(np.mean([g.probability for g in of_bin]))
            row |= {"mean": mean, "right": right, "share": right / len(of_bin)}
            row |= {"low": ends.low, "high": ends.high}
        rows.append(row)
    return pd.DataFrame(rows)


def find_unseen(steps: list[Step]) -> dict[str, float]:
    """How often an effect has no evidence at all, where it is there and where it is not."""
    first = [step for step in steps if step.number == 0]
    shown = [{*step.names} - {ELSE} for step in first]
    apart = {NOTHING, ELSE, *(name for name, effect in KNOWN.items() if effect.noise)}
    there = [
        bool(s.right & names) for s, names in zip(first, shown, strict=True) if not s.right & apart
    ]
    others = sum(len(names - s.right) for s, names in zip(first, shown, strict=True))
    return {
        "there": round((there.count(False) + 0.5) / (len(there) + 1), 3),
        "not there": round(1 - others / (N_APPLYING * len(first)), 3),
    }


def write_table(steps: list[Step], folder: Path) -> str:
    """Fit, write table and figures, and say what they show."""
    theta = fit_map(steps)
    cases = {id(step.case): step.case for step in steps}.values()
    suites = pd.Series([case["suite"] for case in cases]).value_counts().sort_index()
    truth = [NOTHING if NOTHING in s.right else ELSE if ELSE in s.right else "name" for s in steps]
    figures, told, tables = {}, [], []
    for what in ("element", "form"):
        given, loss = judge_left_out(steps, what)
        brier = float(np.mean([(g.probability - g.right) ** 2 for g in given]))
        figures[what] = {"log_loss": round(loss / len(steps), 4), "brier": round(brier, 4)}
        tables.append(reliability(given))
        tables[-1].insert(0, "left out", what)
        told.append(
            f"{what} left out of the fit: log loss {loss / len(steps):.3f}, Brier score of names "
            f"{brier:.3f}\n{tables[-1].to_string(index=False)}"
        )
    table = {
        "coefficients": dict(zip(COEFFICIENTS, theta.round(4).tolist(), strict=True)),
        "unseen": find_unseen(steps),
        "shares": {one: round(truth.count(one) / len(truth), 3) for one in (NOTHING, ELSE, "name")},
        "provenance": {
            "command": "python -m benchmarks.calibrate fit",
            "commit": git("rev-parse", "--short=12", "HEAD"),
            "date": str(date.today()),
            "seeds": {"blind": BLIND_SEED, "second": SECOND_SEED},
            "cases": suites.to_dict(),
            "steps": len(steps),
            "left_out": figures,
        },
    }
    (folder / "skhoid" / "search" / TABLE).write_text(json.dumps(table, indent=2) + "\n")
    frame = pd.concat(tables)
    static = folder / "docs" / "_static"
    frame.to_csv(static / "reliability.csv", index=False, float_format="%.3f")
    draw_reliability(frame, static / "reliability.png")
    return "\n\n".join(told)


def draw_reliability(frame: pd.DataFrame, file: Path) -> None:
    """What was said against what came true, with intervals and counts."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(4.2, 4), layout="constrained")
    ax.plot([0.5, 1], [0.5, 1], color="0.7", lw=1, zorder=0)
    for (what, rows), shift in zip(frame.groupby("left out"), (-0.006, 0.006), strict=True):
        rows = rows[rows["names"] > 0]
        error = (rows["share"] - rows["low"], rows["high"] - rows["share"])
        x = rows["mean"] + shift
        ax.errorbar(x, rows["share"], error, fmt="o", ms=4, capsize=3, label=f"{what}s left out")
        for at, low, n in zip(x, rows["low"], rows["names"], strict=True):
            ax.annotate(f"{n}", (at, low), (0, -9), textcoords="offset points", ha="center", size=7)
    ax.set(xlabel="probability given", ylabel="share that is right", xlim=(0.48, 1.02))
    ax.set_ylim(0, 1.03)
    ax.legend(frameon=False, loc="lower left")
    figure.savefig(file, dpi=160, metadata={"Software": None})
    plt.close(figure)


def main(argv: list[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="benchmarks.calibrate", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    collecting = commands.add_parser("collect", help="run searches")
    collecting.add_argument("--cases", type=int, default=300, help="in all")
    collecting.add_argument("--first", type=int, default=0, help="which to begin with")
    collecting.add_argument("--jobs", type=int, default=1, help="cases at a time")
    collecting.add_argument("--out", type=Path, default=CASES, help="JSON lines to append to")
    fitting = commands.add_parser("fit", help="fit the map and write its table")
    fitting.add_argument("files", type=Path, nargs="*", default=[CASES])
    fitting.add_argument("--folder", type=Path, default=HERE.parent, help="of the repository")
    options = parser.parse_args(argv)
    if options.command == "collect":
        collect(plan(options.cases)[options.first :], options.jobs, options.out)
    else:
        steps = read_steps(read_cases(options.files))
        print(write_table(steps, options.folder))


if __name__ == "__main__":
    main()
