"""Excel, Feather and Parquet files, folders, and several files of one run."""

from __future__ import annotations

from itertools import product

import numpy as np
import pandas as pd
import pytest

from skhoid import read_runs
from skhoid.lab.cli import main
from skhoid.lab.guessing import guess_columns, read_guessed

DT = 0.01


def recording(seed, n=300):
    e, u = np.cumsum(np.random.default_rng(seed).standard_normal((2, n)), axis=1) / 10
    return pd.DataFrame({"time": np.arange(n) * DT, "error": e, "stick": u})


ONE = recording(0)
SEVERAL = [recording(seed, 300 + 20 * seed) for seed in range(3)]


def write_csv(frame, path):
    path.parent.mkdir(parents=True, exist_ok=True)
    frame.to_csv(path, index=False)


def check(paths, expected, said=""):
    X, y = read_runs(paths)
    whole = pd.concat(expected)
    np.testing.assert_allclose(X["e"], whole["error"])
    np.testing.assert_allclose(y, whole["stick"])
    np.testing.assert_allclose(X.index.get_level_values("time"), whole["time"], atol=1e-9)
    assert X.index.droplevel("time").nunique() == len(expected)
    return X


def in_date(frame):
    stamps = pd.Timestamp("2024-05-01 10:00") + pd.to_timedelta(frame["time"], unit="s")
    return frame.assign(time=stamps)


def in_duration(frame):
    return frame.assign(time=pd.to_timedelta(frame["time"], unit="s"))


@pytest.mark.parametrize("change", [pd.DataFrame.copy, in_date, in_duration])
@pytest.mark.parametrize("kind", ["parquet", "feather"])
def test_tables_of_arrow(tmp_path, kind, change):
    getattr(change(ONE), f"to_{kind}")(tmp_path / f"a.{kind}")
    check(tmp_path / f"a.{kind}", [ONE])


def with_units(frame):
    return pd.concat([pd.DataFrame({"time": ["s"], "error": ["deg"], "stick": ["V"]}), frame])


class TestExcel:
    @pytest.fixture(autouse=True)
    def needs_openpyxl(self):
        pytest.importorskip("openpyxl")

    @pytest.mark.parametrize("change", [pd.DataFrame.copy, with_units, in_date])
    @pytest.mark.parametrize("row", [0, 4])
    def test_a_sheet(self, tmp_path, change, row):
        with pd.ExcelWriter(tmp_path / "a.xlsx") as book:
            change(ONE).to_excel(book, index=False, startrow=row)
            if row:
                book.sheets["Sheet1"]["A1"] = "Measured on a Tuesday, by Smith"
        check(tmp_path / "a.xlsx", [ONE])

    def test_sheets_are_runs_and_one_can_be_chosen(self, tmp_path, capsys):
        path = tmp_path / "a.xlsx"
        with pd.ExcelWriter(path) as book:
            for number, frame in enumerate(SEVERAL, 1):
                frame.to_excel(book, sheet_name=f"Run {number}", index=False)
            pd.DataFrame({"subject": ["S1"], "age": [20]}).to_excel(book, sheet_name="Info")
        X = check(path, SEVERAL)
        assert list(X.index.unique("run")) == ["Run 1", "Run 2", "Run 3"]
        assert 'sheets with other columns are not read: "Info"' in capsys.readouterr().out
        check(f"{path}#Run 2", SEVERAL[1:2])
        asked = ["diagnose", str(path), "--dry-run", "--no-pictures", "--sheet"]
        assert main([*asked, "Run 2"]) == 0
        assert "1 run, 320 rows" in capsys.readouterr().out
        assert main([*asked, "Run 9"]) == 2
        assert "no sheet 'Run 9', only 'Run 1'" in capsys.readouterr().err


def test_a_missing_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    (tmp_path / "a.xlsx").touch()
    with pytest.raises(ImportError, match=r'openpyxl: pip install "skhoid\[excel\]"'):
        read_runs(tmp_path / "a.xlsx")


class TestFolder:
    def test_each_file_is_a_run(self, tmp_path):
        (tmp_path / "notes.txt").write_text("nothing here\n")
        (tmp_path / ".hidden.csv").write_text("a,b\n")
        for number, frame in zip((1, 2, 10), SEVERAL, strict=True):
            write_csv(frame, tmp_path / f"run{number}.csv")
        X = check(tmp_path, SEVERAL)
        assert list(X.index.unique("run")) == ["run1", "run2", "run10"]

    @pytest.mark.parametrize(
        ("names", "levels"),
        [
            (["S1/run1", "S2/run1", "S3/run1"], ["subject", "run"]),
            (["S1/lead_1", "S1/gain_1", "S2/lead_1"], ["subject", "condition", "run"]),
            (["sub-a/1", "sub-b/1", "sub-b/2"], ["subject", "run"]),
            (["monday/x", "x", "tuesday/x"], ["run"]),  # names that say no level
        ],
    )
    def test_subfolders(self, tmp_path, names, levels):
        for name, frame in zip(names, SEVERAL, strict=True):
            write_csv(frame, tmp_path / f"{name}.csv")
        X, _ = read_runs(tmp_path)
        assert list(X.index.names) == [*levels, "time"]
        assert len(X) == sum(map(len, SEVERAL))

    def test_on_the_command_line(self, tmp_path, capsys):
        for name, frame in zip(("S1/run1", "S1/run2", "S2/run1"), SEVERAL, strict=True):
            write_csv(frame, tmp_path / f"{name}.csv")
        asked = ["diagnose", str(tmp_path), "--dry-run", "--no-pictures"]
        assert main([*asked, "--subject", "S1"]) == 0
        assert "2 runs, 620 rows" in capsys.readouterr().out


def split(frame, folder, name, header=None):
    """One file for each signal."""
    for signal in ("error", "stick"):
        own = frame[["time", signal]].rename(columns={signal: header or signal})
        write_csv(own, folder / name.format(signal))


ONE_SIGNAL_A_FILE = {
    "by header": ("{}.csv", None),
    "by name of the file": ("{}.csv", "value"),
    "before the run": ("{}_s01.csv", "value"),
    "after the run": ("s01-run_1-{}.csv", "data"),
}


@pytest.mark.parametrize(("name", "header"), ONE_SIGNAL_A_FILE.values(), ids=ONE_SIGNAL_A_FILE)
def test_signals_of_one_run(tmp_path, capsys, name, header):
    split(ONE, tmp_path, name, header)
    check(tmp_path, [ONE])
    assert "2 files are one run, joined by their clock" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "header"),
    [
        *product(["{{}}_run{}.csv", "run{}_{{}}.csv", "run{}/{{}}.csv"], [None, "value"]),
        ("{{}}{}.csv", None),
    ],
)
def test_signals_of_several_runs(tmp_path, name, header):
    for number, frame in enumerate(SEVERAL, 1):
        split(frame, tmp_path, name.format(number), header)
    check(tmp_path, SEVERAL)


def test_signals_without_a_clock_and_of_other_clocks(tmp_path, capsys):
    for signal in ("error", "stick"):
        write_csv(ONE[[signal]], tmp_path / "a" / f"{signal}.csv")
    X, _ = read_runs(tmp_path / "a", dt=DT)
    np.testing.assert_allclose(X["e"], ONE["error"])
    assert "row by row" in capsys.readouterr().out
    # Of a robot: a file for each topic, with stamps in ns of its own.
    stamps = np.round((1.7e9 + ONE["time"]) * 1e9).astype(np.int64)
    for signal, rows in (("error", slice(0, 290)), ("stick", slice(5, 300))):
        topic = pd.DataFrame({"%time": stamps, "field.data": ONE[signal]})[rows]
        write_csv(topic, tmp_path / "b" / f"{signal}.csv")
    X, y = read_runs(tmp_path / "b")
    assert "interpolated onto one clock" in capsys.readouterr().out
    assert np.diff(X.index.get_level_values("time")) == pytest.approx(DT, rel=1e-4)
    n = len(y)
    assert n in (284, 285)  # stamps in ns are rounded to 256 of them
    np.testing.assert_allclose(X["e"], ONE["error"][5 : 5 + n], atol=1e-3)
    np.testing.assert_allclose(y, ONE["stick"][5 : 5 + n], atol=1e-3)


@pytest.mark.parametrize("every", [1, 2, 5])
@pytest.mark.parametrize("beside", [False, True])
def test_rows_of_one_topic_each(tmp_path, capsys, every, beside):
    """Exports of ROS bags and MCAP: an empty cell where another topic was received."""
    stick = ONE[["time", "stick"]].assign(time=ONE["time"] + 0.004)[::every]
    table = pd.concat([ONE[["time", "error"]], stick]).sort_values("time")
    table = table.rename(columns={"time": "__time", "error": "/error/data", "stick": "/stick/data"})
    if beside:
        table = table.assign(**{"/rosout/msg": "text", "/mode": np.where(ONE.index[0] == 0, 1, 0)})
    table.to_csv(tmp_path / "a.csv", index=False)
    X, y = read_runs(tmp_path / "a.csv")
    assert "each row has values of one topic" in capsys.readouterr().out
    time = X.index.get_level_values("time").to_numpy() + 0.01
    np.testing.assert_allclose(np.diff(time), DT, atol=1e-6)
    np.testing.assert_allclose(X["e"], np.interp(time, ONE["time"], ONE["error"]), atol=1e-9)
    np.testing.assert_allclose(y, np.interp(time, stick["time"], stick["stick"]), atol=1e-9)


@pytest.mark.parametrize("signal", ["error", "stick"])
def test_a_table_with_many_empty_cells_stays_as_it_is(tmp_path, signal):
    table = ONE.assign(event=np.where(np.arange(len(ONE)) % 50, np.nan, 1.0))
    table.loc[40:200, signal] = np.nan
    table.to_csv(tmp_path / "a.csv", index=False)
    X, y = read_runs(tmp_path / "a.csv")
    assert len(X) == len(ONE)
    assert (X["e"] if signal == "error" else y).isna().sum() == 161


def test_signals_of_other_lengths_without_a_clock_are_refused(tmp_path):
    write_csv(ONE[["error"]], tmp_path / "error.csv")
    write_csv(ONE[["stick"]][:200], tmp_path / "stick.csv")
    with pytest.raises(ValueError, match="200 and 300 rows and not all have a clock"):
        read_runs(tmp_path, dt=DT)


def test_runs_of_all_signals_stay_runs(tmp_path):
    for number, frame in enumerate(SEVERAL):
        write_csv(frame, tmp_path / f"stick_{number}.csv")
    guess = guess_columns(tmp_path)
    X, _ = read_guessed(guess)
    assert X.index.unique("run").size == 3
    assert not any("one run" in remark for remark in guess.remarks)
