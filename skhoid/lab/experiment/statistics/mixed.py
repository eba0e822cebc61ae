"""mixed_model: a parameter of several people over conditions, by a linear mixed model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from ._model import ADJUSTED, SUBJECT, Fitted, adjusted, fit
from ._require import require
from .checks import check_model
from .result import MixedModelResult
from .rows import Rows, check_reference, select


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
    ImportError
        If statsmodels is missing: ``pip install "skhoid[statistics]"``.

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
    require("statsmodels", "mixed_model")
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
    mean, se, df = model.kr.rows(np.eye(len(model.rows.conditions)))
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
    variance = model.variance(SUBJECT)
    if not variance > 0.0:
        return np.full(difference.size, np.nan), np.full(difference.size, np.nan)
    of_variance = float(model.kr.variance_covariance[0, 0])
    d = difference / np.sqrt(variance)
    return d, np.sqrt(se**2 / variance + d**2 * of_variance / (4.0 * variance**2))


def _variances(model: Fitted) -> pd.DataFrame:
    errors = np.sqrt(np.maximum(np.diag(model.kr.variance_covariance), 0.0))
    names = [*model.groups, "within"]
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
    rows, at, spread = model.rows, model.at, model.at.spread()
    effects = at.predicted()
    inner = np.diag(spread) - spread[:, None] * at.zpz * spread
    across = -at.covariance @ (spread[:, None] * at.zvx).T
    df = model.kr.rows(np.eye(len(rows.conditions)))[2]
    n_runs = np.bincount(rows.cell)
    records = []
    for p, subject in enumerate(rows.subjects):
        for c, condition in enumerate(rows.conditions):
            here = (rows.subject == p) & (rows.condition == c)
            chosen = (np.arange(effects.size) == p).astype(float)
            variance = at.covariance[c, c] + 2.0 * across[c] @ chosen + chosen @ inner @ chosen
            value = at.beta[c] + chosen @ effects
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
    for name in model.groups:
        if model.variance(name) <= 0.0:
            notes.append(f"the variance {name} is estimated as 0, its lower bound")
    if len(rows.subjects) < 6:
        notes.append(f"{len(rows.subjects)} people tell little about people in general")
    if len(contrasts) and model.groups:
        sd = float(np.sqrt(model.variance(SUBJECT)))
        notes.append(f"d is the difference divided by the sd of people, {sd:.4g} ({SUBJECT})")
    return notes
