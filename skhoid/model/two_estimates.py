"""Estimates of least simulation error and of maximum likelihood, and where they differ."""

from __future__ import annotations

import numpy as np
import pandas as pd

from ..text import Estimate
from .estimates import NORMAL_95, parameter_table
from .fitting import Criterion, covariance_of
from .model import Model
from .prepared import Prepared

WHY = (
    "In a closed loop the remnant returns in the error, and the fit of least simulation error "
    "follows it: trust the likelihood. Without a loop, the model lacks something that the two "
    "weigh differently."
)


def of_least_error(model: Model, prepared: Prepared) -> pd.DataFrame:
    """Table of the parameters at the smallest simulation error near those of a model.

    Standard errors allow for a remnant of any colour, but not for a bias.
    """
    criterion = Criterion(model.simulator.record)
    plain = model.refined(criterion)
    covariance = covariance_of(plain.simulator, criterion, plain.fit)
    return parameter_table(
        plain.simulator, plain.theta, covariance, prepared.units, dict(prepared.spec.given)
    )


def that_differ(likelihood: pd.DataFrame, least_error: pd.DataFrame) -> list[str]:
    """Parameters of the core whose two estimates differ by more than their uncertainty allows.

    The 95 % interval of the difference is that of two independent estimates, which is too wide for
    estimates from the same data. A value at its bound counts as exact.
    """
    found = []
    for name in likelihood.index.intersection(least_error.index):
        one, other = likelihood.loc[name], least_error.loc[name]
        width = NORMAL_95 * np.hypot(_sd(one), _sd(other))
        if "__" not in name and width > 0.0 and abs(one["value"] - other["value"]) > width:
            found.append(name)
    return found


def _sd(row: pd.Series) -> float:
    at_bound = np.isnan(row["sd"]) and np.isnan(row["low"])
    return 0.0 if at_bound else float(row["sd"])


def difference_notes(likelihood: pd.DataFrame, least_error: pd.DataFrame) -> list[str]:
    """Both estimates of each parameter that differs, and why, in a sentence; none if none does."""
    names = that_differ(likelihood, least_error)
    if not names:
        return []
    pairs = [
        f"{name} = {Estimate.of(likelihood.loc[name])} by likelihood, "
        f"{Estimate.of(least_error.loc[name])} by least simulation error"
        for name in names
    ]
    return [f"Two estimates differ by more than their uncertainty: {'; '.join(pairs)}. {WHY}"]
