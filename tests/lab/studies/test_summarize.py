"""Means, deviations, quantiles and intervals by cell."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from skhoid.lab.studies import summarize


def table(n=40):
    rng = np.random.default_rng(0)
    return pd.DataFrame(
        {
            "condition": np.repeat(["C1", "C2"], n),
            "order": np.array([1.0, np.nan]).repeat(n),
            "replication": [*range(n)] * 2,
            "nk": rng.normal(29.0, 2.0, 2 * n),
            "found": rng.random(2 * n) < 0.25,
            "name": "x",
            "error": None,
            "seed": None,
        }
    )


def test_statistics_by_cell():
    given = table()
    given.loc[3, "nk"] = np.nan
    found = summarize(given)
    assert found.index.names == ["condition", "order", "value"]
    assert list(found.index.get_level_values("value")) == ["nk", "found"] * 2
    x = given["nk"][:40].dropna()
    row = found.iloc[0]
    assert (row["n"], row["missing"]) == (39, 1)
    wanted = [x.mean(), x.std(), x.quantile(0.05), x.median()]
    np.testing.assert_allclose(row[["mean", "sd", "q05", "q50"]].to_list(), wanted)
    interval = stats.ttest_1samp(x, 0).confidence_interval(0.95)
    np.testing.assert_allclose(row[["low", "high"]].to_list(), interval)
    assert found.iloc[1]["mean"] == given["found"][:40].mean()
    assert summarize(given, by="found", values=["nk"])["n"].sum() == 79


def iqr(x):
    return np.quantile(x, 0.75) - np.quantile(x, 0.25)


@pytest.mark.parametrize("statistic", ["median", iqr])
def test_bootstrap_of_other_statistics(statistic):
    found = summarize(table(), values="nk", statistic=statistic)
    x = table()["nk"][:40].to_numpy()
    function = np.median if statistic == "median" else iqr
    row = found.iloc[0]
    assert row["median" if statistic == "median" else "iqr"] == function(x)
    peer = stats.bootstrap(
        (x,), function, vectorized=False, n_resamples=999, method="percentile", random_state=1
    ).confidence_interval
    np.testing.assert_allclose([row["low"], row["high"]], peer, atol=0.3 * (peer.high - peer.low))
    again = summarize(table(), values="nk", statistic=statistic)
    pd.testing.assert_frame_equal(again, found, check_exact=True)


def test_single_values_have_no_interval():
    given = pd.DataFrame({"condition": ["C1", "C2", "C2"], "replication": 0, "v": [2.0, 1.0, 1.0]})
    found = summarize(given)
    assert found.iloc[0][["sd", "low", "high"]].isna().all()
    assert found.iloc[1][["low", "high"]].tolist() == [1.0, 1.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"by": "subject"}, "no column 'subject'"),
        ({"values": ["nk", "nl"]}, "no column 'nl'"),
        ({"statistic": "mode"}, "statistic must be one of"),
    ],
)
def test_what_makes_no_sense(options, message):
    with pytest.raises(ValueError, match=message):
        summarize(table(), **options)
    with pytest.raises(ValueError, match="'replication'"):
        summarize(table().drop(columns="replication"))


def test_a_share_has_an_interval_even_where_all_agree():
    given = pd.DataFrame({"condition": "C1", "replication": range(20), "seen": True})
    row = summarize(given).iloc[0]
    assert (row["mean"], row["sd"]) == (1.0, 0.0)
    assert row["high"] == pytest.approx(1.0)
    assert row["low"] == pytest.approx(20 / (20 + 1.96**2), abs=1e-3)  # Wilson (1927)
