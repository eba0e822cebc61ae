"""What the effect search says of people who pursue a target that they see coming.

    pip install -e .
    python benchmarks/real_pursuit.py [--data ../shared/data] [person-element ...]

Four people (S02, S04, S06, S09) steer 1/s ("f") or 1/(s(s+1)) ("s") with a slider: the target is
shown 0.25 s ahead, a disturbance is not shown. Sets are S02-f, S04-f, S04-s ...; by default all.
The recordings may not be copied, nor figures of single trials: only medians are printed. Of the
trials with a target the first half (at most 6) is fitted, the second half judged, from 5 s on.
Exits with 1 if a claim below is not met:

names       a response to the target, feedforward or preview, is named in every set
gain        median VAF of the fresh trials is not lower than that of the model without effects
delay       the delay of the person is above the least that is allowed
leaks       the leak test of the model found is silent on the fresh trials
"""

from __future__ import annotations

import sys
import time
import warnings
from typing import Any

import numpy as np
import pandas as pd
from recorded import Table, exit_code, options_of

from skhoid import EffectSearchCV, OperatorRegressor, compare

FOLDER = "human_pursuit_1dof"
ELEMENTS = {"f": "1/s", "s": "1/(s(s+1))"}  # by the first letter of "plant"
SETS = ("S02-f", "S04-f", "S04-s", "S06-f", "S06-s", "S09-f", "S09-s")
RATE = 60  # Hz
BEGIN = 5.0  # s, where the ramp of the forcing functions ends
FITTED = 6  # trials, at most
LEAST_DELAY = 0.1  # s, the default of OperatorRegressor
ANSWERS_TARGET = {"feedforward", "preview"}


def tables(samples: pd.DataFrame, trials: list[int]) -> Table:
    """Error, cursor and target as inputs, the slider as output; a run for each trial."""
    parts = []
    for trial in trials:
        of_trial = samples[(samples["trial"] == trial) & (samples["time"] >= BEGIN - 1e-9)]
        clock = np.round(np.arange(len(of_trial)) / RATE, 9)
        index = pd.MultiIndex.from_product([[f"trial {trial:03d}"], clock], names=["run", "time"])
        target, cursor = of_trial["ref"].to_numpy(), of_trial["pos"].to_numpy()
        columns = {"e": target - cursor, "x": cursor, "f_t": target}
        parts.append(pd.DataFrame({**columns, "u": of_trial["inp"].to_numpy()}, index=index))
    both = pd.concat(parts)
    return both[["e", "x", "f_t"]], both["u"]


def median_vaf(model: Any, X: pd.DataFrame, y: pd.Series) -> float:
    """Median over trials of the VAF of free runs, about the mean of each trial."""
    vafs = []
    for run in X.index.unique("run"):
        measured = y.loc[[run]].to_numpy()
        error = measured - model.predict(X.loc[[run]])
        vafs.append(100 * (1 - np.sum(error**2) / np.sum((measured - measured.mean()) ** 2)))
    return float(np.median(vafs))


def judged(samples: pd.DataFrame, trials: pd.DataFrame, name: str) -> dict[str, Any]:
    """Search on the first half of a set, and medians on the second."""
    person, element = name.split("-")
    of_set = (trials["subject"] == person) & trials["plant"].str.startswith(element)
    chosen = trials[of_set & (trials["ref_kind"] != "zer")]["trial"].tolist()
    middle = len(chosen) // 2
    X, y = tables(samples, chosen[:middle][:FITTED])
    fresh, measured = tables(samples, chosen[middle:])
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search = EffectSearchCV(
            OperatorRegressor(), display="preview", controlled_element=ELEMENTS[element]
        ).fit(X, y)
        leak = compare(search.best_estimator_, fresh, measured).leak
    left = search.unexplained_.head(2)
    return {
        "set": name,
        "named": search.best_effects_,
        "stand_ins": search.stand_ins_,
        "tau_e": float(search.best_estimator_.parameters_["value"]["tau_e"]),
        "before": median_vaf(search.baseline_, fresh, measured),
        "after": median_vaf(search.best_estimator_, fresh, measured),
        "leaks": None if leak is None else leak.leaks,
        "left": [f"{row['where']}: {row['points']:.0f}" for _, row in left.iterrows()],
        "s": time.perf_counter() - began,
    }


def said(one: dict[str, Any]) -> str:
    return (
        f"{one['set']}: {', '.join(one['named']) or 'nothing'}"
        + (f" (part of it: {', '.join(one['stand_ins'])})" if one["stand_ins"] else "")
        + f"; tau_e {one['tau_e']:.2f} s; median VAF of fresh trials {one['before']:.0f} -> "
        f"{one['after']:.0f} %; leaks: {one['leaks']}; left, points: "
        f"{', '.join(one['left']) or 'nothing'} ({one['s']:.0f} s)"
    )


def claims_of(one: dict[str, Any]) -> list[tuple[str, bool]]:
    name = one["set"]
    return [
        (f"{name}: names {one['named']}", bool(ANSWERS_TARGET & set(one["named"]))),
        (f"{name}: {one['before']:.1f} -> {one['after']:.1f} %", one["after"] >= one["before"]),
        (f"{name}: tau_e {one['tau_e']:.3f} s", one["tau_e"] > LEAST_DELAY + 1e-3),
        (f"{name}: leaks {one['leaks']}", not one["leaks"]),
    ]


def main() -> int:
    options = options_of(__doc__, SETS, "person-element")
    folder = options.data / FOLDER
    if not folder.is_dir():
        print(f"skipped, {folder} is missing")
        return 0
    samples = pd.read_parquet(folder / "trials.parquet")
    trials = pd.read_csv(folder / "trials_meta.csv")
    claims = []
    for name in options.names:
        one = judged(samples, trials, name)
        print(said(one), flush=True)
        claims += claims_of(one)
    return exit_code(claims)


if __name__ == "__main__":
    sys.exit(main())
