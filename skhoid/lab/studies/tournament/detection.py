"""One detector of changes for all methods, and what its alarms are worth.

The level of ln K_edot over the last 1.28 s is compared with its median before; an alarm is given
where they differ by more than a threshold. The threshold is that which one in ten of a method's
runs without a change exceeds. Dividing by the method's standard deviation first would change
nothing: thresholds would be divided by it too.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

LAST = 1.28  # s that an alarm looks at
N_THRESHOLDS = 24
THRESHOLDS = np.geomspace(0.02, 3.0, N_THRESHOLDS)  # of |Δ ln K_edot|
ALARMS = [f"alarm_{i:02d}" for i in range(N_THRESHOLDS)]
FALSE_ALARMS = 0.1


def alarms(time: np.ndarray, K_edot: np.ndarray, baseline: tuple[float, float]) -> dict[str, float]:
    """The largest difference from the baseline after it, and when each threshold is exceeded.

    Instants without an estimate, or with one that is not positive, are left out.
    """
    found = {"peak": np.nan} | dict.fromkeys(ALARMS, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        level = np.where(K_edot > 0, np.log(K_edot), np.nan)
    level[~np.isfinite(level)] = np.nan
    before = level[(time >= baseline[0]) & (time <= baseline[1])]
    if not np.isfinite(before).any():
        return found
    width = max(1, round(LAST / float(np.median(np.diff(time)))))
    recent = pd.Series(level).rolling(width, min_periods=1).mean().to_numpy()
    later = time > baseline[1]
    apart = np.abs(recent[later] - np.nanmedian(before))
    apart = np.where(np.isfinite(apart), apart, 0.0)
    if not apart.size:
        return found
    so_far = np.maximum.accumulate(apart)
    found["peak"] = float(so_far[-1])
    first = np.searchsorted(so_far, THRESHOLDS)
    instants = np.append(time[later], np.nan)
    return found | dict(zip(ALARMS, instants[first].tolist(), strict=True))


def roc_area(changed: np.ndarray, constant: np.ndarray) -> float:
    """Area under the ROC of peaks: the share of pairs in which the changed run has the larger one.

    Runs without an estimate count as peaks of zero (Mann and Whitney; Hanley and McNeil 1982).
    """
    changed, constant = (np.nan_to_num(np.asarray(x, float)) for x in (changed, constant))
    if not changed.size or not constant.size:
        return np.nan
    larger = (changed[:, None] > constant).mean()
    return float(larger + 0.5 * (changed[:, None] == constant).mean())


def threshold_of(constant: np.ndarray) -> int | None:
    """Position of the first threshold that at most one in ten constant runs exceeds."""
    constant = np.nan_to_num(np.asarray(constant, float))
    if not constant.size:
        return None
    shares = (constant[:, None] >= THRESHOLDS).mean(axis=0)
    enough = np.flatnonzero(shares <= FALSE_ALARMS)
    return int(enough[0]) if enough.size else None


def detection_table(table: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Detection by method and the columns of ``by``, from rows of K_edot with ``kind``.

    ``roc_area``; and at one false alarm in ten ``threshold``, the shares ``found``, ``missed`` and
    ``too_early`` (before ``change_begins``) of changed runs, and the median ``delay`` of those
    found after the middle of the change, in s.
    """
    rows = []
    for key, part in table.groupby(["method", *by], sort=False, dropna=False):
        changed, constant = part[part["kind"] == "changing"], part[part["kind"] == "constant"]
        if changed.empty or constant.empty:
            continue
        row = dict(zip(["method", *by], key, strict=True))
        row["roc_area"] = roc_area(changed["peak"].to_numpy(), constant["peak"].to_numpy())
        at = threshold_of(constant["peak"].to_numpy())
        times = alarm_times(changed, at)
        early = times < changed["change_begins"].to_numpy(float)
        missed = np.isnan(times)
        delay = (times - changed["change_time"].to_numpy(float))[~early & ~missed]
        row |= {
            "threshold": np.nan if at is None else float(THRESHOLDS[at]),
            "found": float((~early & ~missed).mean()),
            "missed": float(missed.mean()),
            "too_early": float(early.mean()),
            "delay": float(np.median(delay)) if delay.size else np.nan,
            "n_changed": len(changed),
            "n_constant": len(constant),
        }
        rows.append(row)
    return pd.DataFrame(rows)


def alarm_times(rows: pd.DataFrame, threshold: int | None) -> np.ndarray:
    """When each run gives its alarm at a threshold; NaN if it gives none."""
    if threshold is None:
        return np.full(len(rows), np.nan)
    return rows[ALARMS[threshold]].to_numpy(float)
