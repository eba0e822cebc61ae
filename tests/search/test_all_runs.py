"""A search that looks at some of very many runs, and its figures, which are of all."""

import numpy as np
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs, run_labels
from skhoid.model.estimator import vaf_of_output

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data():
    X, y = make_tracking_runs(
        condition="C1",
        n_runs=6,
        duration=20.48,
        sampling_rate=50,
        remnant_intensity=0.05,
        random_state=0,
    )
    return X, y.clip(-0.1, 0.1)


@pytest.fixture(scope="module")
def search(data):
    model = OperatorRegressor(settling=1.0)
    return EffectSearchCV(model, effects=["saturation"], max_rows=3000).fit(*data)


def test_it_says_where_it_looked(data, search):
    assert len(search.searched_runs_) == 3
    assert {*search.searched_runs_} < {*run_labels(data[0])}
    note = search.notes_[0]
    assert note.kind == "some runs"
    assert note.text.startswith("effects were looked for in 3 of 6 runs")
    assert "max_rows=None" in note.hint
    assert search.best_effects_ == ["saturation"]


def test_parameters_are_those_of_all_runs(data, search):
    expected = OperatorRegressor(settling=1.0).fit(*data)
    baseline = search.baseline_
    assert baseline.n_rows_used_ == expected.n_rows_used_ == search.best_estimator_.n_rows_used_
    away = (baseline.parameters_["value"] - expected.parameters_["value"]).abs()
    assert (away < 0.1 * expected.parameters_["sd"]).all()
    assert baseline.loglik_ == pytest.approx(expected.loglik_, abs=0.1)


def test_figures_are_of_all_rows(data, search):
    table, path = search.predictions_, search.error_path_
    assert len(table) == len(data[0])
    assert np.isfinite(table.to_numpy()).all()
    prepared = OperatorRegressor(settling=1.0).prepare(*data)
    for title, vaf in zip(table.columns[1:], path["vaf"], strict=True):
        output = prepared.columns.beside(table[title].to_numpy())
        assert vaf == pytest.approx(vaf_of_output(prepared.record, output), abs=1e-9)
    assert (path["vaf_train"] > path["vaf"] - 0.2).all()
