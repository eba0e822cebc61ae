"""A search that is given little time, and candidates that cannot be fitted."""

import time

import numpy as np
import pandas as pd
import pytest
from support.open_loop import RIVALS

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import Dimension, Effect, Parameter
from skhoid.search import Reason, Status, Verdict


class Failing(Effect):
    """Its arithmetic fails."""

    name = "failing"
    place = "input"
    physics = "It fails."
    formula = "e' = fails"
    parameters = (Parameter("size", Dimension(), 0.1, 10.0, (0.5,), "of what fails"),)
    error: Exception = ValueError("Array must not contain infs or NaNs.")

    def apply(self, signal, record, size):
        raise type(self).error


@pytest.mark.parametrize(
    "error", [ValueError("Array must not contain infs or NaNs"), OverflowError("math range error")]
)
def test_what_cannot_be_fitted_is_a_row_with_its_reason(hidden_data, monkeypatch, error):
    monkeypatch.setattr(Failing, "error", error)
    search = EffectSearchCV(OperatorRegressor(), effects=[Failing(), "dead_zone"]).fit(*hidden_data)
    assert search.best_effects_ == ["dead_zone"]
    row = search.ranking_.set_index(["step", "effect"]).loc[(1, "failing")]
    assert row["status"] == Status.NOT_FITTED
    assert row["reason_code"] == Reason.NOT_FITTED
    assert str(error) in row["reason"]
    assert np.isnan(row["vaf_gain"])
    assert [note.kind for note in search.notes_].count("not fitted") == 2  # beside nothing, and it


def test_no_time_tries_nothing_and_says_so(hidden_data):
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS, time_limit=1e-6).fit(*hidden_data)
    assert set(search.ranking_["status"]) == {Status.NOT_TRIED}
    assert set(search.ranking_["reason_code"]) == {Reason.TIME}
    assert search.verdict_ is Verdict.NOT_TRIED  # instruments see that there is something
    assert search.summary().startswith("Something is missing that no effect was tried to explain")
    assert "set a larger time_limit" in search.summary()
    (note,) = (str(note) for note in search.notes_ if note.kind == "time limit")
    assert "dead zone" in note
    assert "saturation" in note
    pd.testing.assert_index_equal(search.predictions_.index, hidden_data[0].index)


def test_what_was_found_in_time_is_kept(hidden_data, monkeypatch):
    """The clock runs over once the first effect is added."""
    start = time.monotonic()

    def clock():
        late = any(step > 1 for step in steps)
        return start + (1e6 if late else 0.0)

    steps = []
    from skhoid.search.steps import Search

    step = Search.step

    def counted(self, *parent):
        steps.append(len(steps) + 1)
        return step(self, *parent)

    monkeypatch.setattr(Search, "step", counted)
    monkeypatch.setattr("skhoid.model.effort.time.monotonic", clock)
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS, time_limit=100.0)
    search.fit(*hidden_data)
    assert search.best_effects_ == ["dead_zone"]
    by_step = search.ranking_.groupby("step")["status"].agg(set)
    assert Status.NOT_TRIED not in by_step[1]
    assert by_step[2] == {Status.NOT_TRIED}


def test_time_enough_changes_nothing(hidden_data, found):
    limited = EffectSearchCV(OperatorRegressor(), effects=RIVALS, time_limit=600.0)
    pd.testing.assert_frame_equal(limited.fit(*hidden_data).ranking_, found.ranking_)


def test_an_exhaustive_search_finds_the_same(hidden_data, found):
    whole = EffectSearchCV(OperatorRegressor(), effects=RIVALS, exhaustive=True).fit(*hidden_data)
    assert (whole.best_effects_, whole.verdict_) == (found.best_effects_, found.verdict_)
    values = [one.best_estimator_.parameters_["value"] for one in (whole, found)]
    pd.testing.assert_series_equal(*values, rtol=1e-3)
    evidence = [one.ranking_.set_index(["step", "effect"])["evidence"] for one in (whole, found)]
    pd.testing.assert_series_equal(*evidence, check_like=True, atol=0.1)


@pytest.mark.parametrize("limit", [0, -1.0, "long"])
def test_a_limit_is_a_time(hidden_data, limit):
    with pytest.raises(ValueError, match="time_limit"):
        EffectSearchCV(OperatorRegressor(), time_limit=limit).fit(*hidden_data)
