"""From the blocks of groups to the tables of the result."""

from __future__ import annotations

import re
from typing import Any

import pandas as pd

from ....runs import RUN
from ....text import counted
from ..read import ALL, CONDITION, SUBJECT
from .fit import CEILING, EFFECT, FIT, JUDGED, WARNED, WHOLE, unpacked
from .groups import Group
from .outlying import outlying_table
from .result import COLUMNS, PeopleResult

NUMBER = re.compile(r"\d[\d.,e+-]*")
LONGEST = 300  # characters of a note


def assembled(
    estimator: Any,
    groups: list[Group],
    found: list[tuple[pd.DataFrame, bytes]],
    *,
    each_run: bool,
    keep_models: bool,
) -> PeopleResult:
    """The result of all groups, in their order."""
    lines = _labelled(groups, [table for table, _ in found])
    fits = _fits(lines)
    whole = fits[fits["number"] == WHOLE]
    of_runs = fits[fits["number"] != WHOLE] if each_run else whole
    judged = lines[lines["part"] == JUDGED].reset_index(drop=True)
    runs = judged[[SUBJECT, CONDITION, RUN, "n_rows"]].assign(
        vaf=judged["estimate"], vaf_group=judged["vaf"], spread=judged["se"]
    )
    whole, of_runs = (part[list(COLUMNS)].reset_index(drop=True) for part in (whole, of_runs))
    outlying = outlying_table(whole, of_runs, runs)
    whole, of_runs = (_flagged(part, outlying) for part in (whole, of_runs))
    both = pd.concat([whole, of_runs], ignore_index=True) if each_run else whole
    keys = [(group.subject, group.condition) for group in groups]
    contents = [content for _, content in found]
    models = {k: unpacked(c) for k, c in zip(keys, contents, strict=True) if c}
    return PeopleResult(
        table=of_runs,
        groups=whole,
        runs=runs,
        models=models if keep_models else None,
        failures=both[both["failure"] != ""].reset_index(drop=True),
        outlying=outlying,
        found=_effects(lines),
        notes=[*_missing(groups), *_counted_warnings(lines)],
        estimator=" ".join(repr(estimator).split()),
        each_run=each_run,
    )


def _labelled(groups: list[Group], tables: list[pd.DataFrame]) -> pd.DataFrame:
    """All lines, with the labels of their subject, condition and run."""
    parts = []
    for place, (group, table) in enumerate(zip(groups, tables, strict=True)):
        labels = [ALL if number == WHOLE else group.labels[number] for number in table["run"]]
        parts.append(
            table.assign(
                number=table["run"],
                place=place,
                subject=pd.Series([group.subject] * len(table), table.index, dtype=object),
                condition=pd.Series([group.condition] * len(table), table.index, dtype=object),
                run=pd.Series(labels, table.index, dtype=object),
            )
        )
    return pd.concat(parts, ignore_index=True)


def _fits(lines: pd.DataFrame) -> pd.DataFrame:
    """The tidy table; the ceiling of a group holds for its runs too."""
    ceilings = lines[lines["part"] == CEILING].set_index("place")["estimate"]
    fits = lines[lines["part"] == FIT]
    return fits.rename(columns={"name": "parameter", "text": "failure"}).assign(
        ceiling=fits["place"].map(ceilings).astype(float), outlying=""
    )


def _flagged(table: pd.DataFrame, outlying: pd.DataFrame) -> pd.DataFrame:
    """The reasons beside the rows that they concern; those of a person are in all its runs."""
    reasons: dict[tuple[Any, ...], list[str]] = {}
    for flag in outlying.itertuples(index=False):
        reasons.setdefault((flag.subject, flag.condition, flag.run), []).append(flag.reason)
    keys = zip(table[SUBJECT], table[CONDITION], table[RUN], strict=True)
    texts = [
        "; ".join(
            [*reasons.get((s, c, ALL), []), *(reasons.get((s, c, r), []) if r != ALL else [])]
        )
        for s, c, r in keys
    ]
    return table.assign(outlying=pd.Series(texts, table.index, dtype=object))


def _effects(lines: pd.DataFrame) -> pd.DataFrame:
    effects = lines[lines["part"] == EFFECT].rename(
        columns={"of": "effect", "name": "parameter", "text": "verdict"}
    )
    columns = [SUBJECT, CONDITION, "effect", "parameter", "estimate", "se", "unit", "verdict"]
    return effects[columns].reset_index(drop=True)


def _missing(groups: list[Group]) -> list[str]:
    """Who has no runs in a condition, and fewer runs than others."""
    there = {(group.subject, group.condition) for group in groups}
    subjects = list(dict.fromkeys(group.subject for group in groups))
    notes = []
    for condition in dict.fromkeys(group.condition for group in groups):
        absent = [str(name) for name in subjects if (name, condition) not in there]
        if absent:
            notes.append(f"{condition} has no runs of {', '.join(absent)}")
    most = max(len(group.labels) for group in groups)
    notes += [
        f"{group} has {counted(len(group.labels), 'run')}, others have up to {most}"
        for group in groups
        if len(group.labels) < most
    ]
    return notes


def _counted_warnings(lines: pd.DataFrame) -> list[str]:
    """Warnings of fits, those that differ in numbers only counted as one."""
    first: dict[str, tuple[str, str]] = {}
    times: dict[str, int] = {}
    for line in lines[lines["part"] == WARNED].itertuples(index=False):
        text = " ".join(line.text.split())[:LONGEST]
        kind = NUMBER.sub("#", text)
        named = [str(n) for n in (line.subject, line.condition) if n != ALL]
        where = " ".join([*named, "all runs" if line.run == ALL else f"run {line.run}"])
        first.setdefault(kind, (text, where))
        times[kind] = times.get(kind, 0) + 1
    return [
        f"{where}{f' (and {times[kind] - 1} more)' if times[kind] > 1 else ''}: {text}"
        for kind, (text, where) in first.items()
    ]
