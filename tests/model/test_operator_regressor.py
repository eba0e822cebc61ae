"""OperatorRegressor: the parameters of the thesis's operator, their errors, and odd data."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from skhoid import (
    OperatorRegressor,
    RankDeficiencyError,
    RunInTrimmer,
    ShortRunError,
    SimulatedARX,
    make_tracking_runs,
    run_labels,
    select_runs,
    vaf_score,
)
from skhoid.effects import (
    Bias,
    Effects,
    OutputFeedback,
)

# Table II and Appendix D.
TRUTH = {
    "C1": {"K_e": 0.09, "T_L": 0.4, "omega_nm": 11.25, "zeta_nm": 0.35, "tau_e": 0.28},
    "C2": {"K_e": 0.07, "T_L": 1.2, "omega_nm": 11.25, "zeta_nm": 0.35, "tau_e": 0.28},
}
CHANNELS = ["e", "x", "f_t"]


@pytest.fixture(scope="module")
def runs():
    X, y = make_tracking_runs(
        n_runs=3,
        duration=20.48,
        sampling_rate=50,
        remnant_intensity=0.1,
        channels=CHANNELS,
        random_state=0,
    )
    X.attrs["units"] = {"e": "deg", "x": "deg", "f_t": "deg"}
    y.attrs["units"] = {"u": "V"}
    return X, y


@pytest.fixture(scope="module")
def fitted(runs):
    return OperatorRegressor().fit(*runs)


def values(model):
    return model.parameters_["value"]


def assert_same(model, other, rtol=1e-6):
    np.testing.assert_allclose(values(model), values(other), rtol=rtol)
    np.testing.assert_allclose(
        model.parameters_["sd"], other.parameters_["sd"], rtol=1e3 * rtol, equal_nan=True
    )


@pytest.mark.parametrize("condition", ["C1", "C2"])
def test_parameters_without_remnant_are_the_true_ones(condition):
    """The thesis's loop holds f_t over its step: what that changes goes with the step (1/f_s)."""
    found = []
    for rate in (500, 1000):
        X, y = make_tracking_runs(condition, n_runs=1, sampling_rate=rate, random_state=0)
        model = OperatorRegressor().fit(X[:: rate // 100], y[:: rate // 100])
        assert model.vaf_ > 99.9998
        found.append(values(model))
    for name, true in TRUTH[condition].items():
        assert found[1][name] == pytest.approx(true, rel=0.005), name
        assert 2 * found[1][name] - found[0][name] == pytest.approx(true, rel=1e-3), name


@pytest.mark.slow
def test_standard_errors_are_those_of_the_estimates():
    """Of independent recordings: neither too small nor much too large, without a bias, covering."""
    z = []
    for seed in range(8):
        X, y = make_tracking_runs(
            n_runs=2,
            duration=40.96,
            run_in=10.24,
            sampling_rate=500,
            remnant_intensity=0.15,
            random_state=seed,
        )
        table = OperatorRegressor().fit(X[::5], y[::5]).parameters_.loc[list(TRUTH["C1"])]
        z.append(((table["value"] - pd.Series(TRUTH["C1"])) / table["sd"]).to_numpy(float))
    z, n = np.array(z), len(z)
    # sum z^2 is chi-squared with n = 8: 4 sigma of its mean, and its 4e-5 quantile.
    assert (np.mean(z**2, axis=0) < 1 + 4 * np.sqrt(2 / n)).all()
    assert (np.mean(z**2, axis=0) > 0.05).all()
    assert (np.abs(z.mean(axis=0)) < 4 / np.sqrt(n)).all()
    # 40 intervals, of which about five vary together: 3 sigma of 8 independent recordings.
    assert np.mean(np.abs(z) < 1.96) > binom.ppf(0.00135, n, 0.95) / n


def test_numpy_is_pandas(runs):
    X, y = runs
    one = select_runs(X, first=1)
    u = y.loc[one.index]
    of_frame = OperatorRegressor(inputs=["e"]).fit(one[["e"]], u)  # x tells of the closed loop
    of_array = OperatorRegressor(inputs=[0], dt=0.02).fit(one.to_numpy(), u.to_numpy())
    assert_same(of_frame, of_array, rtol=1e-12)
    np.testing.assert_array_equal(of_frame.predict(one[["e"]]), of_array.predict(one.to_numpy()))


def test_runs_in_another_order_give_the_same(runs, fitted):
    X, y = runs
    order = [2, 0, 1]
    labels = list(dict.fromkeys(run_labels(X)))
    X2 = pd.concat([X.loc[[labels[i]]] for i in order])
    permuted = OperatorRegressor().fit(X2, y.loc[X2.index])
    assert_same(fitted, permuted, rtol=1e-4)  # where the descent stops differs a little
    np.testing.assert_allclose(
        pd.Series(fitted.predict(X), X.index).loc[X2.index], fitted.predict(X2), atol=1e-12
    )


def test_a_subset_of_runs_is_predicted_as_among_all(runs, fitted):
    X, _ = runs
    labels = run_labels(X)
    last = X.iloc[np.flatnonzero(labels == labels[-1])]
    np.testing.assert_array_equal(
        fitted.predict(last), pd.Series(fitted.predict(X), X.index).loc[last.index]
    )


def test_the_prediction_is_the_free_run_of_the_error_alone(runs, fitted):
    X, y = runs
    moved = X.assign(x=0.0, f_t=7.0)
    np.testing.assert_array_equal(fitted.predict(X), fitted.predict(moved))
    assert fitted.predict(X).shape == y.shape
    assert fitted.score(X, y) > vaf_score(y, fitted.predict(X))


def test_output_and_input_in_other_units(runs, fitted):
    X, y = runs
    scaled = OperatorRegressor().fit(10 * X, y / 4)
    ratio = values(scaled) / values(fitted)
    np.testing.assert_allclose(ratio[["K_e", "K_edot"]], 1 / 40, rtol=1e-5)
    np.testing.assert_allclose(ratio[["omega_nm", "zeta_nm", "tau_e", "T_L"]], 1, rtol=1e-5)


def test_a_gap_begins_anew(runs):
    X, y = runs
    time = X.index.get_level_values("time").to_numpy()
    kept = (time < 15.0) | (time >= 18.0)
    with_gap = OperatorRegressor().fit(X[kept], y[kept])
    labels = run_labels(X).astype(str)
    part = np.where(time < 16.5, "a", "b")
    index = pd.MultiIndex.from_arrays([np.char.add(labels, part), time], names=["run", "time"])
    as_runs = OperatorRegressor().fit(X.set_axis(index).loc[kept], y.set_axis(index).loc[kept])
    assert_same(with_gap, as_runs, rtol=1e-6)
    np.testing.assert_allclose(
        with_gap.predict(X[kept]), with_gap.predict(X.set_axis(index).loc[kept]), atol=1e-12
    )


def test_a_run_in_is_simulated_and_not_fitted():
    X, y = make_tracking_runs(
        n_runs=1,
        duration=15.0,
        sampling_rate=50,
        keep_run_in=10.0,
        remnant_intensity=0.1,
        random_state=1,
    )
    assert X.index.get_level_values("time").min() < 0
    marked = RunInTrimmer(run_in=10.0).fit_transform(X)
    spoilt = y.copy()
    spoilt[y.index.get_level_values("time") < -0.005] += 5.0
    model = OperatorRegressor(settling=0.0).fit(marked, y)
    assert_same(model, OperatorRegressor(settling=0.0).fit(marked, spoilt))


def test_a_given_delay_is_kept(runs):
    X, y = runs
    model = OperatorRegressor(delay=0.20).fit(X, y)
    row = model.parameters_.loc["tau_e"]
    assert (row["value"], row["sd"], row["unit"], row["meaning"]) == (0.2, 0.0, "s", "given")
    assert "tau_e" not in model.covariance_.index
    assert model.bic_ > OperatorRegressor().fit(X, y).bic_ + 25


def test_wrong_delay_frees_a_given_delay(runs, fitted):
    X, y = runs
    assumed = OperatorRegressor(delay=0.20)
    model = assumed.with_effect("wrong_delay").fit(X, y)
    row = model.parameters_.loc["wrong_delay__extra"]
    free = fitted.parameters_.loc["tau_e"]
    assert 0.20 + row["value"] == pytest.approx(free["value"], abs=5e-4)
    assert row["sd"] == pytest.approx(free["sd"], rel=0.02)
    assert model.vaf_ > assumed.fit(X, y).vaf_ + 1
    assert model.vaf_ == pytest.approx(fitted.vaf_, abs=1e-3)


def test_an_effect_that_is_there_is_found_in_its_values(runs):
    X, y = runs
    model = OperatorRegressor(effects=Bias()).fit(X, y + 0.05)
    row = model.parameters_.loc["bias__level"]
    none = OperatorRegressor(effects=Bias()).fit(X, y).parameters_.loc["bias__level"]
    assert row["value"] - none["value"] == pytest.approx(0.05, abs=1e-5)
    assert dict(model.effects_.steps)["bias"].level == row["value"]
    assert isinstance(model.effects_, Effects)
    np.testing.assert_allclose(
        model.predict(X), OperatorRegressor(effects=model.effects_).fit(X, y + 0.05).predict(X),
        atol=1e-4,
    )  # fmt: skip


def test_roles_are_names_or_given(runs):
    X, y = select_runs(*runs, first=1)
    named = OperatorRegressor(effects=OutputFeedback()).fit(X, y)
    renamed = X.rename(columns={"e": "error", "x": "position", "f_t": "goal"})
    model = OperatorRegressor(
        effects=OutputFeedback(), roles={"error": "e", "position": "x", "goal": "f_t"}
    ).fit(renamed, y)
    assert_same(named, model, rtol=1e-12)
    assert model.inputs_ == ["error"]


def test_units_are_those_of_the_data(fitted):
    units = fitted.parameters_["unit"]
    assert units["K_e"] == "V/deg"
    assert units["K_edot"] == "V s/deg"
    assert units["omega_nm"] == "rad/s"
    assert units["tau_e"] == units["T_L"] == "s"


def test_a_short_run_says_what_to_do(runs):
    X, y = runs
    with pytest.raises(ShortRunError, match=r"rows are left for 5 parameters.*more"):
        OperatorRegressor().fit(X.iloc[:6], y.iloc[:6])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda X, y: (X, 0 * y), "The output 'u' is zero in all rows; is it the right column?"),
        (lambda X, y: (X.assign(e=1.5), y), "Input 'e' is constant (1.5): it excites nothing."),
    ],
    ids=["zero output", "constant input"],
)
@pytest.mark.parametrize("kind", [OperatorRegressor, SimulatedARX])
def test_what_stands_still_is_refused(runs, kind, change, message):
    with pytest.raises(RankDeficiencyError, match=re.escape(message)):
        kind(inputs="e", effects="bias").fit(*change(*runs))
