"""Parameters of effects in the people who are taken to have them."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
from sklearn.base import clone

from ....effects.base import Effect
from ....effects.composition import Effects
from ....pipelines import taken_apart
from ....search.effect_search import EffectSearchCV
from ..people.groups import Group
from ..people.result import COLUMNS
from .evidence import named_by


def member_parameters(
    search: EffectSearchCV,
    groups: list[Group],
    searches: dict[tuple[Any, Any], EffectSearchCV],
    members: pd.DataFrame,
) -> pd.DataFrame:
    """A tidy table of the parameters of each person's effects, core parameters included.

    Who is taken to have other effects than the search named is fitted again with these.
    """
    rows = []
    for group in groups:
        key = group.subject, group.condition
        here = (members["subject"] == key[0]) & (members["condition"] == key[1]) & members["has"]
        wanted = list(members.loc[here, "effect"])
        done, failure = searches[key].best_estimator_, ""
        # Of the best model, those included that only stand in for something without a name.
        own = Effects.of(getattr(search.estimator, "effects", None)).names
        found = [e.name for name, e in done.effects_ if name not in own]
        if sorted(wanted) != sorted(found):
            done, failure = _fitted(search, searches[key], wanted, group)
        fixed = {"run": "all", "n_rows": len(group.y), "ceiling": np.nan, "outlying": ""}
        who = {"subject": key[0], "condition": key[1], **fixed, "failure": failure}
        if done is None:
            rows.append({**who, "parameter": "", "estimate": np.nan, "se": np.nan, "unit": ""})
            continue
        vaf = float(done.score(group.X, group.y))
        for name, row in taken_apart(done)[1].parameters_.iterrows():
            numbers = {"estimate": float(row["value"]), "se": float(row["sd"]), "vaf": vaf}
            unit = "" if row["unit"] in (None, "-") else str(row["unit"])
            rows.append({**who, "parameter": str(name), **numbers, "unit": unit})
    return pd.DataFrame(rows, columns=COLUMNS)


def _fitted(
    search: EffectSearchCV, own: EffectSearchCV, wanted: list[str], group: Group
) -> tuple[Any, str]:
    """The model with other effects than a search named: its choices where it has made them."""
    chosen = {effect.name: effect for _, effect in named_by(own)}
    plain: dict[str, Effect] = {effect.name: effect for effect in own._candidates()}
    effects = [chosen.get(name, plain.get(name)) for name in wanted]
    model = clone(search.estimator)
    given = Effects.of(getattr(model, "effects", None))
    more = Effects.of([effect for effect in effects if effect is not None])
    model.set_params(effects=given + more)
    if search.controlled_element is not None:
        model.set_params(controlled_element=search.controlled_element)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return model.fit(group.X, group.y), ""
        except Exception as error:
            return None, f"{type(error).__name__}: {error}"
