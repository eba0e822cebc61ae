"""Means, deviations, quantiles and intervals by cell."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from skhoid.lab.studies import summarize


def table(n=40, seed=0):
    rng = np.random.default_rng(seed)
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
    found = summarize(given, quantiles=(0.025, 0.5, 1))
    assert found.index.names == ["condition", "order", "value"]
    assert list(found.index.get_level_values("value")) == ["nk", "found"] * 2
    columns = ["n", "missing", "mean", "sd", "q02.5", "q50", "q100", "low", "high"]
    assert list(found.columns) == columns
    x = given["nk"][:40].dropna()
    row = found.iloc[0]
    assert (row["n"], row["missing"]) == (39, 1)
    wanted = [x.mean(), x.std(), x.quantile(0.025), x.median(), x.max()]
    np.testing.assert_allclose(row[["mean", "sd", "q02.5", "q50", "q100"]].to_list(), wanted)
    interval = stats.ttest_1samp(x, 0).confidence_interval(0.95)
    np.testing.assert_allclose(row[["low", "high"]].to_list(), interval)
    assert found.iloc[1]["mean"] == given["found"][:40].mean()


def iqr(x):
    return np.quantile(x, 0.75) - np.quantile(x, 0.25)


@pytest.mark.parametrize(
    ("statistic", "name"), [("median", "median"), ("std", "std"), (iqr, "iqr")]
)
def test_bootstrap_of_other_statistics(statistic, name):
    found = summarize(table(), values="nk", statistic=statistic, confidence=0.9)
    x = table()["nk"][:40].to_numpy()
    function = {"median": np.median, "std": lambda x: x.std(ddof=1)}.get(name, iqr)
    row = found.iloc[0]
    assert row[name] == function(x)
    peer = stats.bootstrap(
        (x,), function, vectorized=False, confidence_level=0.9, n_resamples=999,
        method="percentile", random_state=1,
    ).confidence_interval  # fmt: skip
    np.testing.assert_allclose([row["low"], row["high"]], peer, atol=0.2 * (peer.high - peer.low))
    again = summarize(table(), values="nk", statistic=statistic, confidence=0.9)
    pd.testing.assert_frame_equal(again, found, check_exact=True)


@pytest.mark.parametrize("statistic", ["mean", "std"])
def test_intervals_hold_what_they_say(statistic):
    """Of 200 intervals of 90 % so many hold the truth, within 3.5 sigma (sigma = 2.1 %).

    Those of bootstrapped deviations hold a little less, as is known of percentiles.
    """
    given = pd.concat([table(50, seed).assign(cell=seed) for seed in range(100)])
    options = {"values": "nk", "statistic": statistic, "confidence": 0.9, "n_resamples": 199}
    found = summarize(given, ["cell", "condition"], **options)
    truth = {"mean": 29.0, "std": 2.0}[statistic]
    share = ((found["low"] <= truth) & (truth <= found["high"])).mean()
    assert 0.9 - 0.074 - 0.05 * (statistic == "std") < share < 0.9 + 0.074


@pytest.mark.parametrize("statistic", ["mean", "median", "std", iqr])
@pytest.mark.parametrize("x", [[], [2.0], [2.0, 2.0], [1.0, np.inf], [np.nan, np.nan]])
def test_few_and_strange_values(statistic, x):
    given = pd.DataFrame({"replication": range(len(x)), "v": np.array(x, dtype=float)})
    found = summarize(given, statistic=statistic, n_resamples=9).iloc[0]
    known = np.array(x)[~np.isnan(x)] if x else np.array([])
    assert found["n"] == known.size
    if known.size < 2:
        assert np.isnan(found[["sd", "low", "high"]].to_list()).all()
    elif np.isfinite(known).all():
        assert found["low"] == found["high"] == (2.0 if statistic in ("mean", "median") else 0.0)


def test_other_groups():
    found = summarize(table(), by="found", values=["nk"])
    assert found.index.names == ["found", "value"]
    assert found["n"].sum() == 80


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"by": "subject"}, "no column 'subject'"),
        ({"values": ["nk", "nl"]}, "no column 'nl'"),
        ({"confidence": 95}, "between 0 and 1"),
        ({"statistic": "mode"}, "statistic must be one of"),
        ({"quantiles": [5]}, "between 0 and 1"),
    ],
)
def test_what_makes_no_sense(options, message):
    with pytest.raises(ValueError, match=message):
        summarize(table(), **options)
    with pytest.raises(ValueError, match=r"column 'n', which the summary uses itself: rename it"):
        summarize(table().rename(columns={"order": "n"}))
    with pytest.raises(ValueError, match="'replication'"):
        summarize(table().drop(columns="replication"))


def test_a_share_has_an_interval_even_where_all_agree():
    given = pd.DataFrame({"condition": "C1", "replication": range(20), "seen": True})
    row = summarize(given).iloc[0]
    assert (row["mean"], row["sd"]) == (1.0, 0.0)
    assert row["high"] == pytest.approx(1.0)
    assert row["low"] == pytest.approx(20 / (20 + 1.96**2), abs=1e-3)  # Wilson (1927)
