"""``check_experiment``: whose recordings of an experiment look wrong, and in what."""

from __future__ import annotations

import warnings
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..exceptions import RunIndexError, SlowClockWarning
from ..text import Block, Document, Item, Items, Paragraph, TextTable, Told, counted
from .between_people import BetweenFinding, Recordings, compare_people, gather_facts
from .channels import check_channels
from .recording import join_names

__all__ = ["ExperimentCheck", "check_experiment"]

COLUMNS = ["subject", "condition", "runs", "name", "title", "evidence", "next_step"]
MOST_ROWS = 40  # of the table in the summary
# What a comparison of people says better than the check of one person.
_SAID_BETTER = {"clock": ("clock unit", "sampling time")}


@dataclass(frozen=True, repr=False)
class ExperimentCheck(Told):
    """What was found in the recordings of an experiment.

    Parameters
    ----------
    table : DataFrame
        One row per subject and condition: ``runs``, ``rows``, ``shortest`` and ``longest`` run (s),
        sampling time ``dt`` (s), ``missing`` values, and what looks ``wrong`` ("" if nothing).
    findings : DataFrame
        One row per finding: ``subject``, ``condition`` and ``runs`` ("all" where it holds for all
        of them), ``name``, ``title``, ``evidence``, ``next_step``.
    found : list
        The same as objects, with lists of labels: ``sure`` is whether nothing else explains it, and
        ``channel`` which one to invert, if that mends it.

    See Also
    --------
    check_experiment : Makes it.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.recordings import check_experiment
    >>> runs, time = ["S1", "S2", "S3"], np.arange(1000) / 50
    >>> index = pd.MultiIndex.from_product([runs, [1], time], names=["subject", "run", "time"])
    >>> X = pd.DataFrame({"e": np.random.default_rng(0).standard_normal(3000)}, index)
    >>> check_experiment(X)
    <ExperimentCheck: 3 people, 0 findings>
    """

    table: pd.DataFrame
    findings: pd.DataFrame
    found: list[BetweenFinding]

    @property
    def ok(self) -> bool:
        """Whether nothing was found."""
        return self.findings.empty

    def document(self) -> Document:
        """Counts, a row per subject and condition, and who has what.

        Returns
        -------
        document : Document
        """
        table, shown = self.table, self.table
        people, conditions = table["subject"].nunique(), table["condition"].nunique()
        title = (
            f"Experiment: {people} {'person' if people == 1 else 'people'}, "
            f"{counted(conditions, 'condition')}, {counted(int(table['runs'].sum()), 'run')}, "
            f"{int(table['rows'].sum())} rows"
        )
        if len(table) > MOST_ROWS:
            shown = table[table["wrong"] != ""][:MOST_ROWS]
        rows = [
            [
                f"{row.subject} {row.condition}",
                str(row.runs),
                str(row.rows),
                f"{row.shortest:.4g}",
                f"{row.longest:.4g}",
                f"{row.dt:.4g}",
                str(row.missing),
                str(row.wrong) or "-",
            ]
            for row in shown.itertuples()
        ]
        header = ["", "runs", "rows", "shortest", "longest", "dt", "missing", "wrong"]
        blocks: list[Block] = [TextTable("", header, rows)] if rows else []
        if len(shown) < len(table):
            blocks.append(Paragraph(f"and {len(table) - len(shown)} more rows, in .table"))
        if self.findings.empty:
            return Document(title, [*blocks, Paragraph("Nothing looks wrong.")])
        found = [
            Item(f"{_where(row)}: {row.title}. {row.evidence}", {"Next": row.next_step})
            for row in self.findings.itertuples()
        ]
        return Document(title, [*blocks, Items(found, numbered=False)])

    def __repr__(self) -> str:
        people = self.table["subject"].nunique()
        return f"<ExperimentCheck: {people} people, {counted(len(self.findings), 'finding')}>"

    def __str__(self) -> str:
        return str(self.summary())


def _where(row: Any) -> str:
    """Whose a finding is, in which condition and runs."""
    where = [str(row.subject)]
    where += [str(row.condition)] if row.condition != "all" else []
    return ", ".join(where + ([f"runs {row.runs}"] if row.runs != "all" else []))


def check_experiment(X: pd.DataFrame, y: Any = None) -> ExperimentCheck:
    """Check the recordings of an experiment, person by person and between people.

    Runs :func:`skhoid.check_channels` for each person, and looks for what only a comparison shows:
    a channel with the opposite sign, a gain or unit of one person that is not the others',
    exchanged channels, a clock in ms or of another rate, runs that are much shorter, that are
    missing, or that are the same recording under two names. A fault that all people share is
    reported once.

    Parameters
    ----------
    X : DataFrame of shape (n_rows, n_channels)
        Row index levels run and time, and subject and condition where there are any, as
        :func:`skhoid.read_experiment` gives them.
    y : Series of shape (n_rows,) or None, default=None
        The operator's output.

    Returns
    -------
    check : ExperimentCheck
        With ``table``, ``findings`` and ``summary()``.

    Raises
    ------
    ValueError
        If X has no runs and time in its index, or no rows.

    See Also
    --------
    skhoid.read_experiment : Read the files of an experiment.
    skhoid.check_channels : The checks of one recording.

    Notes
    -----
    Signs, gains and exchanged channels need three people: of two that differ, nobody knows which is
    wrong. The sign is that of the correlations of two channels at lags of -1 to 1 s, whose form is
    compared with the median of the others' in the same condition (cosine below -0.5). A gain is
    reported if a standard deviation is more than 4.5 times the others', or less than 1/4.5, and
    more than 5 robust standard deviations away, of logarithms. People differ in gain by far less
    than units do, but a gain that is wrong by a factor of 2 is not found.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from skhoid.recordings import check_experiment
    >>> runs, time = ["S1", "S2", "S3"], np.arange(1000) / 50
    >>> index = pd.MultiIndex.from_product([runs, [1], time], names=["subject", "run", "time"])
    >>> e, noise = np.random.default_rng(0).standard_normal((2, 3000))
    >>> X = pd.DataFrame({"e": e}, index)
    >>> y = pd.Series(np.roll(e, 10) + noise, index, name="u")
    >>> y[y.index.get_level_values("subject") == "S2"] *= -1
    >>> check = check_experiment(X, y)
    >>> check.findings[["subject", "title"]].to_numpy().tolist()
    [['S2', "u or e of S2 has the opposite sign of the others'"]]
    """
    recordings = gather_facts(X, y)
    between = compare_people(recordings)
    findings = [*between, *_of_each(X, y, recordings, between)]
    rows = [_as_row(finding) for finding in findings]
    frame = pd.DataFrame(rows, columns=COLUMNS)
    return ExperimentCheck(_table(recordings, findings), frame, findings)


def _of_each(
    X: pd.DataFrame, y: Any, recordings: Recordings, between: list[BetweenFinding]
) -> Iterator[BetweenFinding]:
    """Findings of each person alone; those of all people once."""
    groups: dict[tuple[str, str], list[BetweenFinding]] = defaultdict(list)
    said = {
        (who, name) for f in between for name in _SAID_BETTER.get(f.name, ()) for who in f.subjects
    }
    for subject in recordings.subjects:
        own_X, own_y = _of_person(X, y, subject)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", SlowClockWarning)  # is a finding here
                found = check_channels(own_X, own_y)
        except RunIndexError as error:
            groups["run index", subject].append(
                BetweenFinding(
                    [subject],
                    [],
                    [],
                    "run index",
                    f"Runs or time of {subject} make no sense",
                    str(error),
                    "Correct the files, and read them again.",
                )
            )
            continue
        for finding in found:
            if (subject, finding.name) in said:
                continue
            evidence = f"{finding.evidence} {finding.meaning}"
            groups[finding.name, finding.about].append(
                BetweenFinding(
                    [subject], [], [], finding.name, finding.title, evidence, finding.next_step
                )
            )
    for same in groups.values():
        having = {who for finding in same for who in finding.subjects}
        if len(having) < len(recordings.subjects) or len(having) == 1:
            yield from same
            continue
        first = same[0]
        evidence = f"Of {first.subjects[0]}: {first.evidence}"
        yield BetweenFinding([], [], [], first.name, first.title, evidence, first.next_step)


def _of_person(X: pd.DataFrame, y: Any, subject: Any) -> tuple[pd.DataFrame, Any]:
    if "subject" not in X.index.names:
        return X, y
    rows = np.asarray(X.index.get_level_values("subject") == subject)
    own = X[rows]
    own.attrs = dict(X.attrs)
    if y is None:
        return own, None
    output = y[rows]
    output.attrs = dict(getattr(y, "attrs", {}))
    return own, output


def _as_row(finding: BetweenFinding) -> list[Any]:
    runs = ", ".join(map(str, finding.runs)) or "all"
    return [
        _named(finding.subjects),
        _named(finding.conditions),
        runs,
        finding.name,
        finding.title,
        finding.evidence,
        finding.next_step,
    ]


def _named(labels: list[Any]) -> Any:
    """The one label, several in a sentence, or "all"."""
    return labels[0] if len(labels) == 1 else join_names(labels) if labels else "all"


def _table(recordings: Recordings, findings: list[BetweenFinding]) -> pd.DataFrame:
    """One row per subject and condition."""
    rows = []
    for subject in recordings.subjects:
        for condition in recordings.conditions:
            runs = recordings.of(subject, condition)
            if not runs:
                continue
            wrong = [
                finding.name
                for finding in findings
                if subject in (finding.subjects or [subject])
                and condition in (finding.conditions or [condition])
            ]
            rows.append(
                {
                    "subject": subject,
                    "condition": condition,
                    "runs": len(runs),
                    "rows": sum(run.rows for run in runs),
                    "shortest": min(run.duration for run in runs),
                    "longest": max(run.duration for run in runs),
                    "dt": float(np.median([run.step for run in runs])),
                    "missing": sum(run.missing for run in runs),
                    "wrong": ", ".join(dict.fromkeys(wrong)),
                }
            )
    return pd.DataFrame(rows)
