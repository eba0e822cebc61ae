"""Which effects a group shares: experiments put together from people of the blind trial.

    python benchmarks/group_effects.py --people 16 --nulls 90 --jobs 2 --folder pool

People are cases of the blind trial (benchmarks/blind, a simulator of its own): so many of each of
some effects, and so many without any. Each is searched once. Experiments of 12 are drawn from
them: 10 with an effect and 2 without, 1 with one and 11 without, and 12 without. What a search
costs is kept in the folder; a run that was broken off goes on where it was.
"""

from __future__ import annotations

import argparse
import pickle
import sys
import time
import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

sys.path.insert(0, str(Path(__file__).resolve().parent / "blind"))

from generator import make_case
from run import numbers_of
from sets import right_answers
from world import HopelessError

from skhoid import ControlledElement, EffectSearchCV, OperatorRegressor
from skhoid.effects.catalogue import BY_NAME
from skhoid.effects.composition import Effects
from skhoid.lab.experiment.group import SURE, list_candidates
from skhoid.lab.experiment.prevalence import PersonEvidence, prevalences
from skhoid.search.evidence import evidence_of

EFFECTS = (
    "dead_zone,saturation,integral,backlash,feedforward,output_feedback,motion_feedback,tv_gain"
)
ALL = {name: kind() for name, kind in BY_NAME.items()}
N, LEAST = 12, 0.25  # people of an experiment, prevalence of an effect of the group


def _search(case: Any, effects: Any = "all") -> EffectSearchCV:
    element = case.controlled_element and ControlledElement(*case.controlled_element)
    model = OperatorRegressor(delay=case.delay)
    return EffectSearchCV(model, effects, display=case.display, controlled_element=element)


def searched(
    suite: str, effect: str | None, number: int, seed: int, folder: Path, tried: Any
) -> None:
    """Search one person, and keep what was found."""
    path = folder / f"{suite}_{effect}_{number}_{seed}.pkl"
    if path.exists():
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            case = make_case(suite, number, seed)
        except HopelessError:
            return
        search = _search(case, tried).fit(case.X, case.y)
    best = search.best_estimator_
    found = {
        "case": (suite, number, seed),
        "effect": effect,
        "gap": case.gap,
        "best": search.best_effects_,
        "ranking": search.ranking_,
        "found": best.effects_,
        "effects": best.effects,
    }
    path.write_bytes(pickle.dumps(found))


def weighed(person: dict[str, Any], names: list[str], folder: Path) -> pd.DataFrame:
    """The evidence for effects in one person; each is weighed once."""
    suite, number, seed = person["case"]
    path = folder / f"evidence_{suite}_{number}_{seed}.pkl"
    known = pickle.loads(path.read_bytes()) if path.exists() else {}
    own = [name for name in person["best"] if name != "unknown"]
    wanted = [name for name in names if name not in known]
    if wanted:
        chosen = dict(Effects.of(person["effects"]).steps)
        named = [(n, chosen.get(n, e)) for n, e in person["found"] if e.name in own]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            case = make_case(suite, number, seed)
            effects = [ALL[name] for name in wanted]
            table = evidence_of(_search(case), Effects(named), effects, case.X, case.y)
        itself = table["instead_of"] == table["effect"]
        for name in wanted:
            known[name] = table[(table["effect"] == name) & ~itself]
        known["own"] = table[itself]
        path.write_bytes(pickle.dumps(known))
    return pd.concat([*(known[name] for name in names), known["own"]], ignore_index=True)


def experiment(people: list[dict[str, Any]], folder: Path, jobs: int) -> dict[str, Any]:
    """What the group is said to have."""
    searches: list[Any] = [
        SimpleNamespace(
            best_effects_=one["best"],
            ranking_=one["ranking"],
            list_effects=lambda: [*ALL.values()],
        )
        for one in people
    ]
    names = [effect.name for effect in list_candidates(searches)]
    if not names:
        return {"named": [], "found": {}}
    tables = Parallel(jobs)(delayed(weighed)(one, names, folder) for one in people)
    known = [
        PersonEvidence(tuple(n for n in one["best"] if n != "unknown"), table, ALL)
        for one, table in zip(people, tables, strict=True)
    ]
    found = {one.effect: one for one in prevalences(known, names) if one.n_people}
    named = [n for n, one in found.items() if one.more_than(LEAST) >= SURE and one.n_with > 1]
    return {"named": named, "found": found}


def judged(kind: str, effect: str, people: list[dict[str, Any]], said: dict[str, Any]) -> dict:
    """Whether that is right: strictly, and with the answers that count as equal in the trial."""
    named, found = said["named"], said["found"]
    if kind == "none":
        return {"right": not named, "equal": not named, "interval": np.nan}
    has = np.array([one["effect"] is not None for one in people])
    equal = right_answers(effect, 5.0)
    if kind == "most":
        one = found.get(effect)
        inside = one is not None and one.low <= has.mean() <= one.high
        others = set(named) - {effect}
        right = effect in named and not others
        return {
            "right": right,
            "equal": bool(set(named) & equal) and set(named) <= equal,
            "interval": inside,
            "false": bool(set(named) - equal),
        }
    who = int(np.flatnonzero(has)[0])

    def owns(name: str) -> bool:
        return name in found and found[name].has[who] > 0.5

    return {
        "right": owns(effect) and not named,
        "equal": any(owns(name) for name in equal) and not named,
        "interval": np.nan,
        "false": bool(named),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--effects", default=EFFECTS)
    parser.add_argument("--tried", default="all", help="ids of effects")
    parser.add_argument("--people", type=int, default=16, help="with each effect")
    parser.add_argument("--nulls", type=int, default=90, help="people without any")
    parser.add_argument("--experiments", type=int, default=200, help="of each kind")
    parser.add_argument("--seed", type=int, default=240024)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--folder", type=Path, default=Path("group-effects"))
    options = parser.parse_args()
    folder, effects = options.folder, options.effects.split(",")
    tried = options.tried if options.tried == "all" else options.tried.split(",")
    folder.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    cases = [
        ("main", effect, number, options.seed)
        for effect in effects
        for number in numbers_of("main", effect, options.people, 0)
    ]
    cases += [("null", None, number, options.seed) for number in range(options.nulls)]
    Parallel(options.jobs)(delayed(searched)(*case, folder, tried) for case in cases)
    kept = [folder / f"{s}_{e}_{n}_{seed}.pkl" for s, e, n, seed in cases]
    pool = [pickle.loads(path.read_bytes()) for path in kept if path.exists()]
    nulls = [one for one in pool if one["effect"] is None]
    print(f"{len(pool)} people, {time.perf_counter() - start:.0f} s")
    rng = np.random.default_rng(options.seed)
    rows = []
    for kind, n_with in (("most", 10), ("one", 1), ("none", 0)):
        for _ in range(options.experiments):
            effect = str(rng.choice(effects))
            having = [one for one in pool if one["effect"] == effect]
            people = [having[i] for i in rng.choice(len(having), n_with, replace=False)]
            people += [nulls[i] for i in rng.choice(len(nulls), N - n_with, replace=False)]
            said = experiment(people, folder, options.jobs)
            rows.append({"kind": kind, "effect": effect, "named": ", ".join(said["named"])})
            rows[-1].update(judged(kind, effect, people, said))
    table = pd.DataFrame(rows)
    figures = ["right", "equal", "interval", "false"]
    print((100 * table.groupby("kind", sort=False)[figures].mean()).round(1).to_string())
    print((100 * table.groupby(["kind", "effect"])[figures].mean()).round(0).to_string())
    wrong = table[(table["kind"] != "none") & (table["equal"] != True)]  # noqa: E712
    print(wrong[["kind", "effect", "named"]].value_counts().to_string())
    print(f"{time.perf_counter() - start:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
