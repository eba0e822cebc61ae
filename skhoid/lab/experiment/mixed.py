"""mixed_model: a parameter of several people over conditions, by a linear mixed model."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

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
    number,
    p_text,
)
from .reml import FTest, MixedFit, fit_reml
from .rows import Cells, Rows, check_reference, select

ADJUSTED = ("holm", "bonferroni", "fdr", "none")
BETWEEN = "between people"


@dataclass(frozen=True)
class Contrasts:
    """Differences of pairs of conditions (positions), with their t tests."""

    pairs: list[tuple[int, int]]
    difference: np.ndarray
    se: np.ndarray
    df: np.ndarray
    p: np.ndarray

    @property
    def t(self) -> np.ndarray:
        return self.difference / self.se


@dataclass(frozen=True)
class Fitted:
    """A fitted model, and its tests; people are a random effect where ``has_people``."""

    rows: Rows
    has_people: bool
    at: MixedFit

    @property
    def design(self) -> np.ndarray:
        return np.eye(len(self.rows.conditions))[self.rows.condition]

    @property
    def between(self) -> float:
        """Variance between people; 0 where the model has none."""
        return float(self.at.variances[0]) if self.has_people else 0.0

    def residuals(self) -> np.ndarray:
        """What the fixed and the random effects leave, in standard deviations of the cell."""
        rows = self.rows
        rest = rows.y - self.design @ self.at.beta
        if self.has_people:
            rest = rest - self.at.effects[rows.subject]
        return rest * np.sqrt(rows.weights / self.at.variances[-1])

    def omnibus(self) -> FTest | None:
        """All conditions are the same."""
        n = len(self.rows.conditions)
        return self.at.test(np.eye(n)[1:] - np.eye(n)[:1]) if n > 1 else None

    def contrasts(self, reference: int | None) -> Contrasts:
        """All pairs, or all against the reference."""
        n = len(self.rows.conditions)
        pairs = [(j, i) for i, j in combinations(range(n), 2)]
        if reference is not None:
            pairs = [(i, reference) for i in range(n) if i != reference]
        L = np.array([np.eye(n)[i] - np.eye(n)[j] for i, j in pairs]).reshape(-1, n)
        difference, se, df = self.at.estimate(L)
        return Contrasts(pairs, difference, se, df, 2.0 * stats.t.sf(abs(difference / se), df))


def adjusted(p: np.ndarray, adjust: str) -> np.ndarray:
    """p-values that pay for their number.

    multipletests of statsmodels, which tests hold this to, collects garbage at each call: 0.1 s.
    """
    if adjust == "none" or p.size < 2:
        return p
    if adjust == "bonferroni":
        return np.minimum(p.size * p, 1.0)
    if adjust == "fdr":
        return stats.false_discovery_control(p)
    order = np.argsort(p)
    steps = np.maximum.accumulate((p.size - np.arange(p.size)) * p[order])
    holm = np.empty(p.size)
    holm[order] = np.minimum(steps, 1.0)
    return holm


def fit(rows: Rows) -> Fitted:
    """Fit it by REML; people are a random effect where some have several conditions."""
    has_people = rows.y.size > len(rows.subjects)
    design = np.eye(len(rows.conditions))[rows.condition]
    try:
        at = fit_reml(rows.y, design, rows.subject if has_people else None, rows.weights)
    except ValueError as error:
        raise ValueError(f"The mixed model of {rows.parameter} cannot be fitted: {error}") from None
    return Fitted(rows, has_people, at)


def without(rows: Rows, subject: Any) -> Rows | None:
    """The same cells without a person; None where too few people, or a condition less, are left."""
    kept = rows.subject != rows.subjects.index(subject)
    subjects = [name for name in rows.subjects if name != subject]
    if len(subjects) < 2 or np.unique(rows.condition[kept]).size < len(rows.conditions):
        return None
    cells = Cells(*(column[kept] for column in rows.cells))
    renumbered = np.unique(cells.subject, return_inverse=True)[1]
    return replace(rows, cells=cells._replace(subject=renumbered), subjects=subjects)


ALARM = 0.05  # p below which an assumption is doubted
MOST = 5000  # rows for which the p-value of Shapiro and Wilk is right


class Check(NamedTuple):
    """One check. ``ok`` is None where it could not be made."""

    check: str
    statistic: float
    p: float
    ok: bool | None
    said: str


def check_model(
    model: Fitted, reference: int | None, confidence: float, adjust: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """All checks, and the contrasts without each person."""
    influence = influence_of_people(model, reference, confidence, adjust)
    checks = [_normal("normal residuals", model.residuals(), "residuals")]
    if model.has_people:
        checks.append(_normal(f"normal {BETWEEN}", model.at.effects, "effects of people"))
    checks += [_equal_variances(model), _errors_and_scatter(model), _who_decides(influence)]
    return pd.DataFrame(checks), influence


def _normal(name: str, values: np.ndarray, what: str) -> Check:
    if values.size < 3 or np.ptp(values) <= 1e-12 * max(1.0, np.abs(values).max()):
        return Check(name, np.nan, np.nan, None, f"too few {what}, or they do not vary")
    w, p = stats.shapiro(values[:MOST])
    ok = bool(p >= ALARM)
    said = "look normal" if ok else "are not normal: look for outlying ones, or try another scale"
    return Check(name, float(w), float(p), ok, f"the {what} {said} (Shapiro-Wilk, {p_text(p)})")


def _equal_variances(model: Fitted) -> Check:
    name, rest = "equal variances", model.residuals()
    n = len(model.rows.conditions)
    groups = [rest[model.rows.condition == c] for c in range(n)]
    if n < 2 or min(map(len, groups)) < 3:
        return Check(name, np.nan, np.nan, None, "there are too few conditions, or people in one")
    f, p = stats.levene(*groups, center="median")
    ok = bool(p >= ALARM)
    said = "scatter alike in all conditions" if ok else "do not scatter alike in all conditions"
    return Check(name, float(f), float(p), ok, f"people {said} (Brown-Forsythe, {p_text(p)})")


def _errors_and_scatter(model: Fitted) -> Check:
    """The scatter of runs around the mean of their cell, relative to their standard errors."""
    name, rows = "standard errors", model.rows
    df = len(rows.runs) - int(rows.cell.max()) - 1
    values, errors = (rows.runs[name].to_numpy(dtype=float) for name in ("value", "value_se"))
    if df < 2 or not np.all(np.isfinite(errors) & (errors > 0.0)):
        return Check(name, np.nan, np.nan, None, "too few runs, or standard errors, to compare")
    w = 1.0 / errors**2
    means = np.bincount(rows.cell, w * values) / np.bincount(rows.cell, w)
    q = float(w @ (values - means[rows.cell]) ** 2)
    low, high = (float(np.sqrt(q / stats.chi2.isf(tail, df))) for tail in (0.025, 0.975))
    ratio = float(np.sqrt(q / df))
    p = float(2.0 * min(stats.chi2.sf(q, df), stats.chi2.cdf(q, df)))
    ok = bool(low <= 1.0 <= high)
    said = f"runs scatter {ratio:.2f} times ({low:.2f} to {high:.2f}) as much as their se say"
    if low > 1.0:
        said += (
            f"; the weights allow for a further sd of {rows.tau:.3g} between runs"
            if rows.tau
            else "; the weights do not use them"
        )
    return Check(name, ratio, p, ok, said)


def influence_of_people(
    model: Fitted, reference: int | None, confidence: float, adjust: str
) -> pd.DataFrame:
    """The contrasts without each person, and whether a conclusion changes.

    A conclusion changes if the adjusted p-value crosses 1 - confidence.
    """
    level, names = 1.0 - confidence, model.rows.conditions
    whole = model.contrasts(reference)
    before = adjusted(whole.p, adjust) < level
    records: list[dict[str, Any]] = []
    for subject in model.rows.subjects if len(names) > 1 else []:
        rows = without(model.rows, subject)
        if rows is None:
            continue
        found = fit(rows).contrasts(reference)
        p_adjusted = adjusted(found.p, adjust)
        for k, (i, j) in enumerate(found.pairs):
            records.append(
                {
                    "without": subject,
                    "condition": names[i],
                    "against": names[j],
                    "difference": found.difference[k],
                    "shift": (found.difference[k] - whole.difference[k]) / whole.se[k],
                    "p_adjusted": p_adjusted[k],
                    "changes": bool((p_adjusted[k] < level) != before[k]),
                }
            )
    columns = ["without", "condition", "against", "difference", "shift", "p_adjusted", "changes"]
    return pd.DataFrame(records, columns=columns)


def _who_decides(influence: pd.DataFrame) -> Check:
    name = "influence"
    if influence.empty:
        return Check(name, np.nan, np.nan, None, "nobody can be left out")
    largest = influence.loc[influence["shift"].abs().idxmax()]
    shift = float(abs(largest["shift"]))
    changing = influence[influence["changes"]]
    if changing.empty:
        said = (
            f"no single person changes a conclusion; the largest shift is {shift:.1f} se, without "
            f"{largest['without']}"
        )
        return Check(name, shift, np.nan, True, said)
    said = "; ".join(
        f"without {subject}, conclusions change on "
        + ", ".join(f"{r['condition']} - {r['against']}" for r in rows.to_dict("records"))
        for subject, rows in changing.groupby("without", sort=False)
    )
    return Check(name, shift, np.nan, False, said)


def mixed_model(
    table: pd.DataFrame,
    parameter: str,
    *,
    reference: Any = None,
    weighted: bool = True,
    transform: str | None = None,
    outlying: str = "keep",
    confidence: float = 0.95,
    adjust: str = "holm",
) -> MixedModelResult:
    """Compare the conditions of an experiment by a weighted linear mixed model.

    The second of two stages: the first identified each run, and gave an estimate with its standard
    error.

    Parameters
    ----------
    table : DataFrame
        Tidy table of parameters, one row for each fit and parameter, with the columns subject,
        condition, run, parameter, estimate, se, unit, outlying and failure.
    parameter : str
        Which parameter.
    reference : label or None, default=None
        Condition against which the others are compared; None compares all pairs.
    weighted : bool, default=True
        Whether precise runs count more. False gives each row the same weight.
    transform : {None, "log"}, default=None
        Scale of the model. With "log", means are geometric and contrasts are ratios too.
    outlying : {"keep", "leave_out"}, default="keep"
        What becomes of rows that the table calls outlying.
    confidence : float, default=0.95
        Of intervals, each for itself. 1 - confidence is the level of all conclusions.
    adjust : {"holm", "bonferroni", "fdr", "none"}, default="holm"
        How p-values of contrasts pay for their number.

    Returns
    -------
    result : MixedModelResult
        Tables of means, contrasts, variances, people and checks; ``summary()`` says them in words.

    Raises
    ------
    ValueError
        If there is no such parameter, condition or option; if there is one person only; if no row
        can be used, or none has a standard error; if "log" meets an estimate that is not above 0.

    See Also
    --------
    repeated_measures : The classical analysis of run means.
    write_long : The rows and an R script that reproduces the result.

    Notes
    -----
    First the runs r of person p in condition c become one value, with weights that count precise
    runs more; then conditions are compared over people:

        y_pc = Σ_r w_pcr y_pcr / Σ_r w_pcr,  w_pcr = 1 / (se_pcr² + τ²),  s_pc² = 1 / Σ_r w_pcr
        y_pc = β_c + b_p + ε_pc,  Var(ε_pc) = σ² / W_pc,  W_pc ∝ 1 / (s_pc² + τ_c²)

    with random b. It equals ``lmer(value ~ condition + (1 | subject), weights = cell_weight)``.
    Weights W have the mean 1. τ² is the variance between runs beyond their standard errors, τ_c²
    that of people in a condition beyond s² around subject + condition, both as Paule and Mandel
    estimate them [1]_, the latter one standard deviation large: one that is too small lets the most
    precise people decide alone. σ² makes up for standard errors that are all too small or large.
    Variances are those of the restricted likelihood (REML); standard errors, degrees of freedom
    and the F test are those of Kenward and Roger [2]_. What people differ in between conditions is
    part of ε: a random effect of its own, which cannot be below 0, would make tests too careful
    where people do not differ.

    Rows without a standard error get the largest one of their person and condition.

    References
    ----------
    .. [1] R. C. Paule and J. Mandel, "Consensus values and weighting factors", J. Res. Natl. Bur.
       Stand. 87 (1982) 377-385.
    .. [2] M. G. Kenward and J. H. Roger, "Small sample inference for fixed effects from restricted
       maximum likelihood", Biometrics 53 (1997) 983-997.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
    >>> rng = np.random.default_rng(0)
    >>> person = {f"S{p}": rng.normal(1.0, 0.2) for p in range(8)}
    >>> table = pd.DataFrame(
    ...     {
    ...         "subject": s,
    ...         "condition": c,
    ...         "run": r,
    ...         "estimate": k + 0.2 * (c == "C2") + rng.normal(0.0, 0.05),
    ...     }
    ...     for s, k in person.items()
    ...     for c in ("C1", "C2")
    ...     for r in range(4)
    ... ).assign(parameter="K_e", se=0.05, unit="", outlying="", failure="")
    >>> result = mixed_model(table, "K_e")
    >>> result.contrasts[["condition", "against", "difference", "se", "df"]].round(3)
      condition against  difference     se   df
    0        C2      C1       0.189  0.008  7.0
    """
    if adjust not in ADJUSTED:
        raise ValueError(f"adjust is {' or '.join(map(repr, ADJUSTED))}; got {adjust!r}.")
    if not 0.5 <= confidence < 1.0:
        raise ValueError(f"confidence is from 0.5 to below 1; got {confidence!r}.")
    rows = select(table, parameter, weighted=weighted, transform=transform, outlying=outlying)
    if len(rows.subjects) < 2:
        raise ValueError(
            f"{parameter} has rows of one person only ({rows.subjects[0]}). A mixed model needs "
            "at least two people, and is of use from about six; compare the runs of one person by "
            "a t test."
        )
    check_reference(reference, rows.conditions)
    position = None if reference is None else rows.conditions.index(reference)
    return _result(fit(rows), position, transform, confidence, adjust)


def _result(
    model: Fitted, reference: int | None, transform: str | None, confidence: float, adjust: str
) -> MixedModelResult:
    rows = model.rows
    omnibus = model.omnibus()
    contrasts = _contrasts(model, reference, transform, confidence, adjust)
    checks, influence = check_model(model, reference, confidence, adjust)
    return MixedModelResult(
        parameter=rows.parameter,
        unit=rows.unit,
        transform=transform,
        confidence=confidence,
        adjust=adjust,
        reference=None if reference is None else rows.conditions[reference],
        effects=_effects(model, transform, confidence),
        contrasts=contrasts,
        omnibus=omnibus,
        variances=_variances(model),
        people=_people(model, transform, confidence),
        checks=checks,
        influence=influence,
        notes=_notes(model, contrasts),
        data=rows.data,
        tau=rows.tau,
        tau_cells=rows.tau_cells,
        criterion=model.at.criterion,
    )


def _effects(model: Fitted, transform: str | None, confidence: float) -> pd.DataFrame:
    mean, se, df = model.at.estimate(np.eye(len(model.rows.conditions)))
    reach = stats.t.isf((1.0 - confidence) / 2.0, df) * se
    low, high = mean - reach, mean + reach
    if transform == "log":
        mean, low, high = np.exp(mean), np.exp(low), np.exp(high)
        se = se * mean
    counts = np.bincount(model.rows.condition[model.rows.cell])
    return pd.DataFrame(
        {
            "condition": model.rows.conditions,
            "mean": mean,
            "se": se,
            "df": df,
            "low": low,
            "high": high,
            "n_rows": counts,
        }
    )


def _contrasts(
    model: Fitted, reference: int | None, transform: str | None, confidence: float, adjust: str
) -> pd.DataFrame:
    found, names = model.contrasts(reference), model.rows.conditions
    quantile = stats.t.isf((1.0 - confidence) / 2.0, found.df)
    low, high = found.difference - quantile * found.se, found.difference + quantile * found.se
    table = pd.DataFrame(
        {
            "condition": [names[i] for i, _ in found.pairs],
            "against": [names[j] for _, j in found.pairs],
            "difference": found.difference,
            "se": found.se,
            "df": found.df,
            "t": found.t,
            "p": found.p,
            "p_adjusted": adjusted(found.p, adjust),
            "low": low,
            "high": high,
        }
    )
    d, d_se = _effect_size(model, found.difference, found.se)
    table["d"], table["d_low"], table["d_high"] = d, d - quantile * d_se, d + quantile * d_se
    if transform == "log":
        for name, values in (("", found.difference), ("_low", low), ("_high", high)):
            table[f"ratio{name}"] = np.exp(values)
    return table


def _effect_size(
    model: Fitted, difference: np.ndarray, se: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Differences relative to the standard deviation of people, by the delta method."""
    variance = model.between
    if not variance > 0.0:
        return np.full(difference.size, np.nan), np.full(difference.size, np.nan)
    of_variance = float(model.at.variance_covariance[0, 0])
    d = difference / np.sqrt(variance)
    return d, np.sqrt(se**2 / variance + d**2 * of_variance / (4.0 * variance**2))


def _variances(model: Fitted) -> pd.DataFrame:
    errors = np.sqrt(np.maximum(np.diag(model.at.variance_covariance), 0.0))
    names = [*[BETWEEN] * model.has_people, "within"]
    variance = model.at.variances
    return pd.DataFrame(
        {
            "source": names,
            "variance": variance,
            "se": errors,
            "sd": np.sqrt(variance),
            "share": variance / variance.sum(),
        }
    )


def _people(model: Fitted, transform: str | None, confidence: float) -> pd.DataFrame:
    """Each person in each condition (BLUP), also where there are no runs."""
    rows, at = model.rows, model.at
    df = model.at.estimate(np.eye(len(rows.conditions)))[2]
    n_runs = np.bincount(rows.cell)
    records = []
    for p, subject in enumerate(rows.subjects):
        for c, condition in enumerate(rows.conditions):
            here = (rows.subject == p) & (rows.condition == c)
            variance, value = at.plain[c, c], at.beta[c]
            if model.has_people:
                variance += 2.0 * at.cross_covariance[c, p] + at.effect_covariance[p, p]
                value += at.effects[p]
            reach = stats.t.isf((1.0 - confidence) / 2.0, df[c]) * np.sqrt(variance)
            ends = np.array([value, value - reach, value + reach])
            value, low, high = np.exp(ends) if transform == "log" else ends
            records.append((subject, condition, value, low, high, int(n_runs[here].sum())))
    names = ["subject", "condition", "estimate", "low", "high", "n_rows"]
    return pd.DataFrame(records, columns=names)


def _notes(model: Fitted, contrasts: pd.DataFrame) -> list[str]:
    rows: Rows = model.rows
    notes = list(rows.notes)
    empty = [
        f"{subject} in {condition}"
        for p, subject in enumerate(rows.subjects)
        for c, condition in enumerate(rows.conditions)
        if not ((rows.subject == p) & (rows.condition == c)).any()
    ]
    if empty:
        notes.append(f"no rows of {', '.join(empty)}: the others of the person still count")
    if model.has_people and model.between <= 0.0:
        notes.append(f"the variance {BETWEEN} is estimated as 0, its lower bound")
    if len(rows.subjects) < 6:
        notes.append(f"{len(rows.subjects)} people tell little about people in general")
    if len(contrasts) and model.has_people:
        sd = float(np.sqrt(model.between))
        notes.append(f"d is the difference divided by the sd of people, {sd:.4g} ({BETWEEN})")
    return notes


@dataclass(frozen=True, eq=False, repr=False)
class MixedModelResult(Told):
    """What :func:`mixed_model` found.

    Parameters
    ----------
    parameter : str
        The parameter.
    unit : str
        Its unit, or nothing.
    transform : {None, "log"}
        Scale of the model.
    confidence : float
        Of the intervals.
    adjust : str
        How p-values pay for their number.
    reference : label or None
        Condition against which the others were compared; None for all pairs.
    effects : DataFrame
        ``condition``, ``mean`` (over people; geometric with "log"), ``se``, ``df``, ``low``,
        ``high``, ``n_rows``.
    contrasts : DataFrame
        ``condition``, ``against``, ``difference``, ``se``, ``df``, ``t``, ``p``, ``p_adjusted``,
        ``low``, ``high``, and ``d``, ``d_low``, ``d_high``: the difference divided by the standard
        deviation of people. With "log", differences are those of logarithms, and ``ratio``,
        ``ratio_low`` and ``ratio_high`` say them as ratios. Intervals are not adjusted.
    omnibus : FTest or None
        ``F``, ``df1``, ``df2`` and ``p`` of no difference at all; None with one condition.
    variances : DataFrame
        ``source`` (between people; within: people in a condition, of weight 1), ``variance``,
        ``se``, ``sd`` and ``share``.
    people : DataFrame
        ``subject``, ``condition``, ``estimate`` (BLUP: drawn towards the mean as far as its runs
        are few or uncertain), ``low``, ``high``, ``n_rows``.
    checks : DataFrame
        ``check``, ``statistic``, ``p``, ``ok`` (None where it could not be made), ``said``.
    influence : DataFrame
        Contrasts ``without`` each person, their ``shift`` in standard errors, and whether a
        conclusion ``changes``.
    notes : list of str
        What was left out, and how what is missing was handled.
    data : DataFrame
        All rows of the parameter, with ``value`` and ``value_se`` on the scale of the model,
        ``weight`` (the run's share of its person and condition), ``cell_weight`` (that of the
        person and condition, with the mean 1) and ``left_out``: the reason, or nothing.
    tau : float
        Standard deviation between runs beyond their standard errors.
    tau_cells : float
        That of people in a condition beyond the standard errors of their means.
    criterion : float
        -2 log of the restricted likelihood.

    See Also
    --------
    skhoid.lab.experiment.mixed_model : Makes it.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.experiment import mixed_model
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
    >>> result = mixed_model(table, "tau_e")
    >>> result
    MixedModelResult('tau_e', 4 people, 2 conditions, 8 rows)
    >>> result.effects[["condition", "mean", "low", "high"]].round(2)
      condition  mean   low  high
    0        C1  0.22  0.18  0.26
    1        C2  0.25  0.21  0.29
    """

    parameter: str
    unit: str
    transform: str | None
    confidence: float
    adjust: str
    reference: Any
    effects: pd.DataFrame
    contrasts: pd.DataFrame
    omnibus: FTest | None
    variances: pd.DataFrame
    people: pd.DataFrame
    checks: pd.DataFrame
    influence: pd.DataFrame
    notes: list[str]
    data: pd.DataFrame
    tau: float
    tau_cells: float
    criterion: float

    def __repr__(self) -> str:
        used = int((self.data["left_out"] == "").sum())
        return (
            f"MixedModelResult({self.parameter!r}, {self.people['subject'].nunique()} people, "
            f"{len(self.effects)} conditions, {used} rows)"
        )

    @property
    def own_means(self) -> pd.DataFrame:
        """Weighted means of the runs of each person, with intervals; not drawn to the group."""
        used = self.data[self.data["left_out"] == ""]
        within = float(self.variances.set_index("source").loc["within", "variance"])
        quantile = stats.norm.isf((1.0 - self.confidence) / 2.0)
        records = []
        for key, rows in used.groupby(["subject", "condition"], sort=False):
            mean = float(rows["weight"] @ rows["value"])
            reach = quantile * np.sqrt(within / float(rows["cell_weight"].iloc[0]))
            ends = np.array([mean, mean - reach, mean + reach])
            mean, low, high = np.exp(ends) if self.transform == "log" else ends
            records.append((*key, mean, low, high, len(rows)))
        names = ["subject", "condition", "estimate", "low", "high", "n_rows"]
        return pd.DataFrame(records, columns=names)

    def document(self) -> Document:
        """The result in plain words.

        Returns
        -------
        document : Document
        """
        used = int((self.data["left_out"] == "").sum())
        title = (
            f"{self.parameter}: linear mixed model (REML) of {used} rows, "
            f"{self.people['subject'].nunique()} people, "
            f"{counted(len(self.effects), 'condition')}."
        )
        log = self.transform == "log"
        unit = f", {self.unit}" if self.unit else ""
        blocks: list[Block] = [
            TextTable(
                f"{'Geometric means' if log else 'Means'} over people{unit}, with "
                f"{100 * self.confidence:g} % intervals",
                ("", "mean", "from", "to", "rows"),
                [
                    [str(row["condition"]), *_ends(row, "mean"), str(row["n_rows"])]
                    for row in self.effects.to_dict("records")
                ],
            )
        ]
        if self.omnibus is not None:
            F = self.omnibus
            verdict = "differ" if F.p < 1.0 - self.confidence else "do not differ beyond chance"
            blocks += [
                Paragraph(
                    f"The conditions {verdict}: F({F.df1:.0f}, {F.df2:.1f}) = {F.F:.2f}, "
                    f"{p_text(F.p)}.",
                    "verdict",
                ),
                self._tell_contrasts(),
            ]
        rows = [[row["source"], f"{row['sd']:.4g}"] for row in self.variances.to_dict("records")]
        of = " of the logarithm" if log else unit
        marks = {True: "ok", False: "doubtful", None: "not known"}
        blocks += [
            TextTable(f"Standard deviations{of}", ("", "sd"), rows),
            Heading("Checks"),
            Items(
                [
                    Item(f"{marks[row['ok']]}: {row['said']}")
                    for row in self.checks.to_dict("records")
                ],
                numbered=False,
            ),
            Notes([Note("", text) for text in self.notes]),
        ]
        return Document(title, blocks)

    def _tell_contrasts(self) -> TextTable:
        log, level = self.transform == "log", 1.0 - self.confidence
        rows = []
        for row in self.contrasts.to_dict("records"):
            name, sign = ("ratio", "/") if log else ("difference", "-")
            ends = [f"{row[f'{name}{end}']:.3f}" for end in ("", "_low", "_high")] if log else None
            size = f"{row['d']:.2f}" if np.isfinite(row["d"]) else "-"
            star = " *" if row["p_adjusted"] < level else ""
            test = f"t({row['df']:.1f}) = {row['t']:.2f}"
            pair = f"{row['condition']} {sign} {row['against']}"
            p = p_text(row["p_adjusted"]) + star
            rows.append([pair, *(ends or _ends(row, "difference")), test, p, size])
        what = "Ratios" if log else f"Differences{f', {self.unit}' if self.unit else ''}"
        caption = f"{what} of conditions (p adjusted: {self.adjust}; intervals are not)"
        return TextTable(
            caption, ("", what.split(",")[0].lower(), "from", "to", "", "p", "d"), rows
        )


def _ends(row: dict[str, Any], name: str) -> list[str]:
    """A number and the ends of its interval, as exact as its standard error allows."""
    return [number(row[key], row["se"]) for key in (name, "low", "high")]
