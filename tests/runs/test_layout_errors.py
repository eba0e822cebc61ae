"""What is said when the data convention is broken: what was wrong, where, and what to do."""

import numpy as np
import pandas as pd
import pytest
import scipy.sparse
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from support.synthetic import DT, arx_runs, with_levels

from skhoid import (
    ARXRegressor,
    Decimator,
    IrregularSamplingError,
    MissingDataWarning,
    RunIndexError,
    RunInTrimmer,
    ShortRunError,
    VAFScorer,
    run_labels,
    select_runs,
)

X, Y = arx_runs(3, 120)
TIME = X.index.get_level_values("time").to_numpy()
RUN = X.index.get_level_values("run").to_numpy()
SHUFFLED = np.random.default_rng(0).permutation(len(X))
ONE_RUN_SHUFFLED = np.r_[:120, 120 + np.random.default_rng(0).permutation(120), 240:360]
FRAME = X.reset_index("run").reset_index(drop=True)[["run", "e", "x"]]
BARE = FRAME[["e", "x"]]
N = len(X)


def fit(X=X, y=Y, **params):
    return ARXRegressor(2, 2, 3, **params).fit(X, y)


def pipe_fit(*steps, X=X, y=Y):
    return make_pipeline(*steps).fit(X, y)


def ten_runs(*short):
    lengths = [20 if run in short else 100 for run in range(1, 11)]
    return ARXRegressor(2, 2, 29).fit(*arx_runs(lengths=lengths))


def branch(**options):
    return ColumnTransformer([("thin", Decimator(2), ["e"])], remainder="passthrough", **options)


HINT = ["set_output(transform=", "ColumnTransformer"]
# name: action, class of the error, parts that its message must have
ERRORS = {
    "shuffled rows": (
        lambda: fit(X.iloc[SHUFFLED], Y.iloc[SHUFFLED]),
        RunIndexError,
        ["drawn one by one", "take turns", "row ", "sort_index", "LeaveOneGroupOut"],
    ),
    "rows shuffled inside a run": (
        lambda: fit(X.iloc[ONE_RUN_SHUFFLED], Y.iloc[ONE_RUN_SHUFFLED]),
        RunIndexError,
        ["shuffled", "run 2", "row ", "sort_index", "groups=run_labels(X)"],
    ),
    "run in two pieces": (
        lambda: fit(X.iloc[np.r_[:60, 120:240, 60:120]], Y.iloc[np.r_[:60, 120:240, 60:120]]),
        RunIndexError,
        ["run 1", "row 180", "after rows of run 2", "sort_index"],
    ),
    "time decreases": (
        lambda: fit(X.iloc[np.r_[:180, 120:180]], Y.iloc[np.r_[:180, 120:180]]),
        RunIndexError,
        ["decreases", "run 2", "row 180", "0.59 s is followed by 0 s", "label"],
    ),
    "two runs sorted by time": (
        lambda: fit(*(
            table.iloc[np.argsort(TIME, kind="stable")].set_axis(
                pd.MultiIndex.from_arrays([np.ones(N), np.sort(TIME)], names=["run", "time"])
            )
            for table in (X, Y)
        )),
        RunIndexError,
        ["Time repeats in 240 places", "row 1: 0 s is followed by 0 s", "two runs or two channels",
         "too few digits"],
    ),
    "two runs under one label": (
        lambda: fit(with_levels(X, run=1), Y.to_numpy()),
        RunIndexError,
        ["row 120", "1.19 s is followed by 0 s", "own label", "'run'"],
    ),
    "X stripped to an array": (
        lambda: fit(X.to_numpy(), Y), RunIndexError, ["y has a run and time index", *HINT]
    ),
    "a transformer strips X": (
        lambda: pipe_fit(StandardScaler(), ARXRegressor()), RunIndexError, HINT
    ),
    "index at fit, none at predict": (
        lambda: fit().predict(X.reset_index(drop=True)),
        RunIndexError,
        ["ARXRegressor was fitted on X with run and time", "now gets X without", *HINT],
    ),
    "X and y in another order": (
        lambda: fit(X, Y.iloc[SHUFFLED]),
        RunIndexError,
        ["disagree", "row ", "in X", "in y", "y.loc[X.index]"],
    ),
    "X and y at other times": (
        lambda: fit(X, with_levels(Y.to_frame(), time=TIME + DT)["u"]),
        RunIndexError,
        ["disagree", "first difference is in row 0", "0.01", "y.loc[X.index]"],
    ),
    "y longer than X": (
        lambda: fit(X, np.append(Y, 0.0)), ValueError, ["inconsistent numbers of samples", "361"]
    ),
    "all runs too short": (
        lambda: ARXRegressor(2, 2, 29).fit(*arx_runs(3, 20)),
        ShortRunError,
        ["Run 1 (and 2 more)", "20 successive rows", "30 samples back need 31", "nk"],
    ),
    "two runs of ten too short": (
        lambda: ten_runs(5, 7), ShortRunError, ["Run 5 (and 1 more)", "select_runs"]
    ),
    "too few rows for the parameters": (
        lambda: fit(X.iloc[:7], Y.iloc[:7]), ShortRunError, ["3 rows", "4 parameters", "fewer lags"]
    ),
    "datetime": (
        lambda: fit(with_levels(X, time=pd.Timestamp(0) + pd.to_timedelta(TIME, "s")), Y.array),
        RunIndexError,
        ["datetime64", "seconds from the start", "total_seconds"],
    ),
    "time is NaN": (
        lambda: fit(with_levels(X, time=np.where(np.arange(N) == 7, np.nan, TIME)), Y.array),
        RunIndexError,
        ["nan in row 7", "finite"],
    ),
    "irregular sampling": (
        lambda: fit(with_levels(X, time=TIME + 0.003 * (np.arange(N) == 150)), Y.array),
        IrregularSamplingError,
        ["Irregular sampling", "run 2", "row 150", "0.013 s", "0.01 s", "resample_runs"],
    ),
    "runs of different sampling time": (
        lambda: fit(with_levels(X, time=TIME * np.where(RUN == 2, 2, 1)), Y.array),
        IrregularSamplingError,
        ["0.01 s in run 1", "0.02 s in run 2", "resample_runs"],
    ),
    "predict at another sampling time": (
        lambda: fit().predict(with_levels(X, time=2 * TIME)),
        IrregularSamplingError,
        ["0.02 s", "model", "0.01 s", "resample_runs(X, dt=0.01)"],
    ),
    "dt disagrees with the index": (
        lambda: fit(dt=0.02),
        IrregularSamplingError,
        ["0.01 s per row", "dt=0.02 s", "resample_runs"],
    ),
    "no run level": (
        lambda: fit(X.droplevel("run"), Y.droplevel("run")),
        RunIndexError,
        ["row 120", "1.19 s is followed by 0 s", "'run' level"],
    ),
    "levels without names": (
        lambda: fit(X.rename_axis([None, None]), Y.array),
        RunIndexError,
        ["[None, None]", "'run' and 'time'", "set_names", "set_index(['run', 'time'])"],
    ),
    "levels of one name": (
        lambda: fit(
            pd.concat({"a": X}).rename_axis(["time", "run", "time"]),
            Y.array,
        ),
        RunIndexError,
        ["2 levels of the row index of X are called 'time'", "set_names"],
    ),
    "run label missing": (
        lambda: fit(with_levels(X, run=np.where(RUN == 1, np.nan, RUN)), Y.array),
        RunIndexError,
        ["'run'", "Row 0 has no label"],
    ),
    "runs of one row": (
        lambda: fit(X.iloc[[0, 120, 240]], Y.iloc[[0, 120, 240]]),
        IrregularSamplingError,
        ["no run has more than one row", "dt="],
    ),
    "empty": (lambda: fit(X.iloc[:0], Y.iloc[:0]), ValueError, ["0 sample(s)", "ARXRegressor"]),
    "infinite output": (
        lambda: fit(y=Y.where(np.arange(N) != 150, np.inf)),
        ValueError,
        ["Input y", "infinity", "row 150", "by NaN"],
    ),
    "nothing measured": (lambda: fit(y=Y * np.nan), ValueError, ["y", "nothing was measured"]),
    "text in X": (
        lambda: fit(X.astype(object).assign(e="fast")), ValueError, ["not a number", "fast"]
    ),
    "sparse": (
        lambda: fit(scipy.sparse.csr_array(X.to_numpy()), Y.array), TypeError, ["dense", "toarray"]
    ),
    "a Series for X": (lambda: fit(X["e"]), ValueError, ["2-dimensional", "Series"]),
    "no y": (lambda: fit(y=None), ValueError, ["requires y"]),
    "unknown input": (
        lambda: fit(inputs=["ee"]), ValueError, ["'ee'", "not a column", "['e', 'x']"]
    ),
    "no input": (lambda: fit(inputs=[]), ValueError, ["inputs is empty"]),
    "unknown run column": (
        lambda: fit(FRAME, Y.array, run="trial"),
        RunIndexError,
        ["run='trial'", "['run', 'e', 'x']"],
    ),
    "run column with a hole": (
        lambda: fit(FRAME.assign(run=FRAME["run"].where(FRAME.index != 3)), Y.array, run="run"),
        RunIndexError,
        ["'run'", "missing in row 3"],
    ),
    "run column not contiguous": (
        lambda: fit(FRAME.assign(run=np.repeat([1, 2, 1], 120)), Y.array, run="run"),
        RunIndexError,
        ["not contiguous", "row 240"],
    ),
    "shuffled bare frame": (
        lambda: fit(BARE.iloc[SHUFFLED], Y.to_numpy()),
        RunIndexError,
        ["shuffled, or drawn", "at row 1", "reset_index(drop=True)"],
    ),
    "polars output": (
        lambda: Decimator(2).set_output(transform="polars").fit_transform(X),
        RunIndexError,
        ["Decimator", "polars", 'set_output(transform="pandas")', "pipeline itself"],
    ),
    "Decimator in a branch": (
        lambda: pipe_fit(branch(), ARXRegressor()),
        RunIndexError,
        ["Decimator", "one branch of a ColumnTransformer", "steps of the pipeline itself"],
    ),
    "two Decimators": (
        lambda: pipe_fit(Decimator(2), Decimator(3), ARXRegressor()),
        RunIndexError,
        ["already decimated by 2", "factor=6"],
    ),
    "mark at fit, none at predict": (
        lambda: ARXRegressor(2, 1, 1).fit(Decimator(2).fit_transform(X), Y).predict(X),
        RunIndexError,
        ["decimated by 2 (ideal)", "not decimated", "same Decimator", "Pipeline"],
    ),
    "factor longer than the runs": (
        lambda: pipe_fit(Decimator(100), ARXRegressor()), ShortRunError, ["Run 1", "at 1 s"]
    ),
    "run-in longer than the runs": (
        lambda: RunInTrimmer(5.0).fit_transform(X), ShortRunError, ["Run 1 lasts 1.2 s", "of 5 s"]
    ),
    "unknown level": (
        lambda: run_labels(X, level="subject"), RunIndexError, ["'subject'", "['run', 'time']"]
    ),
    "unknown run": (lambda: select_runs(X, runs=9), ValueError, ["no run 9", "[1, 2, 3]"]),
    "no choice of runs": (lambda: select_runs(X), ValueError, ["exactly one", "last="]),
}  # fmt: skip


@pytest.mark.parametrize(("action", "error", "parts"), ERRORS.values(), ids=ERRORS.keys())
def test_error_says_what_where_and_what_to_do(action, error, parts):
    with pytest.raises(error) as caught:
        action()
    message = str(caught.value)
    missing = [part for part in parts if part not in message]
    assert not missing, f"{missing} not in: {message}"


def test_missing_values_are_counted():
    holed, holed_y = X.copy(), Y.copy()
    holed.iloc[50, 0] = np.nan
    holed_y.iloc[150] = np.nan
    with pytest.warns(MissingDataWarning, match=r"1 rows.*run 1, t = 0.5 s \(row 50\); 2 rows"):
        model = fit(holed)
    assert model.n_rows_missing_ == 2
    with pytest.warns(MissingDataWarning, match=r"run 2, t = 0.3 s \(row 150\); 3 rows"):
        assert fit(y=holed_y).n_rows_missing_ == 3
    with pytest.warns(
        MissingDataWarning, match=r"1 rows of the inputs.*\(row 50\).*holds the last"
    ):
        prediction = model.predict(holed)
    held = X.copy()
    held.iloc[50, 0] = held.iloc[49, 0]
    np.testing.assert_array_equal(prediction, model.predict(held))


@pytest.mark.parametrize("method", ["fit", "predict"])
def test_a_run_whose_input_is_missing_is_mentioned(method):
    holed = X.copy()
    holed.iloc[120:240, 0] = np.nan
    model = fit()
    with pytest.warns(MissingDataWarning, match="run 2"):
        fit(holed) if method == "fit" else model.predict(holed)


@pytest.mark.parametrize(
    "action",
    [
        pytest.param(lambda: fit(roles={"err": "e"}), id="role of a column that is not there"),
        pytest.param(
            lambda: fit(FRAME[["e"]].set_axis(pd.Index(np.arange(N) * DT)), Y.array),
            id="time index without a name",
        ),
        pytest.param(lambda: fit(with_levels(X, sample=np.arange(N)), Y.array), id="extra level"),
        pytest.param(
            lambda: ARXRegressor(2, 1, 1).fit(
                *(t[np.arange(N) % 2 == 0] for t in (Decimator(2).fit_transform(X), Y))
            ),
            id="marked rows thinned by hand",
        ),
        pytest.param(
            lambda: VAFScorer()(fit(), X, Y.iloc[::-1]), id="scored against rows in another order"
        ),
    ],
)
def test_other_breaches_of_the_convention(action):
    with pytest.raises(RunIndexError):
        action()
