"""What plots of people in conditions share: each person's own means, and the label of an axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from scipy import stats

from ..lab.experiment.mixed import MixedModelResult, mixed_model
from ._axes import parameter_symbol, with_unit
from .operator_parameters import SYMBOLS

if TYPE_CHECKING:
    from collections.abc import Mapping


def taken_result(
    result: Any, parameter: str | None, options: Mapping[str, Any]
) -> MixedModelResult:
    """The result of a mixed model, which is fitted if a table is given."""
    if isinstance(result, MixedModelResult):
        if options or parameter not in (None, result.parameter):
            raise ValueError(
                f"The result is of {result.parameter}, as it was fitted; give the table for "
                "another parameter or other options."
            )
        return result
    if parameter is None:
        names = [name for name in dict.fromkeys(result["parameter"].fillna("")) if name]
        if len(names) != 1:
            raise ValueError(f"parameter is one of {', '.join(names)}; got None.")
        parameter = names[0]
    return mixed_model(result, parameter, **options)


def own_means(result: MixedModelResult) -> pd.DataFrame:
    """Weighted means of the runs of each person, with intervals; not drawn towards the group."""
    used = result.data[result.data["left_out"] == ""]
    within = float(result.variances.set_index("source").loc["within", "variance"])
    quantile = stats.norm.isf((1.0 - result.confidence) / 2.0)
    records = []
    for key, rows in used.groupby(["subject", "condition"], sort=False):
        w = rows["weight"].to_numpy(dtype=float)
        mean = float(w @ rows["value"].to_numpy(dtype=float))
        reach = quantile * np.sqrt(within / float(rows["cell_weight"].iloc[0]))
        ends = np.array([mean, mean - reach, mean + reach])
        mean, low, high = np.exp(ends) if result.transform == "log" else ends
        records.append((*key, mean, low, high, len(rows)))
    return pd.DataFrame(
        records, columns=["subject", "condition", "estimate", "low", "high", "n_rows"]
    )


def axis_label(parameter: str, unit: str) -> str:
    return with_unit(SYMBOLS.get(parameter, parameter_symbol(parameter)), unit or None)
