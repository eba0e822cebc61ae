"""Numbers of effects that act on what other effects made of a signal say so, wherever told."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid import ARXRegressor, EffectSearchCV, OperatorRegressor
from skhoid.effects import (
    Backlash,
    Bias,
    CubicGain,
    DeadZone,
    Effects,
    ExtraLag,
    Friction,
    Quantised,
    RateLimit,
    Rectified,
    Saturation,
    ScheduledGain,
    WrongDelay,
)

RNG = np.random.default_rng(0)
N, DT = 2400, 0.1
E = np.repeat(RNG.uniform(-1, 1, N // 30), 30)
V = np.sign(E) * np.maximum(np.abs(E) - 0.05, 0)
U = lfilter([0, 0.08], [1, -0.92], 10 * np.sign(V) * np.abs(V) ** 0.5)
INDEX = pd.MultiIndex.from_product([["a"], np.arange(N) * DT], names=["run", "time"])
X = pd.DataFrame({"e": E, "speed": 1 + 0.1 * np.sin(np.arange(N) / 50)}, index=INDEX)
Y = pd.Series(U + 0.05 * RNG.standard_normal(N), index=INDEX, name="u")
POWER, GAP = CubicGain(form="power"), DeadZone(form="gap")


@pytest.mark.parametrize(
    ("chain", "name", "on_arx", "behind"),
    [
        ([POWER, GAP], "dead_zone", True, ("cubic gain",)),
        ([POWER, GAP], "dead_zone", False, ("cubic gain",)),
        ([GAP, POWER], "dead_zone", True, ()),
        ([Rectified(), POWER, GAP], "dead_zone", True, ("one-sided response", "cubic gain")),
        # Of a time or an output: the error's map is not in its way.
        ([POWER, WrongDelay()], "wrong_delay", True, ()),
        ([POWER, Bias()], "bias", True, ()),
        ([POWER, Saturation(at="output")], "saturation", True, ()),
        # What delays, holds or limits a rate keeps the unit.
        ([WrongDelay(), GAP], "dead_zone", True, ()),
        ([ExtraLag(), DeadZone(at="command")], "dead_zone", True, ()),
        ([RateLimit(), Saturation(at="output")], "saturation", True, ()),
        # The command of an ARX model is what became of the input; that of a person is not.
        ([POWER, DeadZone(at="command")], "dead_zone", True, ("cubic gain",)),
        ([POWER, DeadZone(at="command")], "dead_zone", False, ()),
        ([ScheduledGain(), Saturation(at="command")], "saturation", True, ("scheduled gain",)),
        ([DeadZone(at="command"), Saturation(at="command")], "saturation", False, ("dead zone",)),
        ([POWER, Friction(of="output")], "friction", True, ("cubic gain",)),
        ([DeadZone(at="output"), Backlash()], "backlash", False, ("dead zone",)),
        ([GAP, DeadZone(form="jump")], "dead_zone-2", True, ("dead zone",)),
    ],
)  # fmt: skip
def test_what_a_signal_has_passed(chain, name, on_arx, behind):
    assert Effects.of(chain).before(name, on_arx) == behind


@pytest.fixture(scope="module")
def fitted():
    return ARXRegressor(1, 1, 1).with_effect(Effects.of([POWER, GAP])).fit(X, Y)


def test_the_table_and_the_summary_say_it(fitted):
    width = fitted.parameters_.loc["dead_zone__width"]
    assert width["unit"] == "[e] behind cubic gain"
    assert "of the signal behind cubic gain" in width["meaning"]
    assert fitted.parameters_.loc["b0", "unit"] == "[u]/[e]"
    assert "dead_zone__width is in the unit of the signal behind cubic gain" in " ".join(
        fitted.summary().split()
    )
    # The threshold of the truth, 0.05 of the input, is the number through the map before it.
    hardening, spread = fitted.parameters_.loc["cubic_gain__hardening", "value"], E.std()
    inverse = spread * (width["value"] / spread) ** (1 / (1 + hardening))
    assert inverse == pytest.approx(0.05, abs=0.025)
    assert width["value"] > 0.15


def test_the_other_order_needs_no_word():
    table = ARXRegressor(1, 1, 1).with_effect(Effects.of([GAP, POWER])).fit(X, Y).parameters_
    assert table.loc["dead_zone__width", "unit"] == "[e]"
    assert table.loc["dead_zone__width", "value"] == pytest.approx(0.05, abs=0.01)


def test_given_and_moved_numbers_say_it_too(fitted):
    given = ARXRegressor(1, 1, 1).with_effect(
        Effects.of([CubicGain(form="power", hardening=-0.5), DeadZone(form="gap", width=0.1)])
    )
    table = given.fit(X, Y).parameters_
    assert table.loc["dead_zone__width", "unit"] == "[e] behind cubic gain"
    moved = fitted.with_parameters({"dead_zone__width": 0.1}).parameters_
    assert moved.loc["dead_zone__width", "unit"] == "[e] behind cubic gain"


def test_units_of_the_data_are_kept():
    named = X.copy()
    named.attrs["units"] = {"e": "deg"}
    table = ARXRegressor(1, 1, 1).with_effect(Effects.of([POWER, GAP])).fit(named, Y).parameters_
    assert table.loc["dead_zone__width", "unit"] == "deg behind cubic gain"


def test_a_search_says_it_in_its_ranking_and_its_limits():
    model = ARXRegressor(1, 1, 1).with_effect(CubicGain(form="power"))
    search = EffectSearchCV(model, effects=[GAP, Quantised(at="error", form="sharp")]).fit(X, Y)
    tried = search.ranking_[search.ranking_["effect"] == "dead_zone"]
    assert len(tried)
    assert tried["parameters"].str.contains("[e] behind cubic gain", regex=False).all()
    limits = search.limits_.set_index("effect")
    assert limits.loc["dead_zone", "unit"] == "[e] behind cubic gain"


def test_a_person_behind_a_map_keeps_the_unit_of_the_command():
    rng = np.random.default_rng(1)
    n = 1500
    e = np.convolve(rng.standard_normal(n), np.ones(25) / 25, "same")
    index = pd.MultiIndex.from_product([[0], np.arange(n) * 0.04], names=["run", "time"])
    x, u = pd.DataFrame({"e": e}, index=index), pd.Series(np.roll(e, 8), index=index, name="u")
    effects = [CubicGain(form="cubic"), Saturation(at="command", limit=5.0)]
    table = OperatorRegressor(effects=effects).fit(x, u).parameters_
    assert table.loc["saturation__limit", "unit"] == "[u]"
