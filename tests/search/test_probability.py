"""How probable a name is: what the map promises, and where its table comes from."""

import json

import numpy as np
import pandas as pd
import pytest
from support.places import ROOT

from benchmarks import calibrate
from skhoid import effects
from skhoid.search.probability import (
    COEFFICIENTS,
    Alternative,
    find_chances,
    load_table,
    log_factor,
    log_lead,
    name_probability,
    runs_to_decide,
)

TRIED = [effects.DeadZone(), effects.Feedforward(), effects.Backlash(), effects.Stiction()]


def draw_step(seed):
    """Some effects, and a shape, with any evidence."""
    rng = np.random.default_rng(seed)
    found = rng.exponential(50.0, len(TRIED) + 1) * rng.choice([-1.0, 1.0, 1.0], len(TRIED) + 1)
    return [Alternative(e, float(v)) for e, v in zip([*TRIED, None], found, strict=True)]


@pytest.mark.parametrize("seed", range(5))
def test_probabilities_of_a_step_are_one_together(seed):
    step = draw_step(seed)
    chances = find_chances(step)
    assert sum(chances.names) + chances.nothing + chances.something_else == pytest.approx(1)
    assert all(p == 0 for p, one in zip(chances.names, step, strict=True) if one.evidence <= 0)
    assert chances.names[-1] == 0  # a shape is something else


@pytest.mark.parametrize("seed", range(5))
def test_more_evidence_never_makes_a_name_less_probable(seed):
    step = draw_step(seed)
    for i, one in enumerate(step[:-1]):
        found = []
        for nats in np.geomspace(0.1, 3000, 30):
            step[i] = Alternative(one.effect, float(nats))
            found.append(find_chances(step).names[i])
        step[i] = one
        assert np.all(np.diff(found) >= -1e-12)


def test_of_no_evidence_nothing_is_likeliest_and_of_much_alone_the_name():
    none = find_chances([Alternative(effect, -3.0) for effect in TRIED])
    assert none.names == [0.0] * len(TRIED)
    assert none.nothing > 0.8
    alone = [Alternative(TRIED[0], 400.0), *(Alternative(e, -3.0) for e in TRIED[1:])]
    assert find_chances(alone).names[0] > 0.9


def test_names_that_are_easily_taken_for_each_other_count_together():
    step = [Alternative(e, nats) for e, nats in zip(TRIED, [1, 2, 300, 290], strict=True)]
    chances = find_chances(step)
    assert name_probability(step, chances, 2) == pytest.approx(sum(chances.names[2:]))
    assert name_probability(step, chances, 2) > 0.8
    assert name_probability(step, chances, 0) == pytest.approx(chances.names[0])


def test_more_runs_decide_what_few_leave_open():
    step = [Alternative(e, nats) for e, nats in zip(TRIED, [12, 4, -3, -3], strict=True)]
    now = find_chances(step).names[0]
    more = runs_to_decide(step, 0, n_runs=3, confidence=(1 + now) / 2)
    assert more is None or more >= 1
    assert runs_to_decide(step, 0, n_runs=3, confidence=now - 1e-6) == 1
    assert runs_to_decide(step, 0, n_runs=3, confidence=1.0) is None


def test_the_factor_is_what_evidence_makes_of_the_odds_against_nothing():
    chances = find_chances([Alternative(TRIED[0], 40.0)])
    shares = load_table()["shares"]
    odds = chances.names[0] / chances.nothing / (shares["name"] / shares["nothing"])
    of_one = np.log(odds) + np.log(27)  # effects of which the table has the best
    assert log_factor(TRIED[0], 40.0) == pytest.approx(of_one)
    found = [log_factor(TRIED[0], nats) for nats in (-5.0, 0.0, 5.0, 20.0, 200.0)]
    assert found[0] == found[1] < 0 < found[3]
    assert log_factor(TRIED[0], 1e-3) > found[1]  # which is how often nothing shows
    assert np.all(np.diff(found[1:]) > 0)


def test_the_lead_is_of_one_over_the_other_in_its_place():
    one, other = (TRIED[0], 60.0), (TRIED[1], 50.0)
    assert log_lead(one, other) > 0
    assert log_lead(one, other) == pytest.approx(-log_lead(other, one))


def test_a_third_of_what_the_fit_has_hidden_is_beyond_the_catalogue_and_none_is_held_back():
    mix = calibrate.MIX
    hidden = sum(mix.values()) - mix["null"] - mix["second:null"] - mix["second:leaks"] / 2
    assert (mix["beyond"] + mix["second:strange"]) / hidden == pytest.approx(1 / 3, abs=0.05)
    assert "second:held_back" not in mix


def test_the_table_says_where_it_comes_from():
    table = load_table()
    assert [*table["coefficients"]] == [*COEFFICIENTS]
    assert sum(table["shares"].values()) == pytest.approx(1, abs=0.01)
    assert {"command", "commit", "date", "seeds", "cases", "left_out"} <= table["provenance"].keys()


@pytest.mark.slow
def test_the_table_is_what_the_command_writes(tmp_path, capsys):
    for folder in ("skhoid/search", "docs/_static"):
        (tmp_path / folder).mkdir(parents=True)
    calibrate.main(["fit", "--folder", str(tmp_path)])
    written = json.loads((tmp_path / "skhoid/search/probability.json").read_text())
    shipped = load_table()
    for name, value in written["coefficients"].items():
        assert shipped["coefficients"][name] == pytest.approx(value, abs=0.01), name
    assert written["shares"] == shipped["shares"]
    assert (tmp_path / "docs/_static/reliability.png").exists()
    assert "left out of the fit: log loss" in capsys.readouterr().out
    documented, again = (
        pd.read_csv(folder / "docs/_static/reliability.csv") for folder in (ROOT, tmp_path)
    )
    pd.testing.assert_frame_equal(documented, again, atol=0.01)
