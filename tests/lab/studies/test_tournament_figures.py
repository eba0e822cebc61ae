"""Figures of paths whose errors are known."""

from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
import pytest

from skhoid import MonteCarloStudy, RecursiveARX, operator_parameters
from skhoid.lab.studies import TOURNAMENT_METHODS, tournament_cells
from skhoid.lab.studies.tournament_scores import (
    PARAMETERS,
    at_instants,
    fitted,
    lag,
    method_figures,
    rows_of_path,
    settling_time,
    total_delay,
    tuning_scores,
)

RLS = TOURNAMENT_METHODS["rls"]
TIME = np.arange(15.0, 81.92, 0.16)


@pytest.fixture(scope="module")
def data():
    """A run of C4 with its truth."""
    (cell,) = tournament_cells("small", conditions=["C4"])
    study = MonteCarloStudy(
        lambda data, cell: 0.0,
        [cell.row()],
        2,
        n_validation_runs=1,
        simulation={"run_in": 20.0},
        random_state=0,
    )
    return study.data_set(0, 1)


def path_from(data, factor=1.0, sd=0.0):
    truth = data.truth.parameters[[*PARAMETERS]]
    path = truth * factor
    return path.join((truth * sd).add_prefix("sd_")) if sd else path


def figures(data, path, vaf=80.0):
    return rows_of_path(data, RLS, path, vaf, path).set_index("parameter")


def test_the_truth_has_no_error(data):
    found = figures(data, path_from(data, sd=0.1))
    assert list(found.index) == ["K_e", "K_edot", "omega_nm", "zeta_nm"]  # it is told the delay
    for window in ("all", "before", "around", "after"):
        assert (found[f"rmse_{window}"] == 0).all()
        assert (found[f"coverage_{window}"] == 100).all()
    assert found.loc["K_edot", "settling"] < 0.2
    assert found.loc["K_edot", "lag"] == pytest.approx(0.0, abs=1e-9)
    assert not found["diverged"].any()


def test_a_constant_factor_is_bias_alone(data):
    found = figures(data, path_from(data, 1.1, sd=0.1))
    assert found["bias_all"].to_numpy() == pytest.approx(10.0)
    assert found["rmse_after"].to_numpy() == pytest.approx(10.0)
    assert found["median_error_around"].to_numpy() == pytest.approx(10.0)
    assert (found["coverage_all"] == 100).all()  # 0.1 of 1.96 * 0.1
    narrow = figures(data, path_from(data, 1.1, sd=0.05))
    assert (narrow["coverage_all"] == 0).all()
    assert found.loc["K_edot", "lag"] == pytest.approx(0.0, abs=1e-9)


def test_no_estimate_is_the_worst_and_is_told(data):
    path = path_from(data, sd=0.1)
    path.loc[path.index > 48.0] = np.nan
    found = figures(data, path)
    share = (TIME > 48.0).mean()
    assert found["failed_all"].to_numpy() == pytest.approx(100 * share, abs=0.5)
    assert found["rmse_all"].to_numpy() == pytest.approx(100 * np.sqrt(share), abs=0.5)
    assert (found["rmse_after"] == 100).all()
    assert found["bias_after"].isna().all()
    assert found["coverage_all"].to_numpy() == pytest.approx(100 * (1 - share), abs=0.5)
    assert np.isinf(found.loc["K_edot", "settling"])
    none = rows_of_path(data, RLS, None, np.nan, None)
    assert (none["rmse_all"] == 100).all()
    assert none["diverged"].all()


@pytest.mark.parametrize(
    ("factor", "vaf", "diverged"),
    [(1.0, 80.0, False), (101.5, 80.0, True), (np.inf, 80.0, True), (1.0, -101.0, True),
     (1.0, np.nan, True), (50.0, -99.0, False)],
)  # fmt: skip
def test_divergence(data, factor, vaf, diverged):
    assert (figures(data, path_from(data, factor), vaf)["diverged"] == diverged).all()


def test_errors_beyond_100_percent_count_as_100(data):
    found = figures(data, path_from(data, 9.0))
    assert found["rmse_all"].to_numpy() == pytest.approx(100.0)
    assert found["bias_all"].to_numpy() == pytest.approx(100.0)
    assert found["coverage_all"].isna().all()  # nothing is stated


def test_a_first_order_lag_is_its_time_constant():
    """The area above the step response of 1 / (T s + 1) is T."""
    truth = np.where(TIME >= 40.0, 2.0, 1.0)
    T = 2.0
    slow = np.where(TIME >= 40.0, 2.0 - np.exp(-(TIME - 40.0) / T), 1.0)
    windows = {
        "before": TIME < 30.0,
        "around": (TIME >= 30.0) & (TIME <= 60.0),
        "after": TIME > 60.0,
    }
    assert lag(TIME, 3.0 * slow, truth, windows) == pytest.approx(T, abs=0.1)
    noisy = slow + 0.1 * np.random.default_rng(0).standard_normal(TIME.size)
    # sd 0.1 / sqrt(1 / 0.16) * sqrt(30 s) = 0.22 s, and of the levels 0.25 s
    assert lag(TIME, noisy, truth, windows) == pytest.approx(T, abs=4 * 0.33)
    assert np.isnan(lag(TIME, slow, np.ones(TIME.size), windows))
    assert np.isnan(lag(TIME, np.ones(TIME.size), truth, windows))


def test_settling_of_an_exponential():
    """|error| = exp(-t / T) falls to the 15 % of the band at T ln(1 / 0.15)."""
    T = 3.0
    error = np.where(TIME >= 40.0, -np.exp(-(TIME - 40.0) / T), 0.0)
    after = TIME > 60.0
    found = settling_time(TIME, error, 40.0, after)
    assert found == pytest.approx(T * np.log(1 / 0.15), abs=0.17)
    assert settling_time(TIME, error + 0.2, 40.0, after) == pytest.approx(found, abs=0.17)
    assert np.isinf(settling_time(TIME, error + 0.6, 40.0, after))
    swings = np.where(TIME >= 42.0, np.sin(TIME), 0.0)
    swings[TIME > 60.0] = 0.0
    assert settling_time(TIME, swings, 40.0, after) == pytest.approx(60 - 40, abs=2.0)


def test_a_path_at_other_instants():
    path = pd.DataFrame({"K": [0.0, 1.0, np.nan]}, index=pd.Index([10.0, 20.0, 30.0], name="time"))
    time = np.array([0.0, 10.0, 14.0, 20.0, 24.0, 40.0])
    offline = at_instants(path, time, causal=False)["K"].to_numpy()
    np.testing.assert_allclose(offline, [0, 0, 0.4, 1, np.nan, np.nan])
    causal = at_instants(path, time, causal=True)["K"].to_numpy()
    np.testing.assert_allclose(causal, [0, 0, 0, 1, 1, np.nan])
    constant = at_instants(pd.DataFrame({"K": [5.0]}), time, causal=True)
    assert (constant["K"] == 5).all()
    assert list(constant.index) == list(time)


def test_figures_are_those_of_the_estimator(data):
    """The study's function, against RecursiveARX and operator_parameters by hand."""
    found = method_figures(
        data, cell="c", method="rls", settings={"c": 2.56}, watching={"c": 2.56}
    ).set_index("parameter")
    model = RecursiveARX(nk=29, memory_time=2.56, store_covariance=True).fit(data.X, data.y)
    path = operator_parameters(model)
    truth = data.truth.parameters
    judged = (truth.index >= 15) & (np.arange(len(truth)) % 16 == 0)
    error = (path["K_edot"].to_numpy() / truth["K_edot"].to_numpy() - 1)[judged].clip(-1, 1)
    assert found.loc["K_edot", "rmse_all"] == pytest.approx(100 * np.sqrt(np.mean(error**2)))
    assert found.loc["K_edot", "bias_all"] == pytest.approx(100 * error.mean())
    assert found["failure"].isna().all()
    assert 70 < found["vaf"].iloc[0] < 95


def test_alarms_are_of_the_setting_that_watches(data):
    call = partial(method_figures, data, cell="c", method="rls", settings={"c": np.inf})
    same, other = call(watching={"c": np.inf}), call(watching={"c": 2.56})
    followed = same["parameter"] == "K_edot"
    assert same.loc[followed, "rmse_all"].item() == other.loc[followed, "rmse_all"].item()
    assert other.loc[followed, "peak"].item() > 1.5 * same.loc[followed, "peak"].item()


def test_a_method_that_fails_is_a_row_with_the_reason(data, monkeypatch):
    def broken(dt, nk, setting):
        raise FloatingPointError("lost")

    monkeypatch.setitem(TOURNAMENT_METHODS, "rls", replace(RLS, make=broken))
    model, path, vaf, failure = fitted(data, TOURNAMENT_METHODS["rls"], 2.56, "true")
    rows = tuning_scores(data, cell="c", method="rls")
    assert (model, path) == (None, None)
    assert np.isnan(vaf)
    assert failure == "FloatingPointError: lost"
    assert [row["vaf"] for row in rows] == [-100.0] * 5


def test_the_delay_is_told_or_searched(data):
    assert total_delay(data, "true") == 29
    assert total_delay(data, "searched") == pytest.approx(29, abs=4)
