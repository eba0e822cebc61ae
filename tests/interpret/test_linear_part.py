"""Poles and step responses of fitted models, and the frequency response of an operator's."""

import numpy as np
import pytest
from scipy.signal import lti

from skhoid import (
    HumanOperator,
    OperatorRegressor,
    SimulatedARX,
    make_tracking_runs,
    operator_parameters,
)
from skhoid.interpret import FrequencyResponse, pole_table, step_response

NAMES = ["K_e", "K_edot", "omega_nm", "zeta_nm", "tau_e"]
OMEGA = np.geomspace(0.2, 40, 25)


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs(
        "C1", 3, sampling_rate=50, duration=20.48, remnant_intensity=0.05, random_state=3
    )


@pytest.fixture(scope="module")
def person(runs):
    return OperatorRegressor().fit(*runs)


@pytest.fixture(scope="module")
def arx(runs):
    return SimulatedARX(nk=14, effects=["bias"]).fit(*runs)


def operator(values):
    return HumanOperator(**dict(zip(NAMES, values, strict=True)))


def estimates(person):
    return person.parameters_.loc[NAMES, "value"].to_numpy()


def draws(person, n=20_000):
    """Operators as likely as the estimates say, near them: a hundredth of the errors."""
    covariance = person.covariance_.loc[NAMES, NAMES].to_numpy()
    rng = np.random.default_rng(0)
    return rng.multivariate_normal(estimates(person), 1e-4 * covariance, n)


def test_an_operator_responds_as_the_physics_say(person):
    found = FrequencyResponse.of(person, OMEGA)
    truth = operator(estimates(person)).frequency_response(OMEGA)
    np.testing.assert_allclose(found.response, truth, rtol=1e-9)
    assert (found.input, found.output) == ("e", "u")


def test_its_band_is_that_of_draws(person):
    """Of 20000 draws a deviation is known to half a per cent: six of these."""
    found = FrequencyResponse.of(person, OMEGA)
    drawn = np.array([operator(row).frequency_response(OMEGA) for row in draws(person)])
    np.testing.assert_allclose(100 * np.abs(drawn).std(axis=0), found.magnitude_sd, rtol=0.03)
    turn = np.degrees(np.angle(drawn / found.response)).std(axis=0)
    np.testing.assert_allclose(100 * turn, found.phase_sd, rtol=0.03)


def test_poles_of_an_arx_model_are_those_of_the_operator(arx):
    poles, known = pole_table(arx), operator_parameters(arx).iloc[0]
    assert poles.attrs["plane"] == "z"
    for name, of_operator in {"frequency": "omega_nm", "damping": "zeta_nm"}.items():
        np.testing.assert_allclose(poles[name], known[of_operator], rtol=1e-9)
        np.testing.assert_allclose(poles[f"sd_{name}"], known[f"sd_{of_operator}"], rtol=1e-6)
    of_scipy = np.sort_complex(np.roots(np.r_[1, arx.a_]))
    np.testing.assert_allclose(poles["real"] + 1j * poles["imag"], of_scipy, rtol=1e-9)


def test_poles_of_an_operator_are_in_the_plane_of_s(person):
    poles, known = pole_table(person), person.parameters_
    assert poles.attrs["plane"] == "s"
    for name, of_operator in {"frequency": "omega_nm", "damping": "zeta_nm"}.items():
        np.testing.assert_allclose(poles[name], known.loc[of_operator, "value"], rtol=1e-9)
        np.testing.assert_allclose(poles[f"sd_{name}"], known.loc[of_operator, "sd"], rtol=1e-3)
    np.testing.assert_allclose(poles["time_constant"], -1 / poles["real"])


def test_a_step_of_an_arx_model_is_scipys(arx):
    time, (answer,) = arx.to_transfer_function().step(n=100)
    found = step_response(arx, time)["output"]
    np.testing.assert_allclose(found, answer[:, 0], atol=1e-9)


def test_a_step_of_an_operator_is_scipys_after_the_delay(person):
    K_e, K_edot, omega, zeta, delay = estimates(person)
    time = np.linspace(0, 2, 401)
    system = lti([omega**2 * K_edot, omega**2 * K_e], [1, 2 * zeta * omega, omega**2])
    _, answer = system.step(T=time)
    found = step_response(person, time)["output"]
    after = time > delay
    expected = np.interp(time[after] - delay, time, answer)
    np.testing.assert_allclose(found[after], expected, atol=2e-3 * answer.max())
    assert not found[~after].any()


def test_a_step_lasts_until_it_has_settled(person):
    found = step_response(person)
    gain = person.parameters_.loc["K_e", "value"]
    assert found["output"].iloc[-1] == pytest.approx(gain, rel=0.03)
    assert 0 < found["sd"].iloc[-1] < gain


def test_what_was_moved_by_hand_has_no_standard_error(person):
    moved = person.with_parameters({"K_e": 0.2})
    assert FrequencyResponse.of(moved, OMEGA).covariance is None
    assert step_response(moved)["sd"].isna().all()
    assert pole_table(moved)["sd_frequency"].isna().all()


def test_an_integral_is_a_pole_at_one_and_does_not_settle(runs):
    fitted = OperatorRegressor(controller="pi").fit(*runs)
    controller = fitted.with_parameters({"K_i": 0.05})
    poles = pole_table(controller)
    assert poles["real"].tolist() == pytest.approx([1.0])
    assert poles["time_constant"].tolist() == [np.inf]
    found = step_response(controller, [4.0, 6.0])["output"]
    assert np.diff(found)[0] == pytest.approx(2 * 0.05, rel=1e-6)
    low = FrequencyResponse.of(controller, [1e-4])
    assert low.magnitude[0] == pytest.approx(0.05 / 1e-4, rel=1e-3)


def test_a_controller_that_answers_the_measurement_is_refused(runs):
    X, y = make_tracking_runs(
        "C1", 2, channels=["e", "x"], sampling_rate=50, duration=20.48, random_state=1
    )
    model = OperatorRegressor(controller="i-p").fit(X, y)
    with pytest.raises(ValueError, match="answers the measurement too"):
        step_response(model)
