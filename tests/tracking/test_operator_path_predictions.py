"""OperatorPath against the simulator, ARX models and an ordinary differential equation."""

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    ARXRegressor,
    HumanOperator,
    make_tracking_runs,
    operator_parameters,
    zoh_parameters,
)
from skhoid.tracking.operator_path import ESTIMATED, OperatorPath

TRUE = {"K_e": 0.09, "K_edot": 0.036, "tau_e": 0.28, "omega_nm": 11.25, "zeta_nm": 0.35}
OTHER = {"K_e": 0.07, "K_edot": 0.049, "tau_e": 0.23, "omega_nm": 9.0, "zeta_nm": 0.5}
DT = 0.01


class Told(OperatorPath):
    """Parameters as they are told: dicts of them, at sample numbers."""

    def __init__(self, at=None, *, inputs=None, roles=None, dt=None, run=None):
        self.at = at
        self.inputs, self.roles, self.dt, self.run = inputs, roles, dt, run

    def fit(self, X, y):
        self._read_operator_data(X, y)
        at = {0: TRUE} if self.at is None else self.at
        values = {name: np.array([p[name] for p in at.values()]) for name in ESTIMATED}
        self._set_path(np.array([*at]), values, {n: 0.1 * v for n, v in values.items()})
        return self

    def _method_name(self):
        return "told"


def everywhere(parameters, n=10_000):
    """A path without warnings of rows outside it."""
    return Told({0: parameters, n: parameters})


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs("C1", n_runs=2, random_state=0, duration=40.96)


def test_the_operator_that_made_runs_explains_them(runs):
    """Runs do not begin at rest, as predictions do: that costs 2 % of the VAF of 41 s."""
    X, y = runs
    model = everywhere(TRUE).fit(X, y)
    assert 98 < model.score(X, y) < 99
    assert model.score(*make_tracking_runs("C1", n_runs=2, random_state=0)) >= 99
    settled = X.index.get_level_values("time") > 5
    # The simulator does not hold the error between samples, which costs half a sample.
    left = np.var(model.predict(X)[settled] - y[settled])
    assert 1e-6 < left / np.var(y[settled]) < 1e-3


@pytest.mark.parametrize("tau_e", [0.0, 0.01, 0.28, 0.29, 0.57])
def test_whole_delays_are_those_of_an_arx_model(runs, tau_e):
    X, y = runs
    told = everywhere({**TRUE, "tau_e": tau_e}).fit(X, y).predict(X)
    nk = round(tau_e / DT) + 1
    arx = ARXRegressor(nk=nk).fit(X, y)
    arx.coef_ = zoh_parameters(HumanOperator(), DT)
    np.testing.assert_allclose(told, arx.simulate(X), atol=1e-11)


def test_each_sample_of_the_error_keeps_the_gains_that_it_met():
    """The recursion written out, with all parameters but the delay other at each instant."""
    rng = np.random.default_rng(2)
    n, lag = 60, 5
    e = rng.standard_normal(n)
    path = {
        t: {name: TRUE[name] * rng.uniform(0.5, 1.5) for name in ESTIMATED} | {"tau_e": lag * DT}
        for t in range(n)
    }
    theta = np.array(
        [
            zoh_parameters(
                HumanOperator(
                    K_e=p["K_e"], T_L=p["K_edot"] / p["K_e"], omega_nm=p["omega_nm"],
                    zeta_nm=p["zeta_nm"],
                ),
                DT,
            )
            for p in path.values()
        ]
    )  # fmt: skip
    u = np.zeros(n)
    for t in range(lag + 1, n):
        now = theta[t]
        u[t] = -now[0] * u[t - 1] - now[1] * u[t - 2] + now[2] * e[t - lag - 1]
        u[t] += theta[t - 1][3] * (e[t - lag - 2] if t > lag + 1 else 0.0)
    found = Told(path, dt=DT).fit(e[:, None], e).predict(e[:, None])
    np.testing.assert_allclose(found, u, atol=1e-12)


def test_tables_have_units_and_intervals(runs):
    X, y = runs
    model = Told({0: TRUE, 4000: OTHER}).fit(X, y)
    table = model.parameters_
    np.testing.assert_allclose(table["high"] - table["value"], 1.96 * table["sd"])
    assert table.loc["omega_nm", "unit"] == "rad/s"
    assert table.loc["T_L", "value"] == pytest.approx(0.7)
    pd.testing.assert_frame_equal(
        operator_parameters(model), model.parameters_path_, check_names=False
    )
    text = str(model.summary(X, y))
    assert "VAF, free run" in text
    assert "one step" not in text
