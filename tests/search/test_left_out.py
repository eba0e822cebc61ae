"""Stretches of lost control count neither in fits nor in held-out figures of a search."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from skhoid import (
    EffectSearchCV,
    OperatorRegressor,
    make_tracking_runs,
)
from skhoid.exceptions import ShortRunError

EFFECTS = ["bias", "dead_zone", "saturation", "gain_drift"]
BEGIN, END = 12.0, 22.0


@pytest.fixture(scope="module")
def honest():
    return make_tracking_runs(
        "C1",
        n_runs=3,
        duration=30.0,
        sampling_rate=40,
        channels=["e", "x", "f_t"],
        remnant_intensity=0.05,
        random_state=4,
    )


def losing(runs, begin=BEGIN, end=END, run=2):
    """The cursor runs away, and the person pushes the stick to its stop."""
    X, y = (data.copy() for data in runs)
    time = X.index.get_level_values("time")
    lost = (X.index.get_level_values("run") == run) & (time >= begin) & (time < end)
    grows = 15.0 * np.minimum((time[lost] - begin + 0.1) / 2, 1)
    X.loc[lost, "e"] = grows * np.cos(1.5 * (time[lost] - begin))
    X["x"] = X["f_t"] - X["e"]
    y[lost] = 0.35 * np.sign(np.cos(1.5 * (time[lost] - begin)))
    return X, y, lost


@pytest.fixture(scope="module")
def lost(honest):
    return losing(honest)


def search(**options):
    options = {"effects": EFFECTS, "max_effects": 2} | options
    return EffectSearchCV(OperatorRegressor(0.28), **options)


@pytest.fixture(scope="module")
def found(lost):
    X, y, _ = lost
    return search().fit(X, y)


@pytest.mark.slow
def test_nothing_is_named_for_a_run_in_which_control_was_lost(honest, lost, found):
    X, y, _ = lost
    assert search(lost_control="keep").fit(X, y).best_effects_ != []
    assert found.best_effects_ == []
    expected = OperatorRegressor(0.28).fit(*honest).parameters_
    names = ["K_e", "T_L", "omega_nm"]
    apart = found.baseline_.parameters_["value"] - expected["value"]
    assert np.all(np.abs(apart[names]) < 4 * expected.loc[names, "sd"])


def test_what_is_left_out_is_said_with_how_to_keep_it(found):
    assert found.left_out_["run"].tolist() == ["2"]
    assert_allclose(found.left_out_[["from", "to"]], [[BEGIN, END]], atol=3.5)
    note = found.notes_[-1]
    assert note.kind == "lost control"
    assert 'lost_control="keep"' in note.hint
    for told in (str(note), found.summary()):
        assert "run 2 from 11" in told


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::skhoid.exceptions.NothingExplainedWarning")
def test_rows_may_be_kept(lost):
    X, y, _ = lost
    kept = search(effects="bias", lost_control="keep").fit(X, y)
    assert kept.left_out_.empty
    assert kept.predictions_["baseline"].notna().all()
    assert not any("lost" in note.kind for note in kept.notes_)
    machine = search(effects="bias", domain="machine").fit(X, y)
    assert machine.left_out_.empty


def test_an_operator_on_an_array_answers_the_error(lost):
    X, y, _ = lost
    array = np.column_stack([X["e"], X.index.get_level_values("run")])
    model = OperatorRegressor(0.28, inputs=[0], dt=0.025, run=1)
    found = EffectSearchCV(model, effects="bias").fit(array, y.to_numpy())
    assert found.left_out_["run"].tolist() == ["2.0"]


def test_too_little_that_is_left_is_refused(honest):
    X, y, _ = losing(honest, begin=-4.0, end=99.0)
    X, y = X.loc[[1, 2]], y.loc[[1, 2]].copy()
    y.loc[1] = np.where(np.arange(len(y.loc[1])) < 100, y.loc[1], np.nan)
    with pytest.raises(ShortRunError, match=r"because control was lost in them. lost_control="):
        EffectSearchCV(OperatorRegressor(0.28), effects="bias").fit(X, y)
