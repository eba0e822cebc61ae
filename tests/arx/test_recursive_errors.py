"""RecursiveARX: what is said when its parameters or its stream make no sense."""

import numpy as np
import pandas as pd
import pytest
from support.recursion_twin import changing_runs, recursive, shifted

from skhoid import (
    IrregularSamplingError,
    PoorExcitationWarning,
    RunIndexError,
    ShortRunError,
)

N = 200
X, Y = changing_runs(N)
ARRAYS = (X.to_numpy(), Y.to_numpy())


def fit(X=X, y=Y, **params):
    return recursive(**params).fit(X, y)


def stream(*blocks, **params):
    model = recursive(**{"forgetting": 0.97, **params})
    for X, y in blocks:
        model.partial_fit(X, y)
    return model


# name: action, class of the error, parts that its message must have
ERRORS = {
    # forgetting
    "lambda of zero": (lambda: fit(forgetting=0.0), ValueError, ["forgetting", "got 0"]),
    "too few in the matrix": (
        lambda: fit(forgetting=[0.9, 0.9]), ValueError, ["forgetting", "(2,)", "(4,)"]
    ),
    "a function of the wrong shape": (
        lambda: fit(forgetting=lambda t: np.full((t.size, 3), 0.9)),
        ValueError,
        ["forgetting", f"({N}, 3)"],
    ),
    "lambda and N0": (
        lambda: fit(forgetting=0.9, memory_horizon=10), ValueError, ["forgetting", "memory_horizon"]
    ),
    "memory of one sample": (
        lambda: fit(memory_horizon=1), ValueError, ["longer than one sample", "got 1.0 samples"]
    ),
    # start
    "unknown start": (lambda: fit(init="batch"), ValueError, ["init", "batch", "ols"]),
    "P0 too large": (lambda: fit(p0=1e300), ValueError, ["p0", "1e+300", "1e+100"]),
    "reset at no time": (lambda: fit(reset_times=[1.0, np.nan]), ValueError, ["reset_times"]),
    # others
    "smoothing with a joint matrix": (
        lambda: fit(smooth=True, memory_horizon=[np.inf, np.inf, 20, 20]),
        ValueError,
        ["smooth", "random walk", "one λ"],
    ),
    "run too short": (
        lambda: fit(X[:4], Y[:4]), ShortRunError, ["Run 1", "4 successive rows", "need 5"]
    ),
    # streams
    "time goes backwards": (
        lambda: stream((X[:100], Y[:100]), (X[50:150], Y[50:150])),
        RunIndexError,
        ["run 1", "0.99 s", "0.5 s", "new_run=True"],
    ),
    "time off the grid": (
        lambda: stream((X[:100], Y[:100]), tuple(shifted(t[100:], 0.004) for t in (X, Y))),
        IrregularSamplingError,
        ["1.004 s"],
    ),
    "smoothing a stream": (
        lambda: stream(ARRAYS, smooth=True), ValueError, ["smooth", "partial_fit"]
    ),
    "averaging a stream": (
        lambda: stream(ARRAYS, combine="average_estimates"), ValueError, ["combine", "partial_fit"]
    ),
    "auto in a stream": (
        lambda: stream(ARRAYS, forgetting="auto"), ValueError, ["auto", "partial_fit"]
    ),
}  # fmt: skip


@pytest.mark.parametrize(("action", "error", "parts"), ERRORS.values(), ids=ERRORS.keys())
def test_error_says_what_where_and_what_to_do(action, error, parts):
    with pytest.raises(error) as caught:
        action()
    message = str(caught.value)
    missing = [part for part in parts if part not in message]
    assert not missing, f"{missing} not in: {message}"


@pytest.mark.parametrize(
    "block",
    [
        (np.full((1, 1), np.inf), np.zeros(1)),
        (np.zeros((2, 1)), np.zeros(1)),
        (X[50:150], Y[50:150]),
    ],
)
def test_a_refused_block_leaves_the_stream_as_it_was(block):
    tables = isinstance(block[0], pd.DataFrame)
    inputs, output = (X, Y) if tables else ARRAYS
    model = stream((inputs[:100], output[:100]))
    with pytest.raises(ValueError, match=r"."):
        model.partial_fit(*block)
    model.partial_fit(inputs[100:], output[100:])
    np.testing.assert_array_equal(model.coef_, stream((inputs, output)).coef_)


def test_a_window_without_excitation_is_mentioned():
    still = X.copy()
    still.iloc[:120] = 0.0
    with pytest.warns(PoorExcitationWarning, match=r"a1, a2, b0, b1.*init_window"):
        model = fit(still, init="ols", init_window=1.0)
    assert np.isfinite(model.coef_path_).all()
