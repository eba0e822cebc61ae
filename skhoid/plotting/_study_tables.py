"""What displays of studies draw, computed from the table of a study: one row for each mark.

Open it to change a statistic over replications; how it looks is in the file of the Display.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.cbook import boxplot_stats

from ._study import REPLICATION, cells_of, chosen

STATISTICS = {"low": "whislo", "q1": "q1", "median": "med", "q3": "q3", "high": "whishi"}
CENTRAL = (0.16, 0.84)
PREFIXES = ("low_", "high_", "n_")
RESPONSE_KEYS = ["remnant_intensity", "method", "omega"]
TRADE_OFF_KEYS = ["condition", "form", "remnant_intensity", "memory_horizon"]
VAF = ["vaf_estimation", "vaf_validation"]


def boxes_of_cells(table: pd.DataFrame, values: list[str], keys: list[str]) -> pd.DataFrame:
    """Box and whiskers of each cell, as ``StudyBoxDisplay`` takes them."""
    rows = []
    for value in values:
        for key, part in table.groupby(keys, sort=False, dropna=False):
            found = part[value].to_numpy(dtype=float)
            found = found[np.isfinite(found)]
            (known,) = boxplot_stats(found) if found.size else ({},)
            row = {"value": value, **dict(zip(keys, key, strict=True)), "n": found.size}
            row |= {ours: known.get(theirs, np.nan) for ours, theirs in STATISTICS.items()}
            rows.append(row | {"values": found})
    return pd.DataFrame(rows)


def differences(
    table: pd.DataFrame,
    values: list[str],
    keys: list[str],
    difference: tuple[str, Any, Any],
    display: str,
) -> pd.DataFrame:
    """Results at one level of a column less those at another, replication by replication."""
    name, first, second = difference
    index = [c for c in dict.fromkeys([*cells_of(table), *keys]) if c != name] + [REPLICATION]
    # Cells without a remnant filter are cells too: their order may be NaN.
    columns = [*index, *values]
    sides = [chosen(table, {name: level}, display)[columns] for level in (first, second)]
    both = sides[0].merge(sides[1], on=index, suffixes=("", "_other"))
    others = both[[f"{value}_other" for value in values]].to_numpy()
    both[values] = both[values].to_numpy() - others
    return both[columns]


def averages(rows: pd.DataFrame, keys: list[str], names: list[str], average: str) -> pd.DataFrame:
    """Average, edges of the band and number of values of each parameter."""
    groups = rows.groupby(keys, sort=False)
    parts, counts = groups[names], groups[names].count()
    if average == "mean":
        centre, deviation = parts.mean(), parts.std(ddof=1)
        low, high = centre - deviation, centre + deviation
    else:
        centre, low, high = parts.median(), *(parts.quantile(q) for q in CENTRAL)
        low, high = low.where(counts > 1), high.where(counts > 1)
    edges = [
        part.add_prefix(prefix) for prefix, part in zip(PREFIXES, (low, high, counts), strict=True)
    ]
    table: pd.DataFrame = pd.concat([groups.size().rename("n"), centre, *edges], axis=1)
    return table.reset_index()


def batch_averages(
    rows: pd.DataFrame, names: list[str], average: str, windows: dict[str, tuple[float, float]]
) -> pd.DataFrame:
    """Averages of batch fits, with the windows they are of."""
    table = averages(rows, ["remnant_intensity", "form"], names, average)
    for place, edge in enumerate(("start", "stop")):
        table[edge] = [windows[form][place] for form in table["form"]]
    return table


def ensembles(table: pd.DataFrame, truth: pd.DataFrame | None) -> pd.DataFrame:
    """Means over the replications, their spread, and what single estimates state."""
    H = table["H_real"].to_numpy(dtype=float) + 1j * table["H_imag"].to_numpy(dtype=float)
    rows = table[RESPONSE_KEYS].assign(
        re=H.real,
        im=H.imag,
        size=np.abs(H),
        stated_size=table["magnitude_sd"].to_numpy(dtype=float) ** 2,
        stated_angle=table["phase_sd"].to_numpy(dtype=float) ** 2,
    )
    groups = rows.groupby(RESPONSE_KEYS, sort=True)
    mean = groups[["re", "im"]].mean()
    centre = (mean["re"] + 1j * mean["im"]).to_numpy()
    # Angles to the mean, which do not wrap unless they are half a turn off.
    own = mean["re"].index.get_indexer(pd.MultiIndex.from_frame(rows[RESPONSE_KEYS]))
    angle = np.degrees(np.angle(H * np.conj(centre[own])))
    angles = rows[RESPONSE_KEYS].assign(angle=angle).groupby(RESPONSE_KEYS, sort=True)["angle"]
    total = np.sqrt(groups[["re", "im"]].var(ddof=1).sum(axis=1, skipna=False))
    size = np.abs(centre)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = total.to_numpy() / size
    total_phase = np.where(ratio > 1, 180.0, np.degrees(np.arctan(ratio)))  # NaN stays NaN
    stated = np.sqrt(groups[["stated_size", "stated_angle"]].mean())
    found = pd.DataFrame(
        {
            "n": groups.size(),
            "magnitude": size,
            "phase": np.degrees(np.angle(centre)),
            "magnitude_sd": groups["size"].std(ddof=1),
            "phase_sd": angles.std(ddof=1),
            "total_sd": total,
            "total_phase_sd": total_phase,
            "stated_magnitude_sd": stated["stated_size"],
            "stated_phase_sd": np.degrees(stated["stated_angle"]),
        },
        index=mean.index,
    ).reset_index()
    for _, rows_of in found.groupby(RESPONSE_KEYS[:2], sort=False):
        phase = rows_of["phase"].to_numpy(dtype=float)
        if truth is None:
            phase = np.degrees(np.unwrap(np.radians(phase)))
        else:
            near = np.interp(np.log(rows_of["omega"]), np.log(truth["omega"]), truth["phase"])
            phase = phase - 360 * np.round((phase - near) / 360)
        found.loc[rows_of.index, "phase"] = phase
    return found


def trade_off_means(table: pd.DataFrame) -> pd.DataFrame:
    """Means over the replications, and what follows from them."""
    groups = table.groupby(TRADE_OFF_KEYS, sort=False)
    means = groups[VAF].mean().assign(n=groups.size()).reset_index()
    cell = TRADE_OFF_KEYS[:3]
    without = means.loc[np.isinf(means["memory_horizon"]), [*cell, "vaf_validation"]]
    base = means[cell].merge(without, on=cell, how="left")["vaf_validation"].to_numpy(dtype=float)
    estimation, validation = (means[name].to_numpy(dtype=float) for name in VAF)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The ratio to a VAF of 0 says nothing.
        ratio = np.where(validation > 0, estimation / validation, np.nan)
        to_base = np.where(base > 0, validation / base, np.nan)
    return means.assign(
        gain=validation - base,
        overfit_difference=estimation - validation,
        overfit_ratio=ratio,
        tradeoff_ratio=to_base,
    )


def best_horizon(means: pd.DataFrame, form: Any) -> float | None:
    """The horizon with the best mean over the cells of a form, of those that all cells have."""
    cells = means[means["form"] == form].pivot_table(
        index="memory_horizon", columns=["condition", "remnant_intensity"], values="vaf_validation"
    )
    complete = cells.dropna()
    return None if complete.empty else float(complete.mean(axis=1).idxmax())
