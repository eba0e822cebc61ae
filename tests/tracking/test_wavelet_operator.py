"""Operators by wavelets: the response against the true one, and the fit against known ones."""

import builtins

import numpy as np
import pandas as pd
import pytest

from skhoid import HumanOperator, make_tracking_runs
from skhoid.tracking.wavelet_operator import (
    WaveletOperator,
    fit_responses,
)

pytest.importorskip("pywt")

DT = 0.01
OMEGA = 2 * np.pi / 81.92 * np.array([3, 5, 8, 13, 22, 34, 53, 86, 139, 229])
OPERATOR = HumanOperator(K_e=0.09, T_L=0.4, tau_e=0.28)
TRUE = {"K_e": 0.09, "K_edot": 0.036, "tau_e": 0.28, "omega_nm": 11.25, "zeta_nm": 0.35}


def closed_loop(n=8192, seed=0):
    """e, f_t and u of a loop in steady state, exactly: each is a sum of the target's sines."""
    rng = np.random.default_rng(seed)
    amplitude = 1.0 / (1 + (OMEGA / 3) ** 2) * np.exp(1j * rng.uniform(0, 2 * np.pi, OMEGA.size))
    H = OPERATOR.frequency_response(OMEGA)
    G = 90.0 / (1j * OMEGA * (1j * OMEGA + 6.0))
    waves = np.exp(1j * np.outer(np.arange(n) * DT, OMEGA))
    error = amplitude / (1 + G * H)
    e, f, u = ((waves @ part).real for part in (error, amplitude, H * error))
    return pd.DataFrame({"e": e, "f_t": f}), u, H


@pytest.fixture(scope="module")
def exact():
    X, u, H = closed_loop()
    return X, u, H, WaveletOperator(dt=DT).fit(X, u)


def test_response_of_a_constant_loop_without_remnant_is_within_two_percent(exact):
    _, _, H, model = exact
    np.testing.assert_allclose(model.frequencies_, OMEGA, rtol=1e-9)
    middle = abs(model.time_path_ - 40.96) < 2.5
    away = abs(model.frequency_response_[middle] / H - 1)
    assert np.isfinite(away[:, 1:]).all()
    assert np.nanmax(away) < 0.02
    assert (model.coherence_[middle][:, 1:] > 0.95).all()


def test_parameters_of_a_constant_loop_without_remnant(exact):
    X, u, _, model = exact
    path = model.parameters_path_.loc[20:62]
    for name, value in TRUE.items():
        # The fitted response holds the error between samples, half a sample later.
        expected = value - DT / 2 if name == "tau_e" else value
        assert abs(path[name] / expected - 1).max() < 0.03, name
    assert model.score(X, u) > 95


def test_outside_the_cone_responses_are_unknown(exact):
    model = exact[3]
    known = np.isfinite(model.frequency_response_)
    for omega, column in zip(model.frequencies_[3:], known.T[3:], strict=True):
        edge = 2**0.5 * model.omega0 / omega
        inside = (model.time_path_ > edge) & (model.time_path_ < 81.92 - edge)
        near = abs(np.minimum(model.time_path_, 81.92 - model.time_path_) - edge) < 0.6
        assert (column == inside)[~near].all()
    few = known.sum(axis=1) < 4
    path = model.parameters_path_
    assert few.any()
    assert path[few].isna().all(axis=None)
    assert path[~few]["K_e"].notna().all()


def test_without_a_target_the_error_says_what_to_do(exact):
    with pytest.raises(ValueError, match=r"needs the target as its instrument"):
        WaveletOperator(dt=DT).fit(exact[0][["e"]], exact[1])


def test_runs_are_pooled():
    X, y = make_tracking_runs(
        "C1", n_runs=4, remnant_intensity=0.15, random_state=5, channels=["e", "f_t"]
    )
    one = WaveletOperator().fit(X.loc[[0]], y.loc[[0]])
    four = WaveletOperator().fit(X, y)
    assert one.parameters_path_.shape == four.parameters_path_.shape
    ratio = four.frequency_response_sd_ / one.frequency_response_sd_
    assert np.nanmedian(ratio) < 0.6
    rms = [np.nanstd(m.parameters_path_["K_edot"].loc[15:67] / 0.036) for m in (one, four)]
    assert rms[1] < 0.8 * rms[0]


def test_fit_of_exact_responses_is_exact():
    omega = np.geomspace(0.3, 18, 12)
    rng = np.random.default_rng(1)
    K_e, T_L = rng.uniform(0.03, 0.3, 25), rng.uniform(0.1, 1.5, 25)
    tau, natural, zeta = rng.uniform(0.1, 0.5, 25), rng.uniform(5, 20, 25), rng.uniform(0.1, 1, 25)
    H = np.array(
        [
            HumanOperator(K_e=a, T_L=b, tau_e=c + DT / 2, omega_nm=d, zeta_nm=z)
            .frequency_response(omega)
            for a, b, c, d, z in zip(K_e, T_L, tau, natural, zeta, strict=True)
        ]
    )  # fmt: skip
    H[3, :4] = np.nan
    fits = fit_responses(omega, H, np.zeros(H.shape), DT)
    expected = np.stack([K_e, K_e * T_L, tau, natural, zeta, T_L], axis=1)
    np.testing.assert_allclose(fits.values, expected, rtol=1e-4)
    assert not fits.stuck.any()


def test_standard_errors_of_the_fit_are_the_spread_of_its_estimates():
    omega, n = np.geomspace(0.3, 18, 12), 400
    rng = np.random.default_rng(4)
    H = np.tile(OPERATOR.frequency_response(omega), (n, 1))
    sd = np.tile(0.02 * abs(H[0]), (n, 1))
    noise = rng.standard_normal((2, n, 12)) / np.sqrt(2)
    spread = np.hypot(sd, 0.01 * abs(H))
    responses = H + spread * (noise[0] + 1j * noise[1])
    fits = fit_responses(omega, responses, sd, DT)
    # Errors only grow with a misfit, so they are a little too large on average.
    ratio = np.std(fits.values, axis=0) / np.mean(fits.deviations, axis=0)
    assert (ratio > 0.75).all()
    assert (ratio < 1.05).all()


def test_pywavelets_is_named_where_it_is_missing(exact, monkeypatch):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name == "pywt":
            raise ImportError("none")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=r'pip install "skhoid\[wavelets\]"'):
        WaveletOperator(dt=DT).fit(exact[0], exact[1])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"omega0": 0.5}, "The 'omega0' parameter"),
    ],
)
def test_bad_options_are_refused(exact, options, match):
    with pytest.raises(ValueError, match=match):
        WaveletOperator(dt=DT, **options).fit(exact[0], exact[1])
