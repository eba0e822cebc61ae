"""Model and noise model estimated together."""

import numpy as np
import pytest
from support.person_in_loop import Person, pursued

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Feedforward
from skhoid.model.likelihood import (
    fit_jointly,
)


def first(text="1/s", seed=3, **options):
    options = {"n_runs": 2, "duration": 25.0, "rate": 50, **options}
    X, y, person = pursued(text, seed, **options)
    estimator = OperatorRegressor(controlled_element=text)
    prepared = estimator.prepare(X, y)
    return estimator.first_fit(prepared), person


@pytest.fixture(scope="module")
def fitted():
    return first()


def test_gain_on_the_error_rate_that_nobody_needs_is_zero(fitted):
    model, person = fitted
    assert person.K_edot == 0
    found = dict(zip(model.simulator.names, fit_jointly(model)[0], strict=True))
    assert found["K_edot"] == 0
    assert found["K_e"] == pytest.approx(person.K_e, rel=0.2)


def test_fit_without_remnant_is_exact():
    person = Person(K_e=2.0, omega_nm=14.0, zeta_nm=0.25, tau_e=0.3)  # hardly usual
    X, y, _ = pursued("1/s", 0, remnant=0.0, person=person, n_runs=2, duration=25.0, rate=50)
    found = OperatorRegressor(controlled_element="1/s").fit(X, y).parameters_["value"]
    # A lead of less than a sample and as much more delay are what is between samples.
    assert 0 <= found["T_L"] < 1 / 50
    assert found["tau_e"] - found["T_L"] == pytest.approx(0.3, abs=1e-3)
    assert found["omega_nm"] == pytest.approx(14.0, rel=1e-3)
    assert found["zeta_nm"] == pytest.approx(0.25, rel=2e-3)
    assert found["K_e"] == pytest.approx(2.0, rel=1e-4)


@pytest.mark.slow
def test_delay_in_a_loop_is_found_where_the_simulation_error_is_off():
    errors, plain = [], []
    for seed in range(20, 22):
        X, y, person = pursued("1/(s(s+1))", seed, remnant=0.5)
        estimator = OperatorRegressor(controlled_element="1/(s(s+1))")
        prepared = estimator.prepare(X, y)
        plain.append(estimator.first_fit(prepared).values()["tau_e"] - person.tau_e)
        errors.append(estimator.fit(X, y).parameters_["value"]["tau_e"] - person.tau_e)
    assert np.median(np.abs(errors)) < 0.035
    assert np.median(np.abs(plain)) > np.median(np.abs(errors))


@pytest.mark.slow
def test_in_which_of_many_minima_a_fit_ends_is_less_than_its_standard_errors():
    """The last digit of the data decided, for a rate limit beside a response of another kind."""
    X, y = make_tracking_runs(
        "C1",
        n_runs=1,
        remnant_intensity=0.3,
        sampling_rate=60,
        duration=40.96,
        effects=[Feedforward(gain=0.5, delay=0.2)],
        random_state=35,
    )
    model = OperatorRegressor().with_effect("rate_limit")
    scales = ((1, 1), (1 + 1e-12, 1))
    tables = [model.fit(X * a, y * b).parameters_ for a, b in scales]
    values, errors = (np.array([one[name] for one in tables], float) for name in ("value", "sd"))
    assert np.nanmax(np.ptp(values, axis=0) / errors.min(axis=0)) < 0.5
