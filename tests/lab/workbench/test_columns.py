"""Columns as guessed, and as corrected."""

import numpy as np
import pandas as pd
import pytest

import skhoid
from skhoid import OperatorRegressor
from skhoid.lab.workbench.columns import Choices, look, read, search_settings

ROWS = 400


@pytest.fixture
def table(runs):
    """The first run as a table with a header of its own for each column."""
    X, y = runs
    found = X.assign(stick=y).droplevel("run").reset_index().iloc[:ROWS]
    return found.rename(columns={"time": "t [s]", "pitch": "pitch [deg]"})


@pytest.fixture
def written(tmp_path):
    def write(table, name="a.csv"):
        path = tmp_path / name
        table.to_csv(path, index=False)
        return path

    return write


def kinds_of(columns):
    return {column["name"]: column["kind"] for column in columns.table}


def test_the_guess_is_a_table(table, written):
    columns = look([written(table)], Choices())
    assert kinds_of(columns) == {
        "t [s]": "time",
        "error": "e",
        "pitch [deg]": "x",
        "target": "f_t",
        "stick": "u",
    }
    by_name = {column["name"]: column for column in columns.table}
    assert by_name["pitch [deg]"]["unit"] == "deg"
    assert by_name["t [s]"]["first"] == "0, 0.02, 0.04"
    points = by_name["error"]["points"]
    assert min(points) == 0.0
    assert max(points) == 1.0
    assert columns.problems == []
    assert columns.asked == {}


def test_what_the_page_sends_back_unchanged_is_the_guess(table, written):
    path = written(table)
    first = look([path], Choices())
    units = {column["name"]: column["unit"] for column in first.table}
    again = look([path], Choices(kinds=kinds_of(first), units=units))
    assert again.guess == first.guess
    assert again.asked == {}


def test_columns_are_corrected(table, written):
    paths = [written(table.assign(other=table["stick"] ** 2))]
    before = kinds_of(look(paths, Choices()))
    kinds = before | {"stick": "", "other": "u", "target": ""}
    choices = Choices(kinds=kinds, units={"other": "N"})
    columns = look(paths, choices)
    assert kinds_of(columns) == kinds
    assert columns.asked
    recorded = read(paths, columns, choices)
    assert recorded.roles == {"error": "e", "pitch": "x"}
    assert recorded.y.to_list() == (table["stick"] ** 2).to_list()
    assert recorded.y.attrs["units"] == {"other": "N"}
    assert recorded.X.attrs["units"] == {"pitch": "deg"}
    assert recorded.inputs == ["error"]


def test_the_script_reads_the_same(table, written):
    plain = [written(table)]
    numbered = written(
        pd.concat([table, table]).assign(who=["S1"] * ROWS + ["S2"] * ROWS), "people.csv"
    )
    restarting = written(pd.concat([table, table]), "two.csv")
    signs = written(table.assign(error=-table["error"]), "signs.csv")
    rounded = written(table.assign(**{"t [s]": (np.arange(ROWS) * 0.0204).round(2)}), "ticks.csv")
    swapped = {"pitch [deg]": "other"}
    for paths, choices in (
        (plain, Choices()),
        (plain, Choices(kinds=swapped)),
        (plain, Choices(kinds={"error": "", "pitch [deg]": "x"}, units={"target": "deg"})),
        (plain, Choices(kinds={"t [s]": ""}, dt=0.02)),
        (plain, Choices(resample=True, dt=0.04)),
        ([numbered], Choices(kinds={"who": "subject"}, subject="S2")),
        ([restarting], Choices(kinds=swapped)),
        ([signs], Choices(resample=True, dt=0.02)),
        ([rounded], Choices(kinds=swapped)),
    ):
        recorded = read(paths, look(paths, choices), choices)
        assert "guess" not in "".join(recorded.source)  # public names alone
        names = {name: getattr(skhoid, name) for name in skhoid.__all__}
        exec("\n".join(recorded.source), names)
        pd.testing.assert_frame_equal(names["X"], recorded.X)
        pd.testing.assert_series_equal(names["y"], recorded.y)
        assert names["X"].attrs == recorded.X.attrs


def test_without_an_error_it_is_formed(table, written):
    paths = [written(table.drop(columns="error"))]
    choices = Choices(kinds={"pitch [deg]": "x", "target": "f_t"}, units={"target": "deg"})
    recorded = read(paths, look(paths, choices), choices)
    assert recorded.inputs == ["e"]
    difference = (table["target"] - table["pitch [deg]"]).to_numpy()
    assert recorded.X["e"].to_numpy() == pytest.approx(difference, abs=0)


def test_several_motions_are_several_channels(table, written):
    paths = [written(table.assign(roll=table["error"] * 2, yaw=table["error"] ** 2))]
    choices = Choices(kinds={"roll": "motion", "yaw": "motion", "target": "other"})
    columns = look(paths, choices)
    assert kinds_of(columns) | choices.kinds == kinds_of(columns)
    recorded = read(paths, columns, choices)
    assert recorded.roles["roll"] == recorded.roles["yaw"] == "motion"
    OperatorRegressor(inputs=["error"], roles=recorded.roles).fit(recorded.X, recorded.y)


def test_an_unclear_guess_is_said_beside_its_columns(table, written):
    unclear = table.rename(columns={"stick": "abc"}).assign(xyz=table["stick"] * 1.5 + 1)
    columns = look([written(unclear)], Choices())
    (problem,) = columns.problems
    assert "output u" in problem["text"]
    assert {offer["column"] for offer in problem["offers"]} == {"abc", "xyz"}
    assert {offer["kind"] for offer in problem["offers"]} == {"u"}
    noted = {column["name"] for column in columns.table if column["note"]}
    assert noted == {"abc", "xyz"}
    settled = look([written(unclear)], Choices(kinds={"xyz": "u"}))
    assert settled.problems == []
    assert settled.guess.output[0] == "xyz"


def test_a_channel_is_one_column(table, written):
    columns = look([written(table)], Choices(kinds={"target": "u"}))
    assert '"target" and "stick" are both called output u' in columns.problems[0]["text"]


def test_a_sampling_time_replaces_the_clock(table, written):
    paths = [written(table)]
    for kinds in (None, {"target": ""}):
        choices = Choices(dt=0.01, kinds=kinds)
        columns = look(paths, choices)
        assert kinds_of(columns)["t [s]"] == ""
        X = read(paths, columns, choices).X
        assert X.index.get_level_values("time")[1] == 0.01


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"kinds": {"no": "e"}}, "no column 'no'"),
        ({"kinds": {"a": "king"}}, "cannot be 'king'"),
        ({"units": {"a": "m" * 1000}}, "too long"),
        ({"dt": "fast"}, "above 0, in seconds; got 'fast'"),
        ({"core": "black box"}, "no core 'black box'"),
        ({"run_in": -1}, "run-in must be a number 0 or more, in seconds; got -1"),
        ({"run_in": 1, "measurement_time": 2}, "not both"),
        ({"decimate": "2.5"}, "whole number, at least 1; got '2.5'"),
        ({"method": "magic"}, "no filter 'magic'"),
    ],
)
def test_what_the_page_sends_is_checked(asked, said):
    with pytest.raises(ValueError, match=said):
        Choices().corrected(asked, ["a", "b"])


def test_the_search_is_what_was_chosen():
    assert search_settings(Choices()) == {"lost_control": "leave_out", "exhaustive": False}
    chosen = Choices(display="pursuit", effects=["bias"], controlled_element="1/(s(s+1))")
    settings = search_settings(chosen)
    assert settings["effects"] == ["bias"]
    assert settings["display"] == "pursuit"
    assert "s" in str(settings["controlled_element"])
    both = search_settings(Choices(controlled_element="1.5 0.2"))["controlled_element"]
    assert (both.K_c, both.omega_b) == (1.5, 0.2)


def test_an_irregular_clock_is_brought_onto_a_grid(runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table["time"] += [0.004 * (row % 3) for row in range(len(table))]
    path = tmp_path / "a.csv"
    table.to_csv(path, index=False)
    choices = Choices(resample=True, dt=0.02)
    recorded = read([path], look([path], choices), choices)
    names = {}
    exec("\n".join(["from skhoid import read_runs, resample_runs", *recorded.source]), names)
    assert names["X"].equals(recorded.X)
    assert names["y"].equals(recorded.y)


def test_one_of_several_people(runs, tmp_path):
    X, y = runs
    table = X.assign(stick=y).reset_index()
    table.insert(0, "subject", ["AB"[row >= 1024] for row in range(len(table))])
    path = tmp_path / "a.csv"
    table.to_csv(path, index=False)
    choices = Choices(subject="B")
    recorded = read([path], look([path], choices), choices)
    assert recorded.words.startswith("2 runs, 2048 rows")
    everyone = read([path], look([path], Choices()), Choices())
    assert everyone.words.startswith("3 runs of 2 people, 3072 rows")
    with pytest.raises(ValueError, match="no subject 'C' in the files, only 'A', 'B'"):
        read([path], look([path], Choices()), Choices(subject="C"))
