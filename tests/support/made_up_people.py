"""Results of an experiment with people, made up: quick, and with known numbers."""

from types import SimpleNamespace

import numpy as np
import pandas as pd

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.lab.experiment.group import GroupEffectSearch, condition_contrasts
from skhoid.lab.experiment.people import COLUMNS, PeopleResult
from skhoid.search import Verdict

UNITS = {"K_e": "", "tau_e": "s"}


def made_up_people(names=("S1", "S2", "S3"), conditions=("C1", "C2"), runs=3, failing=None):
    """VAF 80 % and a little; tau_e is 0.05 s longer in the second condition."""
    rng = np.random.default_rng(0)
    fits, groups, judged = [], [], []
    for who in names:
        own = rng.normal(0.0, 0.02)
        for place, condition in enumerate(conditions):
            no_fit = (who, condition) == failing
            failure = "ValueError: no <rows>" if no_fit else ""
            vaf = np.nan if no_fit else 80.0 + place
            of_all = {"K_e": 1.0 + own, "tau_e": 0.25 + own + 0.05 * place}
            tail = (vaf, 84.0, 1000, "", failure)
            for run in range(1, runs + 1):
                judged.append((who, condition, run, 1000, vaf + run, vaf, 0.1))
                for name, value in of_all.items():
                    known = value + rng.normal(0.0, 0.005)
                    row = ("", np.nan, np.nan, "") if no_fit else (name, known, 0.005, UNITS[name])
                    fits.append((who, condition, run, *row, *tail))
            for name, value in of_all.items():
                row = ("", np.nan, np.nan, "") if no_fit else (name, value, 0.003, UNITS[name])
                groups.append((who, condition, "all", *row, *tail))
    fits, groups = (pd.DataFrame(rows, columns=COLUMNS) for rows in (fits, groups))
    columns = ["subject", "condition", "run", "n_rows", "vaf", "vaf_group", "spread"]
    outlying = [(names[-1], conditions[0], 1, "run", "VAF 3 %, other runs 80 %")]
    return PeopleResult(
        table=fits,
        groups=groups,
        runs=pd.DataFrame(judged, columns=columns),
        models={},
        outlying=pd.DataFrame(outlying, columns=["subject", "condition", "run", "kind", "reason"]),
        found=pd.DataFrame(
            columns=[
                *("subject", "condition", "effect", "parameter"),
                *("estimate", "se", "unit", "verdict"),
            ]
        ),
        notes=["S1 C1 all runs: RunTimeWarning: runs differ"],
        estimator="OperatorRegressor()",
    )


def made_up_group(people, *, effects=("saturation", "dead_zone")):
    """The first effect is the group's, all but the last person have it; the second is nobody's."""
    group = GroupEffectSearch(EffectSearchCV(OperatorRegressor(), effects=list(effects)))
    names = list(dict.fromkeys(people.runs["subject"]))
    conditions = list(dict.fromkeys(people.runs["condition"]))
    members, prevalence, parameters, rows = [], [], [], []
    for effect in effects:
        first = effect == effects[0]
        for condition in conditions:
            has = [first and who != names[-1] for who in names]
            for who, one in zip(names, has, strict=True):
                p = 0.97 if one else 0.03
                members.append((who, condition, effect, p, one and who == names[0], one))
            with_it = [who for who, one in zip(names, has, strict=True) if one]
            rest = [who for who in names if who not in with_it]
            share = len(with_it) / len(names)
            counts = (len(names), len(with_it), share, 0.6 * share, 0.5 + 0.5 * share)
            tail = (0.97 if first else 0.1, first, with_it, rest)
            prevalence.append((effect, effect, condition, *counts, *tail))
        prevalence.append((effect, effect, "all", *counts, *tail))
    for number, who in enumerate(names):
        for place, condition in enumerate(conditions):
            has = who != names[-1]
            limit = 0.5 + 0.01 * number + 0.002 * (-1) ** number * place
            row = (f"{effects[0]}__limit", limit, 0.02, "deg", 85.0, np.nan, 3000, "", "")
            parameters += [(who, condition, "all", *row)] * has
            verdict = Verdict.FOUND if has else Verdict.NOTHING
            named = (effects[0],) if has else ()
            rows.append((who, condition, named, verdict, 80.0, 85.0, 84.0, ""))
    key = ["subject", "condition"]
    group.members_ = pd.DataFrame(members, columns=[*key, "effect", "probability", "named", "has"])
    group.prevalence_ = pd.DataFrame(
        prevalence,
        columns=[
            *("effect", "title", "condition", "n_people", "n_with", "share", "low", "high"),
            *("p_group", "group", "with_it", "without"),
        ],
    )
    group.parameters_ = pd.DataFrame(parameters, columns=COLUMNS)
    group.people_ = pd.DataFrame(
        rows, columns=[*key, "effects", "verdict", "vaf", "vaf_with", "ceiling", "failure"]
    )
    group.contrasts_ = condition_contrasts(group.members_)
    group.group_effects_ = [effects[0]]
    group.searches_ = {(who, condition): a_search() for who in names for condition in conditions}
    group.identified_ = people
    return group


def a_search():
    """What the page takes from the search of one person."""
    time = np.arange(400) / 20
    index = pd.MultiIndex.from_product([[1, 2], time], names=["run", "time"])
    wave = np.tile(np.sin(time), 2)
    predictions = pd.DataFrame({"measured": wave, "baseline": 0.8 * wave}, index=index)
    predictions.attrs["units"] = {"measured": "deg"}
    steps = {"effect": ["baseline"], "model": ["baseline"], "vaf": [80.0]}
    path = pd.DataFrame({**steps, "vaf_loop": [np.nan], "rmse": [0.1]})
    return SimpleNamespace(predictions_=predictions, error_path_=path)
