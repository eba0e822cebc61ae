"""Frequency responses as objects: covariance, phase, crossover, ARX models, tables."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import freqz
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from support.closed_loop import MULTIPLES, PERIOD, ZOH_100HZ
from support.synthetic import recording

from skhoid import (
    ARXRegressor,
    ControlledElement,
    Decimator,
    DelayShift,
    HumanOperator,
    RunInTrimmer,
    Sigmoid,
)
from skhoid.interpret import (
    FrequencyResponse,
    arx_response,
    arx_response_covariance,
    crossover_path,
)

DT = 0.01
LINES = 2 * np.pi * MULTIPLES / PERIOD
OPERATOR = {"C1": HumanOperator(), "C2": HumanOperator(K_e=0.07, T_L=1.2)}
ELEMENT = {"C1": ControlledElement(90.0, 6.0), "C2": ControlledElement(30.0, 0.2)}


# Propagation of covariances


def sampled(rng, n=200_000):
    """A response with a covariance at two lines, and samples of it."""
    mean = np.array([1.0 + 0.5j, -0.4 + 0.8j])
    covariance = 1e-4 * np.array([[[2.0, 0.7], [0.7, 1.0]], [[1.0, -0.9], [-0.9, 3.0]]])
    parts = [
        rng.multivariate_normal([m.real, m.imag], C, n)
        for m, C in zip(mean, covariance, strict=True)
    ]
    samples = np.array([p[:, 0] + 1j * p[:, 1] for p in parts]).T
    return FrequencyResponse([1.0, 2.0], mean, covariance=covariance), samples


def assert_covers(response, samples):
    """Stated standard deviations against those of samples: 1 % for 2e5 draws, and curvature."""
    np.testing.assert_allclose(response.magnitude_sd, np.abs(samples).std(axis=0), rtol=0.02)
    turn = np.degrees(np.angle(samples / response.response))
    np.testing.assert_allclose(response.phase_sd, turn.std(axis=0), rtol=0.02)


def test_covariances_are_propagated():
    rng = np.random.default_rng(3)
    first, a = sampled(rng)
    second, b = sampled(rng)
    factor = np.array([2.0 - 1j, 0.5j])
    assert_covers(first, a)
    assert_covers(first * factor, a * factor)
    assert_covers(factor * first, a * factor)
    assert_covers(first * second, a * b)
    assert_covers(first.closed_loop(), a / (1 + a))
    both = FrequencyResponse(first.omega, [first.response] * 2)
    assert (both * second).covariance.shape == (2, 2, 2, 2)


# Phase


def test_sparse_lines_unwrap_like_dense_ones():
    """Between the last two lines of Table I the operator turns by 167 or 170 degrees."""
    for operator in OPERATOR.values():
        dense = np.sort([*np.geomspace(0.01, 20, 2000), *LINES])
        phase = np.degrees(np.unwrap(np.angle(operator.frequency_response(dense))))
        expected = phase[np.searchsorted(dense, LINES)]
        known = FrequencyResponse.of(operator, LINES)
        unknown = FrequencyResponse(LINES, known.response)
        late = unknown * np.exp(-0.2j * LINES)  # plain unwrapping would slip
        for found in (
            known.phase,
            unknown.phase,
            late.phase + np.degrees(0.2 * LINES),
        ):
            np.testing.assert_allclose(found, expected, atol=1e-9)


# Crossover


@pytest.mark.parametrize(
    ("state", "omega_c", "margin", "exact"),
    [  # crossover.state1.*, crossover.state2.*
        ("C1", 1.5339807878856413, 77.02746126928065, (1.563485140863052, 76.66834431239965)),
        ("C2", 2.761165418194154, 22.691603793291648, (2.7479645785248255, 22.90174352638533)),
    ],
)
def test_crossover_of_the_thesis(state, omega_c, margin, exact):
    multiples = 2 * np.pi / PERIOD * np.arange(1, 300)
    loop = FrequencyResponse.of(OPERATOR[state], multiples) * ELEMENT[state]
    read = loop.crossover(interpolate=False)
    assert read["omega_c"].item() == pytest.approx(omega_c, abs=0.002)
    assert read["phase_margin"].item() == pytest.approx(margin, abs=0.05)
    between = loop.crossover()
    assert between["omega_c"].item() == pytest.approx(exact[0], abs=0.001)
    assert between["phase_margin"].item() == pytest.approx(exact[1], abs=0.01)
    at_lines = (FrequencyResponse.of(OPERATOR[state], LINES) * ELEMENT[state]).crossover()
    np.testing.assert_allclose(at_lines.to_numpy()[0], exact, rtol=0.025)


def test_crossover_path_against_root_finding():
    n = 600
    time = np.linspace(0.0, 81.92, n)
    weight = Sigmoid(0, 1, rate=0.5, time=40.96)(time)[:, None]
    theta = (1 - weight) * ZOH_100HZ["C1"] + weight * np.array(ZOH_100HZ["C2"])
    theta[100] = np.nan
    element = ControlledElement(
        Sigmoid(90, 30, rate=0.5, time=40.96), Sigmoid(6, 0.2, rate=0.5, time=40.96)
    )
    path = crossover_path(theta, element, dt=DT, nk=29, time=time)
    assert path.index.name == "time"
    assert np.flatnonzero(path["omega_c"].isna()).tolist() == [100]
    for k in range(0, n, 40):

        def loop(w, k=k):
            operator = arx_response(theta[k], [w], DT, na=2, nk=29)[0]
            return operator * element.frequency_response(w, time[k])

        exact = brentq(lambda w: np.log(np.abs(loop(w))), 0.3, 12.0, xtol=1e-13)
        assert path["omega_c"].iloc[k] == pytest.approx(exact, rel=1e-9)
        margin = np.degrees(np.angle(-loop(exact)))
        assert path["phase_margin"].iloc[k] == pytest.approx(margin, abs=1e-6)


# ARX models


@pytest.mark.parametrize(("na", "nb"), [(2, 2), (0, 3), (3, 1)])
def test_arx_response_is_that_of_the_polynomials(na, nb):
    rng = np.random.default_rng(na)
    theta = 0.2 * rng.standard_normal(na + nb)
    omega = np.linspace(0.5, np.pi / DT, 20)
    b = np.r_[np.zeros(3), theta[na:]]
    expected = freqz(b, np.r_[1, theta[:na]], omega * DT)[1] * np.exp(-0.2j * omega)
    found = arx_response(theta, omega, DT, na=na, nk=3, delay=0.2)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    path = arx_response([[theta, theta]] * 4, omega, DT, na=na, nk=3, delay=0.2)
    np.testing.assert_array_equal(path, np.broadcast_to(found, (4, 2, 20)))
    assert np.isnan(arx_response(theta, [400.0], DT, na=na)).all()


def test_arx_covariance_is_that_of_finite_differences():
    theta, omega = np.array(ZOH_100HZ["C1"]), LINES
    A = np.random.default_rng(0).standard_normal((4, 4))
    P = A @ A.T * 1e-8
    step = 1e-6
    slopes = [
        (
            arx_response(theta + d, omega, DT, na=2, nk=29)
            - arx_response(theta - d, omega, DT, na=2, nk=29)
        )
        / (2 * step)
        for d in step * np.eye(4)
    ]
    J = np.stack([np.real(slopes), np.imag(slopes)], axis=0).transpose(2, 0, 1)
    found = arx_response_covariance(theta, P, omega, DT, na=2, nk=29)
    np.testing.assert_allclose(found, J @ P @ J.transpose(0, 2, 1), rtol=1e-5)
    path = arx_response_covariance([theta] * 3, [P] * 3, omega, DT, na=2, nk=29)
    np.testing.assert_allclose(path, np.broadcast_to(found, (3, 10, 2, 2)))
    with pytest.raises(ValueError, match="none is left for the input"):
        arx_response([0.1, 0.2], omega, DT, na=2)


@pytest.fixture(scope="module")
def two_inputs():
    rng = np.random.default_rng(5)
    e, x = rng.standard_normal((2, 2, 1500))
    u = np.zeros((2, 1500))
    for k in range(12, 1500):
        u[:, k] = 0.8 * u[:, k - 1] + 0.3 * e[:, k - 12] - 0.1 * x[:, k - 2] + 0.4
    u += 0.01 * rng.standard_normal(u.shape)
    runs = {i: ([e[i], x[i]], u[i]) for i in range(2)}
    return recording(runs, names=("e", "x"))


def test_response_of_a_model_with_two_inputs(two_inputs):
    X, y = two_inputs
    model = ARXRegressor(na=1, nb=[1, 2], nk=[12, 2], inputs=["e", "x"], fit_intercept=True).fit(
        X, y
    )
    omega = np.array([1.0, 10.0, 300.0, 320.0])
    systems = model.to_transfer_function()
    for name in ("e", "x"):
        found = FrequencyResponse.of(model, omega, input=name)
        _, expected = systems[name].freqresp(omega[:3] * DT)
        np.testing.assert_allclose(found.response[:3], expected, rtol=1e-9)
        assert np.isnan(found.response[3])
        assert (found.input, found.output, found.dt) == (name, "u", 0.01)
        assert found.nyquist == pytest.approx(100 * np.pi)
        assert np.all(found.magnitude_sd[:3] > 0)
    assert FrequencyResponse.of(model, omega, input="e").delay == pytest.approx(0.12)
    assert FrequencyResponse.of(model, omega).input == "e"
    with pytest.raises(ValueError, match="'z' is not an input"):
        FrequencyResponse.of(model, omega, input="z")


def test_response_of_pipelines_and_searches(two_inputs):
    X, y = two_inputs
    omega = LINES
    pipeline = make_pipeline(DelayShift(0.12), RunInTrimmer(run_in=0.5), ARXRegressor(na=1, nb=1))
    shifted = FrequencyResponse.of(pipeline.fit(X, y), omega)
    alone = FrequencyResponse.of(pipeline[-1], omega)
    np.testing.assert_allclose(shifted.response, alone.response * np.exp(-0.12j * omega))
    np.testing.assert_allclose(shifted.magnitude_sd, alone.magnitude_sd)
    assert shifted.delay == pytest.approx(0.12)
    grid = {"delayshift__delay": [0.12]}
    search = GridSearchCV(pipeline, grid, cv=2).fit(X, y)
    np.testing.assert_allclose(FrequencyResponse.of(search, omega).response, shifted.response)
    other = make_pipeline(DelayShift(0.12), ARXRegressor(na=1, nb=1, nk=2, inputs=["x"])).fit(X, y)
    assert FrequencyResponse.of(other, omega).delay == pytest.approx(0.02)  # only e is shifted
    coarse = make_pipeline(Decimator(factor=4), DelayShift(0.12), ARXRegressor(na=1, nb=1)).fit(
        X, y
    )
    found = FrequencyResponse.of(coarse, [1.0, 78.0, 79.0])
    assert found.dt == pytest.approx(0.04)
    assert np.isnan(found.response).tolist() == [False, False, True]
    scaled = make_pipeline(
        StandardScaler().set_output(transform="pandas"), ARXRegressor(na=1, nb=1, nk=12)
    ).fit(X, y)
    with pytest.raises(ValueError, match="cannot account for StandardScaler"):
        FrequencyResponse.of(scaled, omega)
