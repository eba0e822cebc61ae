"""Statistics of a study's table by cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from .blocks import ERROR, REPLICATION, SEED

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
CONFIDENCE = 0.95
N_RESAMPLES = 999  # bootstrap samples


def _deviation(x: np.ndarray) -> float:
    return float(x.std(ddof=1)) if x.size > 1 else np.nan


STATISTICS: dict[Any, Callable[[np.ndarray], Any]] = {
    "mean": np.mean,
    "median": np.median,
    "std": _deviation,
}


def summarize(
    table: pd.DataFrame,
    by: str | Sequence[str] | None = None,
    values: str | Sequence[str] | None = None,
    *,
    statistic: str | Callable[[np.ndarray], float] = "mean",
) -> pd.DataFrame:
    """Means, standard deviations, quantiles and a confidence interval, by cell.

    Parameters
    ----------
    table : DataFrame
        Results of :meth:`MonteCarloStudy.run`.
    by : str, sequence of str or None, default=None
        Columns that define a cell; None means those before ``replication``. Include columns that
        the function returned, such as a setting, if they define cells too.
    values : str, sequence of str or None, default=None
        Columns to describe; None means all with numbers or truth values.
    statistic : {"mean", "median", "std"} or callable, default="mean"
        Statistic for which to give the 95 % confidence interval; a callable takes an array of
        values. The interval is Student's t for a mean, Wilson's for a proportion (the mean of truth
        values), and percentiles of 999 bootstrap samples otherwise.

    Returns
    -------
    summary : DataFrame
        One row per cell and value, with ``n`` (values that are not NaN), ``missing``, ``mean``,
        ``sd``, ``q05``, ``q25``, ``q50``, ``q75``, ``q95``, the statistic under its own name if it
        is not the mean, and the interval ``low`` and ``high`` (NaN with fewer than two values).

    Raises
    ------
    ValueError
        If a column is missing.

    Examples
    --------
    >>> import pandas as pd
    >>> from skhoid.lab.studies import summarize
    >>> table = pd.DataFrame(
    ...     {"condition": ["C1"] * 4, "replication": range(4), "nk": [28.0, 29.0, 29.0, 30.0]}
    ... )
    >>> summarize(table)[["n", "mean", "sd", "low", "high"]].round(2)
                     n  mean    sd  low  high
    condition value
    C1        nk     4  29.0  0.82 27.7  30.3
    """
    columns = list(table.columns)
    if by is None:
        if REPLICATION not in columns:
            raise ValueError(
                "The table has no column 'replication', so the cells are not known: name their "
                "columns (by=)."
            )
        by = columns[: columns.index(REPLICATION)]
    by = [by] if isinstance(by, str) else list(by)
    if values is None:
        numbers = table.select_dtypes(["number", "bool"]).columns
        values = [name for name in numbers if name not in {*by, REPLICATION, ERROR, SEED}]
    values = [values] if isinstance(values, str) else list(values)
    missing = [name for name in [*by, *values] if name not in columns]
    if missing:
        raise ValueError(f"The table has no column {missing[0]!r}; it has {columns}.")
    if isinstance(statistic, str) and statistic not in STATISTICS:
        raise ValueError(
            f"statistic must be one of {list(STATISTICS)} or a function; got {statistic!r}."
        )
    compute: Any = STATISTICS.get(statistic, statistic)
    name = statistic if isinstance(statistic, str) else getattr(statistic, "__name__", "statistic")
    rows = []
    groups = table.groupby(by, sort=False, dropna=False) if by else [((), table)]
    for key, group in groups:
        for value in values:
            x = group[value].to_numpy(dtype=float)
            known = x[~np.isnan(x)]
            row: dict[str, Any] = dict(zip(by, key, strict=True)) | {"value": value}
            row |= {"n": known.size, "missing": x.size - known.size}
            row["mean"] = known.mean() if known.size else np.nan
            row["sd"] = _deviation(known)
            for q in QUANTILES:
                row[f"q{100 * q:02.0f}"] = np.quantile(known, q) if known.size else np.nan
            if name != "mean":
                row[name] = compute(known) if known.size else np.nan
            share = name == "mean" and table[value].dtype == bool
            row["low"], row["high"] = _interval(known, "share" if share else name, compute)
            rows.append(row)
    return pd.DataFrame(rows).set_index([*by, "value"])


def _interval(
    x: np.ndarray, name: str, compute: Callable[[np.ndarray], float]
) -> tuple[float, float]:
    if x.size < (1 if name == "share" else 2):
        return np.nan, np.nan
    if name == "share":
        found = stats.binomtest(int(x.sum()), x.size).proportion_ci(CONFIDENCE, method="wilson")
        return float(found.low), float(found.high)
    if name == "mean":
        half = stats.t.ppf((1 + CONFIDENCE) / 2, x.size - 1) * stats.sem(x)
        return float(x.mean() - half), float(x.mean() + half)
    # stats.bootstrap would draw other numbers from the same seed.
    rng = np.random.default_rng(0)
    again = [compute(rng.choice(x, x.size)) for _ in range(N_RESAMPLES)]
    low, high = np.quantile(again, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)
