"""Whether the assumptions of a mixed model hold, and whose data decide its conclusions.

Open it to add a check: a function that gives a row of the table.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from ....text import p_text
from ._model import SUBJECT, Fitted, adjusted, fit, without
from ._require import require

ALARM = 0.05  # p below which an assumption is doubted
MOST = 5000  # rows for which the p-value of Shapiro and Wilk is right
SAME = 1e-5  # difference of likelihoods that counts as none


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
    if model.groups:
        checks.append(_normal(f"normal {SUBJECT}", model.at.predicted(), "effects of people"))
    checks += [
        _equal_variances(model),
        _errors_and_scatter(model),
        _who_decides(influence),
        _likelihood(model),
    ]
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


def _likelihood(model: Fitted) -> Check:
    """The restricted likelihood at the optimum by other code, that of statsmodels."""
    name, rows, v = "likelihood", model.rows, model.at.variances
    if SUBJECT not in model.groups:
        return Check(name, np.nan, np.nan, None, "no random effect to compare with statsmodels")
    module = require("statsmodels.regression.mixed_linear_model", "mixed_model")
    root = np.sqrt(rows.weights)
    relative = np.maximum(v[:-1] / v[-1], 1e-9)  # at 0 statsmodels has no likelihood
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weighted = root * rows.y, root[:, None] * model.design
        other = module.MixedLM(*weighted, groups=rows.subject, exog_re=root[:, None])
        other.cov_pen = other.fe_pen = None  # set by its fit otherwise
        other.reml = True
        parameters = module.MixedLMParams.from_components(
            fe_params=model.at.beta, cov_re=relative.reshape(1, 1)
        )
        theirs = -2.0 * other.loglike(parameters, profile_fe=True)
    ours = model.at.criterion + model.at.equations.log_weights
    apart = float(abs(theirs - ours))
    ok = bool(apart < SAME * max(1.0, abs(ours)))
    said = "is that of statsmodels" if ok else f"differs from that of statsmodels by {apart:.2g}"
    return Check(name, apart, np.nan, ok, f"the restricted likelihood {said}")
