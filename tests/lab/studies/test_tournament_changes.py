"""When something changes, and which instants are judged."""

import numpy as np
import pytest

from skhoid import CompensatoryTask
from skhoid.lab.studies.tournament_conditions import Change, shapes


def change_of(condition):
    return Change.of(CompensatoryTask.of_condition(condition))


def test_nothing_changes():
    change = change_of("C1")
    time = np.arange(0, 81.92, 0.16)
    assert change.times is None
    assert list(change.windows(time)) == ["all"]
    assert (change.windows(time)["all"] == (time >= 15)).all()
    assert change.baseline == pytest.approx((15.0, 30.72))


def test_a_sudden_change():
    change = change_of("C4")
    assert change.times == pytest.approx((40.96,) * 3, abs=0.1)
    time = np.arange(0, 81.92, 0.16)
    windows = change.windows(time)
    parts = np.sum([windows[name] for name in ("before", "around", "after")], axis=0)
    assert (parts == windows["all"]).all()
    around = time[windows["around"]]
    assert around[0] == pytest.approx(30.72, abs=0.2)
    assert around[-1] == pytest.approx(51.2, abs=0.2)


def test_a_sigmoid_has_gone_5_and_95_percent_where_its_formula_says():
    """(1 + exp(-G (t - t_M)))^-1 = 0.05 at t_M - ln 19 / G."""
    early, middle, late = change_of("C3").times
    half = np.log(19) / 0.5
    assert (early, middle, late) == pytest.approx((40.96 - half, 40.96, 40.96 + half), abs=0.15)


def test_of_two_changes_the_window_holds_both():
    change = change_of(shapes()["relapse"])
    assert change.times[0] == pytest.approx(32.0, abs=0.1)
    assert change.times[2] == pytest.approx(54.0, abs=0.1)
    time = np.arange(0, 81.92, 0.16)
    windows = change.windows(time)
    around = time[windows["around"]]
    assert around[0] == pytest.approx(32.0 - 5.12, abs=0.2)
    assert around[-1] == pytest.approx(54.0 + 5.12, abs=0.2)
    assert windows["before"].sum() * 0.16 > 10
    assert windows["after"].sum() * 0.16 > 20


def test_the_baseline_ends_before_a_change_begins():
    assert change_of(shapes()["drift"]).baseline == pytest.approx((15.0, 27.0), abs=0.1)
