"""The shape of what has no name: found where it acts, with a band, and not where nothing is."""

import numpy as np
import pytest
from support.shapes import Fechner, searched

from skhoid.effects import DeadZone, Effect, Lapses, TimeVaryingDelay


@pytest.fixture(scope="module")
def hidden():
    # Names that come near it are left out: a soft map of the error is all that remains.
    return searched(Fechner(knee=0.15), effects=["bias", "tv_gain", "rate_limit"])


@pytest.mark.slow
def test_a_map_without_a_name_is_shown_where_it_acts(hidden):
    search, X, y = hidden
    shape = search.shape_
    assert search.best_effects_[-1] == "unknown"
    assert (shape.id, shape.place, shape.over) == ("free_map", "input", "e")
    assert shape.closed > 0.9
    assert shape.gain > 1.0
    assert shape.estimator.score(X, y) > search.baseline_.score(X, y) + 1.0
    assert "error" in shape.sentence


@pytest.mark.slow
def test_its_curve_is_the_true_one_and_lies_in_its_band(hidden):
    shape = hidden[0].shape_
    # Where nearly all data are: the outermost knots are quantiles of the error.
    middle = shape.curve.iloc[20:-20]
    at, value = middle.index.to_numpy(), middle["value"].to_numpy()
    # Gain, level and slope are the model's own.
    table = np.stack([Fechner().apply(at, None, 0.15), np.ones_like(at), at], axis=1)
    left = value - table @ np.linalg.lstsq(table, value)[0]
    assert np.std(left) < 0.15 * np.std(value)
    # A band that is right holds nearly all of the curve; its straight part was fitted here.
    assert np.mean(np.abs(left) < middle["high"] - value) > 0.9
    assert 1.0 < shape.dof < 11.0


def test_nothing_has_no_shape():
    search, _, _ = searched(None, seed=1, effects=["bias", "dead_zone"])
    assert search.best_effects_ == []
    assert search.shape_ is None
    assert "shape" not in search.summary()
    assert "free form" not in search.summary()


@pytest.mark.slow
def test_a_name_at_the_wrong_place_is_a_stand_in():
    change = TimeVaryingDelay(change=0.15, rate=1.0, time=40.0)
    search, _, _ = searched(change, seed=2, effects=["tv_gain", "gain_drift"])
    assert search.best_effects_ == ["unknown"]
    assert (search.shape_.id, search.shape_.over) == ("free_delay", "time")


class Cautious(Effect):
    """Gains that fall with the distance from the middle, which no catalogue has."""

    name = "cautious"
    place = "gain"

    def apply(self, signal, record):
        return signal.times(np.exp(-0.4 * np.abs(record.channel("x"))))


@pytest.mark.slow
def test_a_gain_over_what_follows_from_channels_is_shown_over_it():
    found = searched(Cautious(), 3, ("e", "x", "f_t"), effects=["cubic_gain", "dead_zone"])
    search, X, y = found
    shape = search.shape_
    assert search.best_effects_ == ["unknown"]
    assert (shape.id, shape.over, shape.family) == ("free_gain", "|x|", None)
    assert shape.curve["value"].iloc[0] > 1.0 > shape.curve["value"].iloc[-1]
    assert shape.x_label == "size |x|, deg"
    assert 0.3 < shape.misses <= 1.0
    assert shape.estimator.score(X, y) > search.baseline_.score(X, y) + 3.0


@pytest.mark.slow
def test_a_name_says_what_share_of_the_gap_it_closes():
    search, _, _ = searched(
        DeadZone(width=0.4), 5, ("e", "x", "f_t"), effects=["dead_zone", "bias"]
    )
    assert search.best_effects_ == ["dead_zone"]
    value, low, high, of_ceiling = search.closed_
    assert of_ceiling
    assert 0.5 < low < value <= high <= 1.0
    assert value > 0.9
    assert f"Dead zone closes {value:.0%}".replace("%", " %") in search.summary()


@pytest.mark.whole
def test_a_gain_that_vanishes_for_seconds_is_shown_in_detail():
    away = Lapses(depth=1.0, shift=0.0, intervals=[(10.0, 12.0), (21.0, 24.0), (53.0, 55.0)])
    search, _, _ = searched(away, channels=("e", "x", "f_t"), effects=["bias"])
    shape = search.shape_
    assert (shape.id, shape.over) == ("free_gain", "time")
    assert shape.closed > 0.85
    inside, outside = shape.curve.loc[22.0:23.0, "value"], shape.curve.loc[30.0:50.0, "value"]
    assert inside.max() < 0.3 * outside.mean()
    assert shape.curve["low"].min() >= 0.0  # as the gains
    assert shape.curve.index[0] > 0.5  # not before rows count
