"""Sentences about a search."""

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import Feedforward, MotionFeedback, OutputFeedback, Preview, Tremor
from skhoid.search import Verdict
from skhoid.search.explanations import in_loop_text, sentence_of, unexplained_by, untried_notes


@pytest.mark.parametrize("effect", [Feedforward(), Preview(), OutputFeedback()])
def test_nobody_says_what_a_display_showed_unless_told(effect):
    assert EffectSearchCV(OperatorRegressor()).display is None
    unknown = sentence_of(effect, None)
    assert "cannot have seen" not in unknown
    assert "if the display shows the error alone (set display=)" in unknown
    assert "cannot have seen" in sentence_of(effect, "compensatory")
    assert sentence_of(effect, "preview") == effect.physics
    assert sentence_of(effect, None, "machine") == effect.physics_in("machine")


def test_figures_of_the_closed_loop():
    path = pd.DataFrame({"vaf_loop": [41.24, 55.0, np.nan]})
    rows = [row for _, row in path.iterrows()]
    assert in_loop_text(rows[0]) == "; in the closed loop VAF 41.2 %"
    assert in_loop_text(*rows[:2]) == "; in the closed loop VAF 41.2 -> 55.0 %"
    assert in_loop_text(*rows) == ""


def test_what_was_not_tried_is_said():
    row = {"step": 1, "effect": "motion_feedback", "status": "does not apply", "reason": "no role"}
    verdict = Verdict.NOT_TRIED
    for rows in ([], [row]):
        ranking = pd.DataFrame(rows, columns=list(row))
        assert unexplained_by(verdict, ranking, 4) == "no effect was there to explain"
    motion, tremor = untried_notes([MotionFeedback(), Tremor()], ranking)
    assert motion == "motion feedback was not tried: no role"
    assert tremor.startswith("tremor was not tried in the model: it is noise")
    assert untried_notes([MotionFeedback()], ranking.assign(status="not better")) == []
