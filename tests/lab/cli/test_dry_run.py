"""``skhoid diagnose FILE --dry-run``: what was understood, and nothing is fitted."""

from __future__ import annotations

import json
import time

import numpy as np
import pandas as pd
import pytest

from skhoid import EffectSearchCV, OperatorRegressor, make_tracking_runs, write_runs
from skhoid.lab.cli import main

RUNS = make_tracking_runs(
    "C1", n_runs=3, duration=20, sampling_rate=25, channels=["e", "x", "f_t"], random_state=0
)


@pytest.fixture(autouse=True)
def fits_nothing(monkeypatch):
    def fail(*_, **__):
        raise AssertionError("something was fitted")

    monkeypatch.setattr(EffectSearchCV, "fit", fail)
    monkeypatch.setattr(OperatorRegressor, "first_fit", fail)


def dry(capsys, path, *options):
    code = main(["diagnose", str(path), "--dry-run", *options])
    return code, capsys.readouterr()


def test_columns_clock_runs_and_what_would_be_tried(tmp_path, capsys):
    path = write_runs(*RUNS, tmp_path / "a.csv")
    start = time.perf_counter()
    code, said = dry(capsys, path, "--out", str(tmp_path / "pictures"))
    assert time.perf_counter() - start < 10
    assert code == 0
    text = " ".join(said.out.split())
    for part in (
        'time "time", run "run", error e "e", target f_t "f_t", x "x", output u "u"',
        f"3 runs, {len(RUNS[1])} rows at 25 Hz",
        "The sampling time is 0.04 s, and steps of the clock differ from it by at most 0.0 %.",
        "What the check of the channels finds Nothing.",
        "feedforward",
        "It would take about",
    ):
        assert part in text
    assert (tmp_path / "pictures" / "first-seconds.png").stat().st_size > 1000


def as_it_is(frame):
    return frame


def holes(frame):
    return frame.assign(u=frame["u"].where(~frame.index.isin([5, 6, 900])))


def gap(frame):
    return frame.drop(frame.index[100:140])


def jitter(frame):
    return frame.assign(time=frame["time"] + np.random.default_rng(0).uniform(0, 1e-3, len(frame)))


def of_no_target(frame):
    return frame.drop(columns=["f_t", "x"])


@pytest.mark.parametrize(
    ("change", "where", "expected"),
    [
        (holes, lambda f: f["signals"]["u"]["missing"], 3),
        (holes, lambda f: [run["missing"] for run in f["runs"]], [2, 1, 0]),
        (gap, lambda f: [run["gaps"] for run in f["runs"]], [1, 0, 0]),
        pytest.param(
            jitter,
            lambda f: 0.005 < f["clock"]["jitter"] < 0.03,
            True,
            marks=pytest.mark.filterwarnings("default"),
        ),
        (of_no_target, lambda f: "feedforward" in f["not_tried"], True),
        (as_it_is, lambda f: f["signals"]["f_t"]["role"], "f_t"),
        (as_it_is, lambda f: f["clock"]["dt_s"], pytest.approx(0.04)),
    ],
)
def test_as_json(tmp_path, capsys, change, where, expected):
    frame = RUNS[0].assign(u=RUNS[1]).reset_index()
    change(frame).to_csv(tmp_path / "a.csv", index=False)
    code, said = dry(capsys, tmp_path / "a.csv", "--json", "--no-pictures")
    assert code == 0
    assert where(json.loads(said.out)) == expected


@pytest.mark.parametrize("options", [["--core", "arx"], ["--effects", "bias"], ["--run-in", "2"]])
def test_other_models(tmp_path, capsys, options):
    path = write_runs(*RUNS, tmp_path / "a.csv")
    code, said = dry(capsys, path, "--json", "--no-pictures", *options)
    assert code == 0
    found = json.loads(said.out)
    least, most = found["seconds"]
    assert 0 < least <= most
    assert found["tried"] == ["bias"] or len(found["tried"]) > 5


def test_more_is_said_to_take_longer(tmp_path, capsys):
    path = write_runs(*RUNS, tmp_path / "a.csv")
    took = []
    for options in (["--effects", "bias"], []):
        _, said = dry(capsys, path, "--json", "--no-pictures", *options)
        took.append(json.loads(said.out)["seconds"][0])
    assert took[1] > 5 * took[0]


def test_what_is_unclear_is_said_as_ever_and_results_are_refused(tmp_path, capsys):
    pd.DataFrame({"a": [1.0, 2.0], "b": [2.0, 1.0]}).to_csv(tmp_path / "a.csv", index=False)
    code, said = dry(capsys, tmp_path / "a.csv", "--no-pictures")
    assert code == 2
    assert "a          2      1     2          0" in said.out
    assert "problems" in said.err
    code, said = dry(capsys, tmp_path / "a.csv", "--report", str(tmp_path / "r.html"))
    assert code == 2
    assert "--report is for results, and --dry-run has none" in said.err


@pytest.mark.parametrize("command", ["diagnose", "identify", "report"])
def test_help_begins_with_what_people_use(capsys, command):
    with pytest.raises(SystemExit):
        main([command, "--help"])
    said = capsys.readouterr().out
    head, _, rest = said.partition("What people use:")[2].partition("\nData:")
    for option in ("FILES", "--input", "--output", "--target", "--time", "--dt", "--run-in"):
        assert option in head
    assert head.count("\n  --") <= 10
    assert "--unit" in rest


@pytest.mark.filterwarnings("default::skhoid.exceptions.PooledRunsWarning")
@pytest.mark.parametrize(
    ("names", "people"),
    [
        (("anna_run1", "anna_run2", "ben_run1"), "anna, ben"),
        (("run1", "run2", "run3"), ""),
        (("monday", "tuesday", "friday"), ""),
    ],
)
def test_files_of_several_people_are_not_taken_for_one_without_a_word(
    tmp_path, capsys, names, people
):
    X, y = RUNS
    for number, name in enumerate(names):
        table = X.loc[number].assign(u=y.loc[number]).reset_index()
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    code, said = dry(capsys, f"{tmp_path}/*.csv", "--no-pictures")
    assert code == 0
    text = " ".join(said.err.split())
    assert ("tell 2 people or conditions apart" in text) == bool(people)
    assert people in text
