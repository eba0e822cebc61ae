"""Files that are damaged, or of an encoding or structure that few have."""

import sys

import h5py
import numpy as np
import pytest

from skhoid import read_runs
from skhoid.io import write_runs

pytestmark = pytest.mark.slow

T = np.arange(3.0)
ROLES = {"inputs": "e", "output": "u", "time": "t"}
ROWS = "t,e,u\n0,1,2\n1,3,4\n"


@pytest.mark.parametrize("n_rows", [2, 40_000], ids=["small", "above 128 kB"])
@pytest.mark.parametrize(("before", "line"), [("", 1), ("t,e,u\n", 2), ("\nt,e,u\n0,1,2\n", 4)])
def test_a_quote_that_is_not_closed(tmp_path, before, line, n_rows):
    path = tmp_path / "run.csv"
    path.write_text(before + '0,"1,2\n' + "1,1,2\n" * n_rows)
    with pytest.raises(ValueError, match=rf"run.csv .*a quote .* in line {line} is never closed"):
        read_runs(path, **ROLES)


NOTED = "t,e,u,note\n" + "".join(f"{k},1,2,a\n" for k in range(400))


@pytest.fixture
def without_arrow(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.csv", None)


def swallowed(first, last, text=NOTED, opening='"a', closing='a"'):
    """A table whose quotes make one cell of what lies between two lines."""
    lines = text.splitlines()
    lines[first - 1] = lines[first - 1].removesuffix("a") + opening
    lines[last - 1] = lines[last - 1].removesuffix("a") + closing
    return "\n".join(lines) + "\n"


LONG_CELLS = {  # text, and the lines in which the quote opens and closes
    "text column": (swallowed(100, 300), 100, 300),
    "a quote is the cell": (swallowed(100, 300, opening='"', closing='"'), 100, 300),
    "next line": (swallowed(2, 3), 2, 3),
    "the last two": (swallowed(400, 401), 400, 401),
    "CRLF": (swallowed(5, 9).replace("\n", "\r\n"), 5, 9),
    "CR": (swallowed(5, 9).replace("\n", "\r"), 5, 9),
    "mixed ends": (swallowed(5, 9).replace("6,1,2,a\n", "6,1,2,a\r", 1), 5, 9),
    "blank lines": ("\n" + swallowed(5, 9) + "\n" * 9, 6, 10),
    "no end of line": (swallowed(5, 9).rstrip(), 5, 9),
    "header of two lines": (swallowed(5, 9, NOTED.replace("note", '"note\n(text)"')), 5, 9),
    "blank between": (swallowed(5, 9).replace("6,1,2,a\n", "6,1,2,a\n\n", 1), 5, 10),
    "two pairs": (swallowed(50, 60, swallowed(5, 9)), 5, 9),
    "a pair and one": (swallowed(5, 9) + '9,1,2,"a\n', 5, 9),
    "among numbers": ('t,e,u\n0,"1,2\n' + "1,1,2\n" * 99 + '0,1",2\n', 2, 102),
    "too many cells": ('t,e,u\n0,1,"2\n1,1,2\n2,1,2",3,4\n', 2, 4),
}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize(("text", "first", "last"), LONG_CELLS.values(), ids=LONG_CELLS.keys())
def test_a_quoted_cell_that_spans_lines(tmp_path, text, first, last, encoding, without_arrow):
    path = tmp_path / "run.csv"
    path.write_bytes(text.encode(encoding))
    with pytest.raises(
        ValueError, match=rf"run.csv .* line {first} is closed only in line {last},"
    ):
        read_runs(path, **ROLES)


def test_quotes_that_swallow_rows_among_many(tmp_path):
    path = tmp_path / "run.csv"
    rows = "t,e,u,note\n" + "".join(f"{k},0.123456789,2,a\n" for k in range(200_000))
    path.write_text(swallowed(500, 1500, rows))
    with pytest.raises(ValueError, match=r"line 500 is closed only in line 1500,"):
        read_runs(path, **ROLES)
    path.write_text(swallowed(500, 150_000, rows))
    with pytest.raises(ValueError, match=r"line 500 is never closed, or only far below"):
        read_runs(path, **ROLES)


def test_a_quote_in_the_header_swallows_no_rows(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text('t,e,u,"note\n0,1,2,a\n1,1,2,a"\n2,1,2,a\n')
    with pytest.raises(
        ValueError, match=r"a quote .* in line 1 is never closed, or only far below"
    ):
        read_runs(path, **ROLES)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    "text",
    [
        't,e,u,note\n0,1,2,"a"\n1,3,4,"b, ""c"""\n',
        't,e,u,note\n0,1,2,a 5" screen\n1,3,4,b\n',
        '\n\nt,"e\n[deg, filtered]",u,note\n\n0,"1",2,a\n  \n1,3,4,\n\n \n\n',
        't,e,u,"note"\n0,1,2,a\n1,3,4,a',
    ],
)
def test_quotes_that_are_closed_in_their_line(tmp_path, text, end):
    path = tmp_path / "run.csv"
    path.write_text(text.replace("\n", end), newline="")
    inputs = {"e\n[deg, filtered]": "e"} if "filtered" in text else "e"
    X, y = read_runs(path, inputs=inputs, output="u", time="t")
    assert X["e"].tolist() == [1, 3]
    assert y.tolist() == [2, 4]


@pytest.mark.parametrize("mark", ["", "\ufeff"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be"])
def test_encodings(tmp_path, encoding, mark):
    path = tmp_path / "run.csv"
    path.write_bytes((mark + ROWS.replace("e,", "e [°],")).encode(encoding))
    X, _ = read_runs(path, **ROLES)
    assert X["e"].to_list() == [1.0, 3.0]
    assert X.attrs["units"] == {"e": "°"}


def test_zero_bytes_and_broken_encodings(tmp_path):
    path = tmp_path / "run.csv"
    path.write_bytes(ROWS.encode() + bytes(100))
    with pytest.raises(ValueError, match=r"run.csv has a zero byte in line 4"):
        read_runs(path, **ROLES)
    path.write_bytes(ROWS.encode("utf-16-le") + b"\x00\xd8,\x00")
    with pytest.raises(ValueError, match=r"begins as UTF-16-LE text but does not continue as such"):
        read_runs(path, **ROLES)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mat"])
def test_names_that_are_not_utf_8(tmp_path, suffix, runs_of_any):
    path = tmp_path / f"r\udcff{suffix}"
    try:
        path.touch()
    except (OSError, UnicodeEncodeError):
        pytest.skip("this file system has no such names")
    X, y = runs_of_any
    write_runs(X, y, path, overwrite=True)
    again, _ = read_runs(path, inputs="e", output="u", time="time")
    assert again.index.get_level_values("run")[0] == r"r\xff"


@pytest.fixture
def runs_of_any(tmp_path):
    (tmp_path / "one").mkdir()
    path = tmp_path / "one" / "run.csv"
    path.write_text(ROWS)
    return read_runs(path, **ROLES)


@pytest.mark.parametrize(("labels", "refused"), [("01", True), ("11", False)])
@pytest.mark.parametrize("header", ["run", "Run"])
def test_runs_are_not_taken_for_one(tmp_path, labels, refused, header):
    path = tmp_path / "all.csv"
    path.write_text(f"{header},t,e,u\n{labels[0]},0,1,2\n{labels[1]},1,3,4\n")
    if not refused:
        assert len(read_runs(path, **ROLES)[0]) == 2
        return
    with pytest.raises(ValueError, match=f"'{header}' of .*all.csv has 2 labels.*run='{header}'"):
        read_runs(path, **ROLES)
    assert len(read_runs(path, run=header, **ROLES)[0]) == 2


@pytest.fixture
def linked(tmp_path):
    """An HDF5 file whose links lead nowhere, elsewhere, in circles, and far down."""
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["v"] = T[None]
    with h5py.File(tmp_path / "run.mat", "w") as file:
        for name in "teu":
            file[name] = T[None]
        file["dangling"] = h5py.SoftLink("/nowhere")
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/v")
        file["gone"] = h5py.ExternalLink("no.h5", "/v")
        file["circle"] = h5py.SoftLink("/circle")
        group = file.create_group("g")
        group["itself"], group["up"] = h5py.SoftLink("/g"), file["/"]
        group["x"] = T[None]
        for number in range(6):
            for other_number in range(6):
                file[f"s{number}/to{other_number}"] = h5py.SoftLink(f"/s{other_number}")
        deep = file.create_group("/".join("d" * 1200))
        deep["z"] = T[None]
    return tmp_path / "run.mat"


@pytest.mark.parametrize("name", ["e", "elsewhere", "g.x", ".".join("d" * 1200) + ".z"])
def test_what_is_whole_is_read(linked, name):
    X, _ = read_runs(linked, inputs=name, output="u", time="t")
    assert X.iloc[:, 0].to_list() == T.tolist()


def test_names_near_are_those_of_like_fields(tmp_path):
    with h5py.File(tmp_path / "run.mat", "w") as file:
        file["data/t"], file["data/u"], file["data/error"] = T[None], T[None], T[None]
        file["data/ex"] = h5py.SoftLink("/nowhere")
    names = {"output": "data.u", "time": "data.t"}
    with pytest.raises(ValueError, match=r"no variable 'data.x'.*Did you mean 'data.ex'\?"):
        read_runs(tmp_path / "run.mat", inputs="data.x", **names)
    with pytest.raises(ValueError, match=r"no variable 'data.f'") as caught:
        read_runs(tmp_path / "run.mat", inputs="data.f", **names)
    assert "Did you mean" not in str(caught.value)
    with pytest.raises(ValueError, match=r"Did you mean 'data.error'\?"):
        read_runs(tmp_path / "run.mat", inputs="data.eror", **names)


@pytest.mark.parametrize("name", ["dangling", "gone", "circle"])
def test_what_leads_nowhere_is_said(linked, name):
    with pytest.raises(ValueError, match=rf"run.mat, '{name}' is damaged, or a link to nothing"):
        read_runs(linked, inputs=name, output="u", time="t")
