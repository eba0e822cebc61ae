"""Files that are whole or not there."""

import os

import pandas as pd
import pytest

from skhoid.io.tables import write_tables
from skhoid.io.whole import is_left_over, written_whole


@pytest.mark.parametrize("sync", [False, True])
@pytest.mark.parametrize("name", ["runs.csv", "table.csv.gz", "plain", "v" * 240 + ".csv"])
def test_the_file_is_moved_when_it_is_whole(tmp_path, name, sync):
    path = tmp_path / name
    path.write_text("precious")
    with written_whole(str(path), sync=sync) as aside:
        assert (aside.parent, aside.suffixes) == (tmp_path, [".tmp", *path.suffixes])
        assert is_left_over(aside)
        assert not is_left_over(path)
        aside.write_text("new")
        assert path.read_text() == "precious"
    assert path.read_text() == "new"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_leaves_what_was_there(tmp_path, error):
    path = tmp_path / "runs.csv"
    path.write_text("precious")

    def fail():
        with written_whole(path) as aside:
            aside.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no umask")
def test_the_mode_follows_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        with written_whole(tmp_path / "runs.csv") as aside:
            aside.write_text("new")
    finally:
        os.umask(before)
    assert (tmp_path / "runs.csv").stat().st_mode & 0o777 == 0o640


def test_folders_are_refused_before_anything_is_written(tmp_path):
    table = pd.DataFrame({"gain": [1.0]})
    (tmp_path / "a.tsv").write_text("precious")
    (tmp_path / "b.tsv").mkdir()
    with pytest.raises(IsADirectoryError, match=r"b\.tsv is a folder; name a file in it"):
        write_tables({"a.tsv": table, "b.tsv": table}, tmp_path)
    assert (tmp_path / "a.tsv").read_text() == "precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.tsv", "b.tsv"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such pipes")
def test_what_is_no_ordinary_file_is_not_replaced(tmp_path):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="no ordinary file"), written_whole(pipe):
        pass
    assert pipe.is_fifo()
