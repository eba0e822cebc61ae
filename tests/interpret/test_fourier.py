"""Fourier coefficients and spectra: exact cases, the thesis's numbers, Appendix H.

Numbers with a name (fc.C1.remnant_free) are entries of the reference file facts.json, held to the
tolerance given there.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from support.closed_loop import MULTIPLES, PERIOD, simulate
from support.synthetic import recording

from skhoid import (
    ControlledElement,
    Decimator,
    HumanOperator,
    Multisine,
    RunInTrimmer,
    make_tracking_runs,
)
from skhoid.interpret import FrequencyResponse, auto_psd, fourier_coefficients

DT = 0.01
LINES = 2 * np.pi * MULTIPLES / PERIOD
TARGET = SimpleNamespace(omega=LINES, multiples=MULTIPLES, period=PERIOD)
OPERATOR = {"C1": HumanOperator(), "C2": HumanOperator(K_e=0.07, T_L=1.2)}


def periodic(response, multiples, n_samples=400, period=4.0, gain=1.0):
    """Steady state of exp(j phase) at the lines through a response."""
    t = period / n_samples * np.arange(n_samples)
    omega = 2 * np.pi * np.asarray(multiples) / period
    waves = np.exp(1j * (np.outer(t, omega) + 0.7 * np.arange(omega.size) ** 2))
    return gain * (waves * response(omega)).real.sum(axis=1)


# Fourier coefficients


@pytest.mark.parametrize(
    ("state", "magnitude_error", "phase_error"),
    [
        (
            "C1",  # fc.C1.remnant_free
            "-0.0072929 -0.0073400 -0.0074503 -0.0077169 -0.0082913 "
            "-0.0086701 -0.0065866 0.0078109 0.0100462 -0.0038281",
            "-0.0575525 -0.0954383 -0.1508615 -0.2375381 -0.3686053 "
            "-0.4879841 -0.5971930 -1.0831293 -4.2027437 -4.6522794",
        ),
        (
            "C2",  # fc.C2.remnant_free
            "-0.0327291 -0.0210103 -0.0144598 -0.0110515 -0.0086788 "
            "-0.0058594 0.0001211 0.0133880 0.0023374 -0.0016822",
            "1.5282152 1.2577268 0.8738737 0.5188889 0.2197118 "
            "-0.0112525 -0.3604914 -1.3996396 -4.1758957 -4.7056224",
        ),
    ],
)
def test_remnant_free_estimates_of_the_thesis(state, magnitude_error, phase_error):
    window = simulate(state).last()
    found = fourier_coefficients(window.e[:, None], window.u, forcing=TARGET, dt=DT)
    ratio = found.response[0] / OPERATOR[state].frequency_response(LINES)
    expected = [np.array(text.split(), dtype=float) for text in (magnitude_error, phase_error)]
    np.testing.assert_allclose(np.abs(ratio) - 1, expected[0], rtol=0, atol=1e-5)
    np.testing.assert_allclose(np.degrees(np.angle(ratio)), expected[1], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.coherence, 1.0)
    assert np.all(found.magnitude_sd < 1e-12)
    truth = FrequencyResponse.of(OPERATOR[state], LINES)
    assert np.all(np.abs(found.phase - truth.phase) < 5)


def test_one_input_is_exact_in_every_run_window_and_period():
    operator = HumanOperator().frequency_response
    multiples = [2, 3, 7]
    waves = {
        label: ([np.tile(periodic(np.ones_like, multiples, gain=gain), 3)], gain)
        for label, gain in (("a", 1.0), ("b", 2.0))
    }
    u = periodic(operator, multiples)
    X, y = recording({k: (channels, np.tile(gain * u, 3)) for k, (channels, gain) in waves.items()})
    omega = 2 * np.pi * np.array(multiples) / 4
    for window in (None, (0.0, 4.0), (1.0, 9.0), (8.0, 12.0)):
        found = fourier_coefficients(X, y, forcing=omega[::-1], window=window)
        np.testing.assert_allclose(found.omega, omega)
        np.testing.assert_allclose(found.response, [operator(omega)] * 2, rtol=1e-10)
    assert found.runs == ["a", "b"]
    assert (found.input, found.output) == ("e", "u")
    split = {"f_t": omega[:2], "f_d": omega[2:]}  # two functions, one input: lines side by side
    both = fourier_coefficients(X, y, forcing=split)
    np.testing.assert_allclose(both.response, found.response)


def test_containers_and_run_columns_agree():
    e, u = periodic(np.ones_like, [1, 5]), periodic(HumanOperator().frequency_response, [1, 5])
    X, y = recording({"a": ([e], u), "b": ([e], 2 * u)})
    omega = 2 * np.pi * np.array([1, 5]) / 4
    expected = fourier_coefficients(X, y, forcing=omega).response
    plain = X.reset_index().drop(columns="time")
    by_column = fourier_coefficients(plain, y.to_numpy(), forcing=omega, run="run", dt=DT)
    np.testing.assert_array_equal(by_column.response, expected)
    assert by_column.labels == ["a", "b"]
    trimmed = RunInTrimmer(run_in=1.0).fit_transform(
        recording({"a": ([np.r_[e[-100:], e]], np.r_[u[-100:], u])})[0]
    )
    y_trimmed = np.r_[u[-100:], u]
    after_run_in = fourier_coefficients(trimmed, y_trimmed, forcing=omega)
    np.testing.assert_allclose(after_run_in.response, expected[:1])


def test_window_must_hold_whole_periods():
    e = np.zeros(1000)
    X, y = recording({"late": ([e], e)})
    with pytest.raises(ValueError, match=r"'late' the line at 1.5708 rad/s completes 2.5") as info:
        fourier_coefficients(X, y, forcing=2 * np.pi * np.array([1, 3]) / 4)
    assert "longest window in the run that fits lasts 8 s (800 samples)" in str(info.value)
    with pytest.raises(ValueError, match="No window fits in the run's 10 s"):
        fourier_coefficients(X, y, forcing=[2 * np.pi / 4, 0.1])
    with pytest.raises(ValueError, match="below the Nyquist frequency of 314"):
        fourier_coefficients(X, y, forcing=[2 * np.pi * 50])
    with pytest.raises(ValueError, match=r"from 0 to 9.99 s, has no row"):
        fourier_coefficients(X, y, forcing=[2 * np.pi], window=(20.0, 24.0))


def test_missing_samples_are_named():
    e = periodic(np.ones_like, [1])
    X, y = recording({1: ([e], e), 2: ([e], e)})
    holed = y.copy()
    holed.iloc[450] = np.nan
    with pytest.raises(ValueError, match=r"'u' is nan in run 2, t = 0.5 s \(row 450\)"):
        fourier_coefficients(X, holed, forcing=[np.pi / 2])
    whole = fourier_coefficients(X, holed, forcing=[2 * np.pi], window=(1.0, 2.0))
    assert whole.response.shape == (2, 1)
    keep = np.arange(800) != 100
    with pytest.raises(ValueError, match=r"A gap ends at run 1, t = 1.01 s"):
        fourier_coefficients(X[keep], y[keep], forcing=[np.pi / 2])
    marked = Decimator(factor=2).fit_transform(X)
    with pytest.raises(ValueError, match="comes from a Decimator"):
        fourier_coefficients(marked, y, forcing=[np.pi / 2])


def test_wrong_forcing_functions_are_refused():
    e = periodic(np.ones_like, [1])
    X, y = recording({1: ([e, e], e)}, names=("e", "x"))
    both = {"inputs": ["e", "x"]}
    with pytest.raises(ValueError, match=r"2 responses, .*'x'.* there is 1"):
        fourier_coefficients(X, y, forcing=[2 * np.pi], **both)
    with pytest.raises(ValueError, match=r"6.28319 rad/s is given twice"):
        fourier_coefficients(X, y, forcing={"f_t": [2 * np.pi], "f_d": [2 * np.pi]})
    pair = {"f_t": np.pi * np.array([1, 2]), "f_d": np.pi * np.array([1.5, 2.5])}
    with pytest.raises(ValueError, match="no column of that name"):
        fourier_coefficients(X, y, forcing=pair, **both)
    X.columns = ["f_t", "f_d"]
    with pytest.raises(ValueError, match=r"'f_t' has no power at its line 3\.14159 rad/s in run 1"):
        fourier_coefficients(X, y, forcing=pair, inputs=["f_t", "f_d"])
    with pytest.raises(ValueError, match="positive numbers"):
        fourier_coefficients(X, y, forcing=[-1.0])


# Several inputs

N_T = np.array([6, 13, 27, 41, 53, 73, 103, 139, 194, 229])
N_D = np.array([5, 11, 23, 37, 51, 71, 101, 137, 171, 226])


def to_x(omega):
    """A second response, from the controlled element's output."""
    s = 1j * omega
    muscle = 11.25**2 / (s**2 + 2 * 0.35 * 11.25 * s + 11.25**2)
    return -0.03 * (1 + 0.2 * s) * np.exp(-0.2 * s) * muscle


def pursuit_like(remnant=0.0, seed=0, n_samples=8192):
    """e, x, f_t, f_d and u of u = H_e e + H_x x + n, x = H_CE (u + f_d), periodic over 81.92 s."""
    rng = np.random.default_rng(seed)
    F_t, F_d, N = np.zeros((3, n_samples // 2 + 1), dtype=complex)
    base = 2 * np.pi / PERIOD
    omega = base * np.arange(1, n_samples // 2 + 1)
    for F, multiples in ((F_t, N_T), (F_d, N_D)):
        fall = 1 / (1 + multiples * base)
        F[multiples] = n_samples / 2 * fall * np.exp(2j * np.pi * rng.uniform(size=10))
    white = rng.standard_normal((2, omega.size)) / (1 + 0.06j * omega)
    N[1:] = remnant * np.sqrt(n_samples) * (white[0] + 1j * white[1])
    H_e, H_x = HumanOperator().frequency_response(omega), to_x(omega)
    H_c = ControlledElement().frequency_response(omega)
    U, E, X = np.zeros((3, n_samples // 2 + 1), dtype=complex)
    loop = 1 + (H_e - H_x) * H_c
    U[1:] = (H_e * F_t[1:] + (H_x - H_e) * H_c * F_d[1:] + N[1:]) / loop
    X[1:] = H_c * (U[1:] + F_d[1:])
    E[1:] = F_t[1:] - X[1:]
    return [np.fft.irfft(S, n_samples) for S in (E, X, F_t, F_d, U)]


FORCING = {
    "f_t": SimpleNamespace(omega=2 * np.pi * N_T / PERIOD, period=PERIOD),
    "f_d": SimpleNamespace(omega=2 * np.pi * N_D / PERIOD, period=PERIOD),
}


def test_two_responses_from_interleaved_lines():
    *channels, u = pursuit_like()
    X, y = recording({1: (channels, u)}, names=("e", "x", "f_t", "f_d"))
    with pytest.warns(UserWarning, match=r"2 of 20 lines lie outside .*\[0.383, 17.564\] rad/s"):
        found = fourier_coefficients(X, y, forcing=FORCING, inputs=["e", "x"])
    assert list(found) == ["e", "x"]
    omega = found["e"].omega
    np.testing.assert_allclose(omega, 2 * np.pi * np.sort([*N_T, *N_D]) / PERIOD)
    error = np.abs(found["e"].response[0] / HumanOperator().frequency_response(omega) - 1)
    assert np.nanmedian(error) < 0.003
    assert np.nanmax(error) < 0.02
    error = np.abs(found["x"].response[0] / to_x(omega) - 1)
    assert np.nanmedian(error) < 0.02
    assert np.nanmax(error) < 0.25
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(error)), [0, 19])
    assert np.nanmax(found["e"].complex_sd) < 1e-9
    assert found["x"].coherence is None


def test_stated_deviations_of_two_responses():
    """40 runs: the spread over runs has a relative standard deviation of 8 %, and the stated one
    comes from six bins beside each line, where the remnant does not drown the estimate."""
    target = Multisine()
    disturbance = target.interleaved(scale=0.3, random_state=0)
    operator = HumanOperator(K_e=0.09, T_L=0.4, K_x=-0.02, K_xdot=-0.03)
    X, y = make_tracking_runs(
        "C1",
        40,
        operator=operator,
        display="pursuit",
        disturbance=disturbance,
        remnant_intensity=0.05,
        channels=["e", "x", "f_t", "dist"],
        random_state=1,
    )
    forcing = {"f_t": target, "dist": disturbance}
    with pytest.warns(UserWarning, match="outside"):
        found = fourier_coefficients(X, y, forcing=forcing, inputs=["e", "x"])
    usable = slice(1, 12)  # up to 2.7 rad/s
    for name in ("e", "x"):
        spread = found[name].mean().complex_sd[usable]
        stated = np.sqrt(np.mean(found[name].complex_sd[:, usable] ** 2, axis=0))
        assert (np.abs(np.log(stated / spread)) < np.log(1.4)).all(), stated / spread
        truth = operator.frequency_response(found[name].omega, input=name)[usable]
        error = np.abs(found[name].mean().response[usable] - truth)
        assert (error < 4 * spread / np.sqrt(40) + 0.02 * np.abs(truth)).all()


# The statistics of Appendix H


def test_ensemble_statistics_by_hand():
    response = FrequencyResponse([1.0, 2.0], [[1 + 1j, 2], [3 + 2j, 2j], [2 + 3j, -2]])
    mean = response.mean()
    np.testing.assert_allclose(mean.response, [2 + 2j, 2j / 3])  # H.1, H.2
    np.testing.assert_allclose(mean.magnitude[0], np.sqrt(8))  # H.3
    np.testing.assert_allclose(mean.phase[0], 45.0)  # H.4
    np.testing.assert_allclose(mean.covariance[0], [[1.0, 0.5], [0.5, 1.0]])  # H.5, H.6 squared
    np.testing.assert_allclose(mean.complex_sd, [np.sqrt(2), np.sqrt(4 + 4 / 3)])  # H.7
    np.testing.assert_allclose(mean.complex_phase_sd, [np.degrees(np.arctan(0.5)), 180.0])  # H.8
    np.testing.assert_allclose(mean.magnitude_sd[0], np.sqrt(1.5))  # along (1, 1)
    np.testing.assert_allclose(mean.phase_sd[0], np.degrees(np.sqrt(0.5 / 8)))  # across
    error = response.mean(standard_error=True)
    np.testing.assert_allclose(error.covariance, mean.covariance / 3)
    alone = FrequencyResponse([1.0], [[1j]]).mean()
    assert alone.covariance is None
    assert alone.magnitude_sd is None
    assert alone.complex_phase_sd is None


# Spectra


@pytest.mark.parametrize("n_samples", [1000, 1001])
def test_spectrum_sums_to_the_mean_square(n_samples):
    rng = np.random.default_rng(0)
    runs = {i: ([*rng.standard_normal((2, n_samples)) + 0.5], np.zeros(n_samples)) for i in "ab"}
    X, _ = recording(runs, names=("e", "x"))
    table = auto_psd(X)
    spacing = 2 * np.pi / (n_samples * DT)
    total = table.groupby(["run", "channel"])["psd"].sum() * spacing
    for (run, channel), power in total.items():
        assert power == pytest.approx(np.mean(X.loc[run, channel] ** 2), rel=1e-12)
    assert list(table) == ["run", "channel", "omega", "psd"]
