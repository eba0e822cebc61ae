"""What a page holds that cannot compute: every subset, as the library has it, and small enough."""

import numpy as np
import pytest
from support.envelopes import unpack_text

from skhoid import ARXRegressor, FrequencyResponse, OperatorRegressor, VAFScorer, compare
from skhoid.effects import Bias
from skhoid.lab.explore import Exploration, payloads
from skhoid.lab.explore import payloads as wire
from skhoid.lab.explore.payloads import (
    payload_of,
    payload_of_comparison,
    payload_of_exploration,
)


@pytest.fixture(scope="module")
def payload(search, runs):
    return payload_of(search, None, *runs)


def test_every_subset_is_there(payload):
    assert set(payload["states"]) == {"", "bias", "dead_zone", "bias,dead_zone"}
    assert payload["start"] == "bias,dead_zone"
    for trace in payload["traces"]:
        assert set(trace["simulated"]) == set(payload["states"])


def test_the_ends_are_the_models_of_the_search(payload, search, runs):
    vaf = VAFScorer(run_in=3.0)
    states = payload["states"]
    assert states[""]["vaf"]["train"] == vaf(search.baseline_, *runs)
    assert states["bias,dead_zone"]["vaf"]["train"] == vaf(search.best_estimator_, *runs)
    simulated = np.concatenate([t["simulated"]["bias,dead_zone"] for t in payload["traces"]])
    np.testing.assert_array_equal(simulated, search.predict(runs[0]))


def test_between_are_models_fitted_to_the_same_runs(payload, runs):
    model = OperatorRegressor(effects=Bias()).fit(*runs)
    assert payload["states"]["bias"]["vaf"]["train"] == VAFScorer(run_in=3.0)(model, *runs)


def test_it_cannot_compute_and_says_so(payload):
    can = payload["view"]["can"]
    assert can.pop("change")
    assert can.pop("linear")
    assert not any(can.values())
    assert [c["id"] for c in payload["states"]["bias"]["cards"]] == ["dead_zone"]
    assert payload["states"]["bias,dead_zone"]["cards"] == []


def test_each_subset_has_its_linear_part_to_six_digits(payload, search, runs):
    ends = {"": search.baseline_, "bias,dead_zone": search.best_estimator_}
    for key, model in ends.items():
        linear = payload["states"][key]["linear"]
        found = FrequencyResponse.of(model, linear["omega"])
        np.testing.assert_allclose(linear["responses"][0]["gain"], found.magnitude, rtol=2e-5)
        assert linear["without_effects"] == (key != "")
    small = {key: {"linear": state["linear"]} for key, state in payload["states"].items()}
    assert len(wire.pack_text(small)) < 6_000 * len(small)  # of 16 subsets less than 100 kB


def test_survives_the_page(payload):
    back = unpack_text(wire.pack_text(payload))
    one, other = back["traces"][1]["simulated"]["bias"], payload["traces"][1]["simulated"]["bias"]
    np.testing.assert_allclose(one, other, atol=np.ptp(other) / 65_533)
    assert back["states"]["bias"]["stair"] == payload["states"]["bias"]["stair"]


@pytest.mark.parametrize(
    ("most", "note"),
    [
        (30_000, None),
        (5_000, "One row in 2 of 1 of 3 runs is in this page; "),
    ],
)
def test_large_data_are_thinned_and_left_out(search, runs, monkeypatch, most, note):
    monkeypatch.setattr(payloads, "MOST_VALUES", most)
    found = payload_of(search, None, *runs)
    said = found["view"]["note"]
    assert (said is None) if note is None else said.startswith(note)
    kept = [t for t in found["traces"] if t["measured"] is not None]
    values = sum(t["measured"].size * (1 + len(t["channels"]) + len(t["simulated"])) for t in kept)
    assert values <= most
    assert found["traces"][found["view"]["shown"]]["measured"] is not None


def test_an_exploration_offers_what_was_found_and_keeps_what_was_moved(search, runs):
    exploration = Exploration(search.estimator, *runs, search=search)
    exploration.act("add", {"effect": "bias", "run": 0})
    moved = exploration.act("release", {"name": "bias__level", "value": 0.02, "run": 0})
    payload = payload_of_exploration(exploration)
    assert payload["start"] == "bias"
    assert set(payload["states"]) == {"", "bias", "dead_zone", "bias,dead_zone"}
    np.testing.assert_array_equal(payload["traces"][0]["simulated"]["bias"], moved["simulated"])
    assert payload["states"]["bias"]["vaf"] == moved["state"]["vaf"]
    assert exploration.state()["undo"] == "Move bias: level"


def test_a_comparison_shows_its_traces(runs):
    found = compare(ARXRegressor(nk=15).fit(*runs), *runs)
    payload = payload_of_comparison(found)
    assert payload["view"]["state"]["vaf"]["train"] == found.vaf
    assert payload["view"]["state"]["ceiling"]["vaf"] == found.noise_ceiling
    measured = np.concatenate([t["measured"] for t in payload["traces"]])
    np.testing.assert_array_equal(measured, runs[1].to_numpy())
    assert not any(payload["view"]["can"].values())
    assert payload_of(None, found, *runs)["start"] == ""
    assert payload_of(None, None, *runs) is None
