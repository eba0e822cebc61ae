"""EffectSearchCV: names what was hidden, and its tables tell one story."""

import numpy as np
import pandas as pd
import pytest
from sklearn.exceptions import NotFittedError
from support.open_loop import RIVALS, dead, recorded, searched
from support.own_effect import Compressed

from skhoid import (
    EffectSearchCV,
    OperatorRegressor,
)
from skhoid.effects import Bias, DeadZone, Effects, catalogue, title_of
from skhoid.search import Verdict


def said(search):
    """The summary, on one line."""
    return " ".join(search.summary().split())


@pytest.fixture(scope="module")
def clean():
    return searched(recorded())


@pytest.fixture(scope="module")
def two():
    return searched(recorded(inner=dead, outer=lambda u: u + 0.25))


def of_limited_rate(u, step=0.008):
    out = u.copy()
    for k in range(1, len(u)):
        out[k] = out[k - 1] + np.clip(u[k] - out[k - 1], -step, step)
    return out


HIDDEN = {
    "saturation": {"outer": lambda u: np.clip(u, -0.35, 0.35)},
    "gain_drift": {"gain": lambda t: 1 + 0.025 * (t - 20)},
    "lapses": {"gain": lambda t: np.where((t > 12) & (t < 15.5), 0.0, 1.0)},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(HIDDEN))
def test_what_is_hidden_is_named(name):
    search = searched(recorded(**HIDDEN[name], seed=5))
    assert search.best_effects_ == [name]
    assert search.verdict_ is Verdict.FOUND


@pytest.mark.slow
def test_processes_do_not_change_the_result():
    runs, names = recorded(2, 20.0, **HIDDEN["saturation"], seed=5), ["bias", "drift"]
    one, two = (searched(runs, names, n_jobs=n) for n in (1, 2))
    pd.testing.assert_frame_equal(one.ranking_, two.ranking_, check_exact=True)
    pd.testing.assert_frame_equal(one.predictions_, two.predictions_, check_exact=True)


def test_nothing_is_missing(clean):
    assert clean.best_effects_ == clean.stand_ins_ == []
    assert clean.verdict_ is Verdict.NOTHING
    assert list(clean.error_path_["effect"]) == ["baseline"]
    assert list(clean.predictions_.columns) == ["measured", "baseline"]
    assert clean.explainable_gap_ < 1.0
    assert clean.best_estimator_.effects is None
    assert (clean.ranking_["evidence"].dropna() < 12.5).all()
    assert said(clean).startswith("Nothing found; these runs would have shown 5 of 7 effects from")


@pytest.mark.slow
def test_what_no_effect_tried_explains_is_unknown():
    search = searched(recorded(inner=np.sign, remnant=0.05), ["bias", "gain_drift", "extra_lag"])
    assert search.best_effects_ == ["unknown"]
    assert search.verdict_ is Verdict.NOT_TRIED
    where = zip(search.unexplained_["where"], search.unexplained_["at"], strict=True)
    assert ("amplitude", "e") in where
    assert search.explainable_gap_ > 2
    assert "What none of the 3 effects tried explains" in said(search)
    assert 'effects="all"' in said(search)
    assert list(search.error_path_["effect"]) == ["baseline"]


@pytest.mark.slow
def test_a_search_that_stops_at_max_effects_says_so(hidden_data):
    search = searched(hidden_data, ["dead_zone"], max_effects=0)
    assert search.best_effects_ == ["unknown"]
    assert search.verdict_ is Verdict.CUT_SHORT
    assert "What is not explained within max_effects=0" in said(search)
    assert "a larger max_effects" in said(search)


@pytest.mark.slow
def test_what_is_not_sure_is_a_stand_in():
    data = recorded(outer=lambda u: of_limited_rate(u, 0.006), remnant=0.05)
    search = searched(data, ["bias", "gain_drift", "extra_lag"], confidence=0.97)
    assert (search.best_effects_, search.stand_ins_) == (["unknown"], ["extra_lag"])
    assert search.best_estimator_.effects_.names == ["extra_lag"]
    assert search.verdict_ is Verdict.NOT_TRIED  # a rate limit is curved, as no lag is
    assert "none of the 3 effects tried explains; with extra lag the held-" in said(search)
    assert search.result_.as_dict()["stand_ins"] == ["extra_lag"]


def test_two_effects_are_both_named(two):
    assert sorted(two.best_effects_) == ["bias", "dead_zone"]
    parameters = two.best_estimator_.parameters_
    assert parameters.loc["bias__level", "value"] == pytest.approx(0.25, abs=0.03)
    assert two.error_path_["vaf"].is_monotonic_increasing
    assert two.error_path_["rmse"].is_monotonic_decreasing


@pytest.mark.slow
def test_an_own_effect_is_named(hidden_data):
    X, y = recorded(inner=lambda e: 0.3 * np.arcsinh(e / 0.3))
    search = searched((X, y), [*RIVALS[:4], Compressed()])
    assert search.best_effects_ == ["compressed"]
    row = search.best_estimator_.parameters_.loc["compressed__knee"]
    assert abs(row["value"] - 0.3) < 4 * row["sd"] + 0.005
    words = search.ranking_.set_index("effect").loc["compressed", "words"]
    assert words.iloc[0] if isinstance(words, pd.Series) else words == Compressed.physics


@pytest.mark.slow
def test_the_whole_catalogue_is_tried(hidden_data):
    search = searched(hidden_data, "all", max_effects=1)
    assert search.best_effects_[:1] == ["dead_zone"]
    first = search.ranking_[search.ranking_["step"] == 1].set_index("effect")
    assert set(first.index) | {"tremor"} == set(catalogue().index)
    assert first.loc["feedforward", "status"] == "does not apply"
    assert "target" in first.loc["feedforward", "reason"]


def pooled(predictions, column, known):
    measured = predictions["measured"].to_numpy()[known]
    error = measured - predictions[column].to_numpy()[known]
    return 100 * (1 - error @ error / (measured @ measured)), np.sqrt(np.mean(error**2))


@pytest.mark.parametrize("search", ["found", "clean"])
def test_the_error_path_is_that_of_the_predictions(search, request):
    search = request.getfixturevalue(search)
    path, predictions = search.error_path_, search.predictions_
    known = predictions.index.get_level_values("time").to_numpy() >= 3.0 - 1e-9
    for (_, row), column in zip(path.iterrows(), predictions.columns[1:], strict=True):
        vaf, rmse = pooled(predictions, column, known)
        assert row["vaf"] == pytest.approx(vaf, abs=1e-6)
        assert row["rmse"] == pytest.approx(rmse, rel=1e-6)
        assert row["vaf_train"] > row["vaf"] - 0.05  # held-out parameters cannot fit better
    effects = [e for e in search.best_effects_ if e != "unknown"]
    assert list(path["effect"]) == ["baseline", *effects]
    assert path.index.name == "step"
    assert list(path.index) == list(range(len(path)))
    assert list(predictions.columns) == ["measured", "baseline", *(f"+ {e}" for e in effects)]


@pytest.mark.parametrize("search", ["found", "clean"])
def test_the_ranking_is_consistent(search, request):
    search = request.getfixturevalue(search)
    ranking = search.ranking_
    for step, rows in ranking.groupby("step"):
        assert list(rows["rank"]) == list(range(1, len(rows) + 1))
        assert rows["effect"].is_unique
        np.testing.assert_allclose(
            rows["vaf_after"] - rows["vaf_before"], rows["vaf_gain"], atol=1e-9
        )
        assert (rows["status"] == "added").sum() <= 1
        if step == 1:
            assert set(rows["vaf_before"]) == {search.error_path_["vaf"].iloc[0]}
    added = ranking.loc[ranking["status"] == "added", "effect"]
    assert sorted(added) == sorted(e for e in search.best_effects_ if e != "unknown")
    tried = ranking[ranking["status"] != "does not apply"]
    assert tried["p_value"].between(0, 1).all()


def test_fit_changes_nothing_that_it_is_given(hidden_data):
    X, y = (table.copy() for table in hidden_data)
    estimator = OperatorRegressor()
    effects = [DeadZone(), Bias()]
    search = EffectSearchCV(estimator, effects=effects).fit(X, y)
    pd.testing.assert_frame_equal(X, hidden_data[0])
    pd.testing.assert_series_equal(y, hidden_data[1])
    assert not hasattr(estimator, "parameters_")
    assert search.estimator is estimator
    assert search.effects is effects
    assert effects[0].width is None


def test_predict_and_score_are_those_of_the_best_model(found, hidden_data):
    X, y = hidden_data
    np.testing.assert_array_equal(found.predict(X), found.best_estimator_.predict(X))
    assert found.score(X, y) == found.best_estimator_.score(X, y)
    assert found.score(X, y) > found.baseline_.score(X, y) + 1
    assert isinstance(found.best_estimator_.effects_, Effects)
    assert "dead_zone__width" not in found.baseline_.parameters_.index


def test_adding_by_hand_is_what_the_search_added(found, hidden_data):
    by_hand = OperatorRegressor().with_effect(found.best_effects_[0]).fit(*hidden_data)
    best = found.best_estimator_.parameters_
    np.testing.assert_allclose(by_hand.parameters_["value"], best["value"], rtol=0.01)


def test_the_summary_tells_the_steps(found, two):
    text = said(found)
    path = found.error_path_
    before, after = path["vaf"]
    chance = 100 * found.ranking_["probability"].iloc[0]
    told = f"with it the held-out VAF rises from {before:.1f} to {after:.1f} %"
    assert text.startswith(f"Missing: dead zone ({chance:.0f} %); {told}")
    assert f"Baseline: VAF {before:.1f} %" in text
    assert "Step 1, with dead zone: VAF" in text
    assert " (dead_zone: width = 0.29" in text
    assert repr(found.summary()) == found.summary()  # a notebook shows it line by line
    assert f"VAF {path['vaf'].iloc[0]:.1f} -> {path['vaf'].iloc[1]:.1f} %" in text
    assert DeadZone.physics.rstrip(".") in text
    one, other = map(title_of, two.error_path_["effect"][1:])
    assert f"Step 2, with {one} and {other}: VAF" in said(two)


def test_the_short_ranking_is_of_texts(two):
    table = two.ranking_table(n=2)
    assert list(table) == ["effect", "gain", "evidence", "p", "outcome", "parameters"]
    assert table.index.names == ["step", "rank"]
    assert table.groupby("step").size().max() == 2
    assert (table["outcome"] == "added").sum() == 2
    assert not table["effect"].str.contains("_").any()
    assert len(two.ranking_table(n=3, step=1)) == 3
    with pytest.raises(ValueError, match="There is no step 9; the steps are 1, 2"):
        two.ranking_table(step=9)


def test_units_of_the_output_are_kept(found):
    assert found.predictions_.attrs["units"] == {"measured": "deg"}


def test_a_search_that_is_not_fitted_says_so():
    search = EffectSearchCV(OperatorRegressor())
    for call in (search.summary, lambda: search.predict([[0.0]])):
        with pytest.raises(NotFittedError):
            call()


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"effects": ["dead zone"]}, "No effect is called 'dead zone'"),
        ({"effects": "dead zone"}, "No effect is called|effects"),
        ({"effects": [DeadZone]}, "Pass an instance"),
        ({"display": "hud"}, "display"),
        ({"max_effects": -1}, "max_effects"),
        ({"controlled_element": 3.0}, "controlled_element"),
        ({"cv": "loo"}, "cv"),
        ({"estimator": Bias()}, "got Bias"),
    ],
    ids=str,
)
def test_wrong_arguments_are_named(hidden_data, wrong, message):
    arguments = {"estimator": OperatorRegressor(), **wrong}
    with pytest.raises((ValueError, TypeError), match=message):
        EffectSearchCV(**arguments).fit(*hidden_data)
