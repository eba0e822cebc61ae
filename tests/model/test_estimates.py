"""Tables of estimates: what was not determined says so."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Dimension, Effect, Parameter
from skhoid.text import Estimate


class Idle(Effect):
    """Does nothing with its share."""

    name = "idle"
    place = "output"
    parameters = (Parameter("share", Dimension(), 0.0, 1.0, (0.5,), "of nothing"),)

    def __init__(self, *, share=None):
        self.share = share

    def apply(self, signal, record, share):
        return signal

    def derived(self, values):
        return {"double": (2 * values["share"], Dimension(), "share")}


@pytest.fixture(scope="module")
def fitted():
    X, y = make_tracking_runs(duration=20.48, remnant_intensity=0.05, random_state=1)
    return OperatorRegressor(effects=Idle()).fit(X, y)


def test_parameter_without_effect_has_no_error(fitted):
    row = fitted.parameters_.loc["idle__share"]
    assert np.isnan(row["sd"])
    assert (row["low"], row["high"]) == (0.0, 1.0)
    assert str(Estimate.of(row)).endswith("(not determined)")
    assert np.isnan(fitted.parameters_.loc["idle__double", "sd"])
    assert (fitted.parameters_.loc[["K_e", "T_L", "tau_e"], "sd"] > 0).all()
