"""A table with run and time as columns is refused, and the message holds what to write."""

import re

import numpy as np
import polars as pl
import pytest
from support.synthetic import DT, arx_runs

from skhoid import (
    ARXRegressor,
    Decimator,
    DelaySearchCV,
    EffectSearchCV,
    OperatorRegressor,
    RecursiveARX,
    RunIndexError,
    check_channels,
    ensemble_average,
    resample_runs,
    run_labels,
    sampling_time,
    select_runs,
)

X, Y = arx_runs(3, 120)
U = Y.to_numpy()
FLAT = X.reset_index()[["e", "run", "x", "time"]]
FITTED = ARXRegressor(2, 2, 3).fit(X, Y)
ONE = FLAT["run"] == FLAT["run"].iloc[0]
SUBJECTS = FLAT.assign(Subject="S1", condition=2)


def coefficients(table, y=U, **params):
    return ARXRegressor(2, 2, 3, **params).fit(table, y).coef_


def refusal(action, *args, **params):
    with pytest.raises(RunIndexError) as caught:
        action(*args, **params)
    return str(caught.value)


ENTRIES = {
    "ARXRegressor": ARXRegressor().fit,
    "RecursiveARX.partial_fit": RecursiveARX().partial_fit,
    "OperatorRegressor": OperatorRegressor().fit,
    "DelaySearchCV": DelaySearchCV(ARXRegressor()).fit,
    "EffectSearchCV": EffectSearchCV(ARXRegressor(2, 2, 3)).fit,
    "Decimator": Decimator(2).fit,
    "ensemble_average": ensemble_average,
    "check_channels": check_channels,
    "run_labels": lambda X, y: run_labels(X),
    "sampling_time": lambda X, y: sampling_time(X),
    "select_runs": lambda X, y: select_runs(X, y, last=1),
    "resample_runs": resample_runs,
}


@pytest.mark.parametrize("entry", ENTRIES.values(), ids=ENTRIES.keys())
@pytest.mark.parametrize("table", [FLAT, FLAT[["time", "x", "run"]]], ids=["e", "no e"])
def test_every_entry_refuses_a_flat_table(entry, table):
    assert "set_index(['run', 'time'])" in refusal(entry, table, U)


def renamed(run, time, **more):
    return FLAT.rename(columns={"run": run, "time": time}).assign(**more)


def of_text(table, run):
    return table.assign(**{run: "r" + table[run].astype(str)}).astype({run: "category"})


# What the code in the message makes of a table are the runs.
REMEDIES = {
    "run and time": FLAT,
    "in capitals": renamed("RUN", "Time"),
    "units, and t": renamed("run", "t [s]"),
    "outer columns": SUBJECTS,
    "trial": renamed("trial", "time"),
    "run in the index": FLAT.set_index("run"),
    "time in the index": FLAT.set_index("time"),
    "time of several runs": FLAT.drop(columns="run"),
    "t of several runs": FLAT.drop(columns="run").rename(columns={"time": "t"}),
    "near": renamed("trial_id", "time_s"),
    "with a number": renamed("Run No.", "times"),
    "camel": of_text(renamed("runId", "timeSec"), "runId"),
    "participant": renamed("participant", "elapsed").astype({"participant": float}),
}


@pytest.mark.parametrize("table", REMEDIES.values(), ids=REMEDIES.keys())
def test_the_code_in_the_message_gives_the_model_of_the_runs(table):
    message = refusal(coefficients, table)
    first = re.search(r"after (X\['run'\] = .*?\.cumsum\(\))", message)
    code = re.search(r"X = X\S*?(?:\.rename\(columns=\{.*?\}\))?\.set_index\((?:.*?)\)(?=[; .])",
                     message)  # fmt: skip
    scope = {"X": table.copy()}
    for found in (first, code):
        if found is not None:
            exec(found[1] if found is first else found[0], scope)
    assert np.array_equal(coefficients(scope["X"][["e", "x"]]), FITTED.coef_)
    if "subject" in message:
        assert scope["X"].index.names == ["subject", "condition", "run", "time"]


def test_the_labels_around_runs_become_outer_levels():
    table = renamed("Trial No.", "time_s", subject_id="S1", condition=2, session=1.0)
    message = refusal(coefficients, table)
    assert "X has 'Trial No.' and 'time_s'" in message
    assert "set_index(['subject', 'condition', 'session', 'run', 'time'])" in message


STEPS = np.arange(len(FLAT))
CHANNELS = {
    "e_t": STEPS * DT,
    "s": STEPS * DT,
    "block": STEPS // 50 % 2,
    "rep_force": STEPS // 100,
    "time_constant": np.where(STEPS < 100, 0.3, 0.4),
    "trial_id": STEPS // 100 + 0.5,
    "trial_no": STEPS,
    "session": np.ones(len(FLAT)),
    "time_s": np.cumsum(np.random.default_rng(0).standard_normal(len(FLAT))),
    "t1": np.full(len(FLAT), 2.0),
}


@pytest.mark.parametrize(("name", "values"), CHANNELS.items(), ids=CHANNELS.keys())
def test_a_channel_is_not_refused_for_its_name(name, values):
    coefficients(FLAT[["e"]].assign(**{name: values}))


def test_one_of_run_and_time_alone():
    message = refusal(coefficients, FLAT[ONE].drop(columns="run"), U[ONE])
    assert re.search(r"X = X.set_index\('time'\).* dt=", message)
    assert "run='run' and dt=" in refusal(coefficients, FLAT.drop(columns="time"))
    named = coefficients(FLAT.drop(columns="time"), run="run", dt=DT)
    assert np.array_equal(named, FITTED.coef_)
    one = coefficients(FLAT[ONE].drop(columns="run"), U[ONE], dt=DT)
    assert np.array_equal(one, coefficients(X[ONE.to_numpy()], U[ONE]))


def test_polars_are_turned_into_pandas():
    message = refusal(coefficients, pl.from_pandas(FLAT))
    assert "X = X.to_pandas().set_index(['run', 'time'])" in message


@pytest.mark.parametrize("column", ["run", "time", "subject"])
def test_labels_are_no_inputs_beside_an_index_either(column):
    table = X[["x"]].assign(**{column: np.arange(len(X)) % 7})
    with pytest.raises(RunIndexError, match=rf"'{column}'.*inputs="):
        coefficients(table, Y)
    coefficients(table, Y, inputs=["x", column])


WALK = np.random.default_rng(0).standard_normal(len(FLAT)).cumsum()
LEGITIMATE = {
    "run= and dt=": (FLAT, {"run": "run", "dt": DT}),
    "time index, run=": (FLAT.set_index("time"), {"run": "run"}),
    "a channel t": (FLAT[["e"]].assign(t=WALK), {}),
    "a channel trial": (FLAT[["e"]].assign(trial=WALK), {}),
    "one subject": (FLAT[["e"]].assign(subject=3), {}),
    "columns beside the index": (X.assign(run=1, time=2.0), {}),
}


@pytest.mark.parametrize(("table", "params"), LEGITIMATE.values(), ids=LEGITIMATE.keys())
def test_nothing_is_refused_that_is_told(table, params):
    coefficients(table, **params)
