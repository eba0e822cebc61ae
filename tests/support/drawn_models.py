"""Estimators with drawn options, most of them sensible."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from support.hostile import BAD_NAMES

from skhoid import (
    LPVARX,
    ARXRegressor,
    Decimator,
    DelayBankARX,
    DelaySearchCV,
    DelayShift,
    OperatorKalman,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    RecursiveBoxJenkins,
    RecursiveFIR,
    RecursiveIV,
    RunInTrimmer,
    SigmoidOperator,
    WaveletOperator,
    WindowedOperator,
)

GOOD: dict[type, dict[str, list]] = {
    ARXRegressor: {
        "na": [1, 2, 3],
        "nb": [1, 2],
        "nk": [0, 1, 3, 200],
        "inputs": [None, ["e"], [0], ["e", "x"]],
        "fit_intercept": [False, True],
        "method": ["ols", "iv"],
        "instruments": [None, ["f_t"], ["x"]],
        "covariance": ["ols", "hac"],
        "initial": [None, "rest", "estimate"],
        "roles": [None, {"e": "e"}, {"stick": "e"}, {"nothing": "x"}],
        "dt": [None, 0.01, 1.0],
        "run": [None, "run", 0],
    },
    RecursiveARX: {  # the orders stay: each number of parameters compiles a recursion, in 6 s
        "nk": [0, 1, 3, 200],
        "inputs": [["e"], [0]],
        "forgetting": [None, None, 0.99, 1.0, "auto", "variable", [0.9, 0.9, 1.0, 1.0]],
        "memory_horizon": [None, None, 2, 64, np.inf],
        "memory_time": [None, None, 0.5, 10.0],
        "forgetting_form": ["joint", "diagonal"],
        "init": ["ols", "zeros", np.zeros(4)],
        "init_window": [30.72, 0.5, 0.01],
        "p0": [None, 1.0, 1e4, np.ones(4), np.eye(4)],
        "reset_times": [None, 0.5, [0.1, 0.2]],
        "combine": ["pooled", "average_estimates"],
        "parameters": ["path", "last"],
        "smooth": [False, True],
        "store_covariance": [False, True],
        "dt": [None, 0.01],
    },
    RecursiveARXCV: {
        "memory_horizons": [None, [16, 64], [np.inf], [(8, 8, 64, 64)]],
        "nk": [0, 1],
        "inputs": [["e"], [0]],
        "init": ["ols", "zeros"],
        "cv": [None, 2, 3],
    },
    OperatorRegressor: {
        "delay": [None, 0.2, 0.0],
        "least_delay": [None, 0.0],
        "settling": [3.0, 0.0],
        "inputs": [None, ["e"]],
        "dt": [None, 0.01],
    },
    DelaySearchCV: {
        "estimator": [ARXRegressor(), ARXRegressor(inputs=["e"], fit_intercept=True)],
        "nk": [None, [0, 1, 2], range(3), [5]],
        "criterion": ["one_step", "vaf"],
        "cv": [None, 2],
        "window": [None, 0.5, 10.0],
        "step": [None, 0.1],
    },
    OrderSearchCV: {
        "na": [None, [1, 2]],
        "nb": [None, [1, 2]],
        "nk": [[0, 1], [1]],
        "factor": [None, [1, 2]],
        "criterion": ["vaf", "bic", "modified_bic"],
        "rule": ["one_standard_error", "best"],
        "cv": [None, 2],
    },
    Decimator: {
        "factor": [1, 2, 5],
        "method": ["ideal", "fir", "pick"],
        "padding": ["periodic", "reflect"],
        "dt": [None, 0.01],
        "run": [None, "run"],
    },
    DelayShift: {"delay": [0.0, 0.1, 1.0, 1e6], "inputs": [None, ["e"]], "dt": [None, 0.01]},
    RunInTrimmer: {"run_in": [None, 0.0, 0.5], "measurement_time": [None, 0.5], "dt": [None, 0.01]},
}
TRACKING = [RecursiveBoxJenkins, RecursiveIV, OperatorKalman, DelayBankARX, RecursiveFIR, LPVARX]
TRACKING += [WindowedOperator, SigmoidOperator, WaveletOperator]
REGRESSORS = [ARXRegressor, RecursiveARX, RecursiveARXCV, OperatorRegressor]
SEARCHES = [DelaySearchCV, OrderSearchCV]
TRANSFORMERS = [Decimator, DelayShift, RunInTrimmer]
COSTLY = {"na", "nb", "fit_intercept", "memory_horizons", "nk"}  # a list is a long loop


@st.composite
def models(draw: Any, *kinds: type, bad: bool = True) -> Any:
    """An estimator of one of the classes, with up to four options of its own."""
    cls = draw(st.sampled_from(kinds))
    options = {}
    for name in draw(st.lists(st.sampled_from(sorted(GOOD[cls])), max_size=4, unique=True)):
        options[name] = draw(st.sampled_from(GOOD[cls][name]))
    if cls in (RecursiveARX, RecursiveARXCV):
        options.setdefault("inputs", [0])
    if cls in SEARCHES:
        options.setdefault("estimator", ARXRegressor())
    if bad and not draw(st.integers(0, 4)):
        name = draw(st.sampled_from(sorted(cls(**options).get_params(deep=False))))
        value = draw(st.sampled_from(BAD_NAMES))
        options[name] = value
    return cls(**options)
