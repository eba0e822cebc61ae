"""``identify`` leaves lost control out, and refuses models that rebuild the output from x."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.hidden_disturbance import tracked

from skhoid import make_tracking_runs
from skhoid.diagnosis.identification import ModelChoice, Verdict, identify
from skhoid.exceptions import MissingDataWarning


def table(record, *channels):
    n, m = record.y.shape
    index = pd.MultiIndex.from_arrays(
        [np.repeat(np.arange(m), n), np.tile(np.round(np.arange(n) * record.dt, 9), m)],
        names=["run", "time"],
    )
    X = pd.DataFrame({k: record.channels[k].T.ravel() for k in channels}, index=index)
    return X, pd.Series(record.y.T.ravel(), index=index, name="u")


def hidden(seed, *channels, disturbance=1.0, remnant=0.6):
    """Much remnant, and a disturbance that is recorded nowhere."""
    options = {"direct": bool(seed % 2), "remnant": remnant, "disturbance": disturbance}
    return table(tracked("1/(s(s+1))", seed=seed, runs=3, **options), *channels)


@pytest.fixture(scope="module")
def loop():
    return hidden(1, "e", "x")


# Leaks


@pytest.mark.parametrize("channels", [("e", "x"), ("x", "f_t")])
def test_near_a_second_difference_is_refused(channels):
    X, y = hidden(1, *channels)
    found = identify(X, y, ModelChoice(inputs=list(channels), na=2, nb=3, nk=7))
    b = found.best.model.coef_[2:8].reshape(2, 3)
    largest = b[np.argmax(np.abs(b[:, 1]))]
    assert_allclose(largest / largest[0], [1, -2, 1], atol=0.2)
    assert found.best.vaf_validation > 85
    assert found.best.leaks
    assert found.best.verdict is Verdict.REBUILDS
    assert "is no answer" in str(found.notes[-1])
    assert "% of the unseen disturbance is in the prediction" in str(found.notes[-1])
    assert "longer than 0.1" in str(found.notes[-1])
    assert found.best.as_dict()["leaks"] is True


def test_an_answer_sooner_than_anybody_gives_is_none(loop):
    X, y = loop
    found = identify(X, y, ModelChoice(inputs=["e", "x"], na=2, nb=3, nk=0))
    assert not found.best.leaks
    assert found.best.verdict is Verdict.UNTOLD
    assert "longer than 0.1 s" in str(found.notes[-1])
    machine = ModelChoice(inputs=["x"], na=2, nb=3, nk=0, domain="machine")
    assert identify(X[["x"]], y, machine).best.verdict is not Verdict.UNTOLD


def test_the_answer_to_the_error_alone_is_not(loop):
    X, y = loop
    for channels in (X, X[["e"]]):
        found = identify(channels, y, ModelChoice(inputs=["e"], na=2, nb=3, nk=7))
        assert found.best.verdict == "no overfit"
        assert (found.best.leak is None) == (channels is not X)


@pytest.mark.parametrize("inputs", [["e"], ["e", "f_t"]])
def test_honest_loops_are_not_struck(inputs):
    for seed in range(2):
        X, y = make_tracking_runs(
            n_runs=3,
            channels=["e", "x", "f_t"],
            duration=30.0,
            sampling_rate=50,
            remnant_intensity=0.1,
            random_state=seed,
        )
        found = identify(X, y, ModelChoice(inputs=inputs, na=2, nb=2, nk=14))
        assert not found.best.leaks
        assert found.best.verdict in ("no overfit", "overfit")
        assert found.notes == []


# Lost control


@pytest.fixture(scope="module")
def lost():
    X, y = make_tracking_runs(
        n_runs=4, duration=30.0, sampling_rate=40, remnant_intensity=0.05, random_state=3
    )
    run, time = (X.index.get_level_values(level) for level in ("run", "time"))
    rows = (run == 1) & (time >= 10) & (time < 22)
    X, y = X.copy(), y.copy()
    X.loc[rows, "e"] = 15 * np.cos(1.5 * (time[rows] - 10))
    y[rows] = 0.35 * np.sign(X.loc[rows, "e"])
    return X, y, rows


def test_rows_of_lost_control_count_nowhere(lost):
    X, y, rows = lost
    choice = ModelChoice(inputs=["e"], na=2, nb=2, nk=11)
    found = identify(X, y, choice)
    assert found.left_out["run"].tolist() == ["1"]
    run, time = (X.index.get_level_values(level) for level in ("run", "time"))
    begin, end = found.left_out[["from", "to"]].to_numpy()[0]
    out = (run == 1) & (time >= begin) & (time <= end)
    assert out[rows].mean() > 0.95
    with pytest.warns(MissingDataWarning):
        missing = identify(X, y.mask(out), replace(choice, lost_control="keep"))
    keep = replace(choice, lost_control="keep")
    kept = identify(X, y, keep)
    assert kept.left_out.empty
    assert found.best.vaf_validation > 85 > kept.best.vaf_validation
    assert_allclose(found.best.model.coef_, missing.best.model.coef_, rtol=1e-9)
    assert found.tables["predictions"]["measured"].equals(y.rename("measured"))
    assert found.tables["left_out"].equals(found.left_out)
    assert "left_out" not in kept.tables
    (note,) = found.notes
    assert "run 1 from 9" in note.text
    assert note.hint == 'lost_control="keep" keeps them'
