"""What the criteria of a search protect from: a large mean, and models that rebuild the output."""

import numpy as np
import pytest
from support.person_in_loop import answered, pursued

from skhoid import EffectSearchCV, OperatorRegressor
from skhoid.effects import Dimension, Effect, Parameter
from skhoid.search import Reason, Status

LEAST_GAIN, THRESHOLD = 0.2, 12.5  # points and nats of an effect that counts


@pytest.mark.slow
def test_an_effect_behind_a_large_mean_is_found():
    """With a mean of ten, a dead zone explains hundredths of a point of the whole power."""
    X, y = answered(dead=0.5, mean=10.0)
    found = EffectSearchCV(OperatorRegressor(), effects=["bias", "dead_zone", "asym_gain"])
    found.fit(X, y)
    assert found.best_effects_ == ["bias", "dead_zone"]
    gain = found.ranking_.query("effect == 'dead_zone' and status == 'added'")["vaf_gain"]
    assert 0 < gain.item() < LEAST_GAIN


class OfTheAnswer(Effect):
    """What the controlled element does shows what went into it."""

    name = "of_the_answer"
    place = "sum"
    physics = "The acceleration of the controlled element is in the output."
    formula = "u + gain d2x/dt2"
    parameters = (Parameter("gain", Dimension(u=1), -20.0, 20.0, (0.5,), "on it"),)

    def __init__(self, *, gain=None):
        self.gain = gain

    def apply(self, signal, record, gain):
        (name,) = record.with_role("x")
        x = record.channels[name]
        ahead, behind = np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
        second = (ahead - 2 * x + behind) / record.dt**2
        second[0] = second[-1] = 0.0
        return signal + gain * second


def test_a_model_that_rebuilds_the_output_from_x_is_refused():
    X, y, _ = pursued("1/(s(s+1))", 5, n_runs=3, duration=30.0)
    found = EffectSearchCV(
        OperatorRegressor(), effects=[OfTheAnswer()], controlled_element="1/(s(s+1))"
    ).fit(X, y)
    row = found.ranking_.iloc[0]
    assert row["vaf_gain"] > LEAST_GAIN
    assert row["free_run"] > THRESHOLD
    assert "of_the_answer" not in found.best_effects_
    assert row["status"] == Status.NOT_BETTER
    assert row["reason_code"] == Reason.REBUILDS
