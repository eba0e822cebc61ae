"""Statistics of a study's table by cell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from .blocks import ERROR, REPLICATION, SEED


def summarize(
    table: pd.DataFrame,
    by: str | Sequence[str] | None = None,
    values: str | Sequence[str] | None = None,
    *,
    statistic: str | Callable[[np.ndarray], float] = "mean",
    quantiles: Sequence[float] = (0.05, 0.25, 0.5, 0.75, 0.95),
    confidence: float = 0.95,
    n_resamples: int = 999,
    random_state: int = 0,
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
        Statistic for which to give the confidence interval; a callable takes an array of values.
        The interval is Student's t for a mean, Wilson's for a proportion (the mean of truth
        values), and percentiles of bootstrap samples otherwise.
    quantiles : sequence of float, default=(0.05, 0.25, 0.5, 0.75, 0.95)
        Quantiles to give.
    confidence : float, default=0.95
        Confidence level of the interval.
    n_resamples : int, default=999
        Bootstrap samples.
    random_state : int, default=0
        Seed of the bootstrap samples.

    Returns
    -------
    summary : DataFrame
        One row per cell and value, with ``n`` (values that are not NaN), ``missing``, ``mean``,
        ``sd``, ``q05`` ..., the statistic under its own name if it is not the mean, and the
        interval ``low`` and ``high`` (NaN with fewer than two values).

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
    if not 0 < confidence < 1:
        raise ValueError(f"confidence must be between 0 and 1; got {confidence!r}.")
    if not all(0 <= q <= 1 for q in quantiles):
        raise ValueError(f"quantiles must be between 0 and 1; got {quantiles!r}.")
    name, compute = _statistic(statistic)
    made = {"value", "n", "missing", "mean", "sd", "low", "high", name, *map(_label, quantiles)}
    if taken := sorted(made.intersection(by)):
        raise ValueError(
            f"The cells have a column {taken[0]!r}, which the summary uses itself: rename it "
            "first, with "
            f"table.rename(columns={{{taken[0]!r}: ...}})."
        )
    rows = []
    groups = table.groupby(by, sort=False, dropna=False) if by else [((), table)]
    for key, group in groups:
        for value in values:
            x = group[value].to_numpy(dtype=float)
            known = x[~np.isnan(x)]
            row: dict[str, Any] = dict(zip(by, key, strict=True)) | {"value": value}
            row |= {"n": known.size, "missing": x.size - known.size}
            with np.errstate(invalid="ignore"):  # infinities have no deviation
                row["mean"] = known.mean() if known.size else np.nan
                row["sd"] = _deviation(known)
                for q in quantiles:
                    row[_label(q)] = np.quantile(known, q) if known.size else np.nan
                if name != "mean":
                    row[name] = compute(known) if known.size else np.nan
                if name == "mean" and table[value].dtype == bool:
                    row["low"], row["high"] = _share(known, confidence)
                else:
                    row["low"], row["high"] = _interval(
                        known, name, compute, confidence, n_resamples, random_state
                    )
            rows.append(row)
    return pd.DataFrame(rows).set_index([*by, "value"])


def _label(quantile: float) -> str:
    whole, dot, rest = f"{round(100 * quantile, 6):g}".partition(".")
    return f"q{whole.zfill(2)}{dot}{rest}"


def _deviation(x: np.ndarray) -> float:
    return float(x.std(ddof=1)) if x.size > 1 else np.nan


def _statistic(statistic: Any) -> tuple[str, Callable[[np.ndarray], float]]:
    known = {"mean": np.mean, "median": np.median, "std": _deviation}
    if isinstance(statistic, str):
        if statistic not in known:
            raise ValueError(
                f"statistic must be one of {list(known)} or a function; got {statistic!r}."
            )
        return statistic, known[statistic]  # type: ignore[return-value]
    return getattr(statistic, "__name__", "statistic"), statistic


def _share(x: np.ndarray, confidence: float) -> tuple[float, float]:
    if not x.size:
        return np.nan, np.nan
    found = stats.binomtest(int(x.sum()), x.size).proportion_ci(confidence, method="wilson")
    return float(found.low), float(found.high)


def _interval(
    x: np.ndarray,
    name: str,
    compute: Callable[[np.ndarray], float],
    confidence: float,
    n_resamples: int,
    random_state: int,
) -> tuple[float, float]:
    if x.size < 2:
        return np.nan, np.nan
    if np.ptp(x) == 0 and name in ("mean", "median"):
        return float(x[0]), float(x[0])
    if name == "mean":
        # stats.t.interval and stats.sem round differently in the last bits.
        half = stats.t.ppf((1 + confidence) / 2, x.size - 1) * x.std(ddof=1) / np.sqrt(x.size)
        return float(x.mean() - half), float(x.mean() + half)
    rng = np.random.default_rng(random_state)
    # stats.bootstrap would draw other numbers from the same seed.
    found = [compute(rng.choice(x, x.size)) for _ in range(n_resamples)]
    low, high = np.quantile(found, [(1 - confidence) / 2, (1 + confidence) / 2])
    return float(low), float(high)
