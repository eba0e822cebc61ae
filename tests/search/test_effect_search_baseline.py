"""What a search says of the model it begins with does not depend on what it tries."""

import numpy as np
import pytest

from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor, make_tracking_runs

LOOP = ["vaf", "rmse", "vaf_loop", "vaf_train"]
MODELS = {"operator": OperatorRegressor(), "arx": ARXRegressor(na=2, nb=2, nk=14)}


@pytest.fixture(scope="module")
def runs():
    """Runs in which much remnant comes back, of a stick with a stop that is hardly reached."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=2,
        remnant_intensity=0.4,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        random_state=3,
    )
    return X, y.clip(-0.15, 0.15)


def search_of(runs, model, effects):
    return EffectSearchCV(MODELS[model], effects=effects).fit(*runs)


@pytest.mark.slow
def test_the_baseline_is_one_number_whatever_is_tried(runs):
    tried = [["bias"], ["saturation", "dead_zone"]]
    searches = [search_of(runs, "operator", effects) for effects in tried]
    first = searches[0]
    assert any(one.best_effects_ for one in searches)
    for one in searches:
        np.testing.assert_array_equal(
            one.error_path_[LOOP].iloc[0], first.error_path_[LOOP].iloc[0]
        )
        of_first = one.ranking_.loc[one.ranking_["step"] == 1, "vaf_before"]
        assert set(of_first) == {one.error_path_["vaf"].iloc[0]}
        np.testing.assert_array_equal(one.predictions_["baseline"], first.predictions_["baseline"])
        np.testing.assert_array_equal(
            one.baseline_.predict(runs[0]), first.baseline_.predict(runs[0])
        )


@pytest.mark.parametrize("model", MODELS)
def test_a_ranking_without_rows_has_its_columns(model):
    """Tremor is looked for in what is left, and is no row where there is none."""
    X, y = make_tracking_runs(
        "C1", n_runs=2, remnant_intensity=0.1, sampling_rate=50, duration=20.48, random_state=3
    )
    search = search_of((X, y), model, ["tremor"])
    assert search.best_effects_ == []
    assert len(search.ranking_) == 0
    assert {"step", "effect", "status", "reason_code", "vaf_gain"} <= set(search.ranking_)
    assert "Nothing found" in search.summary()
    assert "Nothing found" in search._repr_html_()
