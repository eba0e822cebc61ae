"""check_experiment: a clean experiment is quiet, and a planted fault is named with its person."""

import numpy as np
import pandas as pd
import pytest
from support.experiments import people_in_the_loop

from skhoid import simulate_experiment
from skhoid.recordings import check_experiment


@pytest.fixture(scope="module")
def clean():
    return people_in_the_loop()


@pytest.fixture
def data(clean):
    return tuple(table.copy() for table in clean)


def rows(table, **labels):
    found = np.ones(len(table), dtype=bool)
    for level, label in labels.items():
        found &= np.asarray(table.index.get_level_values(level) == label)
    return found


def found(check):
    return [
        tuple(row) for row in check.findings[["subject", "condition", "runs", "name"]].to_numpy()
    ]


def test_a_clean_experiment(clean):
    check = check_experiment(*clean)
    assert check.ok
    assert found(check) == []
    assert check.table.columns.to_list() == [
        "subject", "condition", "runs", "rows", "shortest", "longest", "dt", "missing", "wrong",
    ]  # fmt: skip
    assert check.table[["runs", "rows"]].to_numpy().tolist() == [[2, 2000]] * 8
    np.testing.assert_allclose(check.table["dt"], 0.02)
    np.testing.assert_allclose(check.table["longest"], 19.98)
    text = str(check.summary())
    assert text.startswith("Experiment: 4 people, 2 conditions, 16 runs, 16000 rows")
    assert text.endswith("Nothing looks wrong.")
    assert "4 people" in repr(check)
    assert "Nothing looks wrong." in check._repr_html_()


def invert(X, y):
    y[rows(y, subject="S2")] *= -1


def invert_one_run(X, y):
    y[rows(y, subject="S2", condition="C2", run=2)] *= -1


def in_radians(X, y):
    y[rows(y, subject="S3")] *= np.pi / 180


def in_thousandths(X, y):
    X.loc[rows(X, subject="S3", condition="C1"), "f_t"] *= 1000


def exchange(X, y):
    own = rows(X, subject="S4")
    target = X.loc[own, "f_t"].copy()
    X.loc[own, "f_t"] = y[own]
    y[own] = target


def twice(X, y):
    one, other = (rows(X, subject=s, condition="C1", run=1) for s in ("S1", "S3"))
    X.loc[other] = X[one].to_numpy()
    y[other] = y[one].to_numpy()


FAULTS = [
    (invert, [("S2", "all", "all", "opposite sign")]),
    (invert_one_run, [("S2", "C2", "2", "opposite sign")]),
    (in_radians, [("S3", "all", "all", "gain")]),
    (in_thousandths, [("S3", "C1", "all", "gain")]),
    (exchange, [("S4", "all", "all", "swapped channels")]),
    (twice, [("S1 and S3", "C1", "1", "same data")]),
]


@pytest.mark.parametrize(("plant", "expected"), FAULTS)
def test_planted_in_signals(data, plant, expected):
    plant(*data)
    X, y = data
    check = check_experiment(X.drop(columns="x"), y)  # without it no check knows e = f_t - x
    assert found(check) == expected
    assert expected[0][0].split()[0] in str(check.summary())


def without(X, y, gone):
    return X[~gone], y[~gone]


def test_missing_and_short_runs(data):
    X, y = data
    check = check_experiment(*without(X, y, rows(X, subject="S2", condition="C1", run=2)))
    assert found(check) == [("S2", "C1", "2", "missing runs")]
    check = check_experiment(*without(X, y, rows(X, subject="S2", condition="C1")))
    assert found(check) == [("S2", "C1", "all", "missing runs")]
    late = np.asarray(X.index.get_level_values("time") > 5)
    check = check_experiment(*without(X, y, rows(X, subject="S2", condition="C1", run=2) & late))
    assert found(check) == [("S2", "C1", "2", "short run")]
    assert check.table["wrong"].to_list() == ["", "", "short run", "", "", "", "", ""]
    assert check.table["shortest"][2] == pytest.approx(5.0)


def with_time(table, factor, own):
    index = table.index.to_frame()
    index.loc[own, "time"] *= factor
    return table.set_axis(pd.MultiIndex.from_frame(index), axis=0)


def test_clocks(data):
    X, y = data
    own = rows(X, subject="S2", condition="C2")
    check = check_experiment(with_time(X, 1000.0, own), with_time(y, 1000.0, own))
    assert found(check) == [("S2", "C2", "all", "clock")]
    assert check.findings["title"][0] == "The clock of S2 looks like ms, read as s"
    gone = rows(X, subject="S2") & (np.arange(len(X)) % 2 == 1)
    check = check_experiment(*without(X, y, gone))
    assert found(check) == [("S2", "all", "all", "clock")]
    assert check.findings["title"][0] == "S2 was recorded at another rate, 25 Hz"


def test_a_fault_of_all_is_told_once(data):
    X, y = data
    X["battery"] = 5.0
    check = check_experiment(X, y)
    assert found(check) == [("all", "all", "all", "constant channel")]
    assert set(check.table["wrong"]) == {"constant channel"}
    X.loc[rows(X, subject="S1"), "battery"] = np.arange(rows(X, subject="S1").sum()) % 97
    assert [row[0] for row in found(check_experiment(X, y))] == ["S2", "S3", "S4"]


def test_one_person_or_no_output(data):
    X, y = data
    own = X.loc["S1"], y.loc["S1"]
    check = check_experiment(*own)
    assert check.table["subject"].unique().tolist() == ["all"]
    assert check.ok
    assert check_experiment(X[["e", "f_t"]]).ok
    with pytest.raises(ValueError, match="must have the row index levels run and time"):
        check_experiment(X.reset_index())
    with pytest.raises(ValueError, match="no rows"):
        check_experiment(X[:0])


def test_nearly_lost_control_is_no_unit(data):
    X, y = data
    own = rows(X, subject="S2")
    X.loc[own, ["e", "x"]] *= 9
    y[own] *= 9
    check = check_experiment(X, y)
    assert "gain" not in set(check.findings["name"])


@pytest.mark.slow
def test_clean_experiments_are_quiet():
    X, y = simulate_experiment(3, ["C1", "C6"], 2, duration=40, random_state=0)
    assert check_experiment(X, y).findings.empty
    assert check_experiment(X[["e"]], y).findings.empty
