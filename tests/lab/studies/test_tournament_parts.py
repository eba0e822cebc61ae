"""Cells, methods, figures, alarms and losses of the tournament, where answers are known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import mannwhitneyu
from sklearn.base import clone

from skhoid import CompensatoryTask, MonteCarloStudy, RecursiveARX, operator_parameters
from skhoid.lab.studies import TOURNAMENT_METHODS, TournamentCell, tournament_cells
from skhoid.lab.studies.tournament_conditions import Change
from skhoid.lab.studies.tournament_methods import available_methods
from skhoid.lab.studies.tournament_result import detect, losses, rank, roc_area
from skhoid.lab.studies.tournament_scores import (
    ALARMS,
    PARAMETERS,
    THRESHOLDS,
    lag,
    method_figures,
    rows_of_path,
    settling_time,
)

HERE, _ = available_methods()
RLS = TOURNAMENT_METHODS["rls"]
TIME = np.arange(15.0, 81.92, 0.16)


def test_all_cells_are_there_once():
    cells = tournament_cells()
    assert len({cell.name for cell in cells}) == len(cells) == 94
    families = [cell.family for cell in cells]
    assert [families.count(f) for f in ("condition", "shape", "50 Hz", "element")] == [72, 12, 6, 4]


def test_some_cells_only():
    cells = tournament_cells(conditions=["C4", "relapse", "K/s²"], intensities=[0.15])
    names = {cell.name for cell in cells}
    assert "C4, P_n 0.15, order 1" in names
    assert {"relapse, P_n 0.15", "K/s², P_n 0.15", "C4, P_n 0.15, 50 Hz"} <= names
    assert len(cells) == 4 + 1 + 1 + 1
    other = tournament_cells("small", conditions=["C1"], intensities=[0.1], orders=["nm"])
    assert [(c.remnant_intensity, c.remnant_order) for c in other] == [(0.1, "nm")]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": "huge"}, "size must be one of"),
        ({"conditions": ["C7"]}, "Unknown condition 'C7'; known are C1, .* Did you mean"),
        ({"intensities": [0.0]}, "above 0"),
    ],
)
def test_cells_that_are_none(options, message):
    with pytest.raises(ValueError, match=message):
        tournament_cells(**options)
    with pytest.raises(ValueError, match="kind must be one of"):
        TournamentCell("a", "C1", kind="odd")


def change_of(condition):
    return Change.of(CompensatoryTask.of_condition(condition))


def test_a_sigmoid_has_gone_5_and_95_percent_where_its_formula_says():
    """(1 + exp(-G (t - t_M)))^-1 = 0.05 at t_M - ln 19 / G."""
    early, middle, late = change_of("C3").times
    half = np.log(19) / 0.5
    assert (early, middle, late) == pytest.approx((40.96 - half, 40.96, 40.96 + half), abs=0.15)


def test_an_estimator_has_the_setting():
    for method in HERE:
        model = method.estimator(0.01, 29, method.settings[-1])
        clone(model)
        if method.knob is not None:
            last = model[-1] if hasattr(model, "steps") else model
            assert getattr(last, method.knob) == method.settings[-1]


def test_the_oracle_is_told_the_change_and_nothing_without_one():
    t = np.arange(0.0, 4.0)
    varies = pd.DataFrame({"K_edot": [1.0, 1.0, 3.0, 3.0]}, index=t)
    method = TOURNAMENT_METHODS["lpv"]
    model = method.estimator(0.01, 29, None, varies)
    np.testing.assert_allclose(model.basis(t), [0, 0, 1, 1])
    still = method.estimator(0.01, 29, None, varies * 0 + 2.0)
    assert type(still).__name__ == "ARXRegressor"


def test_what_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(TOURNAMENT_METHODS, "rls", replace(RLS, package="no_such_package"))
    methods, notes = available_methods(["rls", "arx"])
    assert [m.name for m in methods] == ["arx"]
    assert notes == ["rls needs the package no_such_package, which is not installed."]
    with pytest.raises(ValueError, match=r"No method is left to take part\. rls needs"):
        available_methods(["rls"])


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


def test_the_area_is_that_of_mann_and_whitney():
    rng = np.random.default_rng(1)
    changed, constant = rng.normal(1, 1, 40).round(1), rng.normal(0, 1, 30).round(1)
    expected = mannwhitneyu(changed, constant).statistic / (40 * 30)
    assert roc_area(changed, constant) == pytest.approx(expected)
    assert roc_area(np.array([np.nan]), np.array([np.nan])) == 0.5
    assert np.isnan(roc_area(np.array([]), constant))


def test_alarms_are_counted():
    """Four changed runs: found after 3 s, too early, missed, found after 5 s."""
    at = 5
    rows = pd.DataFrame(
        {
            "method": "m",
            "kind": ["changing"] * 4 + ["constant"] * 10,
            "peak": [9.0] * 4 + [THRESHOLDS[at] * 0.99] * 9 + [9.0],
            "change_begins": 38.0,
            "change_time": 40.0,
        }
    )
    for name in ALARMS:
        rows[name] = np.nan
    rows.loc[:3, ALARMS[at]] = [43.0, 30.0, np.nan, 45.0]
    rows["remnant_intensity"] = 0.15
    (found,) = detect(rows).to_dict("records")
    assert found["threshold"] == pytest.approx(THRESHOLDS[at])
    assert (found["found"], found["too_early"], found["missed"]) == (0.5, 0.25, 0.25)
    assert found["delay"] == 4.0
    assert detect(rows[rows["kind"] == "changing"]).empty


def table(n=3):
    """Two methods, a constant and a changing cell; "good" is right, "bad" is not."""
    rows = []
    for method, error in (("bad", 30.0), ("good", 10.0)):
        for kind in ("constant", "changing"):
            for replication in range(n):
                for parameter in ("K_edot", "tau_e") if method == "good" else ("K_edot",):
                    rows.append(
                        {
                            "cell": kind,
                            "kind": kind,
                            "group": f"{kind}, P_n = 0.15",
                            "replication": replication,
                            "method": method,
                            "parameter": parameter,
                            "rmse_all": error + replication,
                            "rmse_after": error / 2 if kind == "changing" else np.nan,
                            "vaf": 90.0 - error,
                            "peak": 0.05,
                            "change_begins": 38.0,
                            "change_time": 40.0,
                            "change_left": 41.92,
                        }
                        | dict.fromkeys(ALARMS, 40.0 + error / 10)
                    )
    return pd.DataFrame(rows)


def test_each_question_has_its_loss():
    rows = table()
    follow = losses(rows, "follow")
    assert follow.loc[("constant", 1)].to_dict() == {"bad": 31.0, "good": 11.0}
    assert losses(rows, "final").loc[("changing", 0)].to_dict() == {"bad": 15.0, "good": 5.0}
    assert losses(rows, "predict").loc[("changing", 0)].to_dict() == {"bad": 40.0, "good": 20.0}
    assert losses(rows, "detect").loc[("changing", 0)].to_dict() == {"bad": 3.0, "good": 1.0}
    assert list(losses(rows, "delay").columns) == ["good"]
    assert len(losses(rows, "final")) == 3


def test_no_estimate_is_the_largest_loss():
    rows = table()
    rows.loc[rows["method"] == "good", ["rmse_all", "rmse_after", "vaf", *ALARMS]] = np.nan
    assert (losses(rows, "follow")["good"] == 100).all()
    assert (losses(rows, "final")["good"] == 100).all()
    assert (losses(rows, "predict")["good"] == 200).all()
    assert losses(rows, "detect")["good"].to_numpy() == pytest.approx(41.92)


def test_ranking_counts_cells_alike():
    """Medians in cells, then over cells; the share of cells won."""
    index = pd.MultiIndex.from_tuples(
        [("a", 0), ("a", 1), ("a", 2), ("b", 0), ("c", 0)], names=["cell", "replication"]
    )
    found = rank(pd.DataFrame({"x": [1.0, 2, 9, 4, 5], "y": [3.0, 3, 3, 3, np.nan]}, index=index))
    assert found["loss"].to_dict() == {"y": 3.0, "x": 4.0}
    assert found["won"].to_dict() == pytest.approx({"x": 200 / 3, "y": 100 / 3})
    assert found["n"].to_dict() == {"x": 5, "y": 4}
    assert list(found.index) == ["y", "x"]


def test_questions_without_an_answer():
    rows = table()
    with pytest.raises(ValueError, match=r"question must be one of .*; got 'folow'.*'follow'"):
        losses(rows, "folow")
    with pytest.raises(ValueError, match="parameter must be one of"):
        losses(rows, "follow", "K_x")
    still = rows[rows["kind"] == "constant"]
    with pytest.raises(ValueError, match="nothing changes in them"):
        losses(still, "final")
    with pytest.raises(ValueError, match="needs cells in which nothing changes"):
        losses(rows[rows["kind"] == "changing"], "detect")
