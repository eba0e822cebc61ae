"""The stand-in for the experiment of Section VI, and its analysis."""

import re

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline

from skhoid import (
    ARXRegressor,
    DelaySearchCV,
    DelayShift,
    HumanOperator,
    RecursiveARX,
    RunIndexError,
    RunInTrimmer,
    ShortRunError,
    VAFScorer,
    arx_to_operator,
    make_tracking_runs,
    performance_scores,
    read_runs,
    reference_fits,
    write_runs,
    zoh_parameters,
)
from skhoid.lab.experiment import analyse_experiment, simulate_experiment

pytestmark = pytest.mark.slow

T_M = 81.92
ARX = ["a1", "a2", "b0", "b1"]
OPERATOR = ["K_e", "T_L", "K_edot", "omega_nm", "zeta_nm"]


@pytest.fixture(scope="module")
def experiment():
    return simulate_experiment(2, "C4", runs=6, random_state=0, return_truth=True)


@pytest.fixture(scope="module")
def result(experiment):
    X, y, _ = experiment
    return analyse_experiment(X, y, transition_time=41.92)


def of(table, subject="S2", condition="C4", **levels):
    keep = (table["subject"] == subject) & (table["condition"] == condition)
    for name, value in levels.items():
        keep &= table[name] == value
    return table[keep]


def said_by(result):
    """The summary, wherever its lines end."""
    return " ".join(result.summary().split())


# People


def test_the_recording_is_that_of_the_thesis(experiment):
    X, y, truth = experiment
    assert X.index.names == ["subject", "condition", "run", "time"]
    assert list(X.columns) == ["e", "x", "f_t"]
    assert y.name == "u"
    assert X.attrs["units"] == {"e": "deg", "x": "deg", "f_t": "deg"}
    assert len(X) == 2 * 6 * 9000
    one = X.loc[("S1", "C4", 1)]
    assert one.index[0] == -8.08
    assert np.isclose(one.index[-1], T_M - 0.01)
    assert one["x"].iloc[0] == 0.0
    np.testing.assert_allclose(X["e"], X["f_t"] - X["x"], rtol=0, atol=1e-12)
    other = X.loc[("S2", "C4", 3), "f_t"]
    np.testing.assert_array_equal(one["f_t"], other)
    assert (truth["transition_time"] == 41.92).all()


def test_a_run_does_not_depend_on_the_others(experiment):
    X, y, truth = experiment
    more, y_more, truth_more = simulate_experiment(
        1, "c2-c4", runs=2, random_state=0, return_truth=True, n_jobs=2
    )
    assert list(more.index.unique("condition")) == ["C2", "C3", "C4"]
    for run in (1, 2):
        key = ("S1", "C4", run)
        pd.testing.assert_frame_equal(more.loc[key], X.loc[key])
        pd.testing.assert_series_equal(y_more.loc[key], y.loc[key])
    pd.testing.assert_series_equal(truth_more.loc[("S1", "C4")], truth.loc[("S1", "C4")])
    other, _ = simulate_experiment(1, "C4", runs=1, random_state=1)
    assert not np.allclose(other["e"].to_numpy(), X["e"].to_numpy()[:9000])


def test_without_remnant_the_truth_comes_out():
    """Gains of a run scatter by 5 %; that of the first is 0.85, and grows in two runs."""
    X, y, truth = simulate_experiment(
        1, "C1", runs=4, duration=20.48, remnant_intensity=0.0, random_state=5, return_truth=True
    )
    known = truth.loc[("S1", "C1")]
    operator = HumanOperator(**known[["tau_e", "omega_nm", "zeta_nm"]], K_e=1.0, T_L=1.0)
    a = zoh_parameters(operator, 0.01)[:2]
    ratios = []
    for run in range(1, 5):
        X_run, y_run = X.loc[("S1", "C1", [run])], y.loc[("S1", "C1", [run])]
        model = ARXRegressor(inputs=["e"], nk=round(known["tau_e"] / 0.01) + 1)
        model.fit(X_run, y_run)
        np.testing.assert_allclose(model.coef_[:2], a, rtol=2e-3)
        values, _, _ = arx_to_operator(model.coef_, 0.01)
        assert values["T_L"] == pytest.approx(known["T_L_initial"], rel=0.02)
        ratios.append(values["K_e"] / known["K_e_initial"])
    novice = np.exp(-np.arange(4) / 2.0)
    expected = 1 - (1 - 0.85) * novice
    assert (np.abs(np.log(ratios / expected)) < 4 * 0.05).all()
    assert (known[["K_n_initial", "remnant_intensity"]] == 0).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"conditions": "C1-C9"}, "Unknown condition 'C9'"),
        ({"conditions": "C4-C2"}, "ends before it begins"),
        ({"conditions": ["C1", "C1"]}, "at least one condition, each once"),
        ({"subjects": 0}, "subjects must be a whole number"),
        ({"runs": 2.5}, "runs must be a whole number"),
        ({"remnant_intensity": 15}, r"fraction var\(n\) / var\(u\)"),
    ],
)
def test_simulation_refuses(options, message):
    with pytest.raises(ValueError, match=message):
        simulate_experiment(**options)


# The chain, against the classes it is made of


@pytest.fixture(scope="module")
def last_runs(experiment):
    X, y, _ = experiment
    X, y = X.loc["S2"].loc["C4"], y.loc["S2"].loc["C4"]
    later = X.index.get_level_values("run") > 1
    return X[later], y[later]


def test_delay_is_that_of_the_search(result, last_runs):
    X, y = last_runs
    model = make_pipeline(RunInTrimmer(measurement_time=T_M), ARXRegressor(inputs=["e"]))
    search = DelaySearchCV(model, nk=range(1, 51)).fit(X, y)
    row = of(result.delays).iloc[0]
    assert (row["nk"], row["delay"]) == (search.best_nk_, search.best_delay_)
    assert row["searched"]


@pytest.mark.parametrize("form", ["lambda", "Lambda"])
def test_paths_are_those_of_recursive_models(result, last_runs, form):
    X, y = last_runs
    delay = of(result.delays)["delay"].item()
    horizon = 256 if form == "lambda" else (np.inf, np.inf, 256, 256)
    model = make_pipeline(
        RunInTrimmer(measurement_time=T_M),
        DelayShift(delay, inputs=["e"]),
        RecursiveARX(inputs=["e"], memory_horizon=horizon, p0=1.0, combine="average_estimates"),
    ).fit(X, y)[-1]
    paths = of(result.paths, form=form)
    assert list(dict.fromkeys(paths["run"])) == [2, 3, 4, 5, 6, "mean"]
    mean = paths[paths["run"] == "mean"]
    at = np.searchsorted(model.time_path_, mean["time"] - 1e-6)
    np.testing.assert_allclose(model.time_path_[at], mean["time"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diff(mean["time"]), 0.16, rtol=0, atol=1e-9)
    np.testing.assert_allclose(mean[ARX], model.coef_path_[at], rtol=1e-10, atol=1e-12)
    one = paths[paths["run"] == 4]
    np.testing.assert_allclose(one[ARX], model.coef_paths_[2][at], rtol=1e-10, atol=1e-12)
    values, _, _ = arx_to_operator(mean[ARX].to_numpy(), 0.01)
    np.testing.assert_array_equal(mean[OPERATOR], np.stack([values[n] for n in OPERATOR], axis=1))


def test_batch_models_are_reference_fits(result, last_runs):
    X, y = last_runs
    delay = of(result.delays)["delay"].item()
    estimator = make_pipeline(
        RunInTrimmer(measurement_time=T_M),
        DelayShift(delay, inputs=["e"]),
        ARXRegressor(inputs=["e"]),
    )
    expected = reference_fits(X.loc[[5]], y.loc[[5]], estimator=estimator)
    found = of(result.batch, run=5)
    assert found["form"].tolist() == ["ini", "fin"]
    columns = ["start", "stop", *ARX, *OPERATOR, "sd_b0", "sd_K_edot"]
    np.testing.assert_allclose(found[columns], expected[columns], rtol=1e-9)
    each, mean = of(result.batch), of(result.batch, run="mean")
    for form in ("ini", "fin"):
        runs = each[(each["form"] == form) & (each["run"] != "mean")]
        row = mean[mean["form"] == form].iloc[0]
        np.testing.assert_allclose(row[ARX].to_numpy(float), runs[ARX].mean(), rtol=1e-12)
        assert row["sd_b0"] == pytest.approx(runs["b0"].std())
        assert row["sd_K_e"] == pytest.approx(runs["K_e"].std())


def test_scores_are_performance_scores(result, last_runs):
    X, y = last_runs
    marked = RunInTrimmer(measurement_time=T_M).fit_transform(X)
    windows = {"T_m": (0, T_M), "ini": (0, 30.72), "tran": (30.72, 51.2), "fin": (51.2, T_M)}
    expected = performance_scores(marked, y, windows)
    columns = ["run", "window", "rms_e", "tracking_score", "control_activity", "n_samples"]
    found = of(result.scores)[columns].reset_index(drop=True)
    pd.testing.assert_frame_equal(found, expected[columns])
    table = result.score_table("C4")
    mean = expected.groupby("window")["rms_e"].mean()
    assert table.loc["S2", ("rms_e", "tran")] == pytest.approx(mean["tran"])
    assert list(table.columns[:4]) == [("rms_e", w) for w in windows]
    assert result.scores.attrs["units"]["control_activity"] == "deg^2"


def test_validation_is_the_vaf_on_other_runs(result, last_runs):
    X, y = last_runs
    model = make_pipeline(
        RunInTrimmer(measurement_time=T_M),
        DelayShift(of(result.delays)["delay"].item(), inputs=["e"]),
        RecursiveARX(inputs=["e"], memory_horizon=256, p0=1.0),
    ).fit(X.loc[[3]], y.loc[[3]])
    score = VAFScorer(window=(30.72, 51.2))
    others = [score(model, X.loc[[run]], y.loc[[run]]) for run in (2, 4, 5, 6)]
    found = of(result.validation, run=3, form="lambda", window="tran").iloc[0]
    assert found["vaf_validation"] == pytest.approx(np.mean(others))
    own = score(model, X.loc[[3]], y.loc[[3]])
    assert found["vaf_estimation"] == pytest.approx(own)


# What it says


def test_who_adapts_and_whether_the_matrix_is_justified(result):
    rows = result.verdicts.set_index("subject")
    assert rows["adapts"].tolist() == [False, True]
    assert rows["Lambda"].tolist() == ["no need", "justified"]
    assert rows.loc["S2", "gain_lambda"] > 5
    assert rows.loc["S2", "variation_b"] > 2 > rows.loc["S2", "variation_a"]
    text = said_by(result)
    assert "2 subjects, 1 condition; 5 runs of each, from 0 to 81.92 s at 100 Hz." in text
    gain = of(result.changes, parameter="K_edot").iloc[0]
    percent = 100 * gain["change"] / gain["ini"]
    said = f"K_edot {gain['ini']:.3f} to {gain['fin']:.3f} s, {percent:+.0f} %"
    assert re.search(rf"C4: S2 adapts \(K_e .*{re.escape(said)}\)", text)
    assert "S1 shows no change beyond the scatter of runs" in text
    assert re.search(r"C4: yes for S2 \(mean paths of a vary 1.\d, of b 3.\d times", text)
    assert "Highest error S1, lowest S2" in text
    assert repr(result) == "ExperimentResult(2 subjects, 1 conditions)"


# Recordings of one's own


@pytest.fixture(scope="module")
def own():
    return make_tracking_runs(
        "C1", 3, remnant_intensity=0.1, keep_run_in=8.0, random_state=2, channels=["e"]
    )


def test_files_of_recordings(own, tmp_path):
    X, y = own
    for run in range(3):
        write_runs(X.loc[[run]], y.loc[[run]], tmp_path / f"{run}.csv")
    X_read, y_read = read_runs(
        str(tmp_path / "*.csv"), inputs={"e": "error"}, output={"u": "stick"}, time="time"
    )
    found = analyse_experiment(X_read, y_read, input="error", last=3)
    expected = analyse_experiment(X, y, last=3)
    np.testing.assert_allclose(found.batch["b0"], expected.batch["b0"], rtol=1e-6)
    assert found.subjects == found.conditions == ["all"]
    assert found.scores["tracking_score"].isna().all()
    text = said_by(found)
    assert "The operator shows no change" in text
    assert "tracking_score" not in text


def test_what_is_kept_of_the_end_is_the_same_as_negative_times(own):
    X, y = own
    index = X.index.to_frame(index=False)
    index["time"] += 8.0
    recorded = pd.MultiIndex.from_frame(index)
    X_later, y_later = X.set_axis(recorded), y.set_axis(recorded)
    expected = analyse_experiment(X, y, last=None, delay=0.29).paths
    found = analyse_experiment(X_later, y_later, last=None, delay=0.29, measurement_time=T_M)
    assert found.notes == []
    np.testing.assert_allclose(found.paths["b0"], expected["b0"], rtol=1e-9)
    np.testing.assert_allclose(found.paths["time"], expected["time"] + 8.0)
    (note, *_) = analyse_experiment(X_later, y_later, last=2, delay=0.29).notes
    assert note.startswith("nothing was left out as run-in")


def test_one_run(own):
    X, y = own
    result = analyse_experiment(X.loc[[1]], y.loc[[1]])
    assert result.verdicts.loc[0, "adapts"] is None
    assert result.verdicts.loc[0, "Lambda"] == "unknown"
    assert result.validation["vaf_validation"].isna().all()
    assert "has a single run, which is not enough to tell" in said_by(result)
    assert result.notes == ["the recording has 1 of the last 5 runs"]


def test_runs_of_different_length(own):
    X, y = own
    short = (X.index.get_level_values("run") == 1) & (X.index.get_level_values("time") > 70)
    result = analyse_experiment(X[~short], y[~short], last=3, delay=0.29)
    assert "from 0 to 70.01 s, which they share" in result.notes[0]
    assert set(result.batch.loc[result.batch["form"] == "fin", "stop"].round(6)) == {70.01}
    assert not result.paths.isna().any(axis=None)


def test_missing_subjects_runs_and_values(experiment):
    X, y, _ = experiment
    two = pd.concat({"C4": X.loc["S1"].loc["C4"], "C3": X.loc["S2"].loc["C4"]}, names=["condition"])
    both = pd.concat({"S1": two, "S2": two.loc[["C4"]]}, names=["subject"])
    both = both[both.index.get_level_values("run") < 3]
    output = pd.Series(np.resize(y.to_numpy(), len(both)), both.index)
    output.iloc[2000:2010] = np.nan
    result = analyse_experiment(both, output, delay=0.27)
    assert "C3 has no runs of S2" in result.notes
    assert "S1 C4 has 2 of the last 5 runs" in result.notes
    assert "S1 C4 has 10 rows with missing values" in result.notes
    assert not result.delays["searched"].any()
    assert result.delays["nk"].eq(27).all()
    assert result.plot("C3").figure_.axes


def test_with_an_intercept_offsets_do_not_matter(own):
    X, y = own
    options = {"last": 2, "delay": 0.29, "fit_intercept": True}
    at_zero, moved = (analyse_experiment(X + d, y + d / 2, **options) for d in (0.0, 1.0))
    np.testing.assert_allclose(moved.batch[ARX], at_zero.batch[ARX], rtol=1e-7)


def test_short_runs_are_named(experiment):
    X, y, _ = experiment
    labels = X.index.to_frame(index=False)
    cut = (labels["subject"] == "S1") & (labels["run"] == 3) & (labels["time"] > 40)
    keep = ~cut.to_numpy()
    with pytest.raises(ShortRunError, match=r"S1 C4, run 3 lasts 40.01 s .* need 61.44 s"):
        analyse_experiment(X[keep], y[keep])


def test_analysis_refuses(own):
    X, y = own
    with pytest.raises(RunIndexError, match="index levels 'run' and 'time'"):
        analyse_experiment(X.to_numpy(), y.to_numpy())
    for options, message in (
        ({"input": "error"}, "no column 'error'.*the columns are e"),
        ({"last": 0}, "last must be a number of runs"),
        ({"region": 0.0}, "region must be a time in s"),
        ({"memory_horizon": 1.0}, "more than one sample"),
    ):
        with pytest.raises(ValueError, match=message):
            analyse_experiment(X, y, **options)


def test_gaps_and_clocks_that_do_not_begin_at_a_sample(own):
    """A run without half a second has no estimates there, and neither has the mean."""
    X, y = own
    labels = X.index.to_frame(index=False)
    gone = (labels["run"] == 1) & labels["time"].between(40.0, 40.5)
    labels["time"] += 0.004
    index = pd.MultiIndex.from_frame(labels)
    X, y = (table.set_axis(index)[~gone.to_numpy()] for table in (X, y))
    paths = analyse_experiment(X, y, last=2, delay=0.29).paths
    missing = paths["a1"].isna() & (paths["form"] == "lambda")
    assert paths.loc[missing, "time"].between(40.0, 40.5).all()
    assert set(paths.loc[missing, "run"]) == {1, "mean"}
    assert 2 * 3 <= missing.sum() <= 2 * 4
