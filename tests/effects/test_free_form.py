"""Free forms from end to end: given curves, channels, clocks, other cores, dynamics by hand."""

import pickle

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone

from skhoid import OperatorRegressor, SimulatedARX, make_tracking_runs
from skhoid.effects import FreeDelay, FreeDynamics, FreeGain, FreeOffset, FreePath
from skhoid.model.extend import extended
from skhoid.model.fitting import Criterion
from skhoid.search.shape import curve_with_band

FORMS = [FreeGain(), FreeDelay(), FreeOffset(), FreePath(channel="other"), FreeDynamics()]
SEEN_BEFORE = 200  # samples of the longest memory below
NAMES = [form.name for form in FORMS]


def runs(seed, n_runs=2, remnant=0.1):
    X, y = make_tracking_runs(
        condition="C1", n_runs=n_runs, remnant_intensity=remnant, random_state=seed
    )
    noise = np.random.default_rng(seed).normal(size=len(X))
    return X.assign(other=np.convolve(noise, np.ones(40) / 40, "same")), y


def fitted_curve(model, name):
    effect = dict(model.effects_.steps)[name]
    at = np.linspace(effect.knots[0], effect.knots[-1], 200)
    return at, effect.curve(np.asarray(effect.values), at)


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=NAMES)
def test_what_was_found_can_be_stored_copied_and_given_again(form):
    X, y = runs(40)
    new, _ = runs(41, n_runs=1)
    model = OperatorRegressor(effects=form).fit(X, y)
    effect = dict(model.effects_.steps)[form.name]
    assert effect.spread > 0
    assert len(effect.knots) == len(effect.values) >= 11
    assert clone(model).effects.get_params() == form.get_params()
    assert model.covariance_.index.str.startswith(f"{form.name}__c").sum() >= 10
    simulated = model.predict(new)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(model)).predict(new), simulated)
    again = OperatorRegressor(effects=model.effects_).fit(X, y)
    np.testing.assert_allclose(again.predict(new), simulated, atol=1e-3 * np.std(simulated))


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=NAMES)
def test_where_there_is_nothing_few_degrees_of_freedom_are_spent(form):
    """Of seeds 20 to 22 this is the first: 0.7 to 2.4 of eleven.

    Over all three they are 0.2 to 2.4, but 6.1 for an offset in one, for slow remnant looks like
    one; of the 15 simultaneous bands one leaves zero out, of 0.75 expected.
    """
    X, y = runs(20, n_runs=4)
    estimator = OperatorRegressor()
    prepared = estimator.prepare(X, y)
    base, criterion = estimator.first_fit(prepared), Criterion(prepared.record)
    model = extended(base, form.name, form, criterion, criterion.coarse())
    assert curve_with_band(model, form.name)[1] < 3.5


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS, ids=NAMES)
def test_an_arx_model_has_them_too(form):
    X, y = runs(5)
    plain = SimulatedARX(2, 2, nk=20, inputs=["e"], effects="bias").fit(X, y)
    model = SimulatedARX(2, 2, nk=20, inputs=["e"], effects=form).fit(X, y)
    assert model.score(X, y) > plain.score(X, y) - 0.1
    assert not model.parameters_.index.str.contains("__").any()


def test_an_arx_model_has_no_gain_on_the_error_rate():
    X, y = runs(5)
    with pytest.raises(ValueError, match="does not apply: a linear model has no gain"):
        SimulatedARX(2, 2, nk=20, inputs=["e"], effects=FreeGain(of="rate")).fit(X, y)


@pytest.mark.parametrize("effect", [FreeGain(channel="wind"), FreePath(channel="wind")])
def test_a_channel_that_is_not_there_is_named(effect):
    X, y = runs(5, n_runs=1)
    with pytest.raises(ValueError, match="X has no channel 'wind'"):
        OperatorRegressor(effects=effect).fit(X, y)


@pytest.mark.slow
def test_a_response_is_to_what_departs_from_the_mean_of_its_channel():
    X, y = runs(0)
    late = np.convolve(np.roll(X["other"], 40), np.ones(10) / 10, "same")
    found = []
    for mean in (0.0, 100.0):  # 600 standard deviations
        model = OperatorRegressor(effects=FreePath(channel="other"))
        model.fit(X.assign(other=X["other"] + mean), y + 0.3 * late)
        assert dict(model.effects_.steps)["free_path"].reference == pytest.approx(mean, abs=0.1)
        found.append(fitted_curve(model, "free_path")[1])
    np.testing.assert_allclose(found[1], found[0], atol=0.01 * np.abs(found[0]).max())


@pytest.mark.slow
def test_without_a_channel_each_is_tried_and_the_likeliest_kept():
    X, y = runs(0)
    late = np.convolve(np.roll(X["other"], 40), np.ones(10) / 10, "same")
    noise = np.random.default_rng(9).normal(size=len(X))
    X = X.assign(idle=np.convolve(noise, np.ones(40) / 40, "same"))
    model = OperatorRegressor(effects=FreePath()).fit(X[["e", "idle", "other"]], y + 0.3 * late)
    assert dict(model.effects_.steps)["free_path"].channel == "other"


@pytest.mark.parametrize("form", [FreeGain(), FreeDelay(), FreeOffset()])
def test_knots_in_time_begin_where_the_clock_of_a_run_does(form):
    X, y = runs(5)
    clock = X.index.set_levels(X.index.levels[1] + 500.0, level=1)
    record = OperatorRegressor().prepare(X.set_axis(clock), pd.Series(y.to_numpy(), clock)).record
    knots = form.with_knots(record).knots
    assert knots[0] == pytest.approx(500.0)
    assert knots[-1] == pytest.approx(record.t.max())


def echo(X, size):
    """What follows the error 0.8 s later, smeared over 0.6 s."""
    lag = 0.01 * np.arange(SEEN_BEFORE)
    kernel = np.where(abs(lag - 0.8) < 0.3, 1 + np.cos(np.pi * (lag - 0.8) / 0.3), 0.0)
    parts = []
    for _, e in X["e"].groupby(level=0):
        held = np.r_[np.full(SEEN_BEFORE, e.iloc[0]), e]
        late = np.convolve(held, size * kernel / kernel.sum())
        parts.append(late[SEEN_BEFORE : SEEN_BEFORE + len(e)])
    return np.concatenate(parts)


@pytest.mark.slow
def test_dynamics_that_no_name_has_are_found():
    """The whole response, on a new run without remnant.

    Of 0.6 % to 7 % that is missing less than 0.1 % is left, for sizes 0.03 and 0.09 and the seeds
    30 to 32.
    The curve alone is less certain: gains, lead and limb of the model take part of the echo.
    """
    X, y = runs(30, n_runs=4)
    new, clean = runs(130, n_runs=1, remnant=0.0)
    true = (clean + echo(new, 0.09)).to_numpy()[500:]
    left = {}
    for effect in (None, FreeDynamics()):
        model = OperatorRegressor(effects=effect).fit(X, y + echo(X, 0.09))
        left[effect is None] = np.mean((model.predict(new)[500:] - true) ** 2) / np.mean(true**2)
    assert left[True] > 0.05
    assert left[False] < 0.003
    at, curve = fitted_curve(model, "free_dynamics")
    behind = at + model.parameters_["value"]["tau_e"]
    assert 0.4 < behind[np.argmax(curve * (behind > 0.4))] < 0.9
