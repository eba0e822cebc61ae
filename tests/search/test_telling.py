"""What is said of a search, and what may be asked of it."""

import json

import pytest
from support.shapes import a_shape

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import (
    Backlash,
    Bias,
    Feedforward,
    OutputFeedback,
    Preview,
)
from skhoid.search import Reason, Status, Verdict, tell_candidates, tell_search
from skhoid.search.results import describe_effect


def recorded(effects, n_runs=2, duration=40.96):
    return make_tracking_runs(
        "C1",
        n_runs=n_runs,
        duration=duration,
        sampling_rate=50,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=1,
        effects=effects,
    )


@pytest.fixture(scope="module")
def biased():
    tried = ["bias", "cubic_gain", "motion_feedback"]
    return EffectSearchCV(OperatorRegressor(), effects=tried).fit(*recorded(Bias(level=0.1)))


def test_a_verdict_is_no_sentence_and_a_user_who_compares_it_is_told():
    with pytest.raises(TypeError, match=r"is Verdict\.NOTHING"):
        assert Verdict.FOUND == "nothing found"
    assert str(Verdict.FOUND) == "effects found"
    assert (Verdict.FOUND == "some text") is False
    assert [verdict.kind for verdict in Verdict] == ["nothing", "found", *["unknown"] * 5]


def test_candidates_have_a_status_and_a_code_for_the_reason(biased):
    first = biased.ranking_[biased.ranking_["step"] == 1].set_index("effect")
    assert first.loc["bias", "status"] == Status.ADDED
    assert first.loc["bias", "reason_code"] == Reason.NONE
    assert first.loc["motion_feedback", "status"] == Status.REFUSED
    assert first.loc["motion_feedback", "reason_code"] == Reason.REFUSED
    assert set(first["reason_code"]) <= {str(reason) for reason in Reason}


def test_a_search_has_what_users_of_searches_expect(biased):
    path, results = biased.error_path_, biased.cv_results_
    assert biased.best_score_ == path["vaf"].iloc[-1]
    assert biased.n_splits_ == 2
    assert results["params"][0] == {"effects": []}
    assert results["params"][biased.best_index_] == biased.best_params_
    assert results["mean_test_score"][biased.best_index_] == biased.best_score_
    assert {len(column) for column in results.values()} == {len(results["params"])}
    X, y = recorded(Bias(level=0.1))
    again = OperatorRegressor(**biased.best_params_).fit(X, y)
    assert again.effects_.names == ["bias"]
    assert biased.scorer_(again, X, y) == again.score(X, y)
    assert biased.plot().figure_.axes


def test_a_row_says_beside_what_it_was_tried(biased):
    of_steps = biased.ranking_.groupby("step")["beside"]
    assert [first for first, *_ in of_steps.apply(list)] == [[], ["bias"]]
    X, y = recorded(Bias(level=0.1))
    model = OperatorRegressor(effects=["bias"])
    search = EffectSearchCV(model, effects=["dead_zone"], max_effects=0).fit(X, y)
    assert search.ranking_["beside"].tolist() == [["bias"]]
    assert search.cv_results_["params"][1:] == [{"effects": ["bias", "dead_zone"]}]


def test_text_json_and_the_notebook_tell_the_same(biased):
    result = biased.result_
    document = tell_search(result)
    assert document.title.startswith("Missing: ")
    assert "bias" in document.title
    assert "the held-out VAF rises from" in document.title
    assert biased.summary() == document.text()
    assert document.title in biased._repr_html_()
    found = json.loads(json.dumps(result.as_dict()))
    assert found["verdict"] == str(biased.verdict_)
    assert found["best_effects"] == biased.best_effects_
    assert found["parameters"][-1]["parameter"] == "bias__level"


@pytest.mark.slow
def test_what_is_as_likely_and_easily_taken_for_it_is_told_in_the_same_breath():
    search = EffectSearchCV(OperatorRegressor(), effects=["backlash", "stiction", "bias"])
    search.fit(*recorded([Backlash(gap=0.05), Bias(level=0.1)], duration=20.48))
    rows = search.ranking_.query("status == 'added'").set_index("effect")
    chance = 100 * rows.loc["backlash", "probability"]
    assert f"backlash or stiction ({chance:.0f} %)" in search.summary().splitlines()[0]
    assert search.best_effects_.count("stiction") == 0


def test_the_candidates_of_a_step_are_a_table(biased):
    table = tell_candidates(biased.result_, 1, 1)[0]
    assert table.caption == (
        "Search, step 1: 2 effects tried (1 does not apply), judged on held-out rows"
    )
    assert table.rows[0][0].startswith("1. bias")


def test_a_step_that_added_nothing_begins_with_its_best(biased):
    last = biased.ranking_[biased.ranking_["step"] == 2].set_index("rank")
    assert last["effect"].tolist() == ["cubic_gain", "motion_feedback"]
    assert last.loc[1, "evidence"] < 0
    table = tell_candidates(biased.result_, 2, 3)[0]
    assert [row[0] for row in table.rows] == ["1. cubic gain (cubic)"]


def test_where_no_form_passes_it_is_said(biased):
    without = tell_text(biased.result_, verdict=Verdict.NOT_IN_CATALOGUE)
    assert "No free form explains it at any place either." in without
    shape = a_shape()
    shown = tell_text(biased.result_, verdict=Verdict.NOT_TRIED, shape=shape)
    assert shape.explains in shown
    assert 'effects="all"' in shown
    assert shape.explains not in tell_text(biased.result_, shape=shape)


def tell_text(result, **changes):
    changed = type(result)(**{**vars(result), **changes})
    return " ".join(tell_search(changed).text().split())


@pytest.mark.parametrize("effect", [Feedforward(), Preview(), OutputFeedback()])
def test_nobody_says_what_a_display_showed_unless_told(effect):
    assert EffectSearchCV(OperatorRegressor()).display is None
    unknown = describe_effect(effect, None)
    assert "cannot have seen" not in unknown
    assert "if the display shows the error alone (set display=)" in unknown
    assert "cannot have seen" in describe_effect(effect, "compensatory")
    assert describe_effect(effect, "preview") == effect.physics
    assert describe_effect(effect, None, "machine") == effect.physics_in("machine")


@pytest.mark.slow
def test_a_search_of_a_single_run_says_why_there_is_no_ceiling():
    search = EffectSearchCV(OperatorRegressor(), effects=["bias"])
    search.fit(*recorded(Bias(level=0.1), n_runs=1))
    assert "not periodic" in search.ceiling_note_
    assert "The noise ceiling is not known" in " ".join(search.summary().split())
