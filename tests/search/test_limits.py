"""How large an effect may be that is not named, and when a model explains too little."""

import json

import numpy as np
import pandas as pd
import pytest
from support.open_loop import recorded, searched

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import DeadZone
from skhoid.search import Verdict

TRIED = ["dead_zone", "bias", "saturation", "extra_lag", "rectified"]


@pytest.fixture(scope="module")
def plain():
    return searched(recorded(seed=3), TRIED)


def limits_of(search):
    return search.limits_.set_index("effect")


def test_nothing_found_says_what_could_have_been_found(plain):
    assert plain.verdict_ is Verdict.NOTHING
    found = limits_of(plain)
    assert set(found.index) == set(TRIED)
    sized = found.drop(index=["rectified", "extra_lag"])
    numbers = ["limit", "limit_points", "shown_from", "shown_points"]
    assert np.isfinite(sized[numbers].to_numpy()).all()
    assert (sized["limit_points"] < sized["shown_points"]).all()
    assert found.loc["dead_zone", ["parameter", "unit"]].tolist() == ["width", "deg"]
    assert np.isnan(found.loc["rectified", "limit"])
    assert "no size" in found.loc["rectified", "reason"]
    assert np.isnan(found.loc["extra_lag", "limit"])
    assert "imitates it" in found.loc["extra_lag", "reason"]


def test_a_stop_is_limited_from_below(plain):
    found = limits_of(plain)
    assert found.loc["saturation", "sense"] == "at least"
    assert found.loc["saturation", "limit"] > found.loc["saturation", "shown_from"]
    assert found.loc["bias", "sense"] == "at most"
    assert found.loc["bias", "limit"] < found.loc["bias", "shown_from"]


def test_the_summary_and_json_tell_limits(plain):
    said = " ".join(plain.summary().split())
    assert "these runs would have shown 3 of 5 effects from" in said
    assert "dead zone: width at most 0." in said
    rows = json.loads(json.dumps(plain.result_.as_dict()))["limits"]
    assert {row["effect"] for row in rows} == set(TRIED)


def test_more_remnant_allows_more():
    quiet, loud = (
        limits_of(searched(recorded(2, 30.0, seed=1, remnant=remnant), ["bias", "dead_zone"]))
        for remnant in (0.02, 0.4)
    )
    assert (quiet["limit"] < loud["limit"]).all()
    assert not (loud["shown_from"] < quiet["shown_from"]).any()  # NaN: not at any size


def test_what_is_named_has_no_limit():
    found = searched(recorded(2, 30.0, outer=lambda u: u + 0.3), ["bias", "dead_zone"])
    assert found.result_.added == ["bias"]
    assert found.limits_["effect"].tolist() == ["dead_zone"]


@pytest.mark.filterwarnings("ignore::skhoid.NothingExplainedWarning")
def test_an_output_that_has_nothing_to_do_with_the_input_is_too_little():
    rng = np.random.default_rng(3)
    n = 1500
    e, u = (np.convolve(rng.standard_normal(n), np.ones(12) / 12, "same") for _ in range(2))
    index = pd.MultiIndex.from_product([["a"], np.arange(n) * 0.05], names=["run", "time"])
    X, y = pd.DataFrame({"e": e}, index=index), pd.Series(u, index=index, name="u")
    search = EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone"]).fit(X, y)
    assert search.verdict_ is Verdict.TOO_LITTLE
    assert search.best_effects_ == []
    assert "explains too little to say" in search.summary()
    assert "missing is" not in search.summary()


WEAK = {
    "bias": lambda size: {"outer": lambda u: u + size},
    "dead_zone": lambda size: {"inner": lambda e: e - np.clip(e, -size, size)},
    "asym_gain": lambda size: {"inner": lambda e: e + size * np.abs(e)},
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "least_shown"), [("bias", 0), ("dead_zone", 4), ("asym_gain", 4)])
def test_weak_effects_are_within_their_limits_and_what_would_be_shown_is(name, least_shown):
    """Weak are shares of the size shown; of a bias hardly any such runs have one: of the limit.

    Each has a remnant of its own, so of 8 that hold with 95 % fewer than 6 do in 1 of 170 tests.
    """
    tried = [DeadZone(form="gap", at="error") if name == "dead_zone" else name]
    within, added = [], []
    for seed in range(4):
        row = limits_of(searched(recorded(2, 30.0, seed=seed), tried)).loc[name]
        is_shown = np.isfinite(row["shown_from"])
        size = row["shown_from"] if is_shown else 4 * row["limit"]
        for share in (0.3, 0.6):
            runs = recorded(2, 30.0, seed=round(1000 * share) + seed, **WEAK[name](share * size))
            limit = limits_of(searched(runs, tried, max_effects=0)).loc[name, "limit"]
            within.append(limit > share * size)
        if is_shown:
            runs = recorded(2, 30.0, seed=200 + seed, **WEAK[name](size))
            added.append(name in searched(runs, tried).result_.added)
    assert sum(within) >= 6
    assert len(added) >= least_shown
    assert sum(added) >= 5 / 8 * len(added)
