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
    DelayShift,
    EffectSearchCV,
    OperatorRegressor,
    OrderSearchCV,
    RecursiveARX,
    RecursiveARXCV,
    RunIndexError,
    RunInTrimmer,
    VAFScorer,
    compare,
    ensemble_average,
    resample_runs,
    run_labels,
    sampling_time,
    select_runs,
)
from skhoid.recordings.channels import check_channels

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
    "RecursiveARX": RecursiveARX().fit,
    "RecursiveARX.partial_fit": RecursiveARX().partial_fit,
    "OperatorRegressor": OperatorRegressor().fit,
    "DelaySearchCV": DelaySearchCV(ARXRegressor()).fit,
    "OrderSearchCV": OrderSearchCV(ARXRegressor()).fit,
    "RecursiveARXCV": RecursiveARXCV().fit,
    "EffectSearchCV": EffectSearchCV(ARXRegressor(2, 2, 3)).fit,
    "Decimator": Decimator(2).fit,
    "DelayShift": DelayShift(0.1).fit,
    "RunInTrimmer": RunInTrimmer(0.1).fit,
    "ensemble_average": ensemble_average,
    "compare": lambda X, y: compare(FITTED, X, y),
    "predict": lambda X, y: FITTED.predict(X),
    "VAFScorer": lambda X, y: VAFScorer()(FITTED, X, y),
    "check_channels": check_channels,
    "run_labels": lambda X, y: run_labels(X),
    "sampling_time": lambda X, y: sampling_time(X),
    "select_runs": lambda X, y: select_runs(X, y, last=1),
    "resample_runs": resample_runs,
}
LATER = {"predict", "compare", "VAFScorer"}  # a fitted model says that the index is lost


@pytest.mark.parametrize("name", ENTRIES)
@pytest.mark.parametrize("table", [FLAT, FLAT[["time", "x", "run"]]], ids=["e", "no e"])
def test_every_entry_refuses_a_flat_table(name, table):
    message = refusal(ENTRIES[name], table, U)
    assert "set_index(['run', 'time'])" in message or name in LATER


# table: what the code in the message makes of it, and of one of its runs or all
REMEDIES = {
    "run and time": FLAT,
    "in capitals": FLAT.rename(columns={"run": "RUN", "time": "Time"}),
    "units, and t": FLAT.rename(columns={"time": "t [s]"}),
    "outer columns": SUBJECTS,
    "trial": FLAT.rename(columns={"run": "trial"}),
    "run in the index": FLAT.set_index("run"),
    "time in the index": FLAT.set_index("time"),
    "t in the index": FLAT.drop(columns="run").set_index(FLAT["time"].rename("t")).drop(
        columns="time"
    ),
    "time of several runs": FLAT.drop(columns="run"),
    "t of several runs": FLAT.drop(columns="run").rename(columns={"time": "t"}),
}  # fmt: skip


@pytest.mark.parametrize("table", REMEDIES.values(), ids=REMEDIES.keys())
def test_the_code_in_the_message_gives_the_model_of_the_runs(table):
    message = refusal(coefficients, table)
    first = re.search(r"after (X\['run'\] = .*?\.cumsum\(\))", message)
    code = re.search(r"X = X\S*?(?:\.rename\(columns=\{.*?\}\))?\.set_index\((?:.*?)\)(?=[; .]|$)",
                     message)  # fmt: skip
    scope = {"X": table.copy()}
    for found in (first, code):
        if found is not None:
            exec(found[1] if found is first else found[0], scope)
    assert np.array_equal(coefficients(scope["X"][["e", "x"]]), FITTED.coef_)
    if "subject" in message:
        assert scope["X"].index.names == ["subject", "condition", "run", "time"]


def renamed(run, time, **more):
    return FLAT.rename(columns={"run": run, "time": time}).assign(**more)


NEAR = ["trial_id,time_s", "Run No.,Time_ms", "runs,times", "rep,sec", "run_id,t_ms"]
NEAR += ["trial_no,time_ms", "run_nr,t_sec", "runId,timeSec", "trial_num,t0", "Run1,Time1"]
NEAR += ["participant,time_s", "subject_id,time_s", "session,elapsed", "block,Time stamp"]
NEAR += ["trial id,seconds_", "Repetition,trial_time"]


@pytest.mark.parametrize("kind", ["whole", "float", "text", "category"])
@pytest.mark.parametrize("names", NEAR)
def test_names_that_come_near(names, kind):
    run, time = names.split(",")
    table = renamed(run, time)
    if kind in ("text", "category"):
        table[run] = "r" + table[run].astype(str)
    table[run] = table[run].astype(
        {"whole": int, "float": float}.get(kind, kind.replace("text", "str"))
    )
    message = refusal(coefficients, table)
    assert f"X has {run!r} and {time!r} as columns" in message
    assert f"If {run!r} is a channel, give it another name." in message
    assert ("divided by 1000" in message) == ("ms" in time)
    code = re.search(r"X = X\S*?\.rename\(columns=\{.*?\}\)\.set_index\(.*?\)(?=;)", message)
    scope = {"X": table}
    exec(code[0], scope)
    assert scope["X"].index.names == ["run", "time"]
    assert np.array_equal(coefficients(scope["X"][["e", "x"]]), FITTED.coef_)
    assert f"X has {time!r} as a column" in refusal(coefficients, table.drop(columns=run))
    assert f"X has {run!r} as a column" in refusal(coefficients, table.drop(columns=time))
    named = coefficients(table.drop(columns=time), run=run, dt=DT)
    assert np.array_equal(named, FITTED.coef_)


def test_names_that_come_near_in_polars_and_in_the_index():
    table = renamed("trial_id", "time_s")
    assert "'trial_id' and 'time_s'" in refusal(coefficients, pl.from_pandas(table))
    assert ".reset_index().rename(" in refusal(coefficients, table.set_index("time_s"))


def test_the_labels_around_runs_become_outer_levels():
    table = renamed("Trial No.", "time_s", subject_id="S1", condition=2, session=1.0)
    message = refusal(coefficients, table)
    assert "X has 'Trial No.' and 'time_s'" in message
    assert "set_index(['condition', 'subject', 'session', 'run', 'time'])" in message
    assert "'Trial No.'" in refusal(coefficients, table.assign(subject=table["Trial No."] // 2))


STEPS = np.arange(len(FLAT))
CHANNELS = {
    "e_t": STEPS * DT,
    "f_t": STEPS * DT,
    "x1": STEPS // 100,
    "s": STEPS * DT,
    "block": STEPS // 50 % 2,
    "Block": STEPS > 200,
    "sample": STEPS,
    "frame": STEPS,
    "rep_force": STEPS // 100,
    "subject_force": STEPS // 100,
    "time_constant": np.where(STEPS < 100, 0.3, 0.4),
    "run_length": STEPS // 100,
    "trial_id": STEPS // 100 + 0.5,
    "trial_no": STEPS,
    "session": np.ones(len(FLAT)),
    "repetition": STEPS % 2,
    "participant": np.full(len(FLAT), 7),
    "time_s": np.cumsum(np.random.default_rng(0).standard_normal(len(FLAT))),
    "t1": np.full(len(FLAT), 2.0),
    "preview_time": 1.0 - STEPS * DT,
}  # fmt: skip


@pytest.mark.parametrize(("name", "values"), CHANNELS.items(), ids=CHANNELS.keys())
def test_a_channel_is_not_refused_for_its_name(name, values):
    coefficients(FLAT[["e"]].assign(**{name: values}))


def test_the_time_of_one_run_alone_becomes_the_index():
    message = refusal(coefficients, FLAT[ONE].drop(columns="run"), U[ONE])
    assert re.search(r"X = X.set_index\('time'\).* dt=", message)


def test_a_run_column_alone_is_to_be_named():
    message = refusal(coefficients, FLAT.drop(columns="time"))
    assert "run='run' and dt=" in message
    named = coefficients(FLAT.drop(columns="time"), run="run", dt=DT)
    assert np.array_equal(named, FITTED.coef_)


def test_polars_are_turned_into_pandas():
    assert "X = X.to_pandas().set_index(['run', 'time'])" in refusal(
        coefficients, pl.from_pandas(FLAT)
    )


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


def test_dt_makes_the_time_of_one_run_a_channel():
    one = coefficients(FLAT[ONE].drop(columns="run"), U[ONE], dt=DT)
    assert np.array_equal(one, coefficients(X[ONE.to_numpy()], U[ONE]))
