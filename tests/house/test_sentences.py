"""The sentences that results can say, each listed once, with the condition under which it is true.

Each is produced by a test.
"""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from support.comparison import Gives, runs
from support.open_loop import recorded, searched

from skhoid import ARXRegressor, compare
from skhoid.diagnosis import ModelChoice, identify
from skhoid.recordings.loss_of_control import LOST_ROWS
from skhoid.search import Reason, Status, Verdict
from skhoid.search.limits import end_explained
from skhoid.search.statuses import Ending
from skhoid.search.telling import tell_headline

HERE = Path(__file__).parents[2]
FINDINGS = {
    "asymmetry": "the residual depends on the sign of the output",
    "bias": "the mean of the residual differs from zero",
    "clock jitter": "intervals of the clock differ from their median",
    "clock unit": "the clock counts milliseconds or minutes by its steps",
    "constant channel": "a channel has one value in whole runs",
    "copy": "a channel is another one, scaled, shifted or reversed",
    "cross-correlation": "the residual follows a past input",
    "delay": "the response is later or earlier than the model's",
    "distortion": "the residual has harmonics of the target",
    "error signal": "e is not f_t - x",
    "first samples": "the first rows of a run are unlike the next",
    "gain": "the response is larger or smaller than the model's; by how much, where VAF >= 5 %",
    "gain change": "the response changes at one time; by how much, where VAF >= 5 %",
    "gaps": "rows of the clock are missing",
    "lag": "the response is slower or faster than the model's",
    "leak": "the free run rebuilds the output from x",
    "learning": "the residual power has a trend over runs",
    "level": "the output lies at one value more often than by chance",
    "lost control": "the rule of lost_control sees a stretch, of a person",
    "mean change": "the mean of the residual changes at one time",
    "missing samples": "a channel has NaN in the recording, not where control was lost",
    "no ceiling": "the noise ceiling is not known",
    "none": "no test finds anything, and the ceiling is known",
    "nonlinearity": "the residual depends on the size of the output",
    "one step only": "one-step VAF > 95 %, free run < 50 %",
    "one target": "all runs share one target",
    "outlier": "a residual is larger than noise of its spectrum gives",
    "outlying run": "a run has more residual power than the others",
    "overfit": "held-out squared error > 1.1 times that of the fit",
    "rate unit": "a channel is the rate of another in another unit",
    "remnant power change": "the residual power changes at one time",
    "sampling time": "runs have different sampling times",
    "unknown": "more is left than the findings account for",
    "unstable": "the free run grows by itself",
    "wrapped angle": "jumps of 360 or 2 pi, and small steps elsewhere",
}
NOTES = {
    "added": "a group has an effect that single searches do not name",
    "changes": "a gain changes in time, and frequency or damping were freed",
    "controller": "a controller is the linear model",
    "delay": "the delay is at its least, or was given below it",
    "experiment": "two effects explain as much",
    "fitted runs": "the model was fitted on compared runs, or its file does not say on which",
    "failure": "an analysis of a person failed",
    "gaps": "rows outside the longest stretch of each run are not in spectra",
    "idle disturbance": "a recorded disturbance is not answered",
    "leak": "a model is refused",
    "lost control": "stretches are left out",
    "mean": "the mean holds most of the power",
    "missing output": "rows have no output, or lost control",
    "not fitted": "arithmetic of a candidate failed",
    "outlying": "a person is unlike the others",
    "possible": "a name is less probable than asked",
    "settling": "the start of a free run is left out",
    "some runs": "max_rows is less than there is",
    "time limit": "time was over before all were tried",
    "two estimates": "likelihood and least error differ",
    "unknown": "people have structure without a name",
    "unsettled": "the free run does not forget its start",
    "untried": "nothing could be tried",
    "whole periods": "rows before whole periods of the target are not in spectra",
    "worse": "held out it is worse, by more noise than it can have learnt, or than without delay",
}


@pytest.mark.parametrize(("of", "listed"), [("Finding", FINDINGS), ("Note", NOTES)])
def test_each_sentence_is_listed_with_its_condition(of, listed):
    sources = (path.read_text(encoding="utf-8") for path in (HERE / "skhoid").rglob("*.py"))
    first = re.compile(rf'\b{of}\(\s*"([^"]+)"')
    assert {kind for source in sources for kind in first.findall(source)} == {*listed}
    assert all(listed.values())


def test_each_sentence_is_produced_by_a_test():
    own = Path(__file__)
    sources = [own.read_text(encoding="utf-8").split("# Those that")[-1]]
    sources += [
        path.read_text("utf-8") for path in own.parents[1].rglob("test_*.py") if path != own
    ]
    told = "".join(sources)
    assert [kind for kind in (*FINDINGS, *NOTES) if f'"{kind}"' not in told] == []


HEADLINES = {
    Verdict.NOTHING: "Nothing found",
    Verdict.FOUND: "Missing: dead zone",
    Verdict.POSSIBLE: "Missing: possibly dead zone",
    Verdict.TOO_LITTLE: "The model explains too little to say what it is missing",
    Verdict.NOT_IN_CATALOGUE: "Something is missing that no effect of the catalogue explains",
    Verdict.NOT_TRIED: "Something is missing that none of the 3 effects tried explains",
    Verdict.CUT_SHORT: "Something is missing that is not explained within max_effects=4",
}


@pytest.fixture(scope="module")
def result():
    return searched(recorded(n_runs=2), ["dead_zone", "bias", "saturation"]).result_


@pytest.mark.parametrize("verdict", Verdict, ids=lambda one: one.name)
def test_each_verdict_has_its_headline(result, verdict):
    named = ["dead_zone"] if verdict is Verdict.FOUND else []
    unsure = ["dead_zone"] if verdict is Verdict.POSSIBLE else []
    told = tell_headline(replace(result, verdict=verdict, best_effects=named, stand_ins=unsure))
    assert told.startswith(HEADLINES[verdict])
    assert "nothing is missing" not in told.lower()


def test_nothing_is_found_only_where_all_was_tried_in_time(result):
    late = result.ranking.assign(reason_code=Reason.TIME, status=Status.NOT_TRIED)
    told = tell_headline(replace(result, ranking=late))
    assert told.startswith("Nothing found before the time limit")


@pytest.mark.parametrize(
    ("vaf", "ceiling"), [(2.7, np.nan), (-0.1, np.nan), (-33, 80.0), (-2e4, 90)]
)
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_nothing_is_never_found_where_little_is_explained(vaf, ceiling, share):
    about_zero = [100 - (100 - value) * share for value in (vaf, ceiling)]
    ended = end_explained(Ending(Verdict.NOTHING, [], []), *about_zero, share)
    assert ended.verdict is Verdict.TOO_LITTLE
    assert not ended.best_effects


# Those that no other test asks for by its kind.


def drawn(n_runs=4, **more):
    X, y, truth = runs(n_runs)
    return X, y, truth.u_without_remnant.to_numpy()


def by_kind(found):
    return {one.name for one in found.findings} | {one.kind for one in found.notes}


def test_a_residual_that_falls_from_run_to_run():
    X, y, u = drawn(12)
    run = X.index.get_level_values("run").factorize()[0]
    noise = 0.2 * np.std(u) * np.random.default_rng(0).standard_normal(len(u))
    other = u + noise * 0.994**run  # so slowly that no run is unlike the others
    assert "learning" in by_kind(compare(Gives(lambda X: u), X, y * 0 + other, run_in=0))


def test_a_model_that_knows_the_next_sample_alone():
    rng = np.random.default_rng(0)
    index = pd.MultiIndex.from_product([["a", "b"], np.arange(2000) * 0.02], names=["run", "time"])
    X = pd.DataFrame({"e": rng.standard_normal(4000)}, index)
    y = pd.Series(lfilter([1], [1, -1.95, 0.951], rng.standard_normal(4000)), index, name="u")
    assert "one step only" in by_kind(compare(ARXRegressor(2, 1, 1).fit(X, y), X, y))


def test_a_model_that_is_too_simple_for_the_held_out_half():
    n = 4000
    steps = np.repeat(np.random.default_rng(3).standard_normal(n // 20), 20)
    e = np.where(np.arange(n) < n // 2, 4.0, 1.7) * (1 + 0.3 * steps.clip(-2, 2))
    index = pd.MultiIndex.from_product([["a"], np.arange(n) * 0.05], names=["run", "time"])
    u = pd.Series(lfilter([0, 0, 0.1], [1, -0.9], np.sqrt(e)), index, name="u")
    found = identify(pd.DataFrame({"e": e}, index), u, ModelChoice(na=1, nb=1, nk=2))
    assert found.best.verdict == "worse held out"
    assert "worse" in [note.kind for note in found.notes]


def test_rows_without_control_are_told_from_rows_without_output():
    X, y, u = drawn()
    lost = y.copy()
    lost.iloc[300:340] = np.nan
    lost.attrs[LOST_ROWS] = 40
    found = compare(Gives(lambda X: u), X, lost, run_in=0)
    told = {one.kind: one.text for one in found.notes}
    assert told["missing output"] == "40 rows in which control was lost are left out"
    assert "missing samples" not in by_kind(found)
    lost.iloc[700:705] = np.nan
    told = {one.kind: one.text for one in compare(Gives(lambda X: u), X, lost, run_in=0).notes}
    both = (
        "40 rows in which control was lost and 5 rows in which the output is missing are left out"
    )
    assert told["missing output"] == both


def test_what_could_not_be_tried_says_what_it_needs():
    found = searched(recorded(n_runs=2), ["motion_feedback"])
    notes = {one.kind: one.text for one in found.notes_}
    assert notes["untried"].startswith("motion feedback was not tried: X has no column of role")
