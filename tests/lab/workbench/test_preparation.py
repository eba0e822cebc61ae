"""Run-in, range, means, decimation and delay shift: steps that are shown, fitted and copied."""

import contextlib
import io
import re

import numpy as np
import pandas as pd
import pytest
from sklearn.pipeline import make_pipeline
from support.workbench import same, until

from skhoid import (
    Decimator,
    DelayShift,
    FrequencyResponse,
    OperatorRegressor,
    RunInTrimmer,
    SimulatedARX,
    VAFScorer,
    read_runs,
    write_runs,
)
from skhoid.lab.workbench.columns import Choices

THIN = {"run_in": "4", "decimate": "2", "padding": "odd"}
ARX = {"core": "arx", "nk": "0", "shift": "0.29"}


@pytest.fixture
def columns(begun, runs_file):
    page = begun(runs_file)
    page.wait("columns")
    return page


def fit(page, **asked):
    page.post("fit", **asked)
    page.wait("bench")
    return page.state()


def printed(page):
    """The figures that the copied script prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(page.client.get("/api/script.py").text, {})
    return [float(v) for v in re.findall(r"VAF, runs [a-z ]+: (\S+)", out.getvalue())]


@pytest.mark.parametrize(
    ("asked", "more", "model"),
    [
        ({}, [], OperatorRegressor()),
        (ARX, [DelayShift(0.29)], SimulatedARX()),
    ],
)
def test_the_page_fits_what_the_stock_pipeline_fits(columns, runs_file, asked, more, model):
    vaf = fit(columns, **THIN, **asked)["vaf"]["train"]
    steps = [RunInTrimmer(4.0), Decimator(2), *more]
    X, y = read_runs(str(runs_file))
    pipeline = make_pipeline(*steps, model).fit(X, y)
    settling = pipeline[-1].settling
    assert vaf == VAFScorer(run_in=settling or None)(pipeline, X, y)
    assert printed(columns) == [vaf]
    scored = columns.call("trace", run=1)["scored"]
    assert not scored[:200].any()  # of 50 Hz
    assert scored[200:].all()


@pytest.mark.parametrize("judged", [True])
def test_the_linear_part_has_the_delay_of_the_shift(columns, runs_file):
    measured = []
    for asked in ({**ARX, "shift": "", "nk": "7"}, ARX):
        fit(columns, **THIN, **asked)
        until(lambda: not columns.call("state")["state"]["ceiling_pending"])
        told = columns.call("linear")
        measured.append(told["measured"])
        columns.post("back")
    X, y = read_runs(str(runs_file))
    steps = RunInTrimmer(4.0), Decimator(2), DelayShift(0.29)
    pipeline = make_pipeline(*steps, SimulatedARX()).fit(X, y)
    phase = FrequencyResponse.of(pipeline, told["omega"]).phase
    assert told["responses"][0]["phase"] == pytest.approx(phase)
    assert not told["steps"][0]["output"][told["time"] < 0.27].any()
    one, other = (np.exp(1j * np.radians(m["phase"])) for m in measured)
    # What was measured does not depend on the steps, but that bands are turned at their middle; as
    # it is measured behind the shift it is turned by up to 160 degrees.
    assert np.abs(other - one).max() < 0.6


def test_the_script_reprints_the_figures_of_every_step(columns):
    fit(columns, **THIN, **ARX, until="18", remove_means=True)
    columns.call("use", runs=[2], use="hold")
    columns.call("add", effect="bias")
    script = columns.client.get("/api/script.py").text
    steps = "RunInTrimmer(run_in=4.0), Decimator(factor=2), DelayShift(delay=0.29"
    assert f"make_pipeline({steps}" in script
    assert columns.call("trace", run=0)["t"][-1] == pytest.approx(17.98)
    assert printed(columns) == list(columns.state()["vaf"].values())


def test_the_last_seconds_are_kept(columns, runs_file):
    vaf = fit(columns, measurement_time="10")["vaf"]["train"]
    X, y = read_runs(str(runs_file))
    pipeline = make_pipeline(RunInTrimmer(measurement_time=10.0), OperatorRegressor()).fit(X, y)
    assert vaf == VAFScorer(run_in=pipeline[-1].settling)(pipeline, X, y)
    assert printed(columns) == [vaf]


def test_the_steps_are_said(columns):
    assert columns.opening()["steps"] == "operator"
    told = columns.post("prepare", **THIN, core="arx", shift="0.1", until="19").json()
    assert told["steps"] == (
        "up to 19 s → run-in 4 s → one row in 2 (25 Hz) → delay 0.1 s → ARX 2, 2, 0"
    )
    told = columns.post("prepare", core="arx", na="3", remove_means=True).json()
    assert told["steps"] == "about the means → ARX 3, 2, nk is found"
    assert columns.opening()["steps"] == "operator"  # nothing was taken yet
    fit(columns, core="arx", na="3", run_in="2")
    found = columns.bench.exploration.estimator.nk
    assert columns.call("state")["state"]["preparation"] == f"run-in 2 s → ARX 3, 2, {found}"
    assert found > 0


def test_a_session_comes_back_prepared(columns, begun):
    before = fit(columns, **THIN, **ARX)
    view = columns.call("state")["state"]["preparation"]
    columns.bench.folder.give_back()
    page = begun(choices=Choices())
    page.wait("bench")
    assert same(page.state(), before)
    assert page.call("state")["state"]["preparation"] == view
    page.post("back")
    model = page.opening()["model"]
    assert [model[name] for name in ("run_in", "decimate", "padding", "shift")] == [
        4.0,
        2,
        "odd",
        0.29,
    ]


@pytest.mark.parametrize(
    ("asked", "field", "said"),
    [
        ({"run_in": "25"}, "run_in", "Run 0 lasts 20.48 s: give less."),
        ({"measurement_time": "25"}, "measurement_time", "lasts 20.48 s: give less."),
        ({"run_in": "1", "measurement_time": "5"}, "measurement_time", "not both"),
        ({"until": "0"}, "until", "above 0"),
        ({"core": "arx", "shift": "30"}, "shift", "lasts 20.48 s: give less."),
        ({"decimate": "0"}, "decimate", "at least 1"),
        ({"nk": "two"}, "nk", "whole number"),
    ],
)
def test_what_is_not_possible_is_said_of_its_field(columns, asked, field, said):
    told = columns.post("prepare", **asked).json()
    assert told["field"] == field
    assert said in told["message"]
    assert told["steps"] == ""
    columns.post("fit", **asked)
    assert columns.wait("columns")["phase"] == "columns"


def test_too_few_rows_for_the_parameters_are_said_of_the_factor(columns):
    columns.post("fit", decimate="400")
    found = columns.wait("columns")
    assert found["field"] == "decimate"
    assert found["message"].startswith("Too few rows are left.")
    columns.post("fit", decimate="2")
    assert columns.wait("bench")["message"] == ""


def test_a_run_that_begins_behind_the_end_is_said(begun, runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table["time"] += table["run"] * 21.0
    path = tmp_path / "on.csv"
    table.to_csv(path, index=False)
    page = begun(path)
    page.wait("columns")
    reply = page.post("prepare", until="20").json()
    assert reply["field"] == "until"
    assert "run 1, whose time begins at 21 s" in reply["message"]


def test_what_thinned_rows_cannot_hold_is_said(begun, runs, tmp_path):
    X, y = runs
    time = X.index.get_level_values("time").to_numpy()
    fast = y + 0.5 * y.std() * np.sin(2 * np.pi * 10 * time)  # a fifth of the power at 10 Hz
    path = tmp_path / "fast.csv"
    write_runs(X, fast.rename("stick"), path)
    page = begun(path)
    page.wait("columns")
    note = page.post("prepare", decimate="5", padding="odd").json()["note"]
    lost = float(re.match(r"([\d.]+) % of the output is above 5 Hz", note)[1])
    assert lost == pytest.approx(100 * 0.125 / 1.125, abs=1.0)
    assert page.post("prepare", decimate="2", padding="odd").json()["note"] == ""


def test_a_shift_needs_the_target_if_it_is_made_of_the_error(columns):
    asked = {"core": "arx", "shift": "0.1"}
    kinds = {"target": ""}
    columns.post("fit", **asked, kinds=kinds)
    found = columns.wait("columns")
    assert found["field"] == "shift"
    assert "which column the target is" in found["message"]
    fit(columns, **asked, kinds={"target": "", "pitch": ""})


def test_steps_are_prepared_from_the_files_read_once(columns):
    recorded = columns.bench.recorded
    fit(columns, **THIN)
    assert columns.bench.recorded is recorded
    assert isinstance(recorded.X.index, pd.MultiIndex)
    assert list(recorded.X.index.names) == ["run", "time"]
