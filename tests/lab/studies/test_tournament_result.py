"""What a result says, shows and keeps."""

import numpy as np
import pandas as pd
import pytest

from skhoid.lab.studies import TournamentResult, run_tournament, tournament_cells

pytestmark = pytest.mark.slow  # compiles for many seconds

METHODS = ["rls", "rls_auto", "arx"]


@pytest.fixture(scope="module")
def result():
    cells = tournament_cells("small", conditions=["C1", "C4"])
    return run_tournament(METHODS, cells, size="small", n_replications=3, n_validation=1)


def test_words(result):
    text = str(result)
    assert text.startswith("3 methods on 2 conditions, 6 simulated runs")
    assert "- Causal, to follow K_edot over time: rls" in text
    assert "- Offline, to predict the output: arx" in text
    assert max(map(len, text.splitlines())) <= 88
    html = result._repr_html_()
    assert "<table>" in html
    assert "Causal methods: K_edot over time" in html
    assert repr(result) == text


def test_summary_is_of_the_table(result):
    table = result.table
    rows = table[(table["method"] == "rls") & (table["parameter"] == "K_edot")]
    rows = rows[rows["cell"] == "C4, P_n 0.15"]
    found = result.by_cell().loc[("C4, P_n 0.15", "rls", "K_edot")]
    assert found["bias"] == pytest.approx(rows["bias_all"].mean())
    assert found["rmse"] == pytest.approx(rows["rmse_all"].median())
    assert found["sd"] ** 2 + found["bias"] ** 2 == pytest.approx((rows["rmse_all"] ** 2).mean())
    summary = result.summary(family="condition")
    of_cells = result.by_cell().xs(("rls", "K_edot"), level=("method", "parameter"))
    assert summary.loc[("rls", "K_edot"), "bias"] == pytest.approx(of_cells["bias"].abs().median())
    with pytest.raises(ValueError, match="No cell is of the family 'shape'; there are condition"):
        result.summary(family="shape")


def test_rankings(result):
    assert result.best("predict", causal=False) == "arx"
    ranking = result.ranking("follow")
    assert ranking["won"].sum() == pytest.approx(100.0)
    assert ranking["loss"].is_monotonic_increasing
    assert list(result.ranking(causal=True).index.sort_values()) == ["rls", "rls_auto"]
    with pytest.raises(ValueError, match="No data set answers the question 'delay'"):
        result.ranking("delay")
    only = TournamentResult(
        result.table[result.table["method"] == "arx"],
        result.tuning,
        result.methods[2:],
        result.cost,
    )
    with pytest.raises(ValueError, match="No causal method took part that could be ranked"):
        only.ranking(causal=True)


def test_detection(result):
    found = result.detection()
    assert found.index.names == ["method", "remnant_intensity"]
    assert found.loc[("rls", 0.15), "roc_area"] == 1.0
    assert found.loc[("arx", 0.15), "roc_area"] == 0.5


@pytest.mark.parametrize("form", ["csv", "tsv", "parquet"])
def test_saved_and_loaded(result, tmp_path, form):
    files = result.save(tmp_path, figures=form == "csv", table_format=form)
    assert all(path.exists() for path in files)
    if form == "csv":
        assert {"winners.png", "bias.png", "settling.png"} <= {path.name for path in files}
    loaded = TournamentResult.load(tmp_path)
    assert str(loaded) == str(result)
    pd.testing.assert_series_equal(
        loaded.ranking("follow")["loss"], result.ranking("follow")["loss"], rtol=1e-12
    )
    assert loaded.table["failure"].isna().all()


def test_nothing_to_load(tmp_path):
    with pytest.raises(FileNotFoundError, match="no table named table"):
        TournamentResult.load(tmp_path)


def test_costs_are_positive(result):
    assert (result.cost > 0).all()
    assert list(result.cost.index) == METHODS
    assert np.isfinite(result.cost).all()


def test_unknown_pictures(result):
    with pytest.raises(ValueError, match=r"kind must be one of .*; got 'pie'"):
        result.plot("pie")
