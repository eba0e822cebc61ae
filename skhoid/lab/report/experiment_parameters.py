"""Parameters of everybody on the page of an experiment: means, contrasts, checks, pictures."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ...effects.registry import title_of
from ...text import DASH, as_sentence, number, p_text, quantity
from ..experiment.read import ALL
from ..experiment.statistics import MixedModelResult, mixed_model
from .experiment_plots import ExperimentGallery

if TYPE_CHECKING:
    from .experiment_content import Experiment

MOST = 16  # parameters on a page
FEWEST = 3  # people, for a mean over people
Z = 1.96


def parameters_section(
    given: Experiment, reference: Any, gallery: ExperimentGallery
) -> tuple[dict[str, Any], dict[str, MixedModelResult]]:
    """What the page says of each parameter, and the mixed models."""
    parts, statistics, reasons = [], {}, []
    missing = ""
    tables = _tables(given)
    for name, table in list(tables.items())[:MOST]:
        result, why = None, ""
        known = table.dropna(subset=["estimate"])["subject"].nunique()
        try:
            if known < FEWEST:
                raise ValueError(f"known of {people_text(known)} only.")
            result = mixed_model(table, name, reference=_label(table, reference))
        except ImportError as error:
            missing = str(error)
        except ValueError as error:
            why = str(error)
        if result is not None:
            statistics[name] = result
        parts.append(_part(name, table, result, why, gallery))
        reasons.append(why)
    section = {
        "by": _by(given),
        "missing": missing,
        "parts": parts,
        "left": list(map(named, list(tables)[MOST:])),
        "contrasts": list(_contrasts(statistics)),
        "n_tests": sum(len(result.contrasts) for result in statistics.values()),
    }
    return section, statistics


def _label(table: pd.DataFrame, reference: Any) -> Any:
    """The reference, for parameters that are known there."""
    return reference if reference in set(table["condition"]) else None


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
            text += " Parameters of effects are of the search, where the effect is."
            if _lacks_effects(given):
                text += (
                    " This model lacks effects that were found: where somebody has one, it bends "
                    "the parameters here."
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


def _part(
    name: str,
    table: pd.DataFrame,
    result: MixedModelResult | None,
    why: str,
    gallery: ExperimentGallery,
) -> dict[str, Any]:
    unit = str(table["unit"].iloc[0])
    part: dict[str, Any] = {
        "name": named(name),
        "unit": unit,
        "why": why,
        "pictures": [],
        "means": [],
        "omnibus": "",
        "variances": "",
        "checks": [],
        "influence": [],
        "notes": [],
        "plain": list(_plain(table)),
    }
    if result is None:
        return part
    part["pictures"] = gallery.parameter(result, named(name))
    part["means"] = [
        {
            "condition": "all" if row["condition"] == ALL else str(row["condition"]),
            "mean": number(row["mean"], row["se"]),
            "interval": _between(row["low"], row["high"], row["se"]),
            "rows": str(row["n_rows"]),
        }
        for row in result.effects.to_dict("records")
    ]
    if result.omnibus is not None:
        test = result.omnibus
        verdict = "differ" if test.p < 1.0 - result.confidence else "do not differ beyond chance"
        part["omnibus"] = (
            f"The conditions {verdict}: F({test.df1:.0f}, {test.df2:.1f}) = {test.F:.2f}, "
            f"{p_text(test.p)}."
        )
    spreads = [
        f"{row['source']} {quantity(row['sd'], unit)}"
        for row in result.variances.to_dict("records")
        if np.isfinite(row["sd"])
    ]
    part["variances"] = f"Standard deviations: {', '.join(spreads)}."
    part["checks"] = [
        {"mark": {True: "ok", False: "look", None: "not made"}[row["ok"]], "said": row["said"]}
        for row in result.checks.to_dict("records")
    ]
    if len(result.influence) and "changes" in result.influence:
        changed = result.influence[result.influence["changes"].astype(bool)]
        part["influence"] = list(dict.fromkeys(map(str, changed["without"])))
    part["notes"] = [as_sentence(note) for note in result.notes]
    return part


def _plain(table: pd.DataFrame) -> Iterator[dict[str, str]]:
    """Mean and spread of people in each condition, each person once, with its runs' mean."""
    for condition, rows in table.groupby("condition", sort=False):
        people = rows.groupby("subject", sort=False)["estimate"].mean().dropna()
        spread = float(people.std()) if len(people) > 1 else np.nan
        yield {
            "condition": "all" if condition == ALL else str(condition),
            "people": str(len(people)),
            "mean": number(float(people.mean()), spread) if len(people) else DASH,
            "spread": number(spread) if np.isfinite(spread) else DASH,
        }


def _between(low: float, high: float, se: float) -> str:
    if not (np.isfinite(low) and np.isfinite(high)):
        return DASH
    return f"{number(low, se)} to {number(high, se)}"


def _contrasts(statistics: dict[str, MixedModelResult]) -> Iterator[dict[str, Any]]:
    """One table of all contrasts of all parameters."""
    for name, result in statistics.items():
        for row in result.contrasts.to_dict("records"):
            sized = np.isfinite(row["d"])
            yield {
                "parameter": named(name),
                "unit": result.unit,
                "pair": f"{row['condition']} − {row['against']}",
                "difference": number(row["difference"], row["se"]),
                "interval": _between(row["low"], row["high"], row["se"]),
                "t": f"t({row['df']:.1f}) = {row['t']:.2f}",
                "p": p_text(row["p_adjusted"]).removeprefix("p ").removeprefix("= "),
                "d": f"{row['d']:.2f}" if sized else DASH,
                "d_interval": f"{row['d_low']:.2f} to {row['d_high']:.2f}" if sized else DASH,
                "sure": bool(row["p_adjusted"] < 1.0 - result.confidence),
            }


def interval_of(estimate: float, se: float) -> str:
    """95 % interval of a fit by its standard error."""
    return _between(estimate - Z * se, estimate + Z * se, se)
