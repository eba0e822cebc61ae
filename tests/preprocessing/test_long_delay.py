"""A delay in seconds that may be meant in samples is warned of."""

import warnings

import numpy as np
import pandas as pd
import pytest

from skhoid import (
    DelayShift,
    LongDelayWarning,
    OperatorRegressor,
    ShortRunError,
    make_tracking_runs,
)

N = 3000
CLOCKED = pd.MultiIndex.from_product([[0], np.arange(N) * 0.01], names=["run", "time"])
SIGNALS = np.random.default_rng(0).standard_normal((N, 2))
PERSON = pd.DataFrame(SIGNALS, index=CLOCKED, columns=["e", "x"])
ERROR, MACHINE = PERSON[["e"]], PERSON.set_axis(["valve", "level"], axis=1)


@pytest.mark.parametrize(
    ("delay", "X", "dt"),
    [
        (10, PERSON, None),
        (10, ERROR, None),
        (10.0, ERROR, None),
        (np.int64(29), PERSON, None),
        (2, PERSON, None),
        (1, ERROR, None),
        (1.6, PERSON, None),
        (7.25, PERSON, None),
        (10, MACHINE, None),
        (10, SIGNALS, 0.01),
        (5, PERSON.set_axis(["Fehler", "Weg"], axis=1), None),
    ],
)
def test_what_may_be_samples_is_said(delay, X, dt):
    with pytest.warns(LongDelayWarning, match=f"delay={delay!r} is in seconds".replace("(", r"\(")
                      .replace(")", r"\)")) as told:  # fmt: skip
        step = DelayShift(delay, dt=dt).fit(X)
    text = str(told[0].message)
    assert f"{float(delay) / 0.01:.6g} samples of 0.01 s" in text
    assert f"give delay={delay * 0.01:g}" in text
    assert step.n_samples_ == round(delay / 0.01)


@pytest.mark.parametrize(
    ("delay", "X", "dt"),
    [
        (0, PERSON, None),
        (0.0, PERSON, None),
        (0.29, PERSON, None),
        (1.5, PERSON, None),
        (1.0, ERROR, None),
        (10.0, MACHINE, None),
        (2.5, MACHINE, None),
        (10, SIGNALS, None),  # a row counts as a second: samples are seconds
        (10, SIGNALS, 1.0),
    ],
)
def test_what_cannot_be_mistaken_is_not(delay, X, dt):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        DelayShift(delay, dt=dt).fit(X)


def test_a_delay_longer_than_the_run_is_in_seconds_too():
    with pytest.raises(ShortRunError, match=r"seconds: 29 samples, as nk counts.*delay=0\.29"):
        DelayShift(29).fit(PERSON[:1000])


def test_roles_say_who_answers():
    X = MACHINE.set_axis(["Fehler", "Weg"], axis=1)
    DelayShift(2.5).fit(X)
    with pytest.warns(LongDelayWarning, match=r"people take up to 1\.5 s"):
        DelayShift(2.5, roles={"Fehler": "e", "Weg": "x"}).fit(X)


@pytest.mark.parametrize("delay", [2, 1, 3.5, 10])
def test_the_delay_of_a_person_is_no_number_of_samples(delay):
    X, y = make_tracking_runs("C1", 1, duration=20.48, sampling_rate=50, random_state=0)
    with pytest.warns(LongDelayWarning, match="is in seconds"):
        OperatorRegressor(delay=delay).fit(X, y)
