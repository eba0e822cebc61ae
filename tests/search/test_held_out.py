"""Predictions of rows that were held out: by one step, and by fits to the end."""

import numpy as np
import pytest
from support.person_in_loop import answered
from support.searching import search_of

from skhoid.effects import FreeGain
from skhoid.effects.composition import Effects
from skhoid.model.fitting import Criterion
from skhoid.model.model import Model
from skhoid.model.simulator import Simulator
from skhoid.search.judges import held_out, refitted_prediction, within_seen


@pytest.fixture(scope="module")
def fitted():
    search, model = search_of(*answered(dead=0.0, n_runs=3), ["bias"])
    return search, model


@pytest.mark.parametrize("predict", [held_out, refitted_prediction])
def test_measurements_held_out_do_not_matter(fitted, predict):
    search, model = fitted
    fold = search.folds[0]
    record = search.record
    kept = record.y.copy()
    start = model.under(Criterion(record))
    first = predict(start, Criterion(record), [fold])[fold.test]
    record.y[fold.test] += 5.0
    try:
        second = predict(start, Criterion(record), [fold])[fold.test]
    finally:
        record.y[:] = kept
    np.testing.assert_allclose(second, first, rtol=1e-6, atol=1e-9)


def test_curves_over_a_channel_hold_beyond_what_a_fold_was_fitted_on(fitted):
    search, model = fitted
    shape = search.record.known.shape
    speed = np.broadcast_to(np.linspace(0.0, 1.0, shape[0])[:, None], shape) * np.ones(shape)
    speed[:, 0] += 3.0
    record = search.record.changed({"speed": speed})
    form = FreeGain(channel="speed", knots=(0.0, 1.0, 2.0, 4.0), values=(0.0, 0.1, 0.4, 1.5))
    simulator = Simulator(search.core, Effects([("free_gain", form)]), record)
    beyond = Model(simulator, model.fit)
    first = next(fold for fold in search.folds if fold.test[:, 0].any())
    held = within_seen(beyond, first)
    bounded = held.simulator.record.channel("speed")
    seen = speed[first.train]
    np.testing.assert_array_equal(bounded, np.clip(speed, seen.min(), seen.max()))
    assert bounded.max() < 1.5 < speed.max()
    assert within_seen(model, first) is model
