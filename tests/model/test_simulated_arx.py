"""ARXRegressor with effects: against plain loops, recovery of what was simulated, real data."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from sklearn.base import clone
from support.places import RECORDINGS

from skhoid import (
    ARXRegressor,
    EffectSearchCV,
    SimulatedARX,
)
from skhoid.effects import DeadZone
from skhoid.search import Verdict

pytestmark = pytest.mark.slow  # fits many models

A, B, NK = [-1.5, 0.7], [0.12, 0.08], 3
DT = 0.02
SILVERBOX = RECORDINGS / "silverbox" / "SNLS80mV.parquet"


def arx(effect=None):
    """The model of the right orders for what ``SIMULATED`` makes."""
    nk = 1 if effect == "hardening_stiffness" else NK  # a spring that answers later is unstable
    return SimulatedARX(2, 2, nk, effects=effect)


def linear(x, nk=NK):
    return lfilter([0.0] * nk + B, [1.0, *A], x)


def duffing(x, stiffness, nk=1):
    """A y = B (x - stiffness y^3), sample by sample, for nk > 0."""
    y, w = np.zeros_like(x), np.zeros_like(x)
    for t in range(x.size):
        for i, a in enumerate(A, 1):
            y[t] -= a * y[t - i] if t >= i else 0.0
        for j, b in enumerate(B):
            y[t] += b * w[t - nk - j] if t >= nk + j else 0.0
        w[t] = x[t] - stiffness * y[t] ** 3
    return y


def inputs(n_runs=2, n=1200, dt=DT):
    """An error and a slower, independent channel, smooth in time."""
    rng = np.random.default_rng(3)
    frames = []
    for _ in range(n_runs):
        e = lfilter([0.1], [1, -0.9], rng.standard_normal(n)) * 5
        other = lfilter([0.02], [1, -0.98], rng.standard_normal(n)) * 5
        time = np.arange(n) * dt
        frames.append(pd.DataFrame({"e": e, "speed": other}, index=pd.Index(time, name="time")))
    X = pd.concat(frames, keys=range(n_runs), names=["run", "time"])
    X.attrs["units"] = {"e": "V", "speed": "m/s"}
    return X


def runs(response, noise=0.02, **kwargs):
    """Inputs, and the output that ``response(frame of a run)`` makes, with white noise."""
    X = inputs(**kwargs)
    clean = np.concatenate(
        [response(X.loc[r].reset_index()) for r in X.index.get_level_values("run").unique()]
    )
    noise = noise * clean.std() * np.random.default_rng(4).standard_normal(clean.size)
    y = pd.Series(clean + noise, index=X.index, name="u")
    y.attrs["units"] = {"u": "mm"}
    return X, y


def gap(x, width):
    return x - np.clip(x, -width, width)


SIMULATED = {
    "dead_zone": (lambda r: linear(gap(r["e"].to_numpy(), 0.6)), {"width": 0.6}),
    "saturation": (lambda r: np.clip(linear(r["e"].to_numpy()), -1.0, 1.0), {"limit": 1.0}),
    "bias": (lambda r: linear(r["e"].to_numpy()) + 0.5, {"level": 0.5}),
    "cross_axis": (lambda r: linear((r["e"] - 0.7 * r["speed"]).to_numpy()), {"gain": -0.7}),
    "hardening_stiffness": (lambda r: duffing(r["e"].to_numpy(), 0.05), {"stiffness": 0.05}),
}


@pytest.mark.parametrize("name", SIMULATED)
def test_what_was_simulated_is_recovered(name):
    """Within four standard errors, or two percent (forms differ in their first samples)."""
    response, truth = SIMULATED[name]
    X, y = runs(response)
    model = arx(name).fit(X, y)
    for key, value in truth.items():
        row = model.parameters_.loc[f"{name}__{key}"]
        assert abs(row["value"] - value) < max(4 * row["sd"], 0.02 * abs(value)), (key, row)
    np.testing.assert_allclose(model.a_, A, atol=0.05)
    assert model.score(X, y) > 99.8
    assert model.vaf_ == pytest.approx(model.score(X, y), abs=1e-6)


@pytest.mark.parametrize("stiffness", [1.5, 2.0])
def test_no_limit_is_stronger_than_the_output(stiffness):
    """A spring that is added to the linear model, as it is, lets the simulation explode."""
    X, y = runs(lambda r: duffing(r["e"].to_numpy(), stiffness), n=600)
    search = EffectSearchCV(SimulatedARX(2, 2, 1), effects=["hardening_stiffness"], max_effects=0)
    row = search.fit(X, y).limits_.iloc[0]
    assert row["limit"] > stiffness
    for key in ("limit_points", "shown_points"):
        assert row[key] <= 100 or (np.isnan(row[key]) and row["reason"])


@pytest.mark.parametrize("name", ["dead_zone", "hardening_stiffness"])
def test_the_free_run_is_that_of_a_plain_loop(name):
    response, _ = SIMULATED[name]
    X, y = runs(response, noise=0.0)
    effect = DeadZone(form="gap") if name == "dead_zone" else name
    model = arx(name).set_params(effects=effect).fit(X, y)
    np.testing.assert_allclose(model.predict(X), y, atol=2e-4 * y.std())


def one_run(time):
    return pd.MultiIndex.from_product([["r"], time], names=["run", "time"])


def test_a_delay_cannot_come_before_its_cause():
    X, y = runs(lambda r: np.r_[linear(r["e"].to_numpy(), 0)[5:], np.zeros(5)])
    model = SimulatedARX(2, 2, 2, effects="wrong_delay").fit(X, y)
    assert model.parameters_.loc["wrong_delay__extra", "value"] == pytest.approx(-2 * DT)


def test_settling_and_gaps_and_missing_values():
    X, y = runs(SIMULATED["dead_zone"][0])
    disturbed = y.copy()
    disturbed[X.index.get_level_values("time") < 1.0] += 30.0  # counts only without settling
    disturbed.iloc[700:720] = np.nan
    model = SimulatedARX(2, 2, NK, settling=1.0, effects=DeadZone(form="gap")).fit(X, disturbed)
    assert model.parameters_.loc["dead_zone__width", "value"] == pytest.approx(0.6, abs=0.03)
    assert model.n_rows_missing_ == 20
    assert model.n_rows_used_ == len(y) - 2 * 50 - 20
    cut = X.index.get_level_values("time").to_numpy() // 10 != 1  # a gap of 10 s
    model.fit(X[cut], y[cut])
    assert model.parameters_.loc["dead_zone__width", "value"] == pytest.approx(0.6, abs=0.03)


def test_what_does_not_apply_says_why():
    X, y = runs(lambda r: linear(r["e"].to_numpy()))
    model = ARXRegressor(2, 2, NK)
    with pytest.raises(ValueError, match=r"extra_lead does not apply: .* raise nb"):
        model.with_effect("extra_lead").fit(X, y)
    with pytest.raises(ValueError, match=r"nm_mode does not apply: .* no neuromuscular system"):
        model.with_effect("nm_mode").fit(X, y)
    with pytest.raises(ValueError, match=r"X has no column of role motion"):
        model.with_effect("motion_feedback").fit(X, y)
    with pytest.raises(ValueError, match="'iv'"):
        model.set_params(method="iv").with_effect("bias").fit(X, y)
    many = SimulatedARX(2, 2, NK, effects="bias")
    with pytest.raises(ValueError, match=r"one channel, but got inputs=\['a', 'b'\]"):
        many.fit(X.set_axis(["a", "b"], axis=1), y)
    fitted = clone(many).fit(X, y)
    np.testing.assert_array_equal(fitted.simulate(X), fitted.predict(X))


def test_forecasts_are_those_of_the_ar_model():
    X, y = runs(SIMULATED["dead_zone"][0], noise=0.0)
    rng = np.random.default_rng(7)
    y = y + 0.2 * lfilter([1.0], [1, -0.9], rng.standard_normal(len(y)))
    model = SimulatedARX(2, 2, NK, effects=DeadZone(form="gap")).fit(X, y)
    free = model.predict(X)
    residual = (y - free).to_numpy()
    ar = model.noise_ar_
    for horizon in (1, 3):
        ahead = model.predict_ahead(X, y, horizon)
        for row in (200, 1400):  # iterate the recursion from what is known
            known = list(residual[row - horizon - 5 : row - horizon + 1])
            for _ in range(horizon):
                known.append(-np.dot(ar, known[::-1][:6]))
            assert ahead[row] == pytest.approx(free[row] + known[-1], rel=1e-9, abs=1e-12)
    one, far = (np.std(y - model.predict_ahead(X, y, h)) for h in (1, 400))
    assert one == pytest.approx(0.2, rel=0.05)
    assert far == pytest.approx(residual.std(), rel=0.02)


@pytest.mark.parametrize(
    ("name", "others"),
    [
        ("dead_zone", ["cubic_gain", "saturation", "bias"]),
        ("hardening_stiffness", ["cubic_gain", "higher_order"]),
    ],
)
def test_search_names_it(name, others):
    response, _ = SIMULATED[name]
    X, y = runs(response)
    search = EffectSearchCV(arx(name).set_params(effects=None), effects=[*others, name]).fit(X, y)
    assert search.best_effects_ == [name]
    assert search.verdict_ is Verdict.FOUND
    assert search.score(X, y) > 99.8 > search.baseline_.score(X, y)


@pytest.mark.parametrize(("of_e", "of_u"), [(1e6, 1e-6), (1e-9, 1e9), (57.3, 0.0175)])
def test_units_change_no_name(of_e, of_u):
    X, y = runs(lambda r: linear(gap(r["e"].to_numpy(), 1.0)), noise=0.3)
    search = EffectSearchCV(arx(), effects=["dead_zone"]).fit(X[["e"]] * of_e, y * of_u)
    assert search.best_effects_ == ["dead_zone"]
    width = search.best_estimator_.parameters_.loc["dead_zone__width", "value"]
    assert width == pytest.approx(1.0 * of_e, rel=0.1)


@pytest.mark.parametrize(
    ("level", "noise", "seed"), [(1.0, 0.1, 0), (-5.0, 0.1, 1), (30.0, 0.3, 2)]
)
def test_an_offset_of_the_output_is_a_bias(level, noise, seed):
    X, y = runs(lambda r: linear(r["e"].to_numpy()), noise=noise)
    y = y + level
    model = ARXRegressor(2, 2, NK).with_effect("bias").fit(X, y)
    assert model.parameters_.loc["bias__level", "value"] == pytest.approx(level, rel=0.1)
    np.testing.assert_allclose(model.parameters_["value"].iloc[:2], A, atol=0.05)
    search = EffectSearchCV(arx(), effects=["bias", "dead_zone"]).fit(X, y)
    assert search.best_effects_ == ["bias"]


def test_search_finds_nothing_in_a_linear_system():
    X, y = runs(lambda r: linear(r["e"].to_numpy()), noise=0.3)
    some = ["dead_zone", "bias", "higher_order", "nm_mode", "extra_lead"]
    search = EffectSearchCV(ARXRegressor(2, 2, NK), effects=some).fit(X, y)
    assert search.best_effects_ == []
    assert search.verdict_ is Verdict.NOTHING
    assert list(search.error_path_["effect"]) == ["baseline"]
    tried = search.ranking_  # twice: with the delay as given, and freed
    refused = tried[tried["effect"].isin(["nm_mode", "extra_lead"])]
    assert set(refused["status"]) == {"does not apply"}
    assert not tried["status"].eq("added").any()


@pytest.mark.skipif(not SILVERBOX.exists(), reason=f"needs {SILVERBOX}, which is not published")
def test_silverbox():
    """An electronic Duffing oscillator: fitted to multisines, tried on the louder arrow."""
    table = pd.read_parquet(SILVERBOX)
    dt = 2**14 / 1e7

    def part(begin, end):
        rows = table.iloc[begin:end]
        index = one_run(np.arange(end - begin) * dt)
        return pd.DataFrame({"e": rows["V1"].to_numpy()}, index), rows["V2"].to_numpy()

    X, y = part(40_700, 49_000)
    arrow, measured = part(0, 40_500)
    model = SimulatedARX(2, 3, 0, fit_intercept=True, settling=0.1)
    some = ["hardening_stiffness", "cubic_gain", "saturation"]
    search = EffectSearchCV(model, effects=some).fit(X, y)
    assert search.best_effects_ == ["hardening_stiffness"]

    def error(model):
        return 1e3 * float(np.sqrt(np.mean((measured - model.predict(arrow)) ** 2)))

    assert error(search.baseline_) > 10.0  # mV
    assert error(search.best_estimator_) < 2.0
