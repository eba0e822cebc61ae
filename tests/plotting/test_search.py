"""The plots of a search for effects show its tables."""

import matplotlib as mpl

mpl.use("Agg")

import copy
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import same_color
from matplotlib.text import Text
from sklearn.exceptions import NotFittedError
from support.plot_checks import BLUE, covers_nothing

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import titles_of
from skhoid.plotting import (
    ROLES,
    SearchDisplay,
)
from skhoid.search import Verdict

KINDS = ["path", "steps", "ranking"]
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
                    "delta_bic": 100.0 * gain,
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
    search.ranking_["gain_loop"] = search.ranking_["vaf_gain"] / 2
    return search


SEARCHES = {
    "none": a_search([], [87.8]),
    "one": a_search(["dead_zone"], [76.0, 86.5]),
    "four": a_search(LONG, [60.0, 75.0, 82.0, 85.0, 87.0], candidates=30),
    "no ceiling": a_search(["dead_zone", "bias"], [76.0, 86.5, 87.5], np.nan),
    "unknown": a_search(["dead_zone"], [60.0, 70.0], unknown=True),
    "only unknown": a_search([], [60.0], unknown=True),
    "lost": a_search(["tv_gain"], [-300.0, 80.0]),
    "in loop": in_loop(a_search(LONG[:2], [60.0, 75.0, 82.0])),
    "no steps in loop": in_loop(a_search([], [60.0])),
    "lost in loop": in_loop(a_search(["tv_gain"], [-300.0, 80.0])),
}


@pytest.fixture(params=SEARCHES)
def search(request):
    return SEARCHES[request.param]


def texts_in(panel):
    return [text.get_text() for text in panel.texts]


def plain(text):
    return text.replace("\n", " ").replace("\xa0", " ")


def named(display):
    """Names and forms left of the bars."""
    return {
        name: [text.get_text() for text in box.findobj(Text)]
        for name, box in display.names_.items()
    }


# Staircase


def test_staircase_shows_the_path(search):
    display = SearchDisplay.from_estimator(search, rmse=True)
    path = search.error_path_
    np.testing.assert_array_equal(display.lines_["vaf"].get_data().values, path["vaf"])
    np.testing.assert_array_equal(display.lines_["rmse"].get_data().values, path["rmse"])
    labels = [t.get_text().replace("\n", " ") for t in display.axes_[1].get_xticklabels()]
    added = list(path["effect"][1:])
    assert labels == ["baseline", *(f"with {titles_of(added[: i + 1])}" for i in range(len(added)))]
    values = [label.get_text() for label in display.labels_["vaf"]]
    for value, label in zip(path["vaf"], values, strict=True):
        assert f"{value:.1f} %" in label
    assert display.axes_[1].get_ylabel() == "held-out RMSE, deg"


def test_staircase_has_the_closed_loop_beside_the_free_run():
    display = SearchDisplay.from_estimator(SEARCHES["in loop"])
    expected = SEARCHES["in loop"].error_path_["vaf_loop"]
    np.testing.assert_array_equal(display.lines_["vaf_loop"].get_data().values, expected)
    first, *others = [label.get_text() for label in display.labels_["vaf_loop"]]
    assert first == f"in the closed loop\n{expected[0]:.1f} %"
    assert others == [f"{value:.1f} %" for value in expected[1:]]
    low, high = display.axes_[0].get_ylim()
    assert low < expected.min() < high


def test_staircase_skips_steps_whose_loop_is_not_solved():
    search = copy.deepcopy(SEARCHES["in loop"])
    search.error_path_.loc[1, "vaf_loop"] = np.nan
    display = SearchDisplay.from_estimator(search)
    display.figure_.canvas.draw()
    assert [label.get_visible() for label in display.labels_["vaf_loop"]] == [True, False, True]
    search.error_path_["vaf_loop"] = np.nan
    assert "vaf_loop" not in SearchDisplay.from_estimator(search).lines_


def test_staircase_has_the_ceiling_in_both_panels():
    display = SearchDisplay.from_estimator(SEARCHES["one"], rmse=True)
    np.testing.assert_array_equal(display.ceilings_["vaf"].get_data().values, [88.0, 88.0])
    # These outputs have a power of one, so that the RMSE at 88 % is the root of 0.12.
    np.testing.assert_allclose(display.ceilings_["rmse"].get_data().values, np.sqrt(0.12))
    bare = SearchDisplay.from_estimator(SEARCHES["no ceiling"])
    assert bare.ceilings_ == {}
    assert bare.gap_ is None
    assert bare.ceiling_text_.get_text() == "noise ceiling not known"


def said_of_the_ceiling(display):
    return display.ceiling_text_.get_text().replace("\n", " ")


def test_staircase_tells_what_is_left():
    display = SearchDisplay.from_estimator(SEARCHES["one"])
    np.testing.assert_allclose(display.gap_.get_ydata(), [86.5, 88.0])
    assert said_of_the_ceiling(display) == "noise ceiling 88.0 %: 1.5 points left to explain"
    assert same_color(display.gap_.get_color(), ROLES["misfit"].colour)
    done = a_search(["dead_zone"], [76.0, 88.2])
    display = SearchDisplay.from_estimator(done)
    assert display.gap_ is None
    assert "nothing left to explain" in said_of_the_ceiling(display)


def test_staircase_marks_what_no_effect_explains():
    display = SearchDisplay.from_estimator(SEARCHES["unknown"])
    assert said_of_the_ceiling(display).endswith("left to explain, not in the catalogue")
    assert plain(display.axes_[0].get_title()) == (
        "Dead zone: held-out VAF from 60.0 to 70.0 %; something is missing, not in the catalogue"
    )
    listed = copy.copy(SEARCHES["unknown"])
    row = listed.error_path_.iloc[-1:].assign(effect="unknown")
    listed.error_path_ = pd.concat([listed.error_path_, row], ignore_index=True)
    display = SearchDisplay.from_estimator(listed)
    assert len(display.lines_["vaf"].get_data().values) == 2


def test_a_small_gap_looks_small_and_a_lost_baseline_does_not_squeeze():
    low, high = SearchDisplay.from_estimator(SEARCHES["none"]).axes_[0].get_ylim()
    assert high - low >= 10.0
    display = SearchDisplay.from_estimator(SEARCHES["lost"], rmse=True)
    assert display.axes_[0].get_ylim()[0] == -20.0
    assert display.labels_["vaf"][0].get_text() == "↓ -300.0 %"
    assert display.axes_[1].get_ylim()[0] == 0.0


# Before and after


def test_steps_show_where_the_effects_help_most(search):
    display = SearchDisplay.from_estimator(search, "steps")
    assert display.run_ == "3"
    assert display.window_ == pytest.approx((40.0, 55.0), abs=0.5)
    names = list(search.predictions_)
    assert list(display.lines_) == list(dict.fromkeys(["measured", names[1], names[-1]]))
    rows = search.predictions_.loc["3"].loc[slice(*display.window_)]
    for name, line in display.lines_.items():
        np.testing.assert_array_equal(line.get_xdata(), rows.index)
        np.testing.assert_array_equal(line.get_ydata(), rows[name])
    for name, line in display.residuals_.items():
        np.testing.assert_array_equal(line.get_ydata(), rows["measured"] - rows[name])
    title = plain(display.axes_[0].get_title())
    if len(names) > 2:
        assert title.startswith("Where the effects help most: run 3, ")
    else:
        assert title.startswith("Where the baseline is worst: run 3, ")
        assert title.endswith(f"({search.verdict_})")


def test_steps_have_the_vaf_of_all_held_out_runs():
    display = SearchDisplay.from_estimator(SEARCHES["four"], "steps", steps=[1, 4])
    assert [line.get_label() for line in display.lines_.values()] == [
        "measured",
        "simulated, with hardening stiffness, VAF 75.0 %",
        f"simulated, with {titles_of(LONG)}, VAF 87.0 %",
    ]


@pytest.mark.slow
def test_steps_of_a_run_and_a_window():
    search = SEARCHES["one"]
    display = SearchDisplay.from_estimator(search, "steps", run=1, window=(10, 12))
    assert (display.run_, display.window_) == ("1", (10.0, 12.0))
    assert plain(display.axes_[0].get_title()) == "Run 1, 10 to 12 s"
    assert SearchDisplay.from_estimator(search, "steps", window=(45, 46)).run_ == "3"
    assert SearchDisplay.from_estimator(search, "steps", run="2").run_ == "2"
    with pytest.raises(ValueError, match="There is no run 9; there are 1, 2, 3"):
        SearchDisplay.from_estimator(search, "steps", run=9)
    with pytest.raises(ValueError, match="No row of the runs lies in the window"):
        SearchDisplay.from_estimator(search, "steps", window=(200, 210))
    with pytest.raises(ValueError, match=r"some of 0 to 1 \(baseline, \+ dead_zone\)"):
        SearchDisplay.from_estimator(search, "steps", steps=[0, 2])


def test_steps_break_at_gaps_and_skip_what_is_not_predicted():
    search = copy.copy(SEARCHES["one"])
    kept = search.predictions_.loc[["3"]].drop(index=[("3", 45.0), ("3", 45.02), ("3", 45.04)])
    search.predictions_ = kept
    display = SearchDisplay.from_estimator(search, "steps", window=(44, 46))
    assert np.isnan(display.lines_["measured"].get_xdata()).sum() == 1
    search.predictions_ = kept.assign(baseline=np.nan)
    drawn = SearchDisplay.from_estimator(search, "steps", window=(44, 46))
    assert np.isnan(drawn.lines_["baseline"].get_ydata()).all()
    search.predictions_ = kept.assign(**{"baseline": np.nan, "+ dead_zone": np.nan})
    assert "not available" in texts_in(SearchDisplay.from_estimator(search, "steps").axes_[0])[0]


def test_window_passes_over_settling():
    search = copy.copy(SEARCHES["one"])
    search.predictions_ = search.predictions_.loc[["1"]].copy()
    search.predictions_.iloc[:100, 1] += 50.0
    assert SearchDisplay.from_estimator(search, "steps").window_[0] == 0.0
    search.best_estimator_ = SimpleNamespace(settling=3.0)
    assert SearchDisplay.from_estimator(search, "steps").window_[0] > 0.0


# Ranking


def test_ranking_shows_the_candidates_of_a_step():
    search = SEARCHES["one"]
    display = SearchDisplay.from_estimator(search, "ranking")
    table = search.ranking_[search.ranking_["step"] == 1]
    tried = table[table["status"] != "does not apply"]
    assert list(display.lines_) == tried["effect"].tolist()
    widths = [bar.get_width() for bar in display.lines_.values()]
    np.testing.assert_array_equal(widths, tried["vaf_gain"])
    assert display.words_["dead_zone"].get_text() == "+4.0"
    assert display.columns_["dead_zone"]["delta_bic"].get_text() == "+400"
    assert named(display)["dead_zone"] == ["dead zone", "gap"]
    assert display.figure_.get_suptitle() == (
        "Step 1: dead zone added; runner-up: candidate 0, 1.0 points behind"
    )
    assert display.margin_ == pytest.approx(1.0)
    assert same_color(display.lines_["dead_zone"].get_facecolor(), BLUE)
    low, high = display.ax_.get_ylim()
    assert low > high  # the best is on top


def test_ranking_says_what_is_gained_in_the_closed_loop():
    display = SearchDisplay.from_estimator(SEARCHES["in loop"], "ranking")
    values = {name: t.get_text() for name, t in display.columns_["candidate_0"].items()}
    assert values == {"delta_bic": "+300", "gain_loop": "+1.5"}
    display.figure_.canvas.draw()
    panel = display.ax_.get_window_extent()
    assert all(w.get_window_extent().x1 < panel.x1 for w in display.words_.values())
    search = copy.deepcopy(SEARCHES["in loop"])
    search.ranking_["gain_loop"] = np.nan
    display = SearchDisplay.from_estimator(search, "ranking")
    assert list(display.columns_["candidate_0"]) == ["delta_bic"]


def test_ranking_with_another_best_than_what_was_added():
    """What does not hold in the closed loop is not added, however good it is."""
    search = copy.deepcopy(SEARCHES["one"])
    ranking = search.ranking_
    ranking.loc[:1, "status"] = ["not better", "added"]
    display = SearchDisplay.from_estimator(search, "ranking")
    assert display.margin_ == pytest.approx(-1.0)
    assert display.figure_.get_suptitle() == (
        "Step 1: candidate 0 added, though dead zone has a ΔBIC that is 100 larger"
    )


def test_ranking_greys_what_does_not_apply():
    display = SearchDisplay.from_estimator(SEARCHES["one"], "ranking")
    assert not set(display.lines_) & set(REFUSED)
    for name in REFUSED:
        assert display.words_[name].get_text().startswith("X has no target")
    few = SearchDisplay.from_estimator(SEARCHES["one"], "ranking", n_candidates=3)
    assert list(few.words_) == ["dead_zone", "candidate_0", "candidate_1"]


def test_ranking_marks_what_cannot_be_told_apart():
    display = SearchDisplay.from_estimator(SEARCHES["one"], "ranking")
    assert display.confused_ == ["candidate_1"]
    assert [n for n, bar in display.lines_.items() if bar.get_hatch()] == ["candidate_1"]
    assert "which these data cannot tell apart" not in display.figure_.get_suptitle()
    search = copy.copy(SEARCHES["one"])
    search.ranking_ = search.ranking_.copy()
    search.ranking_["confused_with"] = [["candidate_0"]] * len(search.ranking_)
    title = plain(SearchDisplay.from_estimator(search, "ranking").figure_.get_suptitle())
    assert title == (
        "Step 1: dead zone added; runner-up: candidate 0, 1.0 points behind, which these data "
        "cannot tell apart"
    )


def test_ranking_of_a_step_that_adds_nothing():
    display = SearchDisplay.from_estimator(SEARCHES["one"], "ranking", step=2)
    assert display.figure_.get_suptitle() == "Step 2: no candidate is better by more than chance"
    low, high = display.ax_.get_xlim()
    assert high - low >= 1.0
    with pytest.raises(ValueError, match=r"has the steps 1, 2; got step=3"):
        SearchDisplay.from_estimator(SEARCHES["one"], "ranking", step=3)


def test_ranking_without_a_gain_and_far_losses():
    search = copy.copy(SEARCHES["one"])
    search.ranking_ = search.ranking_.copy()
    search.ranking_.loc[2, "vaf_gain"] = np.nan
    search.ranking_.loc[3, "vaf_gain"] = -900.0
    display = SearchDisplay.from_estimator(search, "ranking")
    assert display.words_["candidate_1"].get_text() == ""
    assert display.columns_["candidate_1"]["delta_bic"].get_text() == "+200"
    assert display.words_["candidate_2"].get_text().endswith("(cut)")
    assert display.ax_.get_xlim()[0] > -2.0


# All of a search


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_search_is_refused(kind):
    with pytest.raises(NotFittedError, match="not fitted"):
        SearchDisplay.from_estimator(EffectSearchCV(OperatorRegressor()), kind)
    with pytest.raises(TypeError, match="got OperatorRegressor"):
        SearchDisplay.from_estimator(OperatorRegressor(), kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_covers_data_or_text(kind, search):
    covers_nothing(SearchDisplay.from_estimator(search, kind))
