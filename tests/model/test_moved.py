"""``with_parameters``: a fitted model with other values, which nothing else has changed."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import Bias, DeadZone


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1",
        2,
        effects=DeadZone(width=0.3) + Bias(level=0.05),
        channels=["e", "x", "f_t"],
        sampling_rate=50,
        duration=40.96,
        remnant_intensity=0.05,
        random_state=3,
    )


@pytest.fixture(scope="module")
def model(runs):
    return OperatorRegressor(effects=DeadZone(form="gap") + Bias()).fit(*runs)


def test_bias_moves_the_free_run_by_as_much(model, runs):
    level = model.parameters_.loc["bias__level", "value"]
    moved = model.with_parameters({"bias__level": level + 0.01})
    change = moved.predict(runs[0]) - model.predict(runs[0])
    np.testing.assert_allclose(change, 0.01, rtol=1e-12)


def test_the_model_itself_stays(model, runs):
    before, table = model.predict(runs[0]), model.parameters_.copy()
    model.with_parameters({"dead_zone__width": 0.6, "K_e": 0.1})
    np.testing.assert_array_equal(model.predict(runs[0]), before)
    assert model.parameters_.equals(table)


def test_table_has_what_moved_without_error_and_what_follows_from_it(model):
    table = model.with_parameters({"K_e": 0.2, "dead_zone__width": 0.5}).parameters_
    assert table.loc["T_L", "value"] == table.loc["K_edot", "value"] / 0.2
    for name in ("K_e", "T_L", "dead_zone__width"):
        assert table.loc[name, ["sd", "low", "high"]].isna().all()
    kept = model.parameters_.loc[["K_edot", "omega_nm", "bias__level"]]
    assert table.loc[kept.index].equals(kept)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"dead_zone__widht": 0.1}, "Did you mean 'dead_zone__width'"),
        ({"T_L": 0.1}, "no parameter that can be set. These can: K_e, K_edot"),
        ({"dead_zone__width": -1.0}, "outside its range of"),
        ({"K_e": "much"}, "must be a finite number; got 'much'"),
    ],
)
def test_refused(model, values, message):
    with pytest.raises(ValueError, match=message):
        model.with_parameters(values)


def test_of_an_arx_model_effects_move_and_coefficients_do_not(runs):
    model = SimulatedARX(nk=15, effects=Bias()).fit(*runs)
    moved = model.with_parameters({"bias__level": 0.2})
    change = moved.predict(runs[0]) - model.predict(runs[0])
    np.testing.assert_allclose(change, 0.2 - model.parameters_.loc["bias__level", "value"])
    with pytest.raises(ValueError, match="These can: bias__level"):
        model.with_parameters({"a1": 0.1})
    with pytest.raises(ValueError, match="has no effects, and only parameters of effects"):
        SimulatedARX(nk=15).fit(*runs).with_parameters({"a1": 0.1})


def test_the_table_has_bounds_and_what_is_free(model):
    table = model.parameter_table_
    assert list(table.frame().index) == list(model.parameters_.index)
    width = table["dead_zone__width"]
    assert width.min <= width.value <= width.max
    assert width.free
    assert (table["tau_e"].min, table["tau_e"].unit) == (0.1, "s")
    assert not table["T_L"].free  # it follows from others
    assert table.fix("bias__level", 0.1)["bias__level"].sd == 0.0
    assert table["bias__level"].free  # the table itself stays
    with pytest.raises(ValueError, match="outside its range"):
        table.fix("tau_e", 0.01)


def test_a_table_makes_the_model_to_fit(model, runs):
    table = model.parameter_table_.fix("dead_zone__width", 0.3).fix("tau_e", 0.25).vary("K_e", 0.1)
    other = model.with_table(table)
    assert other.delay == 0.25
    assert other.start == {"K_e": 0.1}
    assert other.effects.get_params()["dead_zone__width"] == 0.3
    assert other.effects.get_params()["bias__level"] is None
    with pytest.raises(ValueError, match="K_e: parameters of the core"):
        model.with_table(table.fix("K_e"))
    assert model.with_table(other.fit(*runs).parameter_table_.vary("tau_e")).delay is None


def test_the_table_of_an_effect_is_in_the_units_of_the_data(model, runs):
    record = model.make_record(runs[0])
    one = DeadZone().table(record, {"e": "deg"})["width"]
    assert (one.min, one.max) == DeadZone().limits(record)["width"]
    assert one.start == DeadZone().starts(record)[0]["width"]
    assert one.unit == "deg"
    assert not DeadZone(width=0.2).table(record)["width"].free
