"""The scorer of the blind trial: stand-ins of known worth get the grades that they deserve.

Nothing here asks the search.
"""

import sys
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from support.places import ROOT

pytestmark = pytest.mark.slow

BLIND = ROOT / "benchmarks" / "blind"
SEED = 6  # no verdict's
MODULES = ["curves", "effects_beyond", "generator", "loop", "scorer"]
MODULES += ["sets", "shapes", "standins"]


@pytest.fixture(scope="module")
def trial():
    """The modules of the trial, which import each other by name."""
    sys.path.insert(0, str(BLIND))
    try:
        yield SimpleNamespace(**{name: __import__(name) for name in MODULES})
    finally:
        sys.path.remove(str(BLIND))


@cache
def case_of(make_case, suite, number):
    return make_case(suite, number, SEED)


def beyond(trial, effect):
    return case_of(trial.generator.make_case, "beyond", trial.generator.BEYOND.index(effect))


def test_every_hidden_effect_has_its_right_shapes(trial):
    hidden = {*trial.generator.EFFECTS, *trial.generator.BEYOND}
    assert {name.split(",")[0] for name in trial.sets.RIGHT_SHAPES} == hidden
    assert set(trial.sets.NEAR) <= set(trial.generator.BEYOND)
    near = {n for name in trial.sets.NEAR for n in trial.sets.NEAR[name]}
    assert near <= hidden | {"friction"}  # which is hidden in no case


@pytest.mark.parametrize("effect", ["dual_slope", "quadratic_damping", "airspeed_gain"])
def test_who_knows_is_right_and_who_is_deaf_is_not(trial, effect):
    case = beyond(trial, effect)
    assert 1 <= case.gap <= 20
    knows, deaf = (
        trial.scorer.grade(case, answer(case))
        for answer in (trial.standins.oracle_answer, trial.standins.deaf_answer)
    )
    assert knows["shape"]["right"]
    assert knows["shape"]["closed"] == pytest.approx(1)
    assert knows["shape"]["curve"]["inside"]
    assert knows["shape"]["curve"]["rms"] < 0.2  # of steps a table shows ramps
    assert (deaf["shape"], deaf["showable"], deaf["strict"]) == (None, True, True)
    rows = dict(trial.scorer.table([knows, deaf]))
    assert rows["place right, of the unknown"].endswith("(1/2)")
    assert rows["gap closed by the shape, of the unknown"] == "median 0.500"
    assert rows["bands that hold the true curve everywhere"].endswith("(1/1)")


def test_another_form_place_or_channel_is_wrong(trial):
    def right(effect, **changes):
        case = beyond(trial, effect)
        shape = replace(trial.standins.true_shape(case), **changes)
        return trial.scorer.grade_shape(case, shape)["shape"]["right"]

    assert right("airspeed_gain")
    assert not right("airspeed_gain", over="time")
    assert not right("airspeed_gain", id="free_delay", place="delay")
    assert right("one_sided_spring", place="output")
    assert not right("one_sided_spring", place="rate")
    assert right("cross_two_lags", channel=None, sentence="A path from e_y, over 2 s.")
    assert not right("cross_two_lags", channel=None, sentence="A path from speed, over 2 s.")
    assert not right("cross_two_lags", channel="speed")


def test_a_shape_where_nothing_is_hidden_is_counted(trial):
    case = case_of(trial.generator.make_case, "null", 0)
    shape = trial.shapes.Shape(
        "free_offset", "sum", "time", pd.DataFrame(), case.baseline_prediction
    )
    quiet = trial.standins.baseline_answer(case)
    records = [trial.scorer.grade(case, each) for each in (quiet, replace(quiet, shape=shape))]
    assert dict(trial.scorer.table(records))["a shape offered"].endswith("(1/2)")


def make_table(x, value, half):
    return pd.DataFrame({"value": value, "low": value - half, "high": value + half}, index=x)


def test_what_the_linear_operator_takes_does_not_count_in_a_map(trial):
    x = np.linspace(-2, 2, 401)
    data = np.random.default_rng(0).normal(0, 0.8, 5000)
    true = trial.curves.TrueCurve(x, x + x**2, np.quantile(data, trial.curves.QUANTILES))

    def grade(value, form="free_map", place="input"):
        return trial.curves.compare(make_table(x, value, 0.1), true, form, place)

    for gain in (0.5, 1, 2):  # a curve is what the map adds to its argument
        same = gain * (x + x**2) - x
        for place in ("input", "spring"):
            assert grade(same, place=place)["inside"]
            assert grade(same, place=place)["rms"] == pytest.approx(0, abs=0.01)
            assert not grade(same + 0.3, place=place)["inside"]  # nothing else makes a level
    straight = grade(np.zeros_like(x))
    assert not straight["inside"]
    assert straight["rms"] == pytest.approx(1.45, abs=0.05)  # the level of x**2 is missing too
    assert grade(1.5 * x**2)["rms"] == pytest.approx(0.27, abs=0.03)
    assert grade(x**2 - 3 * x, place="rate")["inside"]
    assert not grade(x**2 + 0.3, place="rate")["inside"]
    assert not grade(2 * x**2, place="rate")["inside"]


def test_a_map_of_twice_the_command_is_the_same(trial):
    """The output is known, and so the scale of its argument is not."""
    x = np.linspace(-2, 2, 401)
    data = np.random.default_rng(0).normal(0, 0.8, 5000)
    true = trial.curves.TrueCurve(x, x + x**2 / 5, np.quantile(data, trial.curves.QUANTILES))
    for scale in (0.7, 1, 1.5):
        at = scale * x
        curve = make_table(at, true.value - at, 0.05)
        found = {p: trial.curves.compare(curve, true, "free_map", p) for p in ("command", "input")}
        assert found["command"]["inside"]
        assert found["command"]["rms"] == pytest.approx(0, abs=0.01)
        assert found["input"]["inside"] is (scale == 1)


def test_a_gain_counts_by_its_ratio_and_a_delay_by_its_difference(trial):
    t = np.linspace(0, 80, 801)
    true = trial.curves.TrueCurve(t, 1 + 0.3 * np.sin(t / 5), np.quantile(t, [0.025, 0.5, 0.975]))
    true = replace(true, data=np.quantile(t, trial.curves.QUANTILES))
    compare = trial.curves.compare
    assert compare(make_table(t, 3 * true.value, 0.1), true, "free_gain", "gain")["inside"]
    assert not compare(make_table(t, 3 * true.value, 0.1), true, "free_delay", "delay")["inside"]
    assert compare(make_table(t, true.value - 1, 0.1), true, "free_delay", "delay")["inside"]
    assert not compare(make_table(t, true.value - 1, 0.1), true, "free_offset", "sum")["inside"]


def test_at_a_jump_no_smooth_curve_is_asked(trial):
    x = np.linspace(-1, 1, 2001)
    true = trial.curves.TrueCurve(x, 1.0 + (x > 0.3), np.linspace(-0.9, 0.9, 191))
    ramp = 1 + np.clip((x - 0.28) / 0.04, 0, 1)
    gradual = 1 + np.clip((x + 0.1) / 0.8, 0, 1)
    compare = trial.curves.compare
    assert compare(make_table(x, ramp, 0.05), true, "free_gain", "gain")["inside"]
    assert not compare(make_table(x, gradual, 0.05), true, "free_gain", "gain")["inside"]


def test_a_curve_over_something_else_is_no_match(trial):
    x = np.linspace(-2, 2, 401)
    true = trial.curves.TrueCurve(x, x**3, np.linspace(-1, 1, 191))
    far = make_table(x + 100, x**3, 0.1)
    assert not trial.curves.compare(far, true, "free_map", "input")["inside"]


def test_intervals_are_read_as_they_are_said(trial):
    """By their ends, which need not lie evenly about the value."""
    case = case_of(trial.generator.make_case, "null", 0)
    own = case.truth["operator"]
    said = {
        "K_e": (0.5 * own["K_e"], 0.4 * own["K_e"], 1.1 * own["K_e"]),
        "omega_nm": (own["omega_nm"] + 1, own["omega_nm"] + 0.5, own["omega_nm"] + 1.5),
        "tau_e": (own["tau"], own["tau"], own["tau"]),  # given by the user
    }
    answer = replace(trial.standins.baseline_answer(case), parameters=said)
    rows = dict(trial.scorer.table([trial.scorer.grade(case, answer)]))
    assert rows["95 % intervals of the operator that cover the truth"].endswith("(1/2)")
    assert rows["... K_e"].endswith("(1/1)")
    assert rows["... omega_nm"].endswith("(0/1)")
    assert "... tau_e" not in rows


def test_intervals_of_both_of_a_pair_count(trial):
    case = case_of(trial.generator.make_case, "pairs", 1)
    assert case.truth["canonical"]
    limit = case.truth["parameters"]["saturation"]["limit"]
    said = {"saturation__limit": (limit, 0.9 * limit, 1.1 * limit)}
    answer = replace(trial.standins.oracle_answer(case), parameters=said)
    record = trial.scorer.grade(case, answer)
    assert {name.split("__")[0] for name in record["parameters"]} == set(case.truth["effects"])
    rows = dict(trial.scorer.table([record]))
    assert rows["95 % intervals that cover the truth"].endswith("(1/1)")


def test_a_tabled_curve_goes_on_straight(trial):
    row = np.array([1.0, -1.0, 0.5, 4.0, 1.0, 0.0, 1.0, 4.0])
    x = np.array([-1.0, -0.6, 0.0, 0.9, 1.0])
    said = [trial.loop._curve(one, row) for one in x]
    np.testing.assert_allclose(said, np.interp(x, row[1] + row[2] * np.arange(5), row[3:]))
    np.testing.assert_allclose([trial.loop._curve(one, row) for one in (-2.0, 2.0)], [10, 10])


def test_the_fractional_lag_is_of_its_order(trial):
    """Within its band the sections fall and lag as the power of frequency."""
    sections = []
    w = SimpleNamespace(
        operator=SimpleNamespace(K_e=1.0, K_edot=0.3),
        section=lambda b, a: sections.append((b, a)),
        table=np.ones((4, trial.loop.N_COLUMNS)),
    )
    effect = SimpleNamespace(parameters={"order": 0.4, "omega": 0.3})
    trial.effects_beyond.wire_fractional_lag(w, effect)
    s = 1j * np.geomspace(1.0, 20.0, 30)
    response = np.prod(
        [np.polyval(b[::-1], s) / np.polyval(a[::-1], s) for b, a in sections], axis=0
    )
    ideal = (1 + s / 0.3) ** -0.4
    np.testing.assert_allclose(np.abs(response / ideal), 1, atol=0.12)
    np.testing.assert_allclose(np.angle(response / ideal), 0, atol=0.12)
    crossover = 1j * trial.effects_beyond.CROSSOVER
    here = np.prod(
        [np.polyval(b[::-1], crossover) / np.polyval(a[::-1], crossover) for b, a in sections]
    )
    led = w.table[0, trial.loop.K_E] + crossover * w.table[0, trial.loop.K_EDOT]
    assert led * here == pytest.approx(1 + 0.3 * crossover)
