"""mend_recordings: what becomes of recordings that are known to be wrong, and what it changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ...recordings import ExperimentCheck
from ...text import Block, Document, Item, Items, TextTable, Told, number
from .groups import ALL, listed
from .identify import identify_people
from .people import PeopleResult

COLUMNS = ["subject", "condition", "runs", "done", "channel", "reason", "by"]
INVERTED, LEFT_OUT = "inverted", "left out"


VERSIONS = {"used": "as used", "recorded": "as recorded", "without": "without them"}


@dataclass(frozen=True, eq=False, repr=False)
class Mended(Told):
    """Recordings as they are used, and what was changed in them.

    Parameters
    ----------
    X, y : DataFrame and Series
        The recordings as they are used.
    changes : DataFrame
        A row for each change: subject, condition and runs (``"all"``: all of them), done
        (``"inverted"`` or ``"left out"``), channel, reason, and by (``"check"`` or ``"you"``).
    recorded : tuple of DataFrame and Series
        X and y before the changes.
    versions : DataFrame or None
        Means over people of each parameter: parameter, unit, and mean, ``_sd`` between people and
        ``_n`` people as used, as recorded, and without whom was changed. None: not asked yet.
    """

    X: pd.DataFrame
    y: pd.Series
    changes: pd.DataFrame
    recorded: tuple[pd.DataFrame, pd.Series]
    versions: pd.DataFrame | None = None

    def __repr__(self) -> str:
        return f"<Mended: {len(self.changes)} changes>"

    @property
    def sentences(self) -> list[str]:
        """Each change in a sentence, the same of several conditions once."""
        found = []
        by = ["subject", "done", "channel", "by"]
        for (who, done, channel, by_whom), rows in self.changes.groupby(by, sort=False):
            places = [
                " ".join(
                    [str(row["condition"])] * (row["condition"] != ALL)
                    + [f"run {row['runs']}"] * (row["runs"] != ALL)
                )
                for row in rows.to_dict("records")
            ]
            where = f" in {listed(places)}" if all(places) else ""
            what = f"{channel} of {who} is inverted" if done == INVERTED else f"{who} is left out"
            why = "as you asked" if by_whom == "you" else str(rows["reason"].iloc[0])
            found.append(f"{what}{where}: {why}")
        return found

    @property
    def other_version(self) -> list[str]:
        """The mean of the first parameter with and without the changes, in a sentence."""
        if self.versions is None or self.versions.empty:
            return []
        row = self.versions.iloc[0]
        name, unit = row["parameter"], f" {row['unit']}".rstrip()
        used, recorded, without = (_mean_text(row, version) for version in VERSIONS)
        return [
            f"As recorded, the mean of {name} over people would be {recorded}{unit} in place of "
            f"{used}, and without them {without}."
        ]

    def with_versions(
        self, people: PeopleResult, estimator: Any, folder: Any = None, n_jobs: int | None = None
    ) -> Mended:
        """The same with ``versions``: whom the changes are about is identified as recorded, too.

        Parameters
        ----------
        people : PeopleResult
            What was identified in the recordings as they are used.
        estimator : estimator
            By which it was.
        folder, n_jobs
            As in :func:`skhoid.identify_people`.

        Returns
        -------
        mended : Mended
        """
        changed = set(self.changes["subject"].map(str))
        X, y = self.recorded
        rows = np.asarray(X.index.get_level_values("subject").astype(str).isin(changed))
        found = identify_people(
            estimator, X[rows], y[rows], each_run=False, ceiling=False, folder=folder, n_jobs=n_jobs
        )
        others = people.groups[~people.groups["subject"].map(str).isin(changed)]
        tables = {"used": people.groups, "recorded": pd.concat([others, found.groups])}
        records = []
        for name, own in people.groups.groupby("parameter", sort=False):
            record: dict[str, Any] = {"parameter": name, "unit": own["unit"].iloc[0]}
            for version, table in (tables | {"without": others}).items():
                of_one = table[table["parameter"] == name]
                means = of_one.groupby("subject", sort=False)["estimate"].mean().dropna()
                record[version] = means.mean()
                record |= {f"{version}_sd": means.std(), f"{version}_n": len(means)}
            records += [record] * (name != "")
        return replace(self, versions=pd.DataFrame(records))

    def document(self) -> Document:
        """What was changed, and each parameter with and without it."""
        if self.changes.empty:
            return Document("Nothing was changed in the recordings.", [])
        items = [Item(f"{text}.") for text in self.sentences]
        blocks: list[Block] = [Items(items, numbered=False)]
        if self.versions is not None and len(self.versions):
            rows = [
                [
                    row["parameter"],
                    *(f"{_mean_text(row, v)} ({row[f'{v}_n']})" for v in VERSIONS),
                    row["unit"],
                ]
                for row in self.versions.to_dict("records")
            ]
            caption = "Means over people ± spread between them (and how many they are)"
            blocks.append(TextTable(caption, ["", *VERSIONS.values(), "unit"], rows))
        return Document("Changed in the recordings, before anything was identified", blocks)


def _mean_text(row: Mapping[Any, Any] | pd.Series, version: str) -> str:
    """Mean and spread of a version of the recordings."""
    sd = row[f"{version}_sd"]
    return f"{number(row[version], sd)} ± {number(sd, sd)}"


def mend_recordings(
    X: pd.DataFrame,
    y: pd.Series,
    check: ExperimentCheck | None = None,
    *,
    invert: Iterable[str] = (),
    leave_out: Iterable[str] = (),
) -> Mended:
    """Invert channels whose sign is known to be wrong, and leave out what is wrong otherwise.

    Parameters
    ----------
    X, y : DataFrame and Series
        Recordings of several people, as :func:`skhoid.read_experiment` gives them.
    check : ExperimentCheck or None, default=None
        What :func:`skhoid.check_experiment` found in them. Of its findings those are acted on that
        nothing else explains (``sure``): a channel with the opposite sign is inverted, and who has
        exchanged channels, a clock in ms, or a unit 30 times too large or small is left out. None:
        only what you say is done.
    invert, leave_out : iterable of str
        People whose output is inverted, or who are left out, also one condition or run of theirs:
        ``"P04"``, ``"P04/fast"``, ``"P04/fast/2"``. The check has no say in them.

    Returns
    -------
    mended : Mended
        X, y, changes (a table), and what was recorded.

    Raises
    ------
    ValueError
        If there is no such person, condition or run, or nobody would be left.

    Examples
    --------
    >>> from skhoid import check_experiment, simulate_experiment
    >>> from skhoid.lab.experiment import mend_recordings
    >>> X, y = simulate_experiment(4, "C1", runs=1, duration=20.48, random_state=0)
    >>> y.loc[["S2"]] *= -1
    >>> mended = mend_recordings(X, y, check_experiment(X, y))
    >>> mended.changes[["subject", "done", "channel"]].to_numpy().tolist()
    [['S2', 'inverted', 'u']]
    """
    yours = [(name, INVERTED) for name in invert] + [(name, LEFT_OUT) for name in leave_out]
    output = str(y.name)
    rows, changes = [], []
    for name, done in yours:
        who, condition, run = [*name.split("/"), ALL, ALL][:3]
        where = _rows_of(X.index, who, condition, [run] * (run != ALL))
        if not where.any():
            known = ", ".join(map(str, X.index.unique("subject")))
            raise ValueError(
                f"There are no runs of {name!r} to be {done}: people are {known}. Name one, or "
                "person/condition/run."
            )
        rows.append(where)
        reason = "as you asked"
        changes.append((who, condition, run, done, output * (done == INVERTED), reason, "you"))
    said = {name.partition("/")[0] for name, _ in yours}
    for finding in [] if check is None else check.found:
        if not finding.sure or str(finding.subjects[0]) in said:
            continue
        done = INVERTED if finding.channel else LEFT_OUT
        for condition in finding.conditions or [ALL]:
            who = finding.subjects[0]
            rows.append(_rows_of(X.index, who, condition, finding.runs))
            runs = ", ".join(map(str, finding.runs)) or ALL
            reason = f"{finding.evidence[:1].lower()}{finding.evidence[1:]}".rstrip(".")
            changes.append((who, condition, runs, done, finding.channel, reason, "check"))
    table = pd.DataFrame(changes, columns=COLUMNS)
    if not changes:
        return Mended(X, y, table, (X, y))
    new_X, new_y, kept = X.copy(), y.copy(), np.ones(len(X), dtype=bool)
    for where, change in zip(rows, table.to_dict("records"), strict=True):
        if change["done"] == LEFT_OUT:
            kept &= ~where
        elif change["channel"] == output:
            new_y[where] *= -1
        else:
            new_X.loc[where, change["channel"]] *= -1
    if not kept.any():
        raise ValueError("Nobody would be left: leave_out names all people.")
    if not kept.all():
        new_X, new_y = new_X[kept], new_y[kept]
        new_X.index = new_y.index = new_X.index.remove_unused_levels()
    new_X.attrs, new_y.attrs = dict(X.attrs), dict(y.attrs)
    return Mended(new_X, new_y, table, (X, y))


def _rows_of(index: pd.MultiIndex, who: Any, condition: Any, runs: Sequence[Any]) -> np.ndarray:
    """The rows of a person, of one condition and of some runs, by the texts of their labels."""
    found = np.ones(len(index), dtype=bool)
    given = (("subject", [who]), ("condition", [condition] * (condition != ALL)), ("run", runs))
    for level, labels in given:
        if labels and level in index.names:
            texts = index.get_level_values(level).astype(str)
            found &= np.asarray(texts.isin(list(map(str, labels))))
    return found
