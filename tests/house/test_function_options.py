"""Options of functions are refused as those of estimators are: by name, before any work."""

import re

import numpy as np
import pandas as pd
import pytest
from sklearn.utils._param_validation import InvalidParameterError

import skhoid
from skhoid import ARXRegressor, ControlledElement, HumanOperator
from skhoid.exceptions import RunIndexError

INDEX = pd.MultiIndex.from_product([["a", "b"], 0.02 * np.arange(100)], names=["run", "time"])
RNG = np.random.default_rng(0)
X = pd.DataFrame({"e": RNG.standard_normal(200)}, index=INDEX)
Y = X["e"].rolling(3, min_periods=1).mean().rename("u")
MODEL = ARXRegressor().fit(X, Y)


@pytest.mark.parametrize(
    ("function", "args", "option", "value"),
    [
        (skhoid.compare, (MODEL, X, Y), "run_in", "1"),
        (skhoid.compare, (MODEL, X, Y), "domain", "animal"),
        (skhoid.compare, (MODEL, X, Y), "dt", "0.02"),
        (skhoid.remnant_estimate, (MODEL, X, Y), "run_in", -1),
        (skhoid.performance_scores, (X, Y), "change", "later"),
        (skhoid.check_channels, (X, Y), "dt", 0),
        (skhoid.lost_control, (X,), "roles", "e"),
        (skhoid.resample_runs, (X, Y), "dt", 0),
        (skhoid.resample_runs, (X, Y), "dt", -0.02),
        (skhoid.run_labels, (X,), "level", 1),
        (skhoid.sampling_time, (X,), "dt", []),
        (skhoid.select_runs, (X, Y), "first", 0),
        (skhoid.select_runs, (X, Y), "last", 1.5),
        (skhoid.vaf_score, (Y, Y), "window", "ini"),
        (skhoid.vaf_score, (Y, Y), "average", "median"),
        (skhoid.auto_psd, (X,), "dt", {}),
        (skhoid.crossover, (HumanOperator(), ControlledElement()), "t", None),
        (skhoid.make_tracking_runs, ("C1",), "perturbation", ["K_e"]),
        (skhoid.read_runs, ("*.csv",), "units", "deg"),
        (skhoid.write_runs, (X, Y, "runs.csv"), "overwrite", "yes"),
    ],
)
def test_an_option_without_sense_is_named(function, args, option, value):
    needed = {"forcing": [1.0]} if function is skhoid.fourier_coefficients else {}
    needed |= {"inputs": "e", "output": "u"} if function is skhoid.read_runs else {}
    message = f"The '{option}' parameter of {function.__name__} must be"
    with pytest.raises(InvalidParameterError, match=message):
        function(*args, **needed, **{option: value})


@pytest.mark.parametrize("window", [(2.0, 1.0), (1.0,), (0.0, 1.0, 2.0), ("a", "b"), (np.nan, 1)])
def test_a_window_has_two_ends(window):
    with pytest.raises(ValueError, match=re.escape("window must be (start, stop)")):
        skhoid.vaf_score(Y, Y, window=window)


@pytest.mark.parametrize("data", [{"e": [1.0]}, None, 5, "e", len])
def test_what_is_no_table_is_named(data):
    for function in (skhoid.run_labels, skhoid.sampling_time, skhoid.lost_control):
        with pytest.raises(
            TypeError, match=f"X is a {type(data).__name__}, which is not supported"
        ):
            function(data)


def test_tables_of_pyarrow_are_refused():
    table = pytest.importorskip("pyarrow").Table.from_pandas(X.reset_index())
    for function in (skhoid.run_labels, skhoid.sampling_time):
        with pytest.raises(TypeError, match=r"X is a Table, .*X.to_pandas\(\)"):
            function(table)


def test_runs_are_selected_and_resampled_by_their_index():
    for function, options in ((skhoid.select_runs, {"first": 1}), (skhoid.resample_runs, {})):
        with pytest.raises(RunIndexError, match="needs the index levels 'run' and 'time'"):
            function(X.to_numpy(), Y.to_numpy(), **options)


def test_numbers_that_are_none_are_named():
    element = ControlledElement()
    with pytest.raises(TypeError, match="theta must hold numbers; got 'a'"):
        skhoid.crossover_path("a", element, dt=0.01, nk=29)
    with pytest.raises(ValueError, match=r"array of shape \(n_instants,\); got \(1, 1\)"):
        skhoid.crossover(HumanOperator(), element, t=[[1.0]])
    with pytest.raises(TypeError, match="repeats must have a label for each run"):
        skhoid.compare(MODEL, X, Y, repeats=np.zeros((2, 2)))


def test_what_no_machine_holds_is_refused():
    with pytest.raises(ValueError, match=r"1000000000 subjects .* would take .* of memory"):
        skhoid.simulate_experiment(10**9, "C1", 1)
    with pytest.raises(ValueError, match=r"A run of 81.92 s .*, would take .* of memory"):
        skhoid.make_tracking_runs("C1", 1, run_in=1e9)


def test_arrays_of_labels_and_names_are_taken():
    labels = pd.Index(["one", "one"])
    assert skhoid.compare(MODEL, X, Y, repeats=labels).noise_ceiling > 0
    drawn = skhoid.make_tracking_runs("C1", 1, duration=20.48, channels=pd.Index(["e", "x"]))[0]
    assert list(drawn) == ["e", "x"]
    assert skhoid.vaf_score(Y, Y, window=np.array([0.0, 1.0])) == 100


def test_an_output_that_was_never_measured_has_no_score():
    model = skhoid.OperatorRegressor().fit(X, Y)  # which has scales to take from data
    with pytest.raises(ValueError, match="No row is left to score"):
        skhoid.compare(model, X, Y * np.nan)


def test_a_fold_without_rows_to_train_on_is_no_crash():
    short = X.loc[["a"]].iloc[:60].reset_index(drop=True)
    short.index = pd.MultiIndex.from_product([["a"], 0.1 * np.arange(60)], names=["run", "time"])
    y = Y.iloc[:60].set_axis(short.index)  # 6 s, and guards of 5 s around what is held out
    search = skhoid.EffectSearchCV(
        skhoid.OperatorRegressor(settling=0.0), effects=["bias"], controlled_element="1/s"
    )
    assert np.isfinite(search.fit(short, y).error_path_["vaf"]).all()
