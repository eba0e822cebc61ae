"""An effect that waits for events is found among many narrow minima."""

import pytest

from skhoid import OperatorRegressor, make_tracking_runs
from skhoid.effects import Intermittent


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "hold", "threshold"), [(1, 0.36, 0.045), (2, 0.6, 0.035)])
def test_long_holds_between_events_are_found(seed, hold, threshold):
    hidden = Intermittent(trigger="event", hold_time=hold, threshold=threshold)
    X, y = make_tracking_runs(
        "C1",
        4,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        sampling_rate=50.0,
        duration=60.0,
        effects=hidden,
        random_state=seed,
    )
    model = OperatorRegressor(effects=[Intermittent(trigger="event")]).fit(X, y)
    found = model.parameters_["value"]
    assert found["intermittent__hold_time"] == pytest.approx(hold, rel=0.04)
    assert found["intermittent__threshold"] == pytest.approx(threshold, rel=0.15)
