"""An exploration: each step gives what the library gives, and can be undone."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    FrequencyResponse,
    OperatorRegressor,
    RecursiveARX,
    VAFScorer,
    compare,
    select_runs,
)
from skhoid.effects import Bias, DeadZone
from skhoid.interpret import pole_table, step_response
from skhoid.lab.explore import Exploration


@pytest.fixture(scope="module")
def models(runs, search):
    """Fits that most tests begin with: baseline, with bias, with bias and dead zone."""
    first = Exploration(search.estimator, *runs, search=search)
    found = [first.model]
    for effect in ("bias", "dead_zone"):
        first.act("add", {"effect": effect, "run": 0})
        found.append(first.model)
    return found


@pytest.fixture
def exploration(runs, search, models):
    return Exploration(search.estimator, *runs, search=search, fitted=models)


def vaf(model, X, y):
    return VAFScorer(run_in=3.0)(model, X, y)


def titles(state):
    return [step["title"] for step in state["stair"]]


def test_begins_with_the_baseline_and_the_cards_of_the_search(exploration, search, runs):
    state = exploration.state()
    assert titles(state) == ["baseline"]
    assert state["vaf"]["train"] == vaf(OperatorRegressor().fit(*runs), *runs)
    summary = search.summary().replace("\n", " ")
    assert state["verdict"].rstrip(".") in summary
    assert state["findings"][0]["what"] in summary  # the verdict with its figures
    assert state["verdict_kind"] == "found"
    assert {c["id"] for c in state["cards"] if c["status"] == "found"} == {"bias", "dead_zone"}
    first = search.ranking_[search.ranking_["step"] == 1].set_index("effect")["vaf_gain"]
    assert {c["id"]: c["gain"] for c in state["cards"]} == first.to_dict()
    assert state["cards_of"].endswith("Gains are on held-out rows, of each added to the baseline.")
    assert [c["id"] for c in state["cards"]] == ["bias", "dead_zone", "saturation"]  # as ranked
    assert all(c["probability"] > 0.75 for c in state["cards"][:2])
    assert "deg" in state["cards"][2]["limit"]


def test_the_result_is_one_step_from_the_baseline(exploration, search):
    assert exploration.state()["to_add"] == ["bias", "dead_zone"]
    exploration.act("add", {"effect": ["bias", "dead_zone"]})
    added = exploration.state()
    assert added["to_add"] == []
    assert added["undo"] == "Add bias and dead zone"
    exploration.act("undo", {})
    opened = exploration.at_result().state()
    assert titles(opened) == ["baseline", "bias", "dead zone"]
    assert opened["vaf"] == added["vaf"]
    with pytest.raises(ValueError, match="has the effect bias already"):
        exploration.act("add", {"effect": ["bias"]})


def test_adding_is_fitting(exploration, runs):
    exploration.act("add", {"effect": "bias", "run": 0})
    reply = exploration.act("add", {"effect": "dead_zone", "run": 1})
    chosen = exploration.here.effects
    model = OperatorRegressor(effects=chosen).fit(*runs)
    state = reply["state"]
    assert titles(state) == ["baseline", "bias", "dead zone"]
    assert state["stair"][-1]["vaf"] == state["vaf"]["train"] == vaf(model, *runs)
    X, y = select_runs(*runs, runs=1)
    np.testing.assert_array_equal(reply["simulated"], model.predict(X))
    assert state["run_vaf"][1] == pytest.approx(vaf(model, X, y), rel=1e-12)
    errors = [step["rmse"] for step in state["stair"]]
    assert errors == sorted(errors, reverse=True)
    values = {p["name"]: p["value"] for e in state["effects"] for p in e["parameters"]}
    assert values == model.parameters_["value"][list(values)].to_dict()


def test_models_are_kept_side_by_side(exploration, search, runs):
    before = exploration.act("trace", {"run": 1})["simulated"]
    exploration.act("keep", {})
    with pytest.raises(ValueError, match="kept already, as model 1"):
        exploration.act("keep", {})
    exploration.act("add", {"effect": ["bias", "dead_zone"]})
    state = exploration.act("keep", {"run": 1})["state"]
    assert [one["title"] for one in state["models"]] == [
        "bias and dead zone",
        "baseline",
        "bias and dead zone",
    ]
    stair = [step["vaf"] for step in state["stair"]]
    assert [one["vaf"]["train"] for one in state["models"]] == [stair[-1], stair[0], stair[-1]]
    baseline = OperatorRegressor().fit(*runs)
    traced = exploration.act("model", {"model": 1, "run": 1})["simulated"]
    np.testing.assert_array_equal(traced, before)
    values = {p["name"]: p["value"] for p in state["models"][1]["parameters"]}
    assert values["K_e"] == baseline.parameters_["value"]["K_e"]
    kept = Exploration(search.estimator, *runs, search=search, memory=exploration.memory())
    assert [one["vaf"] for one in kept.state()["models"]] == [m["vaf"] for m in state["models"]]
    recalled = exploration.act("recall", {"model": 1})["state"]
    assert titles(recalled) == ["baseline"]
    assert recalled["undo"] == "Go to model 1"
    assert len(exploration.act("drop", {"model": 2})["state"]["models"]) == 2
    with pytest.raises(ValueError, match="no model 2"):
        exploration.act("recall", {"model": 2})


def test_dragging_moves_the_simulation_and_leaves_no_step(exploration, runs):
    exploration.act("add", {"effect": "bias", "run": 0})
    before = exploration.state()
    reply = exploration.act("drag", {"name": "bias__level", "value": 0.02, "run": 0})
    model = OperatorRegressor(effects=Bias()).fit(*runs).with_parameters({"bias__level": 0.02})
    assert reply["vaf"]["train"] == reply["stair"][-1]["vaf"] == vaf(model, *runs)
    np.testing.assert_array_equal(reply["simulated"], model.predict(select_runs(runs[0], runs=0)))
    assert reply["stair"][0] == before["stair"][0]
    after = exploration.state()
    assert after["stair"] == before["stair"]
    assert after["undo"] == "Add bias"


def test_the_numbers_of_the_operator_can_be_moved_too(exploration, runs):
    """What was moved of the operator is drawn and kept as a step; a refit estimates it again."""
    exploration.act("add", {"effect": "bias"})
    before = exploration.state()
    movable = [p["name"] for p in before["model"] if p["movable"]]
    assert movable == ["K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e"]  # T_L follows
    reply = exploration.act("drag", {"name": "K_e", "value": 0.05, "run": 0})
    model = OperatorRegressor(effects=Bias()).fit(*runs).with_parameters({"K_e": 0.05})
    assert reply["vaf"]["train"] == vaf(model, *runs)
    assert reply["stair"][0] == before["stair"][0]
    released = exploration.act("release", {"name": "K_e", "value": 0.05, "run": 0})["state"]
    assert released["undo"] == "Move K_e"
    assert next(p["value"] for p in released["model"] if p["name"] == "K_e") == 0.05
    assert "with_parameters({'K_e': 0.05})" in exploration.script()
    refitted = exploration.act("refit", {})["state"]
    assert refitted["vaf"] == before["vaf"]
    with pytest.raises(ValueError, match="'T_L' is no parameter of this model that can be moved"):
        exploration.act("drag", {"name": "T_L", "value": 0.5, "run": 0})


def test_the_linear_part_is_that_of_the_library(exploration, runs):
    """Of the present model, of kept ones, and of one whose number is dragged."""
    exploration.act("keep", {})
    exploration.act("add", {"effect": "bias"})
    reply = exploration.act("linear", {"models": [1]})
    models = [OperatorRegressor(effects=effects).fit(*runs) for effects in (Bias(), None)]
    for model, response, step in zip(models, reply["responses"], reply["steps"], strict=True):
        found = FrequencyResponse.of(model, reply["omega"])
        np.testing.assert_array_equal(response["gain"], found.magnitude)
        np.testing.assert_array_equal(response["phase"], found.phase)
        low = found.magnitude * np.exp(-1.96 * found.magnitude_sd / found.magnitude)
        np.testing.assert_allclose(response["gain_low"], low)
        answer = step_response(model, reply["time"])
        np.testing.assert_array_equal(step["output"], answer["output"])
        np.testing.assert_allclose(step["high"], answer["output"] + 1.96 * answer["sd"])
    assert [pole["id"] for pole in reply["poles"]] == [0, 0, 1, 1]
    assert reply["poles"][2]["frequency"] == pole_table(models[1])["frequency"][0]
    assert reply["without_effects"]
    dragged = exploration.act("linear", {"name": "K_e", "value": 0.05})
    moved = models[0].with_parameters({"K_e": 0.05})
    found = FrequencyResponse.of(moved, dragged["omega"])
    np.testing.assert_array_equal(dragged["responses"][0]["gain"], found.magnitude)
    assert np.isnan(dragged["responses"][0]["gain_low"]).all()
    assert exploration.state()["undo"] == "Add bias"


def test_the_response_of_the_runs_is_that_of_a_comparison(exploration, runs):
    assert exploration.act("linear", {})["measured"] is None
    exploration.judge()
    measured = exploration.act("linear", {})["measured"]
    table = compare(exploration.model, *runs, run_in=3.0).by_frequency.set_index("omega")
    table = table.loc[measured["omega"]]
    np.testing.assert_array_equal(measured["gain"], table["measured_gain"])
    turns = (measured["phase"] - table["measured_phase"]) / 360
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert (measured["gain"] > 1.96 * table["sd_gain"]).all()
    assert (measured["coherence"] > 0.1).all()


def test_an_arx_model_has_its_poles_in_the_plane_of_z(runs):
    exploration = Exploration(ARXRegressor(nk=14), *runs)
    reply = exploration.act("linear", {})
    assert reply["plane"] == "z"
    assert reply["poles"][0]["frequency"] == pole_table(exploration.model)["frequency"][0]


def test_a_controller_that_answers_the_measurement_has_no_single_response(runs):
    exploration = Exploration(OperatorRegressor(controller="i-p"), *runs)
    assert "answers the measurement" in exploration.act("linear", {})["refused"]


def test_releasing_is_a_step_and_refitting_keeps_what_was_moved(exploration, runs):
    exploration.act("add", {"effect": "bias", "run": 0})
    exploration.act("add", {"effect": "dead_zone", "run": 0})
    state = exploration.act("release", {"name": "dead_zone__width", "value": 0.4, "run": 0})[
        "state"
    ]
    assert not state["settled"]
    assert state["undo"] == "Move dead zone: width"
    width = state["effects"][1]["parameters"][0]
    assert (width["value"], width["moved"], width["fixed"]) == (0.4, True, False)
    state = exploration.act("refit", {"run": 0})["state"]
    width = state["effects"][1]["parameters"][0]
    assert (width["value"], width["moved"], width["fixed"]) == (0.4, False, True)
    model = OperatorRegressor(effects=exploration.here.effects).fit(*runs)
    assert state["vaf"]["train"] == vaf(model, *runs)
    assert exploration.here.effects.get_params()["dead_zone__width"] == 0.4
    state = exploration.act("free", {"name": "dead_zone__width", "run": 0})["state"]
    assert state["effects"][1]["parameters"][0]["fixed"] is False
    assert state["effects"][1]["parameters"][0]["value"] != 0.4


def test_undo_to_the_start_gives_the_start(exploration):
    start = exploration.state()
    steps = [
        ("add", {"effect": "bias"}),
        ("add", {"effect": "dead_zone"}),
        ("use", {"runs": [1], "use": "hold"}),
        ("release", {"name": "bias__level", "value": 0.01}),
        ("refit", {}),
        ("remove", {"effect": "dead_zone"}),
    ]
    passed = [start]
    for name, args in steps:
        passed.append(exploration.act(name, {**args, "run": 0})["state"])
    for state in reversed(passed[:-1]):
        assert same(exploration.act("undo", {"run": 0})["state"], state)
    for state in passed[1:]:
        assert same(exploration.act("redo", {"run": 0})["state"], state)
    with pytest.raises(ValueError, match="nothing to redo"):
        exploration.act("redo", {"run": 0})


def same(one, other):
    kept = ("stair", "vaf", "run_vaf", "effects", "uses", "model")
    return all(text(one[key]) == text(other[key]) for key in kept)


def text(value):
    return json.dumps(value, default=lambda array: array.tolist())


def test_held_out_runs_are_not_fitted(exploration, runs):
    state = exploration.act("use", {"runs": [0, 2], "use": "hold", "run": 0})["state"]
    assert state["uses"] == ["hold", "train", "hold"]
    model = OperatorRegressor().fit(*select_runs(*runs, runs=[1]))
    assert state["vaf"] == {
        "train": vaf(model, *select_runs(*runs, runs=[1])),
        "hold": vaf(model, *select_runs(*runs, runs=[0, 2])),
    }
    assert state["stair"][0]["held"] == state["vaf"]["hold"]
    state = exploration.act("use", {"runs": [0], "use": "out", "run": 0})["state"]
    assert state["vaf"]["hold"] == vaf(model, *select_runs(*runs, runs=[2]))


def test_what_cannot_be_done_is_said_and_changes_nothing(exploration):
    state = exploration.act("add", {"effect": "bias", "run": 0})["state"]
    assert "bias" not in {card["id"] for card in state["cards"]}
    seen = exploration.act("preview", {"effect": "dead_zone", "run": 2})
    before = text(exploration.state())
    for name, args, message in [
        ("ad", {}, "no action 'ad'. Did you mean 'add'"),
        ("add", {"effect": "dead_zne"}, "No effect is called 'dead_zne'. Did you mean 'dead_zone'"),
        ("add", {"effect": "backlash"}, "No effect is called 'backlash'"),
        ("add", {"effect": "bias"}, "has the effect bias already"),
        ("remove", {"effect": "dead_zone"}, "has no effect 'dead_zone'"),
        ("drag", {"name": "K_x", "value": 1.0}, "'K_x' is no parameter of this model"),
        ("drag", {"name": "bias__level", "value": "x"}, "bias__level must be a number; got 'x'"),
        ("drag", {"name": "bias__level", "value": 1e9}, "is beyond what is possible"),
        ("refit", {}, "Nothing was moved"),
        ("free", {"name": "bias__level"}, "is not kept at a number"),
        ("redo", {}, "nothing to redo"),
        ("use", {"runs": [0, 1, 2], "use": "out"}, "At least one run must be left to fit"),
        ("use", {"runs": [0], "use": "fit"}, "used for one of train, hold, out; got 'fit'"),
        ("use", {"runs": [3], "use": "hold"}, "no run number 3; there are 3 runs"),
        ("trace", {"run": -1}, "no run number -1"),
    ]:
        with pytest.raises(ValueError, match=message):
            exploration.act(name, {"run": 0, **args})
    assert text(exploration.state()) == before
    added = exploration.act("add", {"effect": "dead_zone", "run": 2})
    np.testing.assert_array_equal(seen["simulated"], added["simulated"])
    again = exploration.act("add", {"effect": "saturation", "run": 0})["state"]["cards_of"]
    assert again.endswith(". Search again for the present model and runs.")


def test_the_ceiling_and_the_findings_come_with_judge(exploration):
    exploration.act("add", {"effect": "bias", "run": 0})
    state = exploration.act("add", {"effect": "dead_zone", "run": 0})["state"]
    assert state["ceiling_pending"]
    assert state["ceiling"]["note"] == "Of the best model of the search."
    revision = state["revision"]
    exploration.judge()
    state = exploration.state()
    assert not state["ceiling_pending"]
    assert state["revision"] == revision + 1
    assert state["vaf"]["train"] <= state["ceiling"]["vaf"]


def test_what_was_named_for_other_runs_is_not_named_here(exploration):
    state = exploration.act("use", {"runs": [0], "use": "out", "run": 0})["state"]
    other = "The search was on other runs than are fitted now: on run 0 too. There: Missing: "
    assert state["verdict"].startswith(other)
    assert state["verdict_kind"] == ""
    assert "found" not in {card["status"] for card in state["cards"]}
    assert "of other runs than are fitted now" in state["cards_of"]
    assert state["ceiling"] is None  # that of the search is of other runs, too
    exploration.act("undo", {"run": 0})
    assert exploration.state()["verdict_kind"] == "found"


def test_what_was_named_and_added_is_not_called_missing(exploration):
    assert exploration.state()["verdict"].startswith("Missing: ")
    exploration.act("add", {"effect": "bias", "run": 0})
    assert exploration.state()["verdict"].startswith("Missing: ")
    verdict = exploration.act("add", {"effect": "dead_zone", "run": 0})["state"]["verdict"]
    assert re.fullmatch(r"Found and added: bias \(.*\) and dead zone \(.*\)\.", verdict)


def test_a_parameter_at_its_bound_says_so(runs):
    X, y = runs
    early = y.groupby(level="run").shift(-20)  # so that the delay would be below the least
    model = Exploration(OperatorRegressor(), X, early).state()["model"]
    [tau] = [p for p in model if p["name"] == "tau_e"]
    assert tau["meaning"] == "effective time delay; at its lower bound"


def test_a_search_from_here_has_the_model_and_the_runs(exploration, runs):
    exploration.act("add", {"effect": "bias", "run": 0})
    exploration.act("use", {"runs": [1], "use": "hold", "run": 0})
    exploration.act("release", {"name": "bias__level", "value": 0.04, "run": 0})
    search, X, _ = exploration.search_for()
    assert search.estimator.effects.get_params()["bias__level"] == 0.04
    assert search.effects == ["bias", "dead_zone", "saturation"]
    pd.testing.assert_frame_equal(X, select_runs(runs[0], runs=[0, 2]))
    search.fit(*select_runs(*runs, runs=[0, 2]))
    exploration.take_search(search)
    state = exploration.state()
    assert state["cards"][0]["id"] == "dead_zone"
    assert state["cards_of"].endswith("added to the model with bias.")


def test_arrays_without_an_index(runs):
    X, y = select_runs(*runs, runs=0)
    model = OperatorRegressor(dt=0.02, inputs=[0], effects=DeadZone())
    state = Exploration(model, X.to_numpy(), y.to_numpy()).view()
    assert [c["name"] for c in state["channels"]] == ["x0", "x1", "x2"]
    assert len(state["runs"]) == 1
    assert [e["name"] for e in state["state"]["effects"]] == ["dead_zone"]


def test_people_have_their_runs(runs):
    X, y = runs
    X, y = (pd.concat({"S1": part, "S2": part}, names=["subject"]) for part in (X, y))
    view = Exploration(OperatorRegressor(), X, y).view()
    assert view["people"] == [
        {"name": "S1", "runs": [0, 1, 2]},
        {"name": "S2", "runs": [3, 4, 5]},
    ]
    assert view["runs"][4] == {"label": "S2/1", "n": 1024, "person": "S2"}
    assert view["state"]["uses"] == ["train"] * 3 + ["out"] * 3
    assert view["note"].startswith("Only the runs of S1 are fitted at first")


def test_missing_output_is_not_scored(runs):
    X, y = runs
    holes = y.copy()
    holes.iloc[300:900] = np.nan
    exploration = Exploration(OperatorRegressor(), X, holes)
    trace = exploration.act("trace", {"run": 0})
    assert not trace["scored"][300:900].any()
    assert np.isnan(trace["measured"][300:900]).all()
    assert np.isfinite(trace["simulated"]).all()
    assert not trace["scored"][:150].any()  # settling


def test_a_simulation_that_runs_away_is_said(runs):
    X, y = runs
    exploration = Exploration(OperatorRegressor(), X, y, options={"effects": ["output_feedback"]})
    exploration.act("add", {"effect": "output_feedback", "run": 0})
    gain = next(
        p for p in exploration.state()["effects"][0]["parameters"] if p["name"].endswith("gain")
    )
    reply = exploration.act("drag", {"name": gain["name"], "value": gain["high"], "run": 0})
    assert "runs away" in reply["impossible"]
    assert np.isfinite(reply["vaf"]["train"])


def test_other_models_are_refused(runs):
    with pytest.raises(TypeError, match="got RecursiveARX"):
        Exploration(RecursiveARX(), *runs)


def test_where_a_search_finds_a_controller_models_are_of_it():
    rng = np.random.default_rng(0)
    t = 0.02 * np.arange(1500)
    e = np.repeat(rng.standard_normal(15), 100) + 0.1 * rng.standard_normal(1500)
    u = 0.6 * e + 0.9 * 0.02 * np.cumsum(e) + 5.0
    index = pd.MultiIndex.from_product([["a"], t], names=["run", "time"])
    X, y = pd.DataFrame({"e": e}, index), pd.Series(u, index, name="u")
    search = EffectSearchCV(OperatorRegressor(), effects=["quantised"], max_effects=0).fit(X, y)
    assert search.baseline_.controller_ == "pi"
    of_person = Exploration(search.estimator, X, y)
    assert of_person.model.controller_ is None
    of_person.take_search(search)
    for one in (of_person, Exploration(search.estimator, X, y, search=search)):
        assert one.model.controller_ == "pi"
        assert one.model.vaf_ == pytest.approx(search.baseline_.vaf_)
