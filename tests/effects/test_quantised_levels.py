"""A quantisation has three levels in use at least."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import Quantised


@pytest.mark.parametrize("at", ["error", pytest.param("output", marks=pytest.mark.slow)])
def test_step_is_within_the_range(at):
    X, y = make_tracking_runs("C1", 1, duration=10.24, sampling_rate=25, random_state=1)
    model = OperatorRegressor(
        effects=[Quantised(at=at, form="behind", offset=0.0)], settling=0.0
    ).fit(X, y)
    step = model.parameter_table_["quantised__step"]
    seen = X["e"] if at == "error" else y
    assert step.max <= np.ptp(seen) / (1 if at == "error" else 2) * (1 + 1e-9)


@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
def test_two_levels_are_no_quantisation():
    """An output far from zero, which a step that large would imitate."""
    rng = np.random.default_rng(1)
    index = pd.Index(0.04 * np.arange(500), name="time")
    f_t = 30 + 3 * np.sin(np.outer(index, [0.4, 0.9, 1.6]) + rng.uniform(0, 6, 3)).sum(axis=1)
    x = f_t - 0.5 * rng.standard_normal(500)
    X = pd.DataFrame({"e": f_t - x, "x": x, "f_t": f_t}, index)
    y = pd.Series(0.8 * f_t + 0.3 * rng.standard_normal(500), index, name="u")
    search = EffectSearchCV(OperatorRegressor(), effects=["quantised"], domain="human").fit(X, y)
    assert search.best_effects_ in ([], ["unknown"])
