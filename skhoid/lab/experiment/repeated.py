"""repeated_measures: the classical analysis of variance of run means, with its corrections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from ...text import Document, Note, Notes, Paragraph, TextTable, Told, counted, number, p_text
from .factors import list_pairs
from .mixed import ALPHA, holm
from .rows import select


@dataclass(frozen=True, eq=False)
class RepeatedMeasuresResult(Told):
    """What :func:`repeated_measures` found.

    Parameters
    ----------
    parameter : str
        The parameter.
    anova : DataFrame
        One row: ``F``, ``df1``, ``df2``, ``p``; ``epsilon_gg``, ``p_gg`` (Greenhouse and Geisser),
        ``epsilon_hf``, ``p_hf`` (Huynh and Feldt); ``mauchly_W`` and ``mauchly_p``;
        ``generalized_eta2``.
    pairs : DataFrame
        ``condition``, ``against``, ``difference``, ``se``, ``df``, ``t``, ``p``, ``p_adjusted``
        (Holm), and 95 % intervals ``low``, ``high``, of paired t tests.
    means : DataFrame
        Means of runs: a row for each person, a column for each condition.
    notes : list of str
        What was left out, and who has no runs in some condition.
    """

    parameter: str
    anova: pd.DataFrame
    pairs: pd.DataFrame
    means: pd.DataFrame
    notes: list[str]

    def document(self) -> Document:
        """The result in plain words."""
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
        header = ("", "difference", "from", "to", "test", "p")
        table = TextTable("Paired t tests (p adjusted: Holm)", header, rows)
        notes = Notes([Note("", note) for note in self.notes])
        return Document(title, [Paragraph(text), table, notes])


def repeated_measures(
    table: pd.DataFrame,
    parameter: str,
    *,
    reference: Any = None,
    transform: str | None = None,
    outlying: str = "keep",
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

    Returns
    -------
    result : RepeatedMeasuresResult
        The analysis, and paired t tests.

    Raises
    ------
    ValueError
        If there is no such parameter or option, or there are fewer than two conditions or two
        people with all of them.

    Notes
    -----
    With the covariance S of k conditions over n people, orthonormal contrasts C and λ the
    eigenvalues of CSC', ε = (Σλ)² / ((k-1) Σλ²) [1]_. Huynh and Feldt's is (n(k-1)ε - 2) /
    ((k-1)(n-1-(k-1)ε)), 1 at most [2]_. W = Πλ / (Σλ/(k-1))^(k-1), tested by χ² of
    -(n-1-(2(k-1)²+k+1)/(6(k-1))) log W [3]_. Generalised η² = SS_condition / SS_all [4]_.

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
    ...         "estimate": [0.21, 0.24, 0.25, 0.29, 0.19, 0.23, 0.22, 0.25],
    ...     }
    ... ).assign(parameter="tau_e", unit="s", se=0.01, outlying="", failure="")
    >>> repeated_measures(table, "tau_e").anova[["F", "df1", "df2", "p"]].round(4)
          F  df1  df2       p
    0  147.0  1.0  3.0  0.0012
    """
    rows = select(table, parameter, transform=transform, outlying=outlying)
    means = rows.used.pivot_table(
        index="subject", columns="condition", values="value", aggfunc="mean", sort=False
    ).loc[rows.subjects, rows.conditions]
    whole = means.notna().all(axis=1)
    means, left_out = means[whole], list(means.index[~whole])
    if len(rows.conditions) < 2:
        raise ValueError(
            f"{parameter} has one condition only ({rows.conditions[0]}); mixed_model gives its "
            "mean."
        )
    if len(means) < 2:
        raise ValueError(
            f"{parameter} has {counted(len(means), 'person')} with runs in all of "
            f"{', '.join(map(str, rows.conditions))}; two are needed. mixed_model uses the others "
            "too."
        )
    pairs = [
        (rows.conditions[i], rows.conditions[j]) for i, j in list_pairs(rows.conditions, reference)
    ]
    notes = list(rows.notes)
    if left_out:
        notes.append(f"without runs in some condition, left out: {', '.join(map(str, left_out))}")
    return RepeatedMeasuresResult(parameter, _anova(means), _compare(means, pairs), means, notes)


def sphericity(values: np.ndarray) -> tuple[float, float, float, float]:
    """Epsilons of Greenhouse-Geisser and Huynh-Feldt, Mauchly's W and its p-value."""
    n, k = values.shape
    if k == 2:
        return 1.0, 1.0, 1.0, np.nan
    centred = np.eye(k) - 1.0 / k
    roots = np.linalg.eigvalsh(centred @ np.cov(values, rowvar=False) @ centred)[1:]
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
    p, p_gg, p_hf = (float(stats.f.sf(F, e * df1, e * df2)) for e in (1.0, gg, hf))
    row = {"F": F, "df1": df1, "df2": df2, "p": p}
    row |= {"epsilon_gg": gg, "p_gg": p_gg, "epsilon_hf": hf, "p_hf": p_hf}
    row |= {"mauchly_W": w, "mauchly_p": p_w}
    eta2 = of_conditions / np.sum((values - values.mean()) ** 2)
    return pd.DataFrame([row | {"generalized_eta2": eta2}])


def _compare(means: pd.DataFrame, pairs: list[tuple[Any, Any]]) -> pd.DataFrame:
    records = []
    for condition, against in pairs:
        found = stats.ttest_rel(means[condition], means[against])
        apart = means[condition] - means[against]
        row = {"condition": condition, "against": against, "difference": apart.mean()}
        row |= {"se": stats.sem(apart), "df": float(found.df), "t": float(found.statistic)}
        low, high = found.confidence_interval(1.0 - ALPHA)
        records.append(row | {"p": float(found.pvalue), "low": low, "high": high})
    table = pd.DataFrame(records)
    table.insert(7, "p_adjusted", holm(table["p"].to_numpy(dtype=float)))
    return table
