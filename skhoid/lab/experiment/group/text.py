"""The sentences of a search in a group."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pandas as pd

from ....effects.registry import title_of, titles_of
from ....text import counted, p_text
from ..read import ALL

if TYPE_CHECKING:
    from .search import GroupEffectSearch

MOST_NAMED = 6  # people in a sentence
NOTED = 0.05  # p of a difference between conditions


def summary_of(found: GroupEffectSearch) -> list[str]:
    """The verdict, effects of the group, of single people, conditions, and who is left out."""
    people = found.people_
    names = list(dict.fromkeys(people["subject"]))
    conditions = [c for c in dict.fromkeys(people["condition"]) if c != ALL]
    several = f", {counted(len(conditions), 'condition')}" if conditions else ""
    lines = [
        headline(found),
        f"{counted(len(names), 'person').replace('persons', 'people')}{several}.",
    ]
    lines += [f"  {line}" for line in group_lines(found)]
    lines += [f"  {line}" for line in single_lines(found)]
    lines += [f"  {line}" for line in contrast_lines(found)]
    lines += [f"Note: {line}." for line in notes(found)]
    return lines


def headline(found: GroupEffectSearch) -> str:
    """The verdict in one sentence."""
    if found.group_effects_:
        table = found.prevalence_[found.prevalence_["group"]]
        told: dict[str, list[str]] = {}
        for name in found.group_effects_:
            told.setdefault(_where(table[table["effect"] == name], found), []).append(name)
        parts = [f"{titles_of(names)}{where}" for where, names in told.items()]
        return f"The group has {'; '.join(parts)}."
    if len(found.members_) and found.members_["has"].any():
        return "No effect is the group's; single people have some."
    return "Nothing is missing, in the group or in anybody."


def _where(rows: pd.DataFrame, found: GroupEffectSearch) -> str:
    """In which conditions, where not in all."""
    here = [str(c) for c in rows["condition"] if c != ALL]
    others = len(set(found.people_["condition"]) - set(rows["condition"]))
    return f" in {listed(here)}" if here and others else ""


def group_lines(found: GroupEffectSearch) -> Iterator[str]:
    """Each effect of the group: how many people, the prevalence, and who has it not."""
    for name in found.group_effects_:
        rows = found.prevalence_[found.prevalence_["effect"] == name]
        conditions = rows[rows["condition"] != ALL]
        if len(rows) == 1 or not conditions["group"].any():
            conditions = rows[rows["group"]]
        for _, row in conditions.iterrows():
            yield sentence_of(row)


def sentence_of(row: pd.Series) -> str:
    """How many people have an effect, and who has it not, or alone."""
    where = "" if row["condition"] == ALL else f" in {row['condition']}"
    text = (
        f"{title_of(row['effect'])}{where}: {row['n_with']} of {row['n_people']} people, "
        f"prevalence {100 * row['share']:.0f} % ({100 * row['low']:.0f} to "
        f"{100 * row['high']:.0f} %)"
    )
    if row["group"] and row["without"]:
        text += f"; not {listed(row['without'])}"
    elif row["with_it"] and row["without"]:
        text += f"; only {listed(row['with_it'])}"
    return f"{text}."


def single_lines(found: GroupEffectSearch) -> Iterator[str]:
    """What single people have that is not the group's."""
    members = found.members_[found.members_["has"]]
    own = members[~members["effect"].isin(found.group_effects_)]
    for effect, table in own.groupby("effect", sort=False):
        people = [_person(row) for _, row in table.iterrows()]
        verb = "has" if len(people) == 1 else "have"
        yield f"{listed(people)} {verb} {title_of(str(effect))}, the group has not."


def contrast_lines(found: GroupEffectSearch) -> Iterator[str]:
    """Which conditions differ in who has an effect."""
    for _, row in found.contrasts_[found.contrasts_["p_adjusted"] < NOTED].iterrows():
        yield (
            f"{title_of(row['effect'])}: {row['n_with']} of {row['n_people']} people in "
            f"{row['condition']}, {row['n_other']} in {row['other']} "
            f"({p_text(row['p_adjusted'])}, McNemar, Holm)."
        )


def notes(found: GroupEffectSearch) -> Iterator[str]:
    """Whom nothing could be said about, and what has no name."""
    people = found.people_
    for _, row in people[people["failure"] != ""].iterrows():
        yield f"{_person(row)} could not be searched: {row['failure'].rstrip('.')}"
    unknown = people[leaves_unknown(people)]
    if len(unknown):
        who = listed([_person(row) for _, row in unknown.iterrows()])
        yield f"something without a name is missing in {who}: see searches_[subject, condition]"
    added = found.members_[found.members_["has"] & ~found.members_["named"]]
    for effect, table in added.groupby("effect", sort=False):
        who = listed([_person(row) for _, row in table.iterrows()])
        yield (
            f"{title_of(str(effect))} in {who} is named by the evidence of the group; the runs of "
            "the person alone do not name it"
        )
    for _, row in found.identified_.outlying.iterrows():
        yield f"{row['subject']} looks wrong: {str(row['reason']).rstrip('.')}"


def leaves_unknown(people: pd.DataFrame) -> list[bool]:
    """Of which people something is missing that has no name; nothing is said of failed searches."""
    return [verdict is not None and verdict.leaves_unknown for verdict in people["verdict"]]


def _person(row: Any) -> str:
    where = "" if row["condition"] == ALL else f" in {row['condition']}"
    return f"{row['subject']}{where}"


def listed(names: list[Any]) -> str:
    """Names in a sentence; of many, how many."""
    shown = [str(name) for name in names[:MOST_NAMED]]
    if len(names) > MOST_NAMED:
        return f"{', '.join(shown)} and {len(names) - MOST_NAMED} more"
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"
