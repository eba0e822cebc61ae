"""Habits of labs that a guess must bear with, each in a small file."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

from skhoid import read_runs
from skhoid.lab.guessing import UnclearColumnsError, guess_columns
from skhoid.lab.guessing.words import find_label

N = 800
RNG = np.random.default_rng(5)


def smooth(*shape):
    """Signals without rhythm, as those of a loop."""
    noise = RNG.standard_normal((N, *shape))
    return np.apply_along_axis(np.convolve, 0, noise, np.hanning(9), "same").round(4)


E, X = smooth(), smooth()
FRAME = pd.DataFrame(
    {"time": np.arange(N) / 50, "run": 1 + np.arange(N) // 400, "error": E, "plant": X}
).assign(target=(E + X).round(4), stick=np.roll(E, 10))


def write(folder, frame=FRAME, head="", text=None, **form):
    path = folder / "lab.csv"
    body = frame.to_csv(index=False, **form) if text is None else text
    path.write_text(head + body, encoding="utf-8")
    return path


def complaint(path):
    with pytest.raises(UnclearColumnsError) as caught:
        read_runs(path)
    return str(caught.value)


@pytest.mark.parametrize(
    ("head", "n_lines"),
    [
        ("sep=;\n", 1),
        ("Logger v3\nDate;2024-05-01\nRate, Hz;50\n\n", 4),
        ("# subject: 3\n# gains: 1.5, 2, 7\n", 2),
        ("Trial 4;;;;;\n;;;;;\n", 2),
    ],
)
@pytest.mark.parametrize("decimal", [".", ","])
def test_lines_above_the_header_are_skipped(tmp_path, head, n_lines, decimal):
    path = write(tmp_path, head=head, sep=";", decimal=decimal)
    assert f"{n_lines} line{'s' if n_lines > 1 else ''} above the header skipped" in str(
        guess_columns(path)
    )
    X, y = read_runs(path)
    assert X["e"].to_list() == E.tolist()
    assert y.to_list() == FRAME["stick"].to_list()


def test_a_row_of_units_below_the_header(tmp_path):
    units = "s,-,deg,deg,deg,%\n"
    lines = FRAME.to_csv(index=False).split("\n", 1)
    X, y = read_runs(write(tmp_path, text=f"{lines[0]}\n{units}{lines[1]}"))
    assert len(X) == N
    assert X.attrs["units"] == {"e": "deg", "x": "deg", "f_t": "deg"}
    assert y.attrs["units"] == {"u": "%"}


def test_a_unit_of_time_below_the_header(tmp_path):
    frame = FRAME.assign(time=20 * np.arange(N))
    lines = frame.to_csv(index=False).split("\n", 1)
    X, _ = read_runs(write(tmp_path, text=f"{lines[0]}\n[ms],,[mm],[mm],[mm],[V]\n{lines[1]}"))
    assert X.index.get_level_values("time")[1] == 0.02


def two_axes(**more):
    return FRAME.rename(
        columns={"error": "errorX", "plant": "cursorX", "target": "targetX", "stick": "joyX"}
    ).assign(cursorY=smooth(), targetY=smooth(), joyY=smooth(), **more)


def test_the_axis_is_that_of_the_error(tmp_path):
    guess = guess_columns(write(tmp_path, two_axes(gazeX=X, buttonA=False)))
    assert not guess.problems
    assert guess.channels == {"errorX": "e", "targetX": "f_t", "cursorX": "x"}
    assert guess.output == ("joyX", "u")


def test_two_axes_with_an_error_each_are_a_question(tmp_path):
    frame = two_axes()
    frame["errorY"] = frame["targetY"] - frame["cursorY"]
    assert re.search('may be the error e: "errorX", "errorY"', complaint(write(tmp_path, frame)))


def test_dotted_names_whose_last_part_is_the_axis(tmp_path):
    names = {"time": "header.stamp", "error": "tracking_error.x", "plant": "plant.position.x"}
    names |= {"target": "reference.position.x", "stick": "joy.axes.0", "run": "experiment.run"}
    frame = FRAME.rename(columns=names)
    frame["header.stamp"] = 1_700_000_000_000_000_000 + 20_000_000 * np.arange(N)
    frame.insert(0, "header.seq", 500 + np.arange(N))
    frame["joy.axes.1"] = 0.0
    X, y = read_runs(write(tmp_path, frame))
    assert np.diff(X.index.get_level_values("time")[:3]) == pytest.approx(0.02, abs=1e-6)
    assert X["e"].to_list() == E.tolist()
    assert y.to_list() == FRAME["stick"].to_list()


def test_the_wheel_and_not_the_pedal_goes_with_the_error(tmp_path):
    frame = FRAME.rename(columns={"stick": "wheel"}).assign(pedal=smooth())
    guess = guess_columns(write(tmp_path, frame))
    assert guess.output == ("wheel", "u")
    assert '"wheel" is the output and not "pedal"' in str(guess)
    mixed = frame.assign(pedal=frame["wheel"] + smooth())  # goes with the error, too
    assert 'may be the output u: "wheel", "pedal"' in complaint(write(tmp_path, mixed))


def test_each_element_of_a_struct_array_is_a_run(tmp_path):
    path = tmp_path / "lab.mat"
    kinds = [(name, object) for name in ("t", "e", "u", "subject", "Ts")]
    runs = np.zeros((1, 2), dtype=kinds)
    for k, length in enumerate((300, 400)):
        part = np.arange(length)[:, None]
        runs[0, k] = part / 50, E[part], X[part], f"S{k}", 0.02
    savemat(path, {"rec": runs, "note": "x"})
    read, y = read_runs(path)
    assert read.groupby("run", sort=False).size().to_dict() == {1: 300, 2: 400}
    assert y.to_list() == [*X[:300], *X[:400]]
    assert read.index.unique("subject").to_list() == ["S0", "S1"]
    read, _ = read_runs(path, inputs="rec.e", output="rec.u", time="rec.t")
    assert read.index.unique("run").to_list() == [1, 2]
    runs[0, 1]["u"] = runs[0, 1]["u"][:-7]
    runs[0, 0]["e"] = np.full((300, 1), np.nan)
    savemat(path, {"rec": runs})
    said = complaint(path)
    assert '"rec(2).u" has 393 samples, the other fields of rec(2) 400' in said
    assert '"rec.e" has no numbers in run 1' in said


def test_an_error_in_another_unit_is_said(tmp_path):
    guess = guess_columns(write(tmp_path, FRAME.assign(error=-100 * E)))
    assert guess.error_from == "-e"
    assert "e is -100 times f_t - x" in str(guess)


def broken(**columns):
    return FRAME.assign(**columns)


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (broken(error=np.where(np.arange(N) % 90 == 3, -9999, E)), "is -9999 in 9 rows.*row 4"),
        (
            broken(time=(64_000 + 20 * np.arange(N)) % 65536),
            "runs backwards in run 1 at row 78",
        ),
        (
            broken(stick=np.where(FRAME["run"] == 2, 0.5, X), error=0.0),
            "(?s)error e, .* is 0 in every row.*Delete the column.*never changes in run 2",
        ),
        (broken(time=1.7e9 + 128 * (np.arange(N) // 300)), "stands still in run 1"),
        (
            FRAME.sort_values("time", key=lambda t: t % 8),
            "rows of the runs of column .run. do not lie together",
        ),
        (broken(time=np.cumsum(np.where(np.arange(N) % 20, 20, 90)), stick="-"), "has 38 gaps"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, frame, said):
    assert re.search(said, complaint(write(tmp_path, frame)))


def test_decimals_that_are_mixed_are_said_once(tmp_path):
    frame = FRAME.astype(str)
    frame = frame.apply(lambda column: column.str.replace(".", ","))
    frame.loc[500:, "stick"] = frame.loc[500:, "stick"].str.replace(",", ".")
    said = complaint(write(tmp_path, frame, sep=";"))
    assert said.count("decimal commas, and those of column 'stick' have points") == 1


def test_garbled_headers_are_mended(tmp_path):
    frame = FRAME.rename(columns={"stick": "Stellgröße".encode().decode("latin-1")})
    assert guess_columns(write(tmp_path, frame)).output == ("Stellgröße", "u")


def test_a_header_that_stands_twice(tmp_path):
    lines = FRAME.assign(more=3.0).to_csv(index=False).replace("more", "stick", 1)
    said = complaint(write(tmp_path, text=lines))
    assert '2 columns are called "stick", which would be the output u: columns 6 and 7' in said
    assert "column 7 never changes" in said


def test_text_in_parquet(tmp_path):
    path = tmp_path / "lab.parquet"
    stick = FRAME["stick"].astype(str).where(FRAME.index != 4, "ERR")
    FRAME.assign(stick=stick).to_parquet(path)
    said = complaint(path)
    assert "row 5 (the first sample is row 1) is 'ERR'" in said
    assert "list index" not in said


@pytest.mark.parametrize(
    ("header", "level"),
    [
        ("feedback_condition", "condition"),
        ("LoadCondition", "condition"),
        ("flightNo", "run"),
        ("TestNo", "run"),
        ("reaction_time_ms", ""),
    ],
)
def test_labels_of_two_words(header, level):
    assert find_label(header) == level


def test_the_rate_of_a_signal_is_not_offered_as_the_output(tmp_path):
    nameless = FRAME.rename(columns={"stick": "signal"}).assign(signal_rate=smooth(), signal=X**2)
    told = complaint(write(tmp_path, nameless))
    assert "output='signal'" in told
    assert "output='signal_rate'" not in told
