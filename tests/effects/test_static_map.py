"""Maps that may act on the error, on the command or on the output."""

from dataclasses import replace

import numpy as np
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs
from skhoid.effects import AsymmetricGain, CubicGain, DeadZone, Quantised, Saturation
from skhoid.effects.maps import mean_within
from skhoid.effects.operator_signals import Command
from skhoid.effects.parameter import CoreKind
from skhoid.effects.record import differentiated
from skhoid.testing import check_effect, synthetic_record

MAPS = [DeadZone, AsymmetricGain, CubicGain, Saturation, Quantised]
PLACES = {"error": "input", "command": "command", "output": "output"}
ELSEWHERE = [(kind, at) for kind in MAPS for at in kind.choices["at"][1:]]


@pytest.mark.parametrize(("kind", "at"), ELSEWHERE)
def test_passes_the_checks_of_effects_at_every_place(kind, at):
    check_effect(kind(at=at))


@pytest.mark.parametrize("kind", MAPS)
def test_acts_at_its_usual_place_unless_it_is_told(kind):
    assert kind().place == PLACES[kind.choices["at"][0]]
    assert [kind(at=at).place for at in kind.choices["at"]] == [
        PLACES[at] for at in kind.choices["at"]
    ]


def test_sizes_have_the_unit_of_what_is_mapped():
    units = {at: DeadZone(at=at).parameters[0].dimension.label() for at in PLACES}
    assert units == {"error": "[e]", "command": "[u]", "output": "[u]"}
    assert Saturation(at="error").parameters[0].dimension.label() == "[e]"
    assert CubicGain(at="command", form="cubic").parameters[0].dimension.label() == "1/[u]^2"


def test_words_say_where():
    assert "Errors below" in DeadZone().physics_in("human")
    assert DeadZone(at="output").physics_in("human") == (
        "Small movements of the hand do not move the stick."
    )
    assert "Inputs below" in DeadZone(at="error").physics_in("machine")


def test_maps_the_whole_command():
    record = synthetic_record()
    position, rate = np.sin(record.t + np.zeros((1, 3))), 0.3 * np.cos(2 * record.t + np.arange(3))
    given = Command(position, rate, position, 0.2)
    out = DeadZone(at="command", form="gap").apply(given, record, width=0.4)
    whole = position + differentiated(rate, record.dt)
    expected = np.sign(whole) * np.maximum(np.abs(whole) - 0.4, 0.0)
    np.testing.assert_allclose(out.position, expected, atol=1e-12)
    assert not out.rate.any()
    assert out.delay == 0.2


def test_mean_over_remnant_is_that_of_draws():
    rng = np.random.default_rng(3)
    u, noise = np.linspace(-3.0, 3.0, 13), rng.normal(0.0, 0.5, 400_000)
    drawn = [np.clip(x + noise, -1.2, 1.2).mean() for x in u]
    np.testing.assert_allclose(mean_within(u, 1.2, 0.5), drawn, atol=4e-3)
    through = [(x + noise - np.clip(x + noise, -1.2, 1.2)).mean() for x in u]
    found = DeadZone(form="behind", at="output").apply(
        u, synthetic_record(), width=1.2, remnant=0.5
    )
    np.testing.assert_allclose(found, through, atol=6e-3)


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("true", "rivals"),
    [
        (DeadZone(width=0.08, form="gap", at="output"), ["quantised", "cubic_gain"]),
        (Saturation(limit=0.5, form="hard", at="error"), ["hardening_stiffness", "rate_limit"]),
        (AsymmetricGain(asymmetry=0.4, form="all", at="output"), ["bias", "absolute_value"]),
    ],
)
def test_is_named_wherever_it_acts(true, rivals):
    X, y = make_tracking_runs(
        condition="C1", n_runs=3, remnant_intensity=0.1, random_state=5, effects=true
    )
    search = EffectSearchCV(OperatorRegressor(), effects=[true.name, *rivals]).fit(X, y)
    assert search.best_effects_[:1] == [true.name]
    found = dict(search.best_estimator_.effects_.steps)[true.name]
    assert found.at == true.at
