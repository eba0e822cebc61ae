"""The plots of a search for effects show its tables."""

import copy
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from sklearn.exceptions import NotFittedError
from support.pictures import legend_texts
from support.plot_checks import BLUE, covers_nothing

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import titles_of
from skhoid.plotting import (
    ROLES,
    SearchDisplay,
)
from skhoid.search import Verdict

REFUSED = ("preview", "feedforward")


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


def a_search(effects, vaf, ceiling=88.0, *, unknown=False, candidates=8):
    """What a search has after fit, made up; the last run profits most, after 40 s."""
    rng = np.random.default_rng(0)
    index = pd.MultiIndex.from_product(
        [["1", "2", "3"], np.arange(4000) / 50], names=["run", "time"]
    )
    time = index.get_level_values("time").to_numpy()
    measured = sum(np.sin(w * time + rng.uniform(0, 6)) for w in (0.4, 1.1, 2.3))
    late = (index.get_level_values("run") == "3") & (time > 40) & (time < 55)
    predictions = pd.DataFrame({"measured": measured}, index)
    for i, name in enumerate(["baseline", *(f"+ {e}" for e in effects)]):
        predictions[name] = measured * (1 - 0.2 * 0.5**i * (1 + 2 * late))
    predictions.attrs["units"] = {"measured": "deg"}
    vaf = np.array(vaf, dtype=float)
    path = pd.DataFrame(
        {
            "effect": ["baseline", *effects],
            "vaf": vaf,
            "rmse": np.sqrt(1 - vaf / 100),
            "vaf_train": vaf + 0.7,
            "ceiling": ceiling,
            "explainable_gap": ceiling - vaf,
        }
    )
    rows = []
    for step, added in enumerate([*effects, None], 1):
        names = [added] if added else []
        names += [f"candidate_{i}" for i in range(candidates - len(names))]
        for i, name in enumerate(names):
            gain = (4.0 if added else 0.2) - i
            rows.append(
                {
                    "step": step,
                    "rank": i + 1,
                    "effect": name,
                    "form": "gap" if name == "dead_zone" else "",
                    "vaf_gain": gain,
                    "evidence": 50.0 * gain,
                    "probability": 0.9 if added and i == 0 else 0.0,
                    "confused_with": ["candidate_1", "gone"] if i == 0 and step == 1 else [],
                    "status": "added" if name == added else "not better",
                    "reason": "",
                }
            )
        rows += [
            {
                "step": step,
                "effect": name,
                "form": "",
                "confused_with": [],
                "status": "does not apply",
                "reason": "X has no target: a column of role f_t, or e and x",
            }
            for name in REFUSED
        ]
    verdict = Verdict.FOUND if effects else Verdict.NOTHING
    return SimpleNamespace(
        predictions_=predictions,
        error_path_=path,
        ranking_=pd.DataFrame(rows),
        best_effects_=[*effects, *(["unknown"] if unknown else [])],
        verdict_=Verdict.NOT_IN_CATALOGUE if unknown else verdict,
    )


LONG = ["hardening_stiffness", "output_feedback", "absolute_value", "dead_zone-2"]


def in_loop(search):
    """The same search, with figures of the closed loop."""
    path = search.error_path_
    path["vaf_loop"] = path["vaf"] - np.linspace(0.5, 20.0, len(path))
    return search


SEARCHES = {
    "none": a_search([], [87.8]),
    "one": a_search(["dead_zone"], [76.0, 86.5]),
    "four": a_search(LONG, [60.0, 75.0, 82.0, 85.0, 87.0], candidates=30),
    "no ceiling": a_search(["dead_zone", "bias"], [76.0, 86.5, 87.5], np.nan),
    "unknown": a_search(["dead_zone"], [60.0, 70.0], unknown=True),
    "lost": a_search(["tv_gain"], [-300.0, 80.0]),
    "in loop": in_loop(a_search(LONG[:2], [60.0, 75.0, 82.0])),
}


def texts_in(panel):
    return [text.get_text() for text in panel.texts]


def plain(text):
    return text.replace("\n", " ").replace("\xa0", " ")


# Staircase


@pytest.mark.parametrize("name", SEARCHES)
def test_staircase_shows_the_path(name):
    display = SearchDisplay.from_estimator(SEARCHES[name])
    path = SEARCHES[name].error_path_
    np.testing.assert_array_equal(display.lines_["vaf"].get_data().values, path["vaf"])
    labels = [plain(t.get_text()) for t in display.ax_.get_xticklabels()]
    added = list(path["effect"][1:])
    assert labels == ["baseline", *(f"with {titles_of(added[: i + 1])}" for i in range(len(added)))]
    written = " ".join(texts_in(display.ax_))
    assert all(f"{value:.1f} %" in written for value in path["vaf"])
    covers_nothing(display)


def test_staircase_has_the_closed_loop_beside_the_free_run():
    search = copy.deepcopy(SEARCHES["in loop"])
    display = SearchDisplay.from_estimator(search)
    expected = search.error_path_["vaf_loop"]
    np.testing.assert_array_equal(display.lines_["vaf_loop"].get_data().values, expected)
    assert legend_texts(display) == ["free run", "in the closed loop"]
    low, high = display.ax_.get_ylim()
    assert low < expected.min() < high
    search.error_path_["vaf_loop"] = np.nan
    assert "vaf_loop" not in SearchDisplay.from_estimator(search).lines_


def said(search):
    return plain(texts_in(SearchDisplay.from_estimator(search).ax_)[-1])


def test_staircase_tells_what_is_left():
    assert said(SEARCHES["one"]) == "noise ceiling at least 88.0 %: 1.5 points left to explain"
    (gap,) = SearchDisplay.from_estimator(SEARCHES["one"]).ax_.lines
    np.testing.assert_allclose(gap.get_ydata(), [86.5, 88.0])
    assert same_color(gap.get_color(), ROLES["misfit"].colour)
    assert "nothing left to explain" in said(a_search(["dead_zone"], [76.0, 88.2]))
    assert said(SEARCHES["no ceiling"]) == "noise ceiling not known"
    assert said(SEARCHES["unknown"]).endswith("left to explain, not in the catalogue")
    assert plain(SearchDisplay.from_estimator(SEARCHES["unknown"]).ax_.get_title()) == (
        "Dead zone: held-out VAF from 60.0 to 70.0 %; something is missing, not in the catalogue"
    )


def test_a_small_gap_looks_small_and_a_lost_baseline_does_not_squeeze():
    low, high = SearchDisplay.from_estimator(SEARCHES["none"]).ax_.get_ylim()
    assert high - low >= 10.0
    display = SearchDisplay.from_estimator(SEARCHES["lost"])
    assert display.ax_.get_ylim()[0] == -20.0
    assert "↓ -300.0 %" in texts_in(display.ax_)


# Before and after


@pytest.mark.parametrize("name", ["none", "four"])
def test_steps_show_where_the_effects_help_most(name):
    search = SEARCHES[name]
    display = SearchDisplay.from_estimator(search, "steps")
    assert display.run_ == "3"
    assert display.window_ == pytest.approx((40.0, 55.0), abs=0.5)
    names = list(search.predictions_)
    assert list(display.lines_) == list(dict.fromkeys(["measured", names[1], names[-1]]))
    rows = search.predictions_.loc["3"].loc[slice(*display.window_)]
    for column, line in display.lines_.items():
        np.testing.assert_array_equal(line.get_xdata(), rows.index)
        np.testing.assert_array_equal(line.get_ydata(), rows[column])
    for column, line in display.residuals_.items():
        np.testing.assert_array_equal(line.get_ydata(), rows["measured"] - rows[column])
    where = "effects help most" if len(names) > 2 else "baseline is worst"
    assert plain(display.ax_.get_title()).startswith(f"Where the {where}: run 3, ")
    covers_nothing(display)


def test_steps_of_a_run_and_a_window():
    search = SEARCHES["four"]
    options = {"run": 1, "window": (10, 12), "steps": [1, 4]}
    display = SearchDisplay.from_estimator(search, "steps", **options)
    assert (display.run_, display.window_) == ("1", (10.0, 12.0))
    assert [line.get_label() for line in display.lines_.values()] == [
        "measured",
        "simulated, with hardening stiffness, VAF 75.0 %",
        f"simulated, with {titles_of(LONG)}, VAF 87.0 %",
    ]
    with pytest.raises(ValueError, match="run must be one of '1', '2', '3'; got '9'"):
        SearchDisplay.from_estimator(search, "steps", run=9)
    with pytest.raises(ValueError, match="No row of the runs lies in window"):
        SearchDisplay.from_estimator(search, "steps", window=(200, 210))
    with pytest.raises(ValueError, match="a step must be one of 0, 1, 2, 3, 4; got 7"):
        SearchDisplay.from_estimator(search, "steps", steps=[0, 7])


def test_steps_break_at_gaps_and_say_what_is_not_predicted():
    search = copy.copy(SEARCHES["one"])
    kept = search.predictions_.loc[["3"]].drop(index=[("3", 45.0), ("3", 45.02), ("3", 45.04)])
    search.predictions_ = kept
    display = SearchDisplay.from_estimator(search, "steps", window=(44, 46))
    assert np.isnan(display.lines_["measured"].get_xdata()).sum() == 1
    search.predictions_ = kept.assign(**{"baseline": np.nan, "+ dead_zone": np.nan})
    assert "not available" in texts_in(SearchDisplay.from_estimator(search, "steps").ax_)[0]


def test_window_passes_over_settling():
    search = copy.copy(SEARCHES["one"])
    search.predictions_ = search.predictions_.loc[["1"]].copy()
    search.predictions_.iloc[:100, 1] += 50.0
    assert SearchDisplay.from_estimator(search, "steps").window_[0] == 0.0
    search.best_estimator_ = SimpleNamespace(settling=3.0)
    assert SearchDisplay.from_estimator(search, "steps").window_[0] > 0.0


# Ranking


def title_of_ranking(search, **options):
    return plain(SearchDisplay.from_estimator(search, "ranking", **options).figure_.get_suptitle())


def test_ranking_shows_the_candidates_of_a_step():
    search = SEARCHES["one"]
    display = SearchDisplay.from_estimator(search, "ranking")
    table = search.ranking_[search.ranking_["step"] == 1]
    tried = table[table["status"] != "does not apply"]
    assert list(display.lines_) == tried["effect"].tolist()
    widths = [bar.get_width() for bar in display.lines_.values()]
    np.testing.assert_array_equal(widths, tried["vaf_gain"])
    assert {"+4.0", "200"} <= set(texts_in(display.ax_))
    assert sum(text.startswith("X has no target") for text in texts_in(display.ax_)) == len(REFUSED)
    assert same_color(display.lines_["dead_zone"].get_facecolor(), BLUE)
    assert [n for n, bar in display.lines_.items() if bar.get_hatch()] == ["candidate_1"]
    low, high = display.ax_.get_ylim()
    assert low > high  # the best is on top
    covers_nothing(display)
    few = SearchDisplay.from_estimator(search, "ranking", n_candidates=3)
    assert list(few.lines_) == ["dead_zone", "candidate_0", "candidate_1"]


def test_ranking_has_evidence_and_probability():
    display = SearchDisplay.from_estimator(SEARCHES["one"], "ranking")
    for text in ("nats", "200", "probability", "90 %"):
        assert text in texts_in(display.ax_)
    covers_nothing(display)


def test_title_of_the_ranking_compares_what_was_added_with_the_next():
    search = copy.deepcopy(SEARCHES["one"])
    title = "Step 1: dead zone added; runner-up: candidate 0, 1.0 points behind"
    assert title_of_ranking(search) == title
    assert title_of_ranking(search, step=2).endswith("no candidate is better by more than chance")
    search.ranking_["confused_with"] = [["candidate_0"]] * len(search.ranking_)
    assert title_of_ranking(search) == f"{title}, which these data cannot tell apart"
    # What does not hold in the closed loop is not added, however good it is.
    search.ranking_.loc[:1, "status"] = ["not better", "added"]
    start = "Step 1: candidate 0 added, though dead zone has 50 nats more"
    assert title_of_ranking(search).startswith(start)
    with pytest.raises(ValueError, match="step must be one of 1, 2; got 3"):
        SearchDisplay.from_estimator(search, "ranking", step=3)


def test_ranking_without_a_gain_and_far_losses():
    search = copy.deepcopy(SEARCHES["one"])
    search.ranking_.loc[2, "vaf_gain"] = np.nan
    search.ranking_.loc[3, "vaf_gain"] = -900.0
    display = SearchDisplay.from_estimator(search, "ranking")
    assert any(text.endswith("(cut)") for text in texts_in(display.ax_))
    assert display.ax_.get_xlim()[0] > -2.0


def test_what_is_no_search_is_refused():
    with pytest.raises(NotFittedError, match="not fitted"):
        SearchDisplay.from_estimator(EffectSearchCV(OperatorRegressor()))
    with pytest.raises(TypeError, match="got OperatorRegressor"):
        SearchDisplay.from_estimator(OperatorRegressor())
