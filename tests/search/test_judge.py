"""One judge: the least evidence decides, and a name is given if it is as probable as asked."""

import numpy as np
import pytest
from support.open_loop import searched

from skhoid.search import Status, Verdict

THRESHOLD = 12.5  # nats of an effect that is added


def test_evidence_is_the_least_of_what_judges_grant(found):
    first = found.ranking_.iloc[0]
    judges = ["free_run", "likelihood", "instruments"]
    asked = first[judges].astype(float)
    assert first["free_run"] == pytest.approx(first["delta_bic"] / 2)
    assert first["evidence"] == np.nanmin(asked)
    assert first["judge"].replace(" ", "_") == judges[int(np.nanargmin(asked))]


def test_what_has_the_most_evidence_is_added_if_it_is_enough(found):
    for _, rows in found.ranking_.groupby("step"):
        assert rows["evidence"].dropna().is_monotonic_decreasing
        added = rows["status"] == Status.ADDED
        assert added.iloc[0] == (rows["evidence"].iloc[0] > THRESHOLD)
        assert not added.iloc[1:].any()


def test_what_has_evidence_is_probable_and_what_has_none_is_not(found):
    chances = found.ranking_["probability"].dropna()
    assert chances.between(0, 1).all()
    assert chances.iloc[0] > 0.5
    assert (found.ranking_.query("evidence < 0")["probability"] == 0).all()


def test_a_name_that_is_less_probable_than_asked_is_a_possible_one(hidden_data):
    sure = searched(hidden_data, ["dead_zone", "bias"], confidence=1.0)
    assert sure.verdict_ is Verdict.POSSIBLE
    assert sure.best_effects_ == ["unknown"]
    assert sure.stand_ins_ == ["dead_zone"]
    assert "possibly dead zone" in sure.summary().splitlines()[0]
    assert any(note.kind == "possible" for note in sure.notes_)
