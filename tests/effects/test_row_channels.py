"""Channels that are put together when they are asked for."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import arx_runs

from skhoid import OperatorRegressor


@pytest.fixture(scope="module")
def data():
    X, y = arx_runs(lengths=[300, 280, 300, 150, 300], seed=2)
    X.iloc[[5, 700], 1] = np.nan
    return X, y


def make_record(X, y):
    return OperatorRegressor(settling=0.5).prepare(X, y).record


@pytest.fixture
def both(data, monkeypatch):
    """The record of few runs, and the same read on demand."""
    few = make_record(*data)
    monkeypatch.setattr("skhoid.effects.record.LARGE", 500)
    monkeypatch.setattr("skhoid.model.prepared.LARGE", 500)
    monkeypatch.setattr("skhoid.effects.record.CACHED", 600)
    return few, make_record(*data)


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_they_are_those_of_few_runs(both):
    few, many = both
    assert many.channels.order == "F"
    assert few.channels.order == "C"
    assert list(many.channels) == list(few.channels) == ["e", "x", "f_t"]
    assert len(many.channels) == 3
    assert "y" not in many.channels
    for name, values in few.channels.items():
        np.testing.assert_array_equal(many.channels[name], values)
        assert many.sd(name) == pytest.approx(few.sd(name), rel=1e-12)
    np.testing.assert_array_equal(many.y, few.y)
    np.testing.assert_array_equal(many.known, few.known)
    np.testing.assert_array_equal(many.t, few.t)
    assert many.roles == few.roles


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_parts_are_those_of_few_runs(both):
    few, many = both
    runs, some = np.array([0, 3, 4]), np.array([0, 2])
    for one, other in (
        (few.part(runs, 2), many.part(runs, 2)),
        (few.columns(slice(1, 3)), many.columns(slice(1, 3))),
        (few.beginning(1.0), many.beginning(1.0)),
        (few.changed({"e": few.y}).part(runs, 2), many.changed({"e": few.y}).part(runs, 2)),
        (few.part(runs, 2).part(some, 3), many.part(runs, 2).part(some, 3)),
    ):
        assert dict(one.channels).keys() == dict(other.channels).keys()
        for name, values in one.channels.items():
            assert values.shape == one.known.shape
            np.testing.assert_array_equal(other.channels[name], values)


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_to_look_for_a_name_reads_nothing(both):
    channels = replace(both[1].channels, found={})
    assert "e" in channels
    assert "f_t" in channels
    assert channels.found == {}
    sent = pickle.loads(pickle.dumps(channels))
    np.testing.assert_array_equal(sent["f_t"], channels["f_t"])
    with pytest.raises(KeyError):
        channels["y"]


@pytest.mark.filterwarnings("ignore::skhoid.MissingDataWarning")
def test_runs_that_share_no_time_have_their_own(data, monkeypatch):
    X, y = data
    run, time = (X.index.get_level_values(level) for level in ("run", "time"))
    index = X.index.set_levels(X.index.levels[1], level="time")
    late = time + np.where(run == 2, 10.0, 0.0)
    index = type(index).from_arrays([run, late], names=["run", "time"])
    record = make_record(X.set_axis(index), y.set_axis(index))
    assert record.t.shape == record.y.shape
    np.testing.assert_allclose(record.t[:, 1], record.t[:, 0] + 10.0)
