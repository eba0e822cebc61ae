"""The catalogue: every effect keeps the rules, and can be simulated, found, shown and sketched."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.synthetic import arx_runs

from skhoid import EffectSearchCV, SimulatedARX, make_tracking_runs, read_runs
from skhoid import effects as module
from skhoid.effects import (
    AsymmetricGain,
    CoreKind,
    CubicGain,
    DeadZone,
    ExtraLag,
    ExtraLead,
    Friction,
    Intermittent,
    Lapses,
    Preview,
    Quantised,
    RateReflex,
    Rectified,
    Saturation,
    ScheduledDynamics,
    Stops,
    catalogue,
    effect,
)
from skhoid.lab.cli import main
from skhoid.testing import check_effect, synthetic_record
from skhoid.testing.records import signal_at, split_parts

# The ids that tables, JSON and scripts rely on.
IDS = [
    *("wrong_delay", "tv_delay", "intermittent"),
    *("tv_gain", "gain_drift", "lapses", "scheduled_gain"),
    *("dead_zone", "asym_gain", "rectified", "cubic_gain", "absolute_value"),
    *("saturation", "rate_limit", "backlash", "stiction", "quantised", "hardening_stiffness"),
    *("bias", "drift", "integral"),
    *("feedforward", "preview", "output_feedback", "motion_feedback", "disturbance", "cross_axis"),
    *("extra_lag", "extra_lead", "nm_mode", "higher_order"),
    *("friction", "root_flow", "stops", "sensor_magnitude", "input_filter", "rate_reflex"),
    *("scheduled_dynamics", "tremor"),
]
# Values to simulate 3 x 24 s with, of forms unlike the first; the error has an sd of 1.
RECOVERED = [
    (Intermittent(trigger="error"), {"hold_time": 0.1, "threshold": 0.5}),
    (Lapses(intervals=[(6.0, 8.0), (14.0, 16.0)], form="hold"), {"depth": 0.8, "shift": 0.1}),
    (DeadZone(form="jump"), {"width": 0.4}),
    (Rectified(side="negative", form="soft"), {"width": 0.3}),
    (Quantised(form="behind"), {"step": 1.0, "offset": 0.1, "remnant": 0.2}),
    (Preview(form="spread"), {"gain": 0.4, "time": 0.4, "stretch": 0.5}),
    (Friction(), {"coulomb": 0.15}),
    (effect("tv_gain"), {"K_e_change": 0.6, "K_edot_change": -0.5, "rate": 2.0, "time": 12.0}),
    (effect("output_feedback"), {"gain": 0.4, "rate_gain": 0.1, "delay": 0.25}),
]
# In an ARX model; the speed of friction and the level of a tank are the output.
INSIDE = [
    (Friction(form="smooth", of="output"), {"coulomb": 0.4, "width": 0.2}),
    (Stops(form="both"), {"low": -0.6, "high": 0.9}),
    (RateReflex(side="negative", sense=1), {"gain": 0.3, "delay": 0.1, "omega": 12.0, "zeta": 0.8}),
    (ScheduledDynamics(channel="speed"), {"slope": 0.3}),
]


def test_the_catalogue_has_the_ids_that_scripts_rely_on():
    table = catalogue()
    assert list(table.index) == IDS
    assert table["source"].str.len().min() > 3
    assert set(table["class"]) <= set(module.__all__)


@pytest.mark.parametrize("name", IDS)
def test_every_effect_is_simulated_or_says_why_not(name, capsys, monkeypatch, tmp_path):
    """By a function and by the command line, whose runs are shorter here."""
    short = partial(make_tracking_runs, duration=20.48)
    monkeypatch.setattr("skhoid.make_tracking_runs", short)
    known, file = effect(name), tmp_path / "runs.csv"
    words = ["simulate", "--effect", name, "--runs", "1", "--rate", "25", "--out", str(file)]
    if known.hidden:
        assert main(words) == 0
        assert np.isfinite(read_runs(file)[1]).all()
        return
    assert main(words) == 2
    assert f"cannot have {name}: it " in " ".join(capsys.readouterr().err.split())
    with pytest.raises(ValueError, match=r"is noise|does not apply"):
        short("C1", 1, effects=known.with_choices(**known.examples[0]))


def test_a_form_whose_numbers_are_all_given_is_simulated():
    """``skhoid demo --effect quantised`` took the first form, which needs one more number."""
    options = {"duration": 20.48, "run_in": 10.24, "random_state": 0}
    _, y = make_tracking_runs("C1", 1, effects=Quantised(step=0.1, offset=0.0), **options)
    assert len(np.unique(y.round(9))) < 30
    with pytest.raises(ValueError, match=r"needs numbers to be simulated: Quantised\(offset=\)"):
        make_tracking_runs("C1", 1, effects=Quantised(step=0.1), **options)


@pytest.mark.slow
def test_a_search_takes_every_id():
    X, y = arx_runs(1, 120)
    search = EffectSearchCV(SimulatedARX(1, 1, 3, inputs=["e"]), effects=IDS, domain="machine")
    ranking = search.set_params(max_effects=1).fit(X, y).ranking_
    assert set(ranking["effect"]) >= set(IDS) - {"tremor"}


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("core", ["operator", "arx"])
def test_every_effect_keeps_the_rules(name, core):
    if effect(name).refusal(synthetic_record(), core) is not None:
        pytest.skip(f"{name} does not apply to {core}")
    check_effect(effect(name), core=core)


@pytest.mark.slow
@pytest.mark.parametrize(("one", "values"), RECOVERED, ids=str)
def test_values_are_recovered(one, values):
    check_effect(one, recovers=values)


@pytest.mark.parametrize(("one", "values"), INSIDE, ids=str)
def test_values_in_an_arx_model_are_recovered(one, values):
    check_effect(one, core="arx", recovers=values)


def test_maps_are_what_their_formulas_say():
    record, e = synthetic_record(), np.array([[-2.0, -0.5, -0.1, 0.0, 0.1, 0.5, 2.0]])
    gap = DeadZone(form="gap").apply(e, record, 0.3)
    np.testing.assert_allclose(gap, [[-1.7, -0.2, 0.0, 0.0, 0.0, 0.2, 1.7]], atol=1e-15)
    jump = DeadZone(form="jump").apply(e, record, 0.3)
    np.testing.assert_allclose(jump, [[-2.0, -0.5, 0.0, 0.0, 0.0, 0.5, 2.0]])
    smooth = DeadZone(form="smooth").apply(e, record, 0.3)
    np.testing.assert_allclose(smooth, e - 0.3 * np.tanh(e / 0.3))
    np.testing.assert_allclose(
        AsymmetricGain().apply(e, record, 0.2), e * np.where(e > 0, 1.2, 0.8)
    )
    leaking = Rectified(side="negative").apply(e, record, 0.1)
    np.testing.assert_allclose(leaking, np.where(e < 0, e, 0.1 * e))
    np.testing.assert_allclose(CubicGain(form="cubic").apply(e, record, 0.4), e + 0.4 * e**3)
    np.testing.assert_allclose(
        CubicGain(form="square").apply(e, record, 0.4), e + 0.4 * e * np.abs(e)
    )
    power = CubicGain(form="power", reference=0.5).apply(e, record, 0.4)
    np.testing.assert_allclose(power, np.sign(e) * 0.5 * (np.abs(e) / 0.5) ** 1.4, atol=1e-9)
    np.testing.assert_allclose(Saturation(form="hard").apply(e, record, 0.4), np.clip(e, -0.4, 0.4))
    np.testing.assert_allclose(
        Saturation(form="soft").apply(e, record, 0.4), 0.4 * np.tanh(e / 0.4)
    )
    np.testing.assert_allclose(
        Quantised(form="sharp").apply(e, record, 0.25, 0.0), 0.25 * np.round(e / 0.25)
    )


@pytest.mark.parametrize(
    ("behind", "hard", "values", "sd"),
    [
        (Saturation(form="behind"), Saturation(form="hard"), {"limit": 0.8}, 0.3),
        (Quantised(form="behind"), Quantised(form="sharp"), {"step": 0.5, "offset": 0.1}, 0.15),
    ],
    ids=["saturation", "quantised"],
)
def test_behind_is_the_mean_over_remnant(behind, hard, values, sd):
    record, u = synthetic_record(), np.linspace(-2, 2, 41)[:, None]
    # The mean over the remnant by its quantiles, midpoints of 20000 equal shares.
    from scipy.stats import norm

    remnant = sd * norm.ppf((np.arange(20000) + 0.5) / 20000)
    mean = hard.apply(u + remnant, record, **values).mean(axis=1, keepdims=True)
    share = sd / values.get("step", 1.0)  # a quantiser's remnant is in steps
    got = behind.apply(u, record, **values, remnant=share)
    np.testing.assert_allclose(got, mean, atol=2e-3)


def test_extra_lag_is_a_lag_and_a_second_lead_undoes_it():
    record = synthetic_record()
    plain = signal_at("command", record)
    plain = plain._replace(rate=0.0 * plain.rate)
    back = ExtraLag().apply(ExtraLead().apply(plain, record, time=0.3), record, time=0.3)

    def whole(command):
        return command.position + np.gradient(command.rate, record.dt, axis=0)

    assert np.std(whole(back) - whole(plain)) < 0.02 * np.std(whole(plain))


# Maps act at one of several places.
MAPS = [DeadZone, AsymmetricGain, CubicGain, Saturation, Quantised]


@pytest.mark.parametrize("kind", MAPS)
def test_maps_keep_the_rules_at_other_places(kind):
    usual, *others = kind.choices["at"]
    assert kind().place == kind(at=usual).place
    for at in others:
        assert kind(at=at).place != kind().place
        check_effect(kind(at=at))


def test_a_search_tries_each_place_apart():
    record = synthetic_record()
    assert [e.at for e in DeadZone().alternatives(record)] == ["error", "command", "output"]
    assert [e.at for e in DeadZone(at="output").alternatives(record)] == ["output"]
    machine = replace(record, core=CoreKind.ARX)
    assert [e.at for e in DeadZone().alternatives(machine)] == ["error"]
    assert {e.at for e in DeadZone().variants(machine)} == {"error"}


def test_other_places_have_plain_forms():
    record = synthetic_record()
    assert [v.form for v in Saturation().variants(record)] == ["hard", "soft", "unequal"]
    assert [v.form for v in Saturation(at="command").variants(record)] == ["hard"]
    assert [v.form for v in Saturation(at="command", form="soft").variants(record)] == ["soft"]
    # Of the error there is no remnant that was not measured.
    assert [v.form for v in DeadZone().variants(record)] == ["gap", "smooth", "jump"]
    assert [v.form for v in DeadZone(at="output").variants(record)] == ["gap", "behind"]


# Roles: columns may have any names.
OWN = {"e": "err", "x": "pos", "f_t": "ref", "motion_acc": "sled", "dist": "gust", "speed": "x"}


@pytest.fixture(scope="module", params=[CoreKind.OPERATOR, CoreKind.ARX], ids=str)
def records(request):
    """A record, and the same with other names; a column of no role has that of another's."""
    record = replace(synthetic_record(), core=request.param)
    renamed = replace(
        record,
        channels={OWN[name]: values for name, values in record.channels.items()},
        roles={OWN[name]: role for name, role in record.roles.items()},
        inputs=("err",),
        remembered={},
    )
    return record, renamed


def numbers(one, record):
    """Whatever an effect takes from a record: bounds, starts, and what it does to a signal."""
    values = one.fixed | {p.name: p.starts[0] * p.find_scale(record, one.place) for p in one.free}
    changed = one.apply(signal_at(one.place, record), record, **values)
    return (
        one.limits(record),
        one.starts(record),
        {k: np.sum(v) for k, v in split_parts(changed).items()},
    )


@pytest.mark.parametrize("name", list(catalogue().index))
def test_effects_do_not_depend_on_names_of_columns(records, name):
    plain, renamed = records
    one = effect(name)
    assert bool(one.refusal(plain, plain.core)) == bool(one.refusal(renamed, plain.core))
    if one.refusal(plain, plain.core):
        return
    pairs = list(zip(one.variants(plain), one.variants(renamed), strict=True))
    assert pairs
    for a, b in pairs:
        expected, found = numbers(a, plain), numbers(b, renamed)
        assert found[:2] == expected[:2]
        assert found[2] == pytest.approx(expected[2], rel=1e-12)
