"""Candidates judged in the closed loop."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from support.person_in_loop import pursued
from support.searching import search_of

from skhoid import EffectSearchCV, OperatorRegressor, compare
from skhoid.effects import CubicGain, DeadZone, Feedforward, Integral, Lapses
from skhoid.model.extend import extended
from skhoid.model.model import Model
from skhoid.model.simulator import Simulator
from skhoid.search.forward import ordered, output_error_fit
from skhoid.search.in_loop import LEAST_DELTA_BIC, LEAST_RATE, InLoop, LoopJudge

RIVALS = ["feedforward", "preview", "output_feedback"]
SHORT = {"n_runs": 3, "duration": 30.0}
TARGET = {"feedforward", "preview"}


def seeds(first, end):
    """Some, of which one is `slow` and the others are a study."""
    marks = {
        seed: pytest.mark.slow if seed == first else pytest.mark.whole for seed in range(first, end)
    }
    return [pytest.param(seed, marks=mark) for seed, mark in marks.items()]


def named(search):
    return [name for name in search.best_effects_ if name != "unknown"]


def searched(text, seed, effects=RIVALS, **options):
    X, y, _ = pursued(text, seed, **options)
    return EffectSearchCV(OperatorRegressor(), effects=effects, controlled_element=text).fit(X, y)


@pytest.mark.slow
def test_nothing_is_named_of_a_person_who_answers_the_error():
    found = searched("1/s", 1, **SHORT)
    assert named(found) == []
    row = found.ranking_.iloc[0]
    assert row["effect"] in TARGET  # which follows the measured error better
    assert row["vaf_gain"] > 0.5
    assert row["status"] == "not better"
    assert row["delta_bic_joint"] < LEAST_DELTA_BIC
    assert row["reason"].startswith("estimated together with a noise model, it has ΔBIC -")


@pytest.mark.slow
def test_feedforward_is_named_where_it_is():
    found = searched("1/s", 2, feedforward=0.6, early=-0.1, **SHORT)
    assert named(found) == ["feedforward"]
    row = found.ranking_.iloc[0]
    assert row["status"] == "added"
    assert row["delta_bic_loop"] > LEAST_DELTA_BIC
    assert row["gain_loop"] > 0
    assert found.error_path_["vaf_loop"].is_monotonic_increasing


@pytest.mark.parametrize("text", ["1/s", "1/(s(s+1))"])
@pytest.mark.parametrize("seed", seeds(40, 46))
def test_nothing_is_named_over_seeds(text, seed):
    assert named(searched(text, seed)) == []


@pytest.mark.parametrize("text", ["1/s", "1/(s(s+1))"])
@pytest.mark.parametrize("seed", seeds(90, 93))
def test_feedforward_is_named_over_seeds(text, seed):
    """A tenth of a second late: one without delay is a preview of no time."""
    assert named(searched(text, seed, feedforward=0.6, early=-0.1)) == ["feedforward"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(120, 123))
def test_a_preview_is_found_and_not_the_inverse_of_the_element(seed):
    """Which x would give, with a VAF near 100 % on these runs and far below 0 on others."""
    text, sees = "1/(s(s+1))", {"feedforward": 0.6, "early": 0.2}
    X, y, person = pursued(text, seed, **sees)
    found = EffectSearchCV(
        OperatorRegressor(),
        effects=[*RIVALS, "higher_order", "saturation"],
        display="preview",
        controlled_element=text,
    ).fit(X, y)
    assert named(found) == ["preview"]
    X, y, _ = pursued(text, seed + 1000, person=person, **sees)
    assert found.score(X, y) > max(75.0, found.baseline_.score(X, y) + 20.0)
    assert compare(found.best_estimator_, X, y).leak.leaks is False
    tau_e = found.best_estimator_.parameters_.loc["tau_e"]
    assert tau_e["value"] == pytest.approx(person.tau_e, abs=0.06)
    assert np.isfinite(tau_e["sd"])  # not at its least


def with_(search, parent, effect):
    """A model with one more effect at its start."""
    effects = parent.effects + effect
    simulator = Simulator(search.core, effects, search.record)
    own = {f"{effects.names[-1]}__{p.name}": p.starts[0] for p in effect.free}
    values = parent.values() | own
    fit = replace(parent.fit, theta=np.array([values[name] for name in simulator.names]))
    return Model(simulator, fit)


@pytest.fixture(scope="module")
def parts():
    """Search, baseline, and the model with feedforward, of someone who has it."""
    X, y, _ = pursued("1/s", 2, feedforward=0.5, **SHORT)
    search, baseline = search_of(X, y, ["feedforward", "dead_zone", "stiction"], "1/s")
    effect = search.effects[0]
    model = extended(baseline, "feedforward", effect, search.criterion, search.coarse)
    return search, baseline, model


def test_what_is_linear_stays_so_beside_what_is_not(parts):
    """The loop decides of a linear answer, whatever the model has besides."""
    search, baseline, linear = parts
    bent = with_(search, baseline, DeadZone(form="smooth", width=0.5))
    both = with_(search, linear, DeadZone(form="smooth", width=0.5))
    for parent, model, bends in (
        (baseline, linear, False),
        (baseline, bent, True),
        (linear, both, True),
        (bent, both, False),
    ):
        loop = search.loop.around(parent)
        assert loop._bends(model, loop._added(model)) == bends


def test_paths_come_in_any_order_and_maps_of_one_place_in_theirs(parts):
    search, baseline, _ = parts

    def fitted(*effects):
        model = baseline
        for effect in effects:
            model = output_error_fit(with_(search, model, effect))
        return model

    paths = fitted(Integral(form="pure"), Feedforward(form="rate"))
    first = ordered(paths, ["feedforward", "integral"])
    assert first.effects.names == ["feedforward", "integral"]
    np.testing.assert_allclose(first.output, paths.output, atol=1e-9)
    maps = fitted(DeadZone(form="smooth", width=0.1), CubicGain(form="cubic"))
    assert ordered(maps, ["cubic_gain", "dead_zone"]).effects.names == ["dead_zone", "cubic_gain"]


def test_what_was_found_in_the_data_counts_as_bent(parts):
    search, baseline, _ = parts
    model = with_(search, baseline, Lapses(intervals=[(5.0, 8.0)], form="hold", shift=0.0))
    loop = search.loop.around(baseline)
    assert loop._bends(model, loop._added(model))


def test_records_are_thinned_to_what_is_fast_enough():
    X, y, _ = pursued("1/s", 0, n_runs=2, duration=10.0, rate=100)
    search, _ = search_of(X, y, ["bias"], "1/s")
    record = search.loop.record
    assert 1 / record.dt == pytest.approx(50)
    assert 1 / record.dt >= LEAST_RATE
    assert record.y.shape == (500, 2)
    for fold, whole in zip(search.loop.folds, search.folds, strict=True):
        np.testing.assert_array_equal(fold.test, whole.test[::2])
        np.testing.assert_array_equal(fold.train, whole.train[::2])
    assert search.loop.loop.begin == 150


def test_without_an_element_there_is_no_judge(parts):
    X, y, _ = pursued("1/s", 0, n_runs=2, duration=10.0)
    search, baseline = search_of(X[["e"]], y, ["bias"])
    assert search.record.controlled_element is None
    assert search.loop is None
    assert np.isnan(search.step(baseline).candidates[0].in_loop.gain)
    assert LoopJudge.of(search.core, search.record, search.folds) is None


def test_true_effect_pays_in_the_loop(parts):
    search, baseline, model = parts
    judged = search.loop.around(baseline).judged(model)
    assert not judged.refutes
    assert judged.delta_bic > LEAST_DELTA_BIC
    assert judged.gain > 1.0
    assert 0 < judged.vaf < 100


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_error_of_a_sensor_has_no_delta_bic(seed):
    """At the full rate it exceeds the remnant, and what lets less of it pass seems better."""
    X, y, _ = pursued("1/s^2", seed, **SHORT)
    step = 12 * X["x"].std() / 2**10
    X = X.assign(x=step * np.round(X["x"] / step))
    X["e"] = X["f_t"] - X["x"]
    search, baseline = search_of(X, y, ["higher_order"], "1/s^2")
    (effect,) = search.effects
    model = extended(baseline, "higher_order", effect, search.criterion, search.coarse)
    beside = search.loop.around(baseline)
    assert beside.judged(model).delta_bic < 0
    fitted = search.loop.fitted(beside.loop, model.effects, [model.theta])
    assert beside.delta_bic(fitted, np.inf) > LEAST_DELTA_BIC


@pytest.mark.slow
def test_judgement_repeats(parts):
    search, baseline, model = parts
    first, second = (search.loop.around(baseline).judged(model) for _ in range(2))
    assert first == second


@pytest.mark.slow
def test_effect_that_adds_nothing_has_no_delta_bic(parts):
    search, _, model = parts
    more = extended(model, "dead_zone", search.effects[1], search.criterion, search.coarse)
    judged = search.loop.around(model).judged(more)
    assert judged.refutes or np.isnan(judged.gain)


def test_what_jumps_is_not_asked(parts):
    search, baseline, _ = parts
    effect = next(e for e in search.effects if e.name == "stiction")
    assert not effect.smooth
    model = extended(baseline, "stiction", effect, search.criterion, search.coarse)
    judged = search.loop.around(baseline).judged(model)
    assert np.isnan([judged.vaf, judged.delta_bic, judged.gain]).all()
    assert not judged.refutes


@pytest.mark.parametrize(
    ("delta_bic", "gain", "refutes"),
    [
        (100.0, 1.0, False),
        (LEAST_DELTA_BIC, 0.1, True),
        (LEAST_DELTA_BIC, 1.0, False),
        (100.0, 0.0, True),
        (100.0, 0.05, True),
        (-5.0, -1.0, True),
        (np.nan, np.nan, False),
    ],
)
def test_what_refutes(delta_bic, gain, refutes):
    assert InLoop(90.0, delta_bic, gain).refutes == refutes


def test_error_of_the_loop_is_nothing_without_remnant():
    X, y, _ = pursued("1/s", 4, remnant=0.0, n_runs=2, duration=20.0)
    search, baseline = search_of(X, y, ["bias"], "1/s")
    around = search.loop.around(baseline)
    assert around.solved
    assert around.vaf > 99.99


def test_parent_that_cannot_be_solved_judges_nothing(parts):
    search, baseline, model = parts
    broken = copy.copy(search.loop.around(baseline))  # others share it
    broken.__dict__["fit"] = _Unsolved()
    assert not broken.solved
    assert np.isnan(broken.vaf)
    assert np.isnan(broken.judged(model).gain)


class _Unsolved:
    output = np.full((3, 1), np.nan)
