"""Losses of tables whose answer is plain."""

import numpy as np
import pandas as pd
import pytest

from skhoid.lab.studies.tournament_scores import ALARMS, QUESTIONS, THRESHOLDS, losses, ranked


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


def test_an_alarm_too_early_is_none():
    rows = table()
    rows.loc[rows["method"] == "good", ALARMS] = 30.0
    assert losses(rows, "detect")["good"].to_numpy() == pytest.approx(41.92)


def test_the_threshold_is_that_of_the_method_s_own_constant_runs():
    rows = table()
    rows.loc[(rows["method"] == "good") & (rows["kind"] == "constant"), "peak"] = 2 * THRESHOLDS[-1]
    assert losses(rows, "detect")["good"].to_numpy() == pytest.approx(41.92)  # no threshold left
    assert losses(rows, "detect")["bad"].to_numpy() == pytest.approx(3.0)


def test_ranking_counts_cells_alike():
    """Medians in cells, then over cells; the share of cells won."""
    index = pd.MultiIndex.from_tuples(
        [("a", 0), ("a", 1), ("a", 2), ("b", 0), ("c", 0)], names=["cell", "replication"]
    )
    found = ranked(pd.DataFrame({"x": [1.0, 2, 9, 4, 5], "y": [3.0, 3, 3, 3, np.nan]}, index=index))
    assert found["loss"].to_dict() == {"y": 3.0, "x": 4.0}
    assert found["won"].to_dict() == pytest.approx({"x": 200 / 3, "y": 100 / 3})
    assert found["n"].to_dict() == {"x": 5, "y": 4}
    assert list(found.index) == ["y", "x"]


def test_errors():
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
    assert set(QUESTIONS) == {"follow", "final", "detect", "predict", "delay"}
