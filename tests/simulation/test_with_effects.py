"""Effects in the simulated loop."""

import numpy as np
import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Bias, DeadZone, Effect, GainDrift, Intermittent, Parameter, Preview

SHORT = {"n_runs": 3, "duration": 40.96, "sampling_rate": 50, "channels": ["e", "x", "f_t"]}


def test_an_effect_that_does_nothing_leaves_the_loop_as_it_is():
    options = {**SHORT, "remnant_intensity": 0.1, "random_state": 0, "sampling_rate": 100}
    X, y = make_tracking_runs("C4", run_in=20.0, **options)
    X_same, y_same = make_tracking_runs("C4", effects=GainDrift(rate=0.0), **options)
    # The kernel holds the target over a step, the simulation of effects is linear between samples.
    assert 1 - ((y - y_same) ** 2).sum() / (y**2).sum() > 0.998
    assert np.corrcoef(X["e"], X_same["e"])[0, 1] > 0.999


def test_the_loop_is_closed():
    X, y = make_tracking_runs("C1", effects=DeadZone(width=0.3), **SHORT)
    np.testing.assert_allclose(X["e"], X["f_t"] - X["x"], atol=1e-12)
    model = OperatorRegressor(effects=DeadZone()).fit(X, y)
    truth = {"K_e": 0.09, "T_L": 0.4, "tau_e": 0.28, "omega_nm": 11.25, "dead_zone__width": 0.3}
    found = model.parameters_["value"]
    assert {name: found[name] for name in truth} == pytest.approx(truth, rel=0.03)
    assert model.vaf_ > 99.9


def test_runs_with_effects_do_not_depend_on_their_number():
    options = {"remnant_intensity": 0.1, "random_state": 3, "effects": DeadZone(width=0.3)}
    _, y = make_tracking_runs("C1", **{**SHORT, "n_runs": 1}, **options)
    _, y_more = make_tracking_runs("C1", **SHORT, **options)
    np.testing.assert_allclose(y_more.loc[[0]], y, atol=1e-7)


def test_own_effects_and_those_that_look_ahead_are_simulated():
    class Half(Effect):
        name = "half"
        place = "output"
        parameters = (Parameter("factor"),)

        def __init__(self, *, factor=None):
            self.factor = factor

        def apply(self, signal, record, factor):
            return factor * signal

    _, y = make_tracking_runs("C1", effects=Half(factor=0.5), **SHORT)
    _, y_gain = make_tracking_runs("C1", perturbation={"K_e": -0.045, "K_edot": -0.018}, **SHORT)
    assert 1 - ((y - y_gain) ** 2).sum() / (y**2).sum() > 0.998
    effect = Preview(gain=0.5, time=0.4)
    X, y = make_tracking_runs("C1", effects=effect, **SHORT)
    model = OperatorRegressor(effects="preview").fit(X, y)
    assert model.parameters_.loc["preview__time", "value"] == pytest.approx(0.4, abs=0.02)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"effects": DeadZone()}, r"needs numbers to be simulated: DeadZone\(width=\)"),
        ({"effects": "tremor"}, "tremor is noise"),
        ({"effects": Bias(level=0.05), "display": 0.5}, "the display must be 'compensatory'"),
        ({"effects": Intermittent(hold_time=0.3)}, "needs numbers"),
    ],
)
def test_what_cannot_be_simulated_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        make_tracking_runs("C1", **SHORT, **options)
