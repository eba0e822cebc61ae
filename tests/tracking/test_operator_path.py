"""OperatorPath: what a model with the operator's own parameters over time predicts and shows."""

import numpy as np
import pytest
from scipy.signal import lfilter

from skhoid import HumanOperator, make_tracking_runs, operator_parameters, zoh_parameters
from skhoid.exceptions import RunTimeWarning
from skhoid.tracking.operator_path import ESTIMATED, OperatorPath, interpolated

TRUE = {"K_e": 0.09, "K_edot": 0.036, "tau_e": 0.28, "omega_nm": 11.25, "zeta_nm": 0.35}


class Given(OperatorPath):
    """Parameters that were given, at given sample numbers."""

    def __init__(self, path=None, numbers=None, *, inputs=None, roles=None, dt=None, run=None):
        self.path, self.numbers = path, numbers
        self.inputs, self.roles, self.dt, self.run = inputs, roles, dt, run

    def fit(self, X, y):
        self._read_operator_data(X, y)
        numbers = np.array([0]) if self.numbers is None else np.asarray(self.numbers)
        values = TRUE if self.path is None else self.path
        values = {name: np.broadcast_to(values[name], numbers.size) for name in ESTIMATED}
        self._set_path(numbers, values, {name: 0.1 * v for name, v in values.items()})
        return self

    def _method_name(self):
        return "given"


pytestmark = pytest.mark.filterwarnings("ignore::skhoid.exceptions.RunTimeWarning")


@pytest.fixture(scope="module")
def runs():
    return make_tracking_runs("C1", n_runs=2, remnant_intensity=0.1, random_state=0, run_in=10.0)


def test_whole_delays_are_exact(runs):
    X, y = runs
    model = Given().fit(X, y)
    a1, a2, b0, b1 = zoh_parameters(HumanOperator(), 0.01)
    for run in (0, 1):
        e = X.loc[run, "e"].to_numpy()
        expected = lfilter(np.r_[np.zeros(29), b0, b1], [1, a1, a2], e)
        np.testing.assert_allclose(model.predict(X.loc[[run]]), expected, atol=1e-10)


def test_delays_between_samples_are_between(runs):
    X, y = runs
    third, fourth, half = (
        Given({**TRUE, "tau_e": tau}).fit(X, y).predict(X) for tau in (0.28, 0.29, 0.285)
    )
    np.testing.assert_allclose(half, (third + fourth) / 2, atol=1e-10)


def test_tables(runs):
    model = Given(numbers=[0, 4000]).fit(*runs)
    frame = operator_parameters(model)
    assert frame.index.tolist() == [0.0, 40.0]
    assert frame["T_L"].tolist() == pytest.approx([0.4, 0.4])
    assert frame["sd_T_L"].iloc[0] == pytest.approx(0.4 * 0.1 * np.sqrt(2))
    assert frame.attrs["units"]["tau_e"] == "s"
    assert model.parameters_.loc["omega_nm", "value"] == 11.25
    assert "given" in str(model.summary())


def test_logarithms_are_interpolated():
    numbers, path = np.array([0, 10]), np.array([[1.0, -1.0], [100.0, 1.0]])
    at = interpolated(numbers, path, np.array([-5, 5, 20]))
    np.testing.assert_allclose(at, [[1, -1], [10, 0], [100, 1]])
    path[1, 0] = np.nan
    assert interpolated(numbers, path, np.array([5]))[0, 0] == 1.0


def test_rows_outside_are_told(runs):
    X, y = runs
    model = Given(numbers=[9000, 9001]).fit(X, y)
    with pytest.warns(RunTimeWarning, match="outside the fitted times"):
        model.predict(X)


def test_one_input(runs):
    X, y = runs
    with pytest.raises(ValueError, match="one linear input, the error"):
        Given(inputs=["e", "x"]).fit(X.assign(x=1.0), y)
