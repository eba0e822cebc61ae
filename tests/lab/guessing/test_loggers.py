"""Text files as loggers of labs write them: what is left out, taken or sorted is said."""

import numpy as np
import pandas as pd
import pytest

from skhoid import read_experiment, read_runs
from skhoid.lab.guessing import guess_columns

from .test_text_layouts import LOOP, TIME, check, of, rows

N = len(TIME)
BODY = rows(of("t e u"))


def written(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("scale", [1e3, 1e6, 1e9])
def test_a_named_clock_has_the_unit_that_its_steps_say(tmp_path, capsys, scale):
    stamps = np.round(1.7e6 * scale + TIME * scale)
    path = written(
        tmp_path / "a.csv", "stamp,e,u\n" + rows(of("t e u", time=stamps), form="{:.17g}")
    )
    every = {"time": "stamp", "inputs": "e", "output": "u"}
    for read, given in (
        (read_runs, {"time": "stamp"}),
        (read_runs, every),
        (read_experiment, every),
    ):
        X, _ = read(path, **given)
        assert np.median(np.diff(X.index.get_level_values("time"))) == pytest.approx(0.02)
        assert "as it advances by" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["run1.lvm", "run1.xyz", "run1", "run1.001"])
def test_text_of_any_extension(tmp_path, name):
    check(written(tmp_path / name, "t,e,u\n" + BODY))
    check(tmp_path)


def test_other_files_of_unknown_extension_are_refused(tmp_path):
    path = tmp_path / "run.xyz"
    path.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(ValueError, match="is no text"):
        read_runs(path)


ENDS = {
    "cut off": ("60.0,1", 1),
    "cut off in the clock": ("60", 1),
    "a comment of words": ("\nend of the recording\n", 1),
    "a summary with numbers": ("\n\nMean of e,0.1,deg\nCrashes,none,0\n", 2),
    "statistics": ("Mean,0.1,0.2\nMax,3,4\n", 2),
    "empty cells": (",,\n,,\n", 2),
    "one cell of words": ("stopped by: operator,,\n", 1),
}


@pytest.mark.parametrize("end", ENDS)
def test_what_stands_below_the_rows_is_left_out(tmp_path, capsys, end):
    text, count = ENDS[end]
    check(written(tmp_path / "a.csv", "t,e,u\n" + BODY + text))
    assert f"{count} line{'s' * (count > 1)} below the rows, from line" in capsys.readouterr().out


def test_words_between_rows_are_an_error(tmp_path):
    half = len(BODY) // 2
    middle = BODY.index("\n", half) + 1
    path = written(tmp_path / "a.csv", "t,e,u\n" + BODY[:middle] + "a,pause,here\n" + BODY[middle:])
    with pytest.raises(ValueError, match="not numeric"):
        read_runs(path, time="t", inputs="e", output="u")


@pytest.mark.parametrize("between", ["", "\n", "\nTrial 2,,\n", "# next\n"])
def test_a_header_that_comes_again_begins_a_run(tmp_path, capsys, between):
    block = "t,e,u\n[s],[deg],[V]\n" + BODY
    X, _ = check(written(tmp_path / "a.csv", block + between + block), n_runs=2)
    assert "its header stands 2 times" in capsys.readouterr().out
    assert X.attrs["units"]["e"] == "deg"


@pytest.mark.parametrize("width", [3, 5])
def test_another_table_below_is_not_read(tmp_path, capsys, width):
    header = ",".join(f"marker{k}" for k in range(width))
    other = "\nMarkers\n100\n" + header + "\n" + rows(np.arange(5.0 * width).reshape(width, 5))
    check(written(tmp_path / "a.csv", "t,e,u\n" + BODY + other))
    assert "another table of" in capsys.readouterr().out


def test_a_counter_of_rows_beside_a_clock(tmp_path):
    columns = [np.arange(1.0, N + 1), TIME, LOOP["e"], LOOP["u"]]
    check(written(tmp_path / "a.csv", "A1,A2,e,u\n" + rows(columns)))


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_of_two_clocks_the_more_even_one(tmp_path, capsys, order):
    late = TIME + np.random.default_rng(0).uniform(0, 0.008, N)
    clocks = [("receive_time", late), ("stamp", TIME)]
    (one, first), (other, second) = (clocks[k] for k in order)
    columns = [first, second, LOOP["e"], LOOP["u"]]
    check(written(tmp_path / "a.csv", f"{one},{other},e,u\n" + rows(columns)))
    said = capsys.readouterr().out
    assert 'time "stamp"' in said
    assert '"receive_time" could be the time too' in said


@pytest.mark.parametrize(("dt", "form"), [(0.025, "{:.4g}"), (1 / 30, "{:.2f}"), (0.25, "{:.1f}")])
def test_a_clock_of_few_digits_is_even(tmp_path, capsys, dt, form):
    time = np.arange(N) * dt
    lines = [
        f"{form.format(t)},{e:.7g},{u:.7g}"
        for t, e, u in zip(time, LOOP["e"], LOOP["u"], strict=True)
    ]
    X, _ = read_runs(written(tmp_path / "a.csv", "t,e,u\n" + "\n".join(lines)))
    steps = np.diff(X.index.get_level_values("time"))
    np.testing.assert_allclose(steps, dt, rtol=1e-4)
    assert "is taken as even" in capsys.readouterr().out


def test_a_lost_row_is_no_few_digits(tmp_path):
    time = np.delete(np.arange(N + 1) * 0.025, 2000)
    columns = [np.round(time, 2), LOOP["e"], LOOP["u"]]
    with pytest.raises(ValueError, match="Irregular sampling"):
        read_runs(written(tmp_path / "a.csv", "t,e,u\n" + rows(columns)))


def test_what_a_serial_monitor_writes(tmp_path, capsys):
    wall = pd.Timestamp("2024-01-01 23:59:40") + pd.to_timedelta(TIME, unit="s")
    stamps = list(wall.strftime("%H:%M:%S.%f").str[:-3])
    lines = [f"{s} -> {line}" for s, line in zip(stamps, BODY.splitlines(), strict=True)]
    header = f"{stamps[0]} -> t,e,u"
    check(written(tmp_path / "a.txt", "\n".join([header, *lines])))
    own = [f"{s} -> {e:.7g};{u:.7g}" for s, e, u in zip(stamps, LOOP["e"], LOOP["u"], strict=True)]
    check(written(tmp_path / "b.txt", "\n".join([f"{stamps[0]} -> e;u", *own])))
    assert 'time "arrival time"' in capsys.readouterr().out


def test_names_that_are_numbers_above_units(tmp_path):
    path = written(tmp_path / "a.csv", "x-axis,1,2\nsecond,Volt,Volt\n" + BODY)
    X, y = read_runs(path, inputs="1", output="2")
    np.testing.assert_allclose(X["1"], LOOP["e"], atol=1e-5)
    assert y.attrs["units"] == {"2": "Volt"}


def test_equal_columns_of_one_name_are_one(tmp_path, capsys):
    columns = of("t f_t f_t x u")
    path = written(
        tmp_path / "a.txt",
        "t\tTarget.PosX\tTarget.PosX\tCursor.PosX\tstick\n" + rows(columns, "\t"),
    )
    check(path)
    assert 'equal columns of one name are one: "Target.PosX"' in capsys.readouterr().out


def test_names_that_repeat_are_offered_by_number(tmp_path):
    path = written(tmp_path / "a.csv", "t,Volt,Volt\n" + BODY)
    guess = guess_columns(path)
    assert ("output", "3") in [option for problem in guess.problems for option in problem.options]
    X, y = read_runs(path, inputs={"2": "e"}, output="3")
    np.testing.assert_allclose(X["e"], LOOP["e"], atol=1e-5)
    np.testing.assert_allclose(y, LOOP["u"], atol=1e-5)


@pytest.mark.parametrize(
    ("target", "place"),
    [("reference.position", "cart::position"), ("goal.pose.angle", "arm.pose.angle")],
)
def test_other_words_of_a_name_decide(tmp_path, target, place):
    columns = of("t f_t x u")
    path = written(tmp_path / "a.csv", f"t,{target},{place},stick\n" + rows(columns))
    assert guess_columns(path).channels == {target: "f_t", place: "x"}


def test_nanoseconds_of_a_stamp_are_no_signal(tmp_path):
    ns = np.round(TIME * 1e9).astype(int)
    columns = [ns // 10**9, ns % 10**9, LOOP["e"], LOOP["u"]]
    path = written(
        tmp_path / "a.csv", "stamp.sec,stamp.nanosec,e,u\n" + rows(columns, form="{:.9g}")
    )
    assert "stamp.nanosec" not in guess_columns(path).columns
    check(path)


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_rows_are_sorted_by_their_dates(tmp_path, capsys, kind):
    dates = pd.Timestamp("2024-03-31 00:30", tz="UTC") + pd.to_timedelta(TIME, unit="s")
    frame = pd.DataFrame({"ts": dates, "e": LOOP["e"], "u": LOOP["u"]}).sample(
        frac=1, random_state=0
    )
    path = tmp_path / f"a.{kind}"
    if kind == "csv":
        frame.to_csv(path, index=False)
    else:
        pytest.importorskip("pyarrow")
        frame.set_index("ts").to_parquet(path)
    check(path)
    assert "are sorted by" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("encoding", "names"),
    [
        ("cp932", "時刻[s],目標値[℃],操作量[%]"),
        ("gb18030", "时间[s],目标值[度],操作量[%]"),
        ("cp1251", "время,ошибка,выход"),
    ],
)
def test_letters_that_are_no_latin(tmp_path, encoding, names):
    pytest.importorskip("charset_normalizer")
    guess = guess_columns(written(tmp_path / "a.csv", f"{names}\n{BODY}", encoding))
    assert guess.columns == names.split(",")


def test_latin_letters_that_lie_together(tmp_path):
    guess = guess_columns(written(tmp_path / "a.csv", f"Zeit,Größe,Stellgröße\n{BODY}", "cp1252"))
    assert guess.columns == ["Zeit", "Größe", "Stellgröße"]


def test_rows_of_another_label_are_no_summary(tmp_path):
    rows = [
        f"{label},{0.01 * i:g},{i % 7},{i % 5}" for label in ("1", "practice") for i in range(60)
    ]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["r,t,e,u", *rows, "end of file, by H."]))
    X, _ = read_runs(path, time="t", inputs="e", output="u", run="r")
    assert X.groupby("run").size().tolist() == [60, 60]


def test_a_sign_of_comments_is_no_part_of_a_name(tmp_path):
    rows = [f"{0.01 * i:g},{i % 7},{i % 5}" for i in range(60)]
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["# tempo,e,u", *rows]))
    assert len(read_runs(path, time="tempo", inputs="e", output="u")[0]) == 60


@pytest.mark.parametrize("sign", [",", ";", "\t"])
def test_an_output_that_was_hardly_measured(tmp_path, sign):
    rows = [f"{0.01 * i:g}{sign}{i % 7}{sign}{i % 5 if i % 50 == 3 else ''}" for i in range(200)]
    path = tmp_path / "r.csv"
    path.write_text("\n".join([sign.join("teu"), *rows]))
    X, y = read_runs(path, time="t", inputs="e", output="u")
    assert (len(X), int(y.notna().sum())) == (200, 4)
