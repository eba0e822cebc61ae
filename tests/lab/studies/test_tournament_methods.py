"""The registry: every method can be made, and is as it says."""

import numpy as np
import pytest
from sklearn.base import clone

from skhoid.lab.studies import TOURNAMENT_METHODS, TournamentMethod, available_methods
from skhoid.lab.studies.tournament_methods import SCHEDULE

HERE, _ = available_methods()


def test_all_that_have_a_knob_try_as_many_settings():
    assert {len(m.settings) for m in TOURNAMENT_METHODS.values() if m.knob} == {5}
    assert {m.settings for m in TOURNAMENT_METHODS.values() if not m.knob} == {(None,)}


def test_names_are_keys_and_settings_differ():
    for name, method in TOURNAMENT_METHODS.items():
        assert method.name == name
        assert len({str(setting) for setting in method.settings}) == len(method.settings)
        assert method.told in ("", "start", "delay", SCHEDULE)
        assert method.estimates_delay == (method.told == "")


@pytest.mark.parametrize("method", HERE, ids=lambda m: m.name)
def test_an_estimator_has_the_setting(method):
    for setting in method.settings:
        model = method.make(0.01, 29, setting)
        clone(model)
        if method.knob is not None:
            last = model[-1] if hasattr(model, "steps") else model
            assert getattr(last, method.knob) == setting


@pytest.mark.parametrize("method", [m for m in HERE if m.causal], ids=lambda m: m.name)
def test_causal_methods_stream(method):
    model = method.make(0.01, 29, method.settings[0])
    assert hasattr(model[-1] if hasattr(model, "steps") else model, "partial_fit")


def test_the_oracle_is_told_the_change_and_nothing_without_one():
    if TOURNAMENT_METHODS["lpv"].missing():
        pytest.skip("not in this version")
    import pandas as pd

    t = np.arange(0.0, 4.0)
    varies = pd.DataFrame({"K_edot": [1.0, 1.0, 3.0, 3.0]}, index=t)
    method = TOURNAMENT_METHODS["lpv"]
    model = method.estimator(0.01, 29, None, varies)
    (schedule,) = model.basis
    np.testing.assert_allclose(schedule(t), [0, 0, 1, 1])
    still = method.estimator(0.01, 29, None, varies * 0 + 2.0)
    assert type(still).__name__ == "ARXRegressor"


def test_what_is_missing_is_said(monkeypatch):
    lost = TournamentMethod("lost", "a", True, lambda dt, nk, s: None, package="no_such_package")
    older = TournamentMethod("older", "b", True, lambda dt, nk, s: None, module="no_such_module")
    monkeypatch.setitem(TOURNAMENT_METHODS, "lost", lost)
    monkeypatch.setitem(TOURNAMENT_METHODS, "older", older)
    methods, notes = available_methods(["rls", "lost", "older"])
    assert [m.name for m in methods] == ["rls"]
    assert notes == [
        "lost needs the package no_such_package, which is not installed.",
        "older is not part of this version of skhoid.",
    ]
    with pytest.raises(ValueError, match=r"No method is left to take part\. lost needs"):
        available_methods(["lost"])


def test_unknown_names():
    with pytest.raises(ValueError, match=r"Unknown method 'rsl'; known are .* Did you mean 'rls'"):
        available_methods(["rsl"])
    with pytest.raises(ValueError, match="No method is left"):
        available_methods(["rls"], causal=False)
