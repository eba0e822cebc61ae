"""What identify_people found, as tables and as text."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ...effects import title_of
from ...pipelines import taken_apart
from ...runs import RUN
from ...text import (
    Block,
    Document,
    Heading,
    Item,
    Items,
    Note,
    Notes,
    Paragraph,
    TextTable,
    Told,
    counted,
)
from .groups import ALL, CONDITION, SUBJECT, runs_of_each

COLUMNS = (
    SUBJECT,
    CONDITION,
    RUN,
    "parameter",
    "estimate",
    "se",
    "unit",
    "vaf",
    "ceiling",
    "n_rows",
    "outlying",
    "failure",
)
SHOWN = 12  # failures, outlying ones and notes in a summary


@dataclass(frozen=True, repr=False, eq=False)
class PeopleResult(Told):
    """What :func:`identify_people` found.

    Parameters
    ----------
    table : DataFrame
        One row per fit and parameter: ``subject`` and ``condition`` (``"all"`` where the data have
        no such level), ``run`` (``"all"`` for a fit of all runs), ``parameter``, ``estimate``,
        ``se`` (of this fit, NaN where not known), ``unit``, ``vaf`` (of the free run on the rows of
        the fit, in percent, unclipped), ``ceiling`` (the noise ceiling of the group, in percent,
        NaN where not known), ``n_rows``, ``outlying`` (why this person or run looks wrong, or
        ``""``), ``failure`` (why there is no fit, or ``""``; then ``parameter`` is ``""``). Fits of
        single runs if each run was fitted, else those of groups.
    groups : DataFrame
        The same columns, for the fits of all runs of a person in a condition.
    runs : DataFrame
        One row per run: ``n_rows``, ``vaf`` (of its own fit, NaN if there is none), ``vaf_group``
        (of the fit of the group, on this run), ``spread`` (standard deviation of the output).
    models : dict
        Fitted estimator of each group by (subject, condition).
    outlying : DataFrame
        ``subject``, ``condition``, ``run`` (``"all"`` for a person), ``kind`` (``"sign"``,
        ``"scale"``, ``"no response"``, ``"parameter"``, ``"run"``) and ``reason``.
    found : DataFrame
        Of a search for effects, one row per parameter of each effect found: ``subject``,
        ``condition``, ``effect``, ``parameter``, ``estimate``, ``se``, ``unit``, ``verdict``; one
        row with an empty ``effect`` where none was found. Empty for other estimators.
    notes : list of str
        What is missing, and the warnings of fits, counted.
    estimator : str
        The estimator as text.
    """

    table: pd.DataFrame
    groups: pd.DataFrame
    runs: pd.DataFrame
    models: dict[tuple[Any, Any], Any]
    outlying: pd.DataFrame
    found: pd.DataFrame
    notes: list[str]
    estimator: str

    @property
    def each_run(self) -> bool:
        """Whether each run was fitted on its own."""
        return bool((self.table[RUN] != ALL).any())

    @property
    def failures(self) -> pd.DataFrame:
        """The rows of both tables with a failure."""
        both = (
            pd.concat([self.groups, self.table], ignore_index=True)
            if self.each_run
            else self.groups
        )
        return both[both["failure"] != ""].reset_index(drop=True)

    @property
    def meanings(self) -> dict[str, str]:
        """What the parameters of the models are, in words; those of effects have their titles."""
        found: dict[str, str] = {}
        for model in self.models.values():
            table = getattr(taken_apart(model)[1], "parameters_", None)
            if isinstance(table, pd.DataFrame) and "meaning" in table:
                found |= {str(name): f"{said} {name}" for name, said in table["meaning"].items()}
        for name in found:
            effect, _, own = name.partition("__")
            found[name] = f"{title_of(effect)} {own}" if own else found[name]
        return found

    def of_members(self, members: pd.DataFrame) -> PeopleResult:
        """The same without the parameters of effects in people who are not taken to have them.

        Where the model has an effect that somebody has not, its parameter is at a bound, and means
        over it and others are of two kinds of people.

        Parameters
        ----------
        members : DataFrame
            ``GroupEffectSearch.members_``.

        Returns
        -------
        people : PeopleResult
        """
        has = members.loc[members["has"], [SUBJECT, CONDITION, "effect"]]
        there = set(has.itertuples(index=False, name=None))
        known = {effect for *_, effect in there} | set(members["effect"])

        def kept(table: pd.DataFrame) -> pd.DataFrame:
            effect = table["parameter"].str.partition("__")[0]
            keys = zip(table[SUBJECT], table[CONDITION], effect, strict=True)
            own = [key in there or key[2] not in known for key in keys]
            return table[np.array(own, dtype=bool)].reset_index(drop=True)

        return replace(self, table=kept(self.table), groups=kept(self.groups))

    def __repr__(self) -> str:
        n = [self.runs[name].nunique() for name in (SUBJECT, CONDITION)]
        return f"PeopleResult({n[0]} people, {n[1]} conditions, {len(self.runs)} runs)"

    def document(self) -> Document:
        """The result in plain words: how many, means and spreads, what failed, what looks wrong."""
        blocks: list[Block] = [Paragraph(f"Estimator: {self.estimator}"), *_of_conditions(self)]
        blocks += _effects(self)
        failed = self.failures.to_dict("records")
        blocks += _listed("No fit:", [f"{_name(row)}: {row['failure']}" for row in failed])
        odd = self.outlying.to_dict("records")
        reasons = [f"{_name(row)}: {row['reason']}" for row in odd]
        blocks += _listed("Looks wrong (and counts all the same):", reasons)
        if not odd:
            blocks.append(Paragraph("Nobody and no run is outlying."))
        blocks.append(Notes([Note("", note) for note in self.notes[:SHOWN]]))
        return Document(_how_many(self), blocks)

    def plot(self, ax: Any = None) -> Any:
        """Draw the VAF of everybody's runs against the noise ceiling, on Axes for each person."""
        from ...plotting import PeopleDisplay

        return PeopleDisplay.from_result(self, ax=ax)


def _how_many(r: PeopleResult) -> str:
    n = r.runs.groupby([SUBJECT, CONDITION], sort=False).size()
    subjects, conditions = (r.runs[name].nunique() for name in (SUBJECT, CONDITION))
    people = "1 person" if subjects == 1 else f"{subjects} people"
    fitted = "each run and all runs" if r.each_run else "all runs"
    return (
        f"{people}, {counted(conditions, 'condition')}; {runs_of_each(n)}, "
        f"{len(r.runs)} in all. Fitted: {fitted} of each person and condition."
    )


def _of_conditions(r: PeopleResult) -> list[Block]:
    """A table of means and spreads between people for each condition."""
    found: list[Block] = []
    for condition, part in r.groups.groupby(CONDITION, sort=False):
        people = part.drop_duplicates(SUBJECT)
        vaf = people["vaf"].dropna()
        caption = f"{'Fits' if condition == ALL else condition}: " + (
            f"VAF (about zero) {vaf.min():.0f} to {vaf.max():.0f} %, median {vaf.median():.0f} %"
            if len(vaf)
            else "no fit"
        )
        top = people["ceiling"].dropna()
        if len(top):
            caption += f"; noise ceiling at least {top.median():.0f} % (median)"
        rows = [
            _spread(name, of_one)
            for name, of_one in part[part["parameter"] != ""].groupby("parameter", sort=False)
        ]
        header = ("", "unit", "mean", "spread", "se", "people")
        found.append(TextTable(caption, header, rows) if rows else Paragraph(f"{caption}."))
    if any(isinstance(block, TextTable) for block in found):
        said = "spread: standard deviation between people; se: median of their fits."
        found.append(Paragraph(said))
    return found


def _spread(name: Any, part: pd.DataFrame) -> tuple[str, ...]:
    values = part["estimate"].dropna()
    se = part["se"].dropna()
    return (
        str(name),
        part["unit"].iloc[0],
        f"{values.mean():.3g}" if len(values) else "-",
        f"{values.std():.2g}" if len(values) > 1 else "-",
        f"{se.median():.2g}" if len(se) else "-",
        str(len(values)),
    )


def _effects(r: PeopleResult) -> list[Block]:
    if r.found.empty:
        return []
    each = r.found.drop_duplicates([SUBJECT, CONDITION, "effect"])
    total = len(each.drop_duplicates([SUBJECT, CONDITION]))
    named = each["effect"].where(each["effect"] != "", "no effect").value_counts()
    return _listed("Effects found:", [f"{name}: {n} of {total}" for name, n in named.items()])


def _name(row: dict[str, Any]) -> str:
    named = [str(row[level]) for level in (SUBJECT, CONDITION) if row[level] != ALL]
    run = "" if row[RUN] == ALL else f"run {row[RUN]}"
    return ", ".join(part for part in (" ".join(named), run) if part) or "all runs"


def _listed(title: str, texts: list[str]) -> list[Block]:
    if not texts:
        return []
    shown = texts[:SHOWN] + [f"{len(texts) - SHOWN} more"] * (len(texts) > SHOWN)
    return [Heading(title), Items([Item(text) for text in shown], numbered=False)]
