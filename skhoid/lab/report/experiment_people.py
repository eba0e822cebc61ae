"""Each person on the page of an experiment: parameters, effects, error path, pictures."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ...effects.registry import title_of, titles_of
from ...pipelines import prediction_from
from ...text import DASH, number
from ..experiment.people.groups import Group
from ..experiment.read import ALL
from .experiment_parameters import interval_of, named
from .experiment_plots import ExperimentGallery, Stretch
from .plots import Plot

if TYPE_CHECKING:
    from .experiment_content import Experiment

STRETCH = 12.0  # s of a run in a picture
LEAST_PROBABLE = 0.05  # below which an effect is not listed


def people_section(
    given: Experiment,
    groups: dict[tuple[Any, Any], Group],
    anchors: dict[Any, str],
    gallery: ExperimentGallery,
) -> dict[str, Any]:
    """The picture of all, and a part for each person."""
    return {
        "picture": gallery.people(given.people),
        "list": [_person(given, who, anchors[who], groups, gallery) for who in given.subjects],
    }


def _person(
    given: Experiment,
    who: Any,
    anchor: str,
    groups: dict[tuple[Any, Any], Group],
    gallery: ExperimentGallery,
) -> dict[str, Any]:
    conditions = [
        c
        for c in given.conditions
        if (given.people.runs["subject"].eq(who) & given.people.runs["condition"].eq(c)).any()
    ]
    return {
        "name": "Everybody" if who == ALL else str(who),
        "anchor": anchor,
        "sentences": list(_sentences(given, who)),
        "fits": list(_fits(given, who, conditions)),
        "searched": given.group is not None,
        "conditions": ["estimate" if c == ALL else str(c) for c in conditions],
        "parameters": list(_parameters(given, who, conditions)),
        "effects": list(_effects(given, who)),
        "path": list(_path(given, who, conditions)),
        "pictures": list(_pictures(given, who, conditions, groups, gallery)),
    }


def _of(table: pd.DataFrame, who: Any) -> pd.DataFrame:
    return table[table["subject"] == who]


def _where(condition: Any) -> str:
    return "" if condition == ALL else f"{condition}: "


def _sentences(given: Experiment, who: Any) -> Iterator[str]:
    """The verdict of each condition, and what looks wrong."""
    if given.group is not None:
        for row in _of(given.group.people_, who).to_dict("records"):
            text = row["failure"] and f"no search: {row['failure']}"
            if not text:
                names = [name for name in str(row["effects"]).split(", ") if name]
                text = f"has {titles_of(names)}" if names else str(row["verdict"])
            yield f"{_where(row['condition'])}{text.rstrip('.')}."
    for row in _of(given.outlying, who).to_dict("records"):
        run = "" if row["run"] == ALL else f"run {row['run']}: "
        yield f"Looks wrong: {_where(row['condition'])}{run}{str(row['reason']).rstrip('.')}."


def _fits(given: Experiment, who: Any, conditions: list[Any]) -> Iterator[dict[str, str]]:
    """VAF and ceiling of each condition."""
    people = _of(given.people.groups, who).drop_duplicates("condition").set_index("condition")
    runs = _of(given.people.runs, who)
    for condition in conditions:
        row = people.loc[condition]
        vaf = runs.loc[runs["condition"] == condition, "vaf_group"].dropna()
        found = {
            "condition": "all runs" if condition == ALL else str(condition),
            "runs": str(int((runs["condition"] == condition).sum())),
            "vaf": _percent(row["vaf"]),
            "of_runs": f"{vaf.min():.1f} to {vaf.max():.1f}" if len(vaf) else DASH,
            "ceiling": _percent(row["ceiling"]),
            "held": DASH,
            "held_with": DASH,
        }
        if given.group is not None:
            own = _of(given.group.people_, who)
            own = own[own["condition"] == condition]
            if len(own):
                found["held"] = _percent(own["vaf"].iloc[0])
                found["held_with"] = _percent(own["vaf_with"].iloc[0])
        yield found


def _percent(value: Any) -> str:
    return f"{float(value):.1f}" if np.isfinite(float(value)) else DASH


def _parameters(given: Experiment, who: Any, conditions: list[Any]) -> Iterator[dict[str, Any]]:
    """Each parameter in each condition, of all runs in one fit."""
    tables = [given.people.groups]
    if given.group is not None:
        tables = [given.group.parameters_] if not given.own_people else tables
    table = _of(pd.concat(tables, ignore_index=True), who)
    table = table[table["parameter"] != ""]
    for name, rows in table.groupby("parameter", sort=False):
        known = rows.drop_duplicates("condition").set_index("condition")
        cells = [
            _estimate(known.loc[condition]) if condition in known.index else DASH
            for condition in conditions
        ]
        yield {"name": named(str(name)), "unit": str(rows["unit"].iloc[0]), "cells": cells}


def _estimate(row: pd.Series) -> str:
    estimate, se = float(row["estimate"]), float(row["se"])
    if not np.isfinite(estimate):
        return DASH
    text = number(estimate, se)
    return f"{text} ± {number(se, se)}" if np.isfinite(se) and se > 0 else text


def _effects(given: Experiment, who: Any) -> Iterator[dict[str, str]]:
    """Effects that the person may have: probability, and parameters with intervals."""
    if given.group is None:
        yield from _found(given, who)
        return
    found = _of(given.group.parameters_, who)
    for row in _of(given.group.members_, who).to_dict("records"):
        if not row["probability"] >= LEAST_PROBABLE:
            continue
        own = found[found["condition"] == row["condition"]]
        own = own[own["parameter"].str.startswith(f"{row['effect']}__")]
        yield {
            "condition": "" if row["condition"] == ALL else str(row["condition"]),
            "effect": title_of(row["effect"]),
            "probability": sure_text(row["probability"]),
            "named": "yes" if row["named"] else "no",
            "parameters": _listed(own) if row["has"] else DASH,
        }


def sure_text(probability: float) -> str:
    """A probability in percent, never quite 0 or 100."""
    percent = 100.0 * float(probability)
    if percent > 99.0:
        return "> 99 %"
    return "< 1 %" if percent < 1.0 else f"{percent:.0f} %"


def _found(given: Experiment, who: Any) -> Iterator[dict[str, str]]:
    """Effects of a search that was made person by person."""
    for (condition, effect), rows in _of(given.people.found, who).groupby(
        ["condition", "effect"], sort=False
    ):
        if effect:
            yield {
                "condition": "" if condition == ALL else str(condition),
                "effect": title_of(str(effect)),
                "probability": DASH,
                "named": "yes",
                "parameters": _listed(rows),
            }


def _listed(rows: pd.DataFrame) -> str:
    texts = []
    for row in rows.to_dict("records"):
        if not row["parameter"]:
            continue
        name = str(row["parameter"]).partition("__")[2] or row["parameter"]
        text = f"{name} {number(row['estimate'], row['se'])} {row['unit']}".rstrip()
        between = interval_of(row["estimate"], row["se"])
        texts.append(text if between == DASH else f"{text} ({between})")
    return ", ".join(texts) or DASH


def _path(given: Experiment, who: Any, conditions: list[Any]) -> Iterator[dict[str, str]]:
    """The error on held-out rows at each step of the person's own search."""
    if given.group is None:
        return
    for condition in conditions:
        search = given.group.searches_.get((who, condition))
        if search is None:
            continue
        unit = search.predictions_.attrs.get("units", {}).get("measured", "")
        for row in search.error_path_.to_dict("records"):
            yield {
                "condition": "" if condition == ALL else str(condition),
                "model": str(row["model"]),
                "vaf": _percent(row["vaf"]),
                "loop": _percent(row["vaf_loop"]),
                "rmse": f"{number(row['rmse'])} {unit}".rstrip(),
            }


def _pictures(
    given: Experiment,
    who: Any,
    conditions: list[Any],
    groups: dict[tuple[Any, Any], Group],
    gallery: ExperimentGallery,
) -> Iterator[Plot]:
    """A stretch of measured and simulated output in each condition."""
    for condition in conditions:
        stretch = _of_search(given, who, condition)
        if stretch is None and (who, condition) in groups:
            stretch = _of_model(given, (who, condition), groups[who, condition])
        if stretch is not None:
            yield gallery.stretch(stretch, "" if who == ALL else str(who), condition)


def _of_search(given: Experiment, who: Any, condition: Any) -> Stretch | None:
    """Held-out simulation with the effects found."""
    search = None if given.group is None else given.group.searches_.get((who, condition))
    table = getattr(search, "predictions_", None)
    if not isinstance(table, pd.DataFrame) or "measured" not in table or table.shape[1] < 2:
        return None
    unit = table.attrs.get("units", {}).get("measured", "")
    last = table.columns[-1]
    how = "held out" + ("" if last == "baseline" else f", with {_effects_of(search)}")
    return _cut(table.index, table["measured"], table[last], unit, how)


def _effects_of(search: Any) -> str:
    return titles_of([str(name) for name in search.error_path_["effect"].iloc[1:]])


def _of_model(given: Experiment, key: tuple[Any, Any], group: Group) -> Stretch | None:
    """Simulation by the model of the person, on the rows of the fit."""
    model = (given.people.models or {}).get(key)
    if model is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            simulated, _ = prediction_from(model, group.X, group.y)
        except (TypeError, ValueError):
            return None
    unit = group.y.attrs.get("units", {}).get(group.y.name, "")
    return _cut(group.y.index, group.y, simulated, unit, "on the rows of the fit")


def _cut(index: Any, measured: Any, simulated: Any, unit: Any, how: str) -> Stretch | None:
    """The middle of the middle run."""
    frame = pd.DataFrame({"m": np.asarray(measured), "s": np.asarray(simulated)})
    time = (
        np.asarray(index.get_level_values("time"), dtype=float)
        if "time" in (index.names or [])
        else np.arange(len(frame), dtype=float)
    )
    starts = np.flatnonzero(np.r_[True, np.diff(time) < 0])
    ends = np.r_[starts[1:], len(time)]
    middle = len(starts) // 2
    rows = slice(starts[middle], ends[middle])
    time, frame = time[rows], frame.iloc[rows]
    half = (time[0] + time[-1]) / 2
    near = np.abs(time - half) <= STRETCH / 2
    if not np.isfinite(frame["s"].to_numpy(dtype=float)[near]).any():
        return None
    label = index.get_level_values("run")[rows.start] if "run" in (index.names or []) else 1
    return Stretch(
        time[near],
        frame["m"].to_numpy(float)[near],
        frame["s"].to_numpy(float)[near],
        str(unit or ""),
        str(label),
        how,
    )
