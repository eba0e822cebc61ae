"""repeated_measures: the classical analysis of variance of run means, with its corrections."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from ...text import Document, Note, Notes, Paragraph, TextTable, Told, counted, number, p_text
from .mixed import ADJUSTED, adjusted
from .rows import Rows, check_reference, select

ALPHA = 0.05


@dataclass(frozen=True, eq=False, repr=False)
class RepeatedMeasuresResult(Told):
    """What :func:`repeated_measures` found.

    Parameters
    ----------
    parameter : str
        The parameter.
    unit : str
        Its unit, or nothing.
    anova : DataFrame
        One row: ``F``, ``df1``, ``df2``, ``p``; ``epsilon_gg``, ``p_gg`` (Greenhouse and Geisser),
        ``epsilon_hf``, ``p_hf`` (Huynh and Feldt); ``mauchly_W`` and ``mauchly_p``;
        ``generalized_eta2``.
    pairs : DataFrame
        ``condition``, ``against``, ``difference``, ``se``, ``df``, ``t``, ``p``, ``p_adjusted``,
        ``low``, ``high`` of paired t tests.
    means : DataFrame
        Means of runs: a row for each person, a column for each condition.
    left_out : list
        People without runs in some condition.
    notes : list of str
        What was left out.
    confidence : float
        Of the intervals.
    adjust : str
        How p-values of pairs pay for their number.
    transform : {None, "log"}
        Scale of the means.

    See Also
    --------
    skhoid.lab.experiment.repeated_measures : Makes it.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import repeated_measures
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> repeated_measures(table, "tau_e")
    RepeatedMeasuresResult('tau_e', 4 people, 2 conditions)
    """

    parameter: str
    unit: str
    anova: pd.DataFrame
    pairs: pd.DataFrame
    means: pd.DataFrame
    left_out: list[Any]
    notes: list[str]
    confidence: float
    adjust: str
    transform: str | None

    def __repr__(self) -> str:
        people, conditions = self.means.shape
        return (
            f"RepeatedMeasuresResult({self.parameter!r}, {people} people, {conditions} conditions)"
        )

    def document(self) -> Document:
        """The result in plain words.

        Returns
        -------
        document : Document
        """
        row = self.anova.iloc[0]
        people, conditions = self.means.shape
        title = (
            f"{self.parameter}: repeated-measures analysis of variance of run means, "
            f"{people} people, {conditions} conditions."
        )
        text = (
            f"F({row['df1']:.0f}, {row['df2']:.0f}) = {row['F']:.2f}, {p_text(row['p'])}; with "
            f"Greenhouse-Geisser epsilon {row['epsilon_gg']:.2f}, {p_text(row['p_gg'])}; "
            f"generalised eta squared {row['generalized_eta2']:.2f}."
        )
        if np.isfinite(row["mauchly_p"]):
            doubt = "is in doubt: use the corrected p" if row["mauchly_p"] < ALPHA else "holds"
            text += (
                f" Sphericity {doubt} (Mauchly's W = {row['mauchly_W']:.2f}, "
                f"{p_text(row['mauchly_p'])})."
            )
        rows = [
            [
                f"{pair['condition']} - {pair['against']}",
                *(number(pair[name], pair["se"]) for name in ("difference", "low", "high")),
                f"t({pair['df']:.0f}) = {pair['t']:.2f}",
                p_text(pair["p_adjusted"]),
            ]
            for pair in self.pairs.to_dict("records")
        ]
        caption = f"Paired t tests (p adjusted: {self.adjust})"
        table = TextTable(caption, ("", "difference", "from", "to", "test", "p"), rows)
        notes = Notes([Note("", note) for note in self.notes])
        return Document(title, [Paragraph(text, "verdict"), table, notes])


def repeated_measures(
    table: pd.DataFrame,
    parameter: str,
    *,
    reference: Any = None,
    transform: str | None = None,
    outlying: str = "keep",
    confidence: float = 0.95,
    adjust: str = "holm",
) -> RepeatedMeasuresResult:
    """Compare the conditions of an experiment by a repeated-measures analysis of variance.

    Each person counts by the plain mean of the runs in each condition. Only people with runs in
    all conditions count.

    Parameters
    ----------
    table : DataFrame
        Tidy table of parameters, as for :func:`mixed_model`; standard errors are not used.
    parameter : str
        Which parameter.
    reference : label or None, default=None
        Condition against which the others are compared; None compares all pairs.
    transform : {None, "log"}, default=None
        Scale of the estimates, of which means are taken.
    outlying : {"keep", "leave_out"}, default="keep"
        What becomes of rows that the table calls outlying.
    confidence : float, default=0.95
        Of intervals.
    adjust : {"holm", "bonferroni", "fdr", "none"}, default="holm"
        How p-values of pairs pay for their number.

    Returns
    -------
    result : RepeatedMeasuresResult
        The analysis, and paired t tests.

    Raises
    ------
    ValueError
        If there is no such parameter or option, or there are fewer than two conditions or two
        people with all of them.

    See Also
    --------
    mixed_model : Weighs runs by their precision, and uses people with missing conditions.

    Notes
    -----
    With the covariance S of k conditions over n people, orthonormal contrasts C and λ the
    eigenvalues of CSC', ε = (Σλ)² / ((k-1) Σλ²) [1]_. Huynh and Feldt's is (n(k-1)ε - 2) /
    ((k-1)(n-1-(k-1)ε)), 1 at most [2]_. W = Πλ / (Σλ/(k-1))^(k-1), tested by χ² of
    -(n-1-(2(k-1)²+k+1)/(6(k-1))) log W [3]_. Generalised η² = SS_condition / (SS_condition +
    SS_people + SS_rest) [4]_.

    References
    ----------
    .. [1] S. W. Greenhouse and S. Geisser, Psychometrika 24 (1959) 95-112.
    .. [2] H. Huynh and L. S. Feldt, J. Educ. Stat. 1 (1976) 69-82.
    .. [3] J. W. Mauchly, Ann. Math. Stat. 11 (1940) 204-209.
    .. [4] S. Olejnik and J. Algina, Psychol. Methods 8 (2003) 434-447.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import repeated_measures
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": list("aabbccdd"),
    ...         "condition": ["C1", "C2"] * 4,
    ...         "run": 1,
    ...         "unit": "s",
    ...         "parameter": "tau_e",
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...         "se": 0.01,
    ...         "outlying": "",
    ...         "failure": "",
    ...     }
    ... )
    >>> repeated_measures(table, "tau_e").anova[["F", "df1", "df2", "p"]].round(4)
          F  df1  df2       p
    0  147.0  1.0  3.0  0.0012
    """
    if adjust not in ADJUSTED:
        raise ValueError(f"adjust is {' or '.join(map(repr, ADJUSTED))}; got {adjust!r}.")
    rows = select(table, parameter, weighted=False, transform=transform, outlying=outlying)
    means, left_out = complete_means(rows)
    conditions = list(means.columns)
    if len(conditions) < 2:
        raise ValueError(
            f"{parameter} has one condition only ({conditions[0]}); mixed_model gives its mean."
        )
    if len(means) < 2:
        raise ValueError(
            f"{parameter} has {counted(len(means), 'person')} with runs in all of "
            f"{', '.join(map(str, conditions))}; two are needed. mixed_model uses the others too."
        )
    check_reference(reference, conditions)
    notes = list(rows.notes)
    if left_out:
        notes.append(f"without runs in some condition, left out: {', '.join(map(str, left_out))}")
    pairs = [(b, a) for a, b in combinations(conditions, 2)]
    if reference is not None:
        pairs = [(name, reference) for name in conditions if name != reference]
    return RepeatedMeasuresResult(
        parameter=parameter,
        unit=rows.unit,
        anova=_anova(means),
        pairs=_pairs(means, pairs, confidence, adjust),
        means=means,
        left_out=left_out,
        notes=notes,
        confidence=confidence,
        adjust=adjust,
        transform=transform,
    )


def complete_means(rows: Rows) -> tuple[pd.DataFrame, list[Any]]:
    """Means of runs of the people who have all conditions, and the others."""
    means = rows.runs.pivot_table(
        index="subject", columns="condition", values="value", aggfunc="mean", sort=False
    ).loc[rows.subjects, rows.conditions]
    whole = means.notna().all(axis=1)
    return means[whole], list(means.index[~whole])


def sphericity(values: np.ndarray) -> tuple[float, float, float, float]:
    """Epsilons of Greenhouse-Geisser and Huynh-Feldt, Mauchly's W and its p-value."""
    n, k = values.shape
    if k == 2:
        return 1.0, 1.0, 1.0, np.nan
    covariance = np.cov(values, rowvar=False)
    centred = np.eye(k) - 1.0 / k
    roots = np.linalg.eigvalsh(centred @ covariance @ centred)[1:]
    roots = np.maximum(roots, 0.0)
    epsilon = float(roots.sum() ** 2 / ((k - 1) * np.sum(roots**2)))
    below = (k - 1) * (n - 1 - (k - 1) * epsilon)
    corrected = min((n * (k - 1) * epsilon - 2.0) / below, 1.0) if below > 0.0 else 1.0
    if n - 1 < k - 1 or roots[0] <= 1e-12 * roots[-1]:
        return epsilon, max(corrected, epsilon), np.nan, np.nan
    w = float(np.exp(np.log(roots).sum() - (k - 1) * np.log(roots.mean())))
    chi2 = -(n - 1 - (2.0 * (k - 1) ** 2 + k + 1) / (6.0 * (k - 1))) * np.log(w)
    p = float(stats.chi2.sf(chi2, k * (k - 1) // 2 - 1))
    return epsilon, max(corrected, epsilon), w, p


def _anova(means: pd.DataFrame) -> pd.DataFrame:
    values = means.to_numpy(dtype=float)
    n, k = values.shape
    of_conditions = n * np.sum((values.mean(axis=0) - values.mean()) ** 2)
    rest = values - values.mean(axis=1, keepdims=True)
    left = np.sum((rest - rest.mean(axis=0)) ** 2)
    df1, df2 = k - 1.0, (n - 1.0) * (k - 1.0)
    F = float(of_conditions / df1 / (left / df2))
    gg, hf, w, p_w = sphericity(values)
    total = np.sum((values - values.mean()) ** 2)
    return pd.DataFrame(
        {
            "F": [F],
            "df1": df1,
            "df2": df2,
            "p": float(stats.f.sf(F, df1, df2)),
            "epsilon_gg": gg,
            "p_gg": float(stats.f.sf(F, gg * df1, gg * df2)),
            "epsilon_hf": hf,
            "p_hf": float(stats.f.sf(F, hf * df1, hf * df2)),
            "mauchly_W": w,
            "mauchly_p": p_w,
            "generalized_eta2": of_conditions / total,
        }
    )


def _pairs(
    means: pd.DataFrame, pairs: list[tuple[Any, Any]], confidence: float, adjust: str
) -> pd.DataFrame:
    records = []
    for condition, against in pairs:
        found = stats.ttest_rel(means[condition], means[against])
        difference = float((means[condition] - means[against]).mean())
        low, high = found.confidence_interval(confidence)
        records.append(
            {
                "condition": condition,
                "against": against,
                "difference": difference,
                "se": difference / found.statistic if found.statistic else np.nan,
                "df": float(found.df),
                "t": float(found.statistic),
                "p": float(found.pvalue),
                "p_adjusted": np.nan,
                "low": low,
                "high": high,
            }
        )
    table = pd.DataFrame(records)
    table["p_adjusted"] = adjusted(table["p"].to_numpy(dtype=float), adjust)
    return table
