"""The whole way through the public API: hidden effect, search, added, held-out error falls.

The data come from two loops that share no code with the package: ``hidden_effects.py`` (the
thesis's loop at 100 Hz) and the blind trial's generator (its own plants at 500 Hz, of which a fixed
seed is taken here that no verdict uses).
"""

import sys

import numpy as np
import pytest
from support.hidden_effects import Effects as Hidden
from support.hidden_effects import simulate_runs
from support.places import ROOT

from skhoid import ControlledElement, EffectSearchCV, OperatorRegressor, vaf_score
from skhoid.effects.catalogue import CLASSES
from skhoid.search import Verdict

BLIND = ROOT / "benchmarks" / "blind"
SEED = 6
CLOSED = 0.9  # of the gap between the linear model and the true operator, on held-out runs
RIVALS = ["tv_gain", "dead_zone", "saturation", "bias"]
NOT_SEEN = 5.0  # s at the start of a held-out run, before which the past is not known

# Effects of the thesis's loop, in its own terms, and the ids that are right.
OF_LOOP = {
    "tv_gain, step": (Hidden(gain_step=(20.0, 1.7)), {"tv_gain"}),
    "tv_gain, sigmoid": (Hidden(gain_sigmoid=(20.0, 0.5, 0.5)), {"tv_gain"}),
    "tv_delay": (Hidden(delay_change=(20.0, 0.1)), {"tv_delay"}),
    "lapses": (Hidden(lapses=(2, 1.5), lapses_repeat=True), {"lapses"}),
    "dead_zone": (Hidden(dead_zone=0.6), {"dead_zone"}),
    "asym_gain": (Hidden(asymmetry=0.35), {"asym_gain"}),
    "feedforward": (Hidden(feedforward=(0.05, 0.3)), {"feedforward"}),
    "bias": (Hidden(bias=0.05), {"bias"}),
    "drift": (Hidden(drift=0.12, bias=-0.06), {"drift"}),
    "saturation": (Hidden(saturation=0.1), {"saturation"}),
    "rate_limit": (Hidden(rate_limit=0.25), {"rate_limit"}),
}
# What the trial has and the thesis's loop has not.
OF_TRIAL = [
    *("wrong_delay", "intermittent", "gain_drift", "scheduled_gain", "rectified"),
    *("absolute_value", "backlash", "stiction", "hardening_stiffness", "integral", "preview"),
    *("output_feedback", "motion_feedback", "disturbance", "cross_axis", "extra_lead"),
    *("higher_order", "tremor", "quantised", "cubic_gain"),
]
ALL = [c.name for c in CLASSES]
STUCK = {"intermittent"}
# Weak linear answers, which three runs do not confirm in the closed loop.
UNCONFIRMED = {*STUCK, "integral", "disturbance"}
# Some that act at different places; the rest are a study.
OF_TRIAL_SLOW = {"hardening_stiffness", "output_feedback", "quantised"}
# Of the thesis's loop.
OF_LOOP_SLOW = {"tv_delay", "lapses", "feedforward", "dead_zone"}


def closed_share(search, X, y, oracle):
    """Of the gap between baseline and oracle, on held-out runs; and the gap in points."""

    def vaf(prediction):
        kept = X.index.get_level_values("time") >= NOT_SEEN
        return vaf_score(y.to_numpy()[kept], np.asarray(prediction)[kept])

    linear, best = vaf(search.baseline_.predict(X)), vaf(search.predict(X))
    gap = vaf(oracle) - linear
    return (best - linear) / gap, gap


def names(listed, stuck, quick, slow):
    reason = "stops beside the minimum, another name fits as well, or the loop does not confirm it"
    mark = pytest.mark.xfail(reason=reason, strict=True)

    def marks(name):
        rest = pytest.mark.slow if name in slow else pytest.mark.whole
        return [mark] * (name in stuck) + [rest] * (name not in quick)

    return [pytest.param(name, marks=marks(name)) for name in listed]


def of_loop(name):
    hidden, right = OF_LOOP[name]
    X, y, truth = simulate_runs(
        n_runs=4,
        effects=hidden,
        intensity=0.1,
        duration=40.96,
        run_in=20.48,
        targets=(0, 0, 1, 2),
        seed=SEED,
    )
    return X, y, truth, right


@pytest.fixture(scope="module")
def trial():
    """``make_case`` and ``effect_of`` of the generator, which is no package."""
    sys.path.insert(0, str(BLIND))
    try:
        import generator
        import sets

        yield generator, sets
    finally:
        sys.path.remove(str(BLIND))


def search_loop(name, effects):
    X, y, truth, right = of_loop(name)
    train, test = X.loc[1:3], X.loc[[4]]
    search = EffectSearchCV(OperatorRegressor(), effects=effects).fit(train, y.loc[train.index])
    share, gap = closed_share(
        search, test, y.loc[test.index], truth.u_without_remnant.loc[test.index]
    )
    return search, share, gap, right


def check(search, share, gap, right):
    assert gap > 1, "there must be something to find"
    assert search.best_effects_[:1] != []
    assert search.best_effects_[0] in right
    assert search.verdict_ is Verdict.FOUND
    assert search.best_effects_[-1] != "unknown"
    assert share > CLOSED
    path = search.error_path_
    assert path["vaf"].iloc[-1] - path["vaf"].iloc[0] > 0.35
    assert path["rmse"].iloc[-1] < path["rmse"].iloc[0]
    assert search.best_effects_[0] in search.summary()


@pytest.mark.parametrize("name", names(OF_LOOP, (), (), OF_LOOP_SLOW))
def test_what_the_thesiss_loop_hides_is_found_among_rivals(name):
    check(*search_loop(name, sorted({*RIVALS, name.split(",")[0]})))


@pytest.mark.whole
@pytest.mark.parametrize("name", OF_LOOP)
def test_what_the_thesiss_loop_hides_is_found_in_the_catalogue(name):
    check(*search_loop(name, "all"))


def search_trial(trial, name, effects, n_runs):
    generator, sets = trial
    number = next(n for n in range(60) if generator.effect_of(n) == name)
    case = generator.make_case("main", number, SEED)
    runs = case.X.index.get_level_values(0).unique()[:n_runs]
    X, y = case.X.loc[runs], case.y.loc[runs]
    element = case.controlled_element and ControlledElement(*case.controlled_element)
    search = EffectSearchCV(
        OperatorRegressor(delay=case.delay),
        effects=effects,
        display=case.display,
        controlled_element=element,
    ).fit(X, y)
    share, gap = closed_share(search, case.X_test, case.y_test, case.oracle_prediction)
    return search, share, gap, sets.right_answers(name, case.gap)


@pytest.mark.parametrize("name", names(OF_TRIAL, UNCONFIRMED, (), OF_TRIAL_SLOW))
def test_what_the_trial_hides_is_found_among_rivals(trial, name):
    search, share, gap, right = search_trial(trial, name, sorted({*RIVALS, name}), 3)
    if name == "tremor":  # of unknown phase: named, and nothing to gain
        assert "tremor" in search.best_effects_
        return
    check(search, share, gap, right)


@pytest.mark.whole
@pytest.mark.parametrize("name", names(ALL, STUCK, ALL, ()))
def test_what_the_trial_hides_is_found_in_the_catalogue(trial, name):
    search, share, gap, right = search_trial(trial, name, "all", 5)
    if name == "tremor":
        assert "tremor" in search.best_effects_
    elif gap < 1:
        assert set(search.best_effects_[:1]) <= right
    else:
        check(search, share, gap, right)


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden():
    X, y, _ = simulate_runs(n_runs=3, intensity=0.15, duration=40.96, run_in=20.48, seed=SEED)
    search = EffectSearchCV(OperatorRegressor()).fit(X, y)
    assert search.best_effects_ == []
    assert search.verdict_ is Verdict.NOTHING
    assert search.explainable_gap_ < 1.0
    assert len(search.error_path_) == 1


@pytest.mark.slow
@pytest.mark.parametrize("number", [0])
def test_nothing_is_found_in_the_trials_null_cases(trial, number):
    null_case(trial, number, 3)


@pytest.mark.whole
@pytest.mark.parametrize("number", range(1, 25))
def test_nothing_is_found_in_more_null_cases(trial, number):
    null_case(trial, number, 5)


def null_case(trial, number, n_runs):
    generator, _ = trial
    case = generator.make_case("null", number, SEED)
    runs = case.X.index.get_level_values(0).unique()[:n_runs]
    search = EffectSearchCV(OperatorRegressor(delay=case.delay), display=case.display)
    search.fit(case.X.loc[runs], case.y.loc[runs])
    assert search.best_effects_ == []
    assert search.verdict_ is Verdict.NOTHING


@pytest.mark.slow
def test_two_hidden_effects_are_found_one_after_the_other():
    """The story of the documentation: error falls, and falls again, until nothing is left."""
    hidden = Hidden(dead_zone=0.5, gain_sigmoid=(20.0, 0.5, 0.5))
    X, y, truth = simulate_runs(
        n_runs=4,
        effects=hidden,
        intensity=0.1,
        duration=40.96,
        run_in=20.48,
        targets=(0, 0, 1, 2),
        seed=SEED,
    )
    train, test = X.loc[1:3], X.loc[[4]]
    search = EffectSearchCV(OperatorRegressor(), effects=RIVALS)
    search.fit(train, y.loc[train.index])
    assert set(search.best_effects_) == {"dead_zone", "tv_gain"}
    share, gap = closed_share(
        search, test, y.loc[test.index], truth.u_without_remnant.loc[test.index]
    )
    assert gap > 5
    assert share > CLOSED
    vaf = search.error_path_["vaf"]
    assert len(vaf) == 3
    assert vaf.diff().iloc[1:].min() > 0.5
    parameters = search.best_estimator_.parameters_
    width = parameters.loc["dead_zone__width"]
    assert abs(width["value"] - 0.5) < 4 * width["sd"] + 0.02
    middle = parameters.loc["tv_gain__time"]
    assert abs(middle["value"] - 20.0) < 4 * middle["sd"] + 1.0
    # The same model by hand, one effect after the other.
    model = OperatorRegressor()
    before = model.fit(train, y.loc[train.index]).vaf_
    for effect in search.best_effects_:
        model = model.with_effect(effect).fit(train, y.loc[train.index])
        assert model.vaf_ > before + 0.5
        before = model.vaf_
