"""The parts of the page of an experiment: parameters of everybody, and each person."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ...effects import title_of, titles_of
from ...pipelines import by_likelihood, prediction_from
from ...text import DASH, TextTable, number
from ..experiment.factors import Factors, find_factors
from ..experiment.groups import ALL, Group
from ..experiment.mixed import MixedModelResult, mixed_model
from .plots import ExperimentGallery, Plot, Stretch

if TYPE_CHECKING:
    from .experiment import Experiment

MOST = 16  # parameters on a page
FEWEST = 3  # people, for a mean over people
Z = 1.96


def parameters_section(
    given: Experiment, reference: Any, factors: Factors | None, gallery: ExperimentGallery
) -> tuple[dict[str, Any], dict[str, MixedModelResult]]:
    """What the page says of each parameter, and the mixed models."""
    parts, statistics = [], {}
    tables = _tables(given)
    for name, table in list(tables.items())[:MOST]:
        part: dict[str, Any] = {"name": named(name), "unit": str(table["unit"].iloc[0])}
        known = table.dropna(subset=["estimate"])["subject"].nunique()
        try:
            if known < FEWEST:
                raise ValueError(f"known of {people_text(known)} only.")
            # The reference counts for parameters that are known there.
            against = reference if reference in set(table["condition"]) else None
            result = mixed_model(table, name, reference=against, factors=factors)
        except ValueError as error:
            part |= {"why": str(error), "means": _plain_means(table)}
        else:
            statistics[name] = result
            part |= {
                "told": result.document().html(),
                "pictures": gallery.parameter(result, named(name)),
                "influence": _influential(result),
            }
        parts.append(part)
    known = list(find_factors(given.conditions) if factors is None else factors)
    section: dict[str, Any] = {
        "by": _by(given),
        "factors": " and ".join(known),
        "parts": parts,
        "left": list(map(named, list(tables)[MOST:])),
    }
    return section, statistics


def _influential(result: MixedModelResult) -> list[str]:
    """Without whom a conclusion would be another."""
    if "changes" not in result.influence:
        return []
    changed = result.influence[result.influence["changes"].astype(bool)]
    return list(dict.fromkeys(map(str, changed["without"])))


def named(parameter: str) -> str:
    """Name of a parameter; that of an effect with the effect's title."""
    effect, _, own = parameter.partition("__")
    return f"{title_of(effect)}: {own}" if own else parameter


def _tables(given: Experiment) -> dict[str, pd.DataFrame]:
    """A tidy table for each parameter; those of effects are from the search in the group."""
    tables = [given.people.table]
    if given.group is not None:
        found = given.group.parameters_
        if given.own_people:
            known = set(given.people.table["parameter"])
            found = found[~found["parameter"].isin(known)]
            tables.append(found[found["parameter"].str.contains("__")])
        else:
            tables = [found]
    rows = pd.concat([t for t in tables if len(t)], ignore_index=True)
    places = {name: place for place, name in enumerate(given.conditions)}
    rows = rows[rows["parameter"] != ""].sort_values(
        "condition", key=lambda names: names.map(places), kind="stable"
    )
    order = dict.fromkeys(name for t in tables for name in t["parameter"] if name)
    parts = dict(iter(rows.groupby("parameter", sort=False)))
    return {str(name): parts[name] for name in order}


def people_text(n: int) -> str:
    return "1 person" if n == 1 else f"{n} people"


def _by(given: Experiment) -> str:
    """Which fits the parameters are of."""
    if given.group is None or given.own_people:
        each = "each run" if given.people.each_run else "all runs of a person in a condition"
        text = f"Fits of {each}, by {given.people.estimator}."
        if given.group is not None:
            text += " Parameters of an effect are of those in whom it is shown."
            if _lacks_effects(given):
                text += (
                    " This model lacks effects that were found, whose parameters are of the "
                    "search: where somebody has one, it bends the parameters here."
                )
        return text
    return (
        "Fits of all runs of a person in a condition, with the effects that the person has there: "
        "where people have different effects, their other parameters are those of different models."
    )


def _lacks_effects(given: Experiment) -> bool:
    """Whether somebody has an effect that the model of the parameters has not."""
    if given.group is None:
        return False
    members = given.group.members_
    known = set(given.people.groups["parameter"].str.partition("__")[0])
    return not set(members.loc[members["has"], "effect"]) <= known


def _plain_means(table: pd.DataFrame) -> TextTable:
    """Mean and spread of people in each condition, each person once, with its runs' mean."""
    rows = []
    for condition, own in table.groupby("condition", sort=False):
        people = own.groupby("subject", sort=False)["estimate"].mean().dropna()
        spread = float(people.std()) if len(people) > 1 else np.nan
        rows.append(
            [
                "all" if condition == ALL else str(condition),
                str(len(people)),
                number(float(people.mean()), spread) if len(people) else DASH,
                number(spread) if np.isfinite(spread) else DASH,
            ]
        )
    header = ["condition", "people", "mean", "spread between people"]
    return TextTable("Means over people, each counted once", header, rows, left=["condition"])


def _tell_interval(estimate: float, se: float) -> str:
    """95 % interval of a fit by its standard error."""
    low, high = estimate - Z * se, estimate + Z * se
    return f"{number(low, se)} to {number(high, se)}" if np.isfinite(low) else DASH


STRETCH = 12.0  # s of a run in a picture
LEFT = ["effect", "condition", "named by these runs alone", "its parameters (95 % interval)"]
OF_EFFECTS = [*LEFT[:2], "probability", *LEFT[2:]]
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
        "tables": [
            _fits(given, who, conditions),
            TextTable("Effects", OF_EFFECTS, list(_effects(given, who)), left=LEFT),
            _parameters(given, who, conditions),
            _path(given, who, conditions),
        ],
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
                names = list(row["effects"])
                text = f"has {titles_of(names)}" if names else str(row["verdict"])
            yield f"{_where(row['condition'])}{text.rstrip('.')}."
    for row in _of(given.outlying, who).to_dict("records"):
        run = "" if row["run"] == ALL else f"run {row['run']}: "
        yield f"Looks wrong: {_where(row['condition'])}{run}{str(row['reason']).rstrip('.')}."


def _fits(given: Experiment, who: Any, conditions: list[Any]) -> TextTable:
    """VAF and ceiling of each condition."""
    people = _of(given.people.groups, who).drop_duplicates("condition").set_index("condition")
    runs = _of(given.people.runs, who)
    header = ["condition", "runs", "all runs", "by run", "noise ceiling, at least"]
    header += ["held out", "held out, with effects"] if given.group is not None else []
    rows = []
    for condition in conditions:
        row = people.loc[condition]
        vaf = runs.loc[runs["condition"] == condition, "vaf_group"].dropna()
        cells = [
            "all runs" if condition == ALL else str(condition),
            str(int((runs["condition"] == condition).sum())),
            _percent(row["vaf"]),
            f"{vaf.min():.1f} to {vaf.max():.1f}" if len(vaf) else DASH,
            _percent(row["ceiling"]),
        ]
        if given.group is not None:
            own = _of(given.group.people_, who)
            own = own[own["condition"] == condition]
            cells += [_percent(own[n].iloc[0]) if len(own) else DASH for n in ("vaf", "vaf_with")]
        rows.append(cells)
    return TextTable("VAF of the free run, %", header, rows, left=["condition"])


def _percent(value: Any) -> str:
    return f"{float(value):.1f}" if np.isfinite(float(value)) else DASH


def _parameters(given: Experiment, who: Any, conditions: list[Any]) -> TextTable:
    """Each parameter in each condition, of all runs in one fit."""
    tables = [given.people.groups]
    if given.group is not None:
        tables = [given.group.parameters_] if not given.own_people else tables
    table = _of(pd.concat(tables, ignore_index=True), who)
    table = table[table["parameter"] != ""]
    found = []
    for name, rows in table.groupby("parameter", sort=False):
        known = rows.drop_duplicates("condition").set_index("condition")
        cells = [
            _estimate(known.loc[condition]) if condition in known.index else DASH
            for condition in conditions
        ]
        found.append([named(str(name)), *cells, str(rows["unit"].iloc[0])])
    names = ["estimate" if c == ALL else str(c) for c in conditions]
    header = ["parameter", *names, "unit"]
    caption = "Parameters, ± one standard error"
    return TextTable(caption, header, found, left=["parameter", "unit"])


def _estimate(row: pd.Series) -> str:
    estimate, se = float(row["estimate"]), float(row["se"])
    if not np.isfinite(estimate):
        return DASH
    text = number(estimate, se)
    return f"{text} ± {number(se, se)}" if np.isfinite(se) and se > 0 else text


def _effects(given: Experiment, who: Any) -> Iterator[list[str]]:
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
        yield [
            title_of(row["effect"]),
            "" if row["condition"] == ALL else str(row["condition"]),
            sure_text(row["probability"]),
            "yes" if row["named"] else "no",
            _listed(own) if row["has"] else DASH,
        ]


def sure_text(probability: float) -> str:
    """A probability in percent, never quite 0 or 100."""
    percent = 100.0 * float(probability)
    if percent > 99.0:
        return "> 99 %"
    return "< 1 %" if percent < 1.0 else f"{percent:.0f} %"


def _found(given: Experiment, who: Any) -> Iterator[list[str]]:
    """Effects of a search that was made person by person."""
    for (condition, effect), rows in _of(given.people.found, who).groupby(
        ["condition", "effect"], sort=False
    ):
        if effect:
            where = "" if condition == ALL else str(condition)
            yield [title_of(str(effect)), where, DASH, "yes", _listed(rows)]


def _listed(rows: pd.DataFrame) -> str:
    texts = []
    for row in rows.to_dict("records"):
        if not row["parameter"]:
            continue
        name = str(row["parameter"]).partition("__")[2] or row["parameter"]
        text = f"{name} {number(row['estimate'], row['se'])} {row['unit']}".rstrip()
        between = _tell_interval(row["estimate"], row["se"])
        texts.append(text if between == DASH else f"{text} ({between})")
    return ", ".join(texts) or DASH


def _path(given: Experiment, who: Any, conditions: list[Any]) -> TextTable:
    """The error on held-out rows at each step of the person's own search."""
    rows = []
    for condition in conditions if given.group is not None else []:
        search = given.group.searches_.get((who, condition))  # type: ignore[union-attr]
        if search is None:
            continue
        unit = search.predictions_.attrs.get("units", {}).get("measured", "")
        rows += [
            [
                str(row["model"]),
                "" if condition == ALL else str(condition),
                _percent(row["vaf"]),
                _percent(row["vaf_loop"]),
                f"{number(row['rmse'])} {unit}".rstrip(),
            ]
            for row in search.error_path_.to_dict("records")
        ]
    header = ["model", "condition", "VAF, %", "VAF in the closed loop, %", "RMSE"]
    caption = "The error on held-out rows, step by step"
    return TextTable(caption, header, rows, left=["model", "condition"])


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
    how = "held out" + ("" if last == "baseline" else f", with {_tell_effects(search)}")
    return _cut(table.index, table["measured"], table[last], unit, how)


def _tell_effects(search: Any) -> str:
    return titles_of([str(name) for name in search.error_path_["effect"].iloc[1:]])


def _of_model(given: Experiment, key: tuple[Any, Any], group: Group) -> Stretch | None:
    """Simulation by the model of the person, on the rows of the fit."""
    model = given.people.models.get(key)
    if model is None:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            simulated, _ = prediction_from(by_likelihood(model), group.X, group.y)
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
