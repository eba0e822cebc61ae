"""Text files as labs write them: what is read is what was recorded, or one question is asked."""

import gzip
import re

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from skhoid import read_experiment, read_runs
from skhoid.lab.cli import main
from skhoid.lab.guessing import UnclearColumnsError, guess_columns

DT, N = 0.02, 3000
TIME = np.round(np.arange(N) * DT, 6)


def loop(seed=0, gain=1.6, remnant=0.1, delay=0.24, size=1.0, still=0):
    """Target, error, output and position of a person who steers an integrator; u is delayed."""
    rng = np.random.default_rng(seed)
    lines = 2 * np.pi * np.array([0.05, 0.08, 0.13, 0.21, 0.34, 0.55, 0.9])
    phases = rng.uniform(0, 2 * np.pi, len(lines))
    target = size * (np.sin(np.outer(TIME, lines) + phases) / (1 + lines)).sum(axis=1)
    target[:still] = 0.0
    noise = lfilter([np.sqrt(DT)], [1, DT / 0.3 - 1], rng.standard_normal(N))
    n_delay, lag = round(delay / DT), DT / (0.08 + DT)
    error, output, position = np.zeros((3, N))
    for k in range(N):
        position[k] = position[k - 1] + DT * output[k - 1] if k else 0.0
        error[k] = target[k] - position[k]
        drive = gain * (error[k - n_delay] if k >= n_delay else 0.0) + remnant * noise[k]
        output[k] = output[k - 1] + lag * (drive - output[k - 1]) if k else 0.0
    return {"f_t": target, "e": error, "u": output, "x": position}


def element(seed=0):
    """What drives an element with a resonance, in steps, and what it does."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.choice([-1.0, 1.0], N // 40), 40)
    y = lfilter([0.0, 0.0016, 0.0016], [1, -1.974, 0.9772], u) + 0.02 * rng.standard_normal(N)
    return {"u": u, "y": y}


LOOP = loop()


def rows(columns, separator=",", end="", form="{:.7g}"):
    cells = [[c if isinstance(c, str) else form.format(c) for c in row] for row in zip(*columns)]  # noqa: B905
    return "".join(separator.join(row) + end + "\n" for row in cells)


def of(names, record=LOOP, time=TIME):
    return [time if name == "t" else record[name] for name in names.split()]


def check(path, record=LOOP, n_runs=1, times=TIME, **given):
    """Error and output are those that were recorded, and so is the clock."""
    X, y = read_runs(path, **given)
    assert len(y) == N * n_runs
    assert X.index.get_level_values("run").nunique() == n_runs
    read = X.index.get_level_values("time").to_numpy()
    np.testing.assert_allclose(np.diff(read[:N]), np.diff(times[:N]), atol=0.1 * DT)
    error, output = (record["e"], record["u"]) if "e" in record else (record["u"], record["y"])
    place = "e" if "e" in X else X.columns[0]
    np.testing.assert_allclose(X[place], np.tile(error, n_runs), atol=1e-5)
    np.testing.assert_allclose(y, np.tile(output, n_runs), atol=1e-5)
    return X, y


HEADERS = {
    "spaces": ("t e u\n", " ", ""),
    "columns of equal width": ("        Time      Error      Stick\n", "   ", ""),
    "comment": ("# recorded by H., 2021\n# t e u\n", " ", ""),
    "percent": ("% t e u\n", "\t", ""),
    "semicolon comment": ("; flight 3, pilot B\n; time error stick\n", "  ", ""),
    "units stand apart": ("Result\n======\n\n  Time [s]  Error [deg]  Stick [deg]\n", "  ", ""),
    "header with commas": ("time, error, stick\n", " ", ""),
    "separator at the end of rows": ("Zeit;Regelfehler;Knüppel\n", ";", ";"),
    "separator at every end": ("time,error,stick,\n", ",", ","),
    "tabs at the end": ("Lab, room 3\nCentre (X,Y) is:\t5\t6\t\n\nt\terror\tstick\n", "\t", "\t"),
    "numbers above": ("Subject,7\nRange,-10,10\n\ntime,error,stick\n", ",", ""),
    "as many cells above": ("a;b\nDate;2024-05-01\nTime (s);e;u\n", ";", ""),
    "row of units": ("time,error,stick\ns,counts,-\n", ",", ""),
    "a rule": ("time error stick\n---- ----- -----\n", " ", ""),
    "quoted": ('"Time, s","Error, deg","Stick, deg"\n', ",", ""),
    "two lines": ('"Time\n[s]","Tracking\nerror","Stick"\n', ",", ""),
    "sep": ("sep=;\ntime;error;stick\n", ";", ""),
}


@pytest.mark.parametrize(("head", "separator", "end"), HEADERS.values(), ids=HEADERS)
def test_headers(tmp_path, head, separator, end):
    path = tmp_path / "run.csv.gz"
    path.write_bytes(gzip.compress((head + rows(of("t e u"), separator, end)).encode()))
    check(path)


@pytest.mark.parametrize(
    ("ending", "encoding", "separator"),
    [
        (".res", "utf-16", " "),
        (".log", "utf-8-sig", ";"),
        (".asc", "latin-1", "\t"),
        (".txt", "utf-16", ";"),
        (".tsv", "latin-1", " "),
    ],
)
def test_decimal_commas(tmp_path, ending, encoding, separator):
    text = "Zeit Fehler Stellgröße\n".replace(" ", separator) + rows(of("t e u"), separator)
    path = tmp_path / f"run{ending}"
    path.write_bytes(text.replace(".", ",").encode(encoding))
    check(path)


def test_comments_among_rows_and_names_of_rows(tmp_path):
    lines = rows(of("t e u")).splitlines()
    lines.insert(1500, "# pause, key pressed")
    (tmp_path / "a.csv").write_text("time,error,stick\n" + "\n".join(lines))
    check(tmp_path / "a.csv")
    quoted = [f'"{k + 1}"' for k in range(N)]
    (tmp_path / "r.txt").write_text('"time" "err" "stick"\n' + rows([quoted, *of("t e u")], " "))
    check(tmp_path / "r.txt")


@pytest.mark.parametrize(
    ("head", "separator"),
    [("", ","), ("", "  "), ("# Octave 6\n# type: matrix\n", "\t"), ("Data of trial 4\n\n", ";")],
)
def test_no_header(tmp_path, head, separator, capsys):
    """No sample is lost; columns are named by numbers, and values say which is which."""
    path = tmp_path / "run1.txt"
    path.write_text(head + rows(of("t f_t x u"), separator))
    check(path)
    assert "no header, so that columns are numbered from 1 to 4" in capsys.readouterr().out
    X, y = read_runs(path, time="1", inputs=["2"], output="4")
    np.testing.assert_allclose(X["2"], LOOP["f_t"], atol=1e-5)
    np.testing.assert_allclose(y, LOOP["u"], atol=1e-5)


def test_numbers_on_the_command_line(tmp_path, capsys):
    path = tmp_path / "run1.txt"
    path.write_text(rows(of("t e u x"), " "))
    named = ["--time", "1", "--input", "2", "--output", "3"]
    assert main(["identify", str(path), *named, "--no-pictures", "--nk", "13", "--na", "1"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert 'Columns: time "1", input "2", output u "3"; not used: "4"; no header' in said
    assert f"{N} rows" in said


def test_a_header_of_numbers(tmp_path, capsys):
    pd.DataFrame(np.column_stack(of("t f_t x u"))).to_csv(tmp_path / "a.csv", index=False)
    check(tmp_path / "a.csv")
    assert "its first row, 0, 1, 2, 3, is taken for the header" in capsys.readouterr().out


def test_a_longer_row_is_named(tmp_path):
    lines = rows(of("t e u"), " ").splitlines()
    lines[2000] += " 7"
    (tmp_path / "a.dat").write_text("time error stick\n" + "\n".join(lines))
    with pytest.raises(ValueError, match=r"separated by white space.*line 2002 has 4 cells"):
        read_runs(tmp_path / "a.dat")


START = pd.Timestamp("2023-01-31 11:59:40") + pd.to_timedelta(TIME, unit="s")
LATE = pd.Timestamp("2023-01-31 23:59:40") + pd.to_timedelta(TIME, unit="s")


@pytest.mark.parametrize(
    "stamps",
    [
        START.strftime("%I:%M:%S.%f %p"),
        START.strftime("%m/%d/%Y %I:%M:%S.%f %p"),
        LATE.strftime("%H:%M:%S.%f"),
        LATE.strftime("%d/%m/%Y %H:%M:%S.%f"),
        LATE.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        LATE.strftime("%d.%m.%Y %H:%M:%S,%f"),
        LATE.strftime("%a %d %b %Y %H:%M:%S.%f"),
        LATE.strftime("%H:%M:%S:%f"),
        (START + pd.Timedelta("1h")).strftime("%I:%M:%S.%f"),
        pd.Index([f"{int(t // 60):02}:{t % 60:06.3f}" for t in TIME]),
        pd.Index(pd.to_timedelta(TIME, unit="s").astype(str)),
    ],
)
def test_dates_and_times_of_day(tmp_path, stamps, capsys):
    columns = [list(stamps), *of("e u")]
    (tmp_path / "a.csv").write_text("Time;error;stick\n" + rows(columns, ";"))
    check(tmp_path / "a.csv")
    assert '"Time" is read as seconds from its first row' in capsys.readouterr().out
    X, _ = read_runs(tmp_path / "a.csv", inputs="error", output="stick", time="Time")
    np.testing.assert_allclose(X.index.get_level_values("time"), TIME, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "per_second", "jitter"),
    [("tempo_ms", 1000, 1), ("stamp", 1000, 1), ("tidsstempel", 1e6, 1), ("czas", 1000, 0)],
)
def test_a_clock_of_whole_ticks(tmp_path, name, per_second, jitter, capsys):
    """The only column that rises in every row is the clock; whole ms that jitter are even."""
    rng = np.random.default_rng(1)
    fast = np.arange(N) * 0.005
    ticks = (fast * per_second).round() + rng.integers(-jitter, jitter + 1, N) + 51237
    text = f"error,{name},stick\n" + rows([LOOP["e"], ticks, LOOP["u"]], form="{:.9g}")
    (tmp_path / "a.csv").write_text(text)
    X, _ = read_runs(tmp_path / "a.csv")
    np.testing.assert_allclose(np.diff(X.index.get_level_values("time")), 0.005, rtol=0.1)
    even = "the clock is in whole ms and even but for 1.5 ms" in capsys.readouterr().out
    assert even == (jitter > 0 and per_second == 1000)


@pytest.mark.parametrize(("step", "lost"), [(2, 700), (10, 1500)])
def test_a_lost_row_is_no_rounding(tmp_path, step, lost, capsys):
    ticks = np.delete(np.arange(N + 1) * step, lost)
    text = "error,time_ms,stick\n" + rows([LOOP["e"], ticks, LOOP["u"]])
    (tmp_path / "a.csv").write_text(text)
    X, _ = read_runs(tmp_path / "a.csv")
    assert np.diff(X.index.get_level_values("time")).max() == pytest.approx(2e-3 * step)
    assert "even" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "heads",
    [
        ("/ctl/.header.stamp.secs", "/ctl/.header.stamp.nsecs"),
        ("header.stamp.sec", "header.stamp.nanosec"),
    ],
)
def test_ros_stamps(tmp_path, heads):
    stamps = 1_700_000_000_123_456_789 + np.round(TIME * 1e9).astype(np.int64)
    whole, rest = ([str(k) for k in part] for part in np.divmod(stamps, 10**9))
    head = ",".join([*heads, "field.error", "field.stick"])
    (tmp_path / "a.csv").write_text(head + "\n" + rows([whole, rest, *of("e u")]))
    check(tmp_path / "a.csv")
    nanoseconds = [str(k) for k in stamps]
    text = "%time,field.error,/joy/axes[0]\n" + rows([nanoseconds, *of("e u")])
    (tmp_path / "b.csv").write_text(text)
    check(tmp_path / "b.csv")


@pytest.mark.parametrize("labels", [(4, 7, 9), ("easy", "hard", "rest"), (0.5, 1.5, 1.0)])
def test_runs_that_begin_at_other_times(tmp_path, labels, capsys):
    names = [str(label) for label in labels for _ in range(N)]
    time = np.concatenate([TIME + start for start in (73.0, 12.0, 0.5)])
    columns = [names, time, np.tile(LOOP["e"], 3), np.tile(LOOP["u"], 3)]
    (tmp_path / "a.csv").write_text("passage_x,time,error,stick\n" + rows(columns))
    check(tmp_path / "a.csv", n_runs=3)
    assert 'run "passage_x"' in capsys.readouterr().out


def test_what_moves_late(tmp_path):
    """Whole columns count, not their first rows."""
    record = loop(3, still=1500)
    text = "Tempo_s,Referencia,Saida_y,Controle_u\n" + rows(of("t f_t x u", record))
    (tmp_path / "a.csv").write_text(text)
    check(tmp_path / "a.csv", record)


@pytest.mark.parametrize(
    ("head", "names"),
    [
        ("aika tavoite kulma ohjaus", "t f_t x u"),
        ("czas zadana polozenie uchyb drazek", "t f_t x e u"),
        ("时间 目标 位置 误差 操纵", "t f_t x e u"),
        ("Время Ручка Цель Положение", "t u f_t x"),
        ("t delta_e theta theta_cmd", "t u x f_t"),
        ("Zeit Abweichung Steuerausschlag", "t e u"),
        ("time u y yref", "t u x f_t"),
        ("time SP_pos PV_pos OP_pos", "t f_t x u"),
        ("t Sollwinkel Istwert Ausgang", "t f_t x u"),
    ],
)
def test_roles_by_values_and_what_is_left_over(tmp_path, head, names):
    record = loop(12, remnant=0.25)
    text = head.replace(" ", "\t") + "\n" + rows(of(names, record), "\t")
    (tmp_path / "a.tsv").write_text(text, encoding="utf-8")
    check(tmp_path / "a.tsv", record)


@pytest.mark.parametrize("head", ["t,u,y", "tijd,spanning,toerental", "time,voltage,position", ""])
def test_a_driven_element(tmp_path, head):
    """What drives it is the input, and not what a person did."""
    record = element()
    path = tmp_path / "a.csv"
    path.write_text((head and f"{head}\n") + rows([TIME, record["u"], record["y"]]))
    check(path, record)


def test_an_element_is_called_one(tmp_path):
    (tmp_path / "a.csv").write_text("time,u,y\n" + rows([TIME, *element().values()]))
    assert str(guess_columns(tmp_path / "a.csv")).startswith(
        'Columns: time "time", input "u", output "y"; there is no error and no target: "u" drives'
    )


def question(path):
    """The options of the one question that is asked."""
    guess = guess_columns(path)
    assert len(guess.problems) == 1, guess.problems
    return guess.problems[0].options


@pytest.mark.parametrize(
    ("head", "names", "options", "given"),
    [
        ("a,b", "u e", ["a", "b"], {"output": "a"}),
        ("stick,roll", "u x", ["stick", "roll"], {"output": "stick"}),
        ("error,pulse,turn", "e noise u", ["turn", "pulse"], {"output": "turn"}),
        ("q,p,w", "noise u e", ["p", "w"], {"output": "p"}),
        ("error,angle", "e x", ["angle"], {"output": "angle"}),
    ],
)
def test_one_question_where_values_do_not_decide(tmp_path, head, names, options, given):
    """The likeliest is offered first, and its answer settles the rest."""
    record = loop(4) | {"noise": np.random.default_rng(2).standard_normal(N).cumsum()}
    if "noise u e" in names:
        record["noise"] = np.full(N, 2.0)
    (tmp_path / "a.csv").write_text(f"time,{head}\n" + rows(of(f"t {names}", record)))
    asked = question(tmp_path / "a.csv")
    assert [value for _, value in asked][: len(options)] == options
    assert {name for name, _ in asked} == {"output"}
    X, y = read_runs(tmp_path / "a.csv", **given)
    wanted = names.split()[head.split(",").index(given["output"])]
    np.testing.assert_allclose(y, record[wanted], atol=1e-5)
    assert "e" in X


def test_what_a_user_needs_of_many_columns_is_named(tmp_path):
    rng = np.random.default_rng(5)
    dead = {f"chan{k}": np.full(N, float(k)) for k in range(52)}
    moving = dict(zip(["p", "q", "s"], rng.standard_normal((3, N)).cumsum(axis=1), strict=True))
    pd.DataFrame({"time": TIME} | dead | moving).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(UnclearColumnsError, match=r"It has: 'p', 'q', 's', .* and 26 more"):
        read_runs(tmp_path / "a.csv")


def test_values_that_decide_nothing_are_asked_about(tmp_path):
    """Copies, filtered copies and walks are no target and position."""
    rng = np.random.default_rng(6)
    walk = rng.standard_normal(N).cumsum()
    slow = lfilter([0.05], [1, -0.95], LOOP["x"])
    for columns in ([LOOP["x"], slow, LOOP["u"]], [walk, walk + 1e-3, LOOP["u"]]):
        (tmp_path / "a.csv").write_text("time,p,q,s\n" + rows([TIME, *columns]))
        with pytest.raises(UnclearColumnsError):
            read_runs(tmp_path / "a.csv")


@pytest.mark.parametrize("named", ["Sollspur,Istspur", "reference,p", "p,q"])
@pytest.mark.parametrize("seed", [1, 2])
def test_what_answers_the_error_is_the_output_whatever_else_was_recorded(tmp_path, named, seed):
    other_axis = np.interp(0.85 * TIME, TIME, loop(seed=seed + 10)["u"])  # at other frequencies
    beside = [other_axis, 70 + np.cumsum(np.random.default_rng(seed).normal(size=N)) / 50]
    own = [LOOP["f_t"], LOOP["x"], LOOP["u"]]
    (tmp_path / "a.csv").write_text(f"time,{named},a,b,c\n" + rows([TIME, *own, *beside]))
    X, y = read_runs(tmp_path / "a.csv")
    np.testing.assert_allclose(X["f_t"], LOOP["f_t"], atol=1e-5)
    np.testing.assert_allclose(y, LOOP["u"], atol=1e-5)


def test_two_that_answer_the_error_are_asked_about(tmp_path):
    own = [LOOP["f_t"], LOOP["x"], LOOP["u"], lfilter([0.2], [1, -0.8], LOOP["u"])]
    (tmp_path / "a.csv").write_text("time,p,q,a,b\n" + rows([TIME, *own]))
    with pytest.raises(UnclearColumnsError):
        read_runs(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--run-in", "70"], "lasts 60 s.* a run-in of 70 s leaves nothing"),
        (["--longest-delay", "40"], "more than half of the shortest run.*--longest-delay"),
    ],
)
def test_what_a_short_record_cannot_hold_is_said(tmp_path, options, said, capsys):
    (tmp_path / "a.csv").write_text("time,e,u\n" + rows(of("t e u")))
    assert main(["identify", str(tmp_path / "a.csv"), "--no-pictures", *options]) == 2
    assert re.search(said, " ".join(capsys.readouterr().err.split()))


@pytest.mark.parametrize("run_in", ["20", "40"])
def test_half_a_record_may_be_run_in(tmp_path, run_in, capsys):
    (tmp_path / "a.csv").write_text("time,e,u\n" + rows(of("t e u", loop(remnant=0.02))))
    options = ["--no-pictures", "--na", "2", "--run-in", run_in]
    assert main(["identify", str(tmp_path / "a.csv"), *options]) == 0
    assert float(re.search(r"held-out VAF ([\d.]+) %", capsys.readouterr().out)[1]) > 95


@pytest.mark.parametrize("step", [1e-5, 1e-4])
def test_a_fast_record_needs_no_option(tmp_path, step, capsys):
    record = element()
    (tmp_path / "a.csv").write_text(
        "time,u,y\n" + rows([np.arange(N) * step, *record.values()], form="{:.9g}")
    )
    assert main(["identify", str(tmp_path / "a.csv"), "--no-pictures", "--na", "2"]) == 0
    assert f"{N} rows at {1 / step:g} Hz" in " ".join(capsys.readouterr().out.split())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("has_header", [True, False])
def test_an_experiment_of_such_files(tmp_path, has_header, capsys):
    clock = list(START.strftime("%I:%M:%S.%f %p"))
    columns = [clock, *of("e u")] if has_header else of("t f_t x u")
    text = ("Time;e;u\n" if has_header else "") + rows(columns, ";")
    for person in ("S1", "S2"):
        for run in "12":
            (tmp_path / f"{person}_gain_{run}.dat").write_text(text)
    X, y = read_experiment(tmp_path)
    assert "looks like" not in capsys.readouterr().out
    assert len(y) == 4 * N
    np.testing.assert_allclose(X["e"], np.tile(LOOP["e"], 4), atol=1e-5)
    np.testing.assert_allclose(y, np.tile(LOOP["u"], 4), atol=1e-5)
