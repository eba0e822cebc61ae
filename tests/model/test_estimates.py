"""Tables of estimates: what was not determined says so."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone, Dimension, Effect, Parameter
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


def test_the_summary_names_what_the_runs_do_not_determine():
    hidden = DeadZone(width=0.3) + Bias(level=0.05)  # and the model has neither
    task = {"channels": ["e", "x"], "sampling_rate": 50, "random_state": 0}
    X, y = make_tracking_runs("C1", 3, effects=hidden, remnant_intensity=0.1, **task)
    blind, seeing = OperatorRegressor(), OperatorRegressor(effects=["dead_zone", "bias"])
    assert "These runs do not determine omega_nm" in " ".join(blind.fit(X, y).summary().split())
    assert "do not determine" not in " ".join(seeing.fit(X, y).summary().split())
