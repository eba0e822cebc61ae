"""Files that are whole or not there."""

import errno
import os

import pandas as pd
import pytest

from skhoid.io.writing import is_left_over, write_tables, written_whole

LINKS = pytest.mark.skipif(os.name == "nt", reason="Windows lets not everyone make links")


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
    with pytest.raises(OSError, match="not a regular file"), written_whole(pipe):
        pass
    assert pipe.is_fifo()


@LINKS
@pytest.mark.parametrize("there", [True, False])
def test_a_link_is_followed(tmp_path, there):
    (tmp_path / "data").mkdir()
    target, link = tmp_path / "data" / "real.csv", tmp_path / "link.csv"
    link.symlink_to("data/real.csv")
    if there:
        target.write_text("old")
    with written_whole(link) as aside:
        assert aside.parent == target.parent
        aside.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"
    assert not target.is_symlink()


@LINKS
def test_a_link_to_itself_is_refused(tmp_path):
    link = tmp_path / "link.csv"
    link.symlink_to("link.csv")
    with pytest.raises(OSError, match=r"link\.csv"), written_whole(link):
        pass
    assert link.is_symlink()


@pytest.mark.parametrize("names_aside", [True, False])
def test_a_full_disk_names_the_file(tmp_path, names_aside):
    path = tmp_path / "runs.csv"
    path.write_text("precious")

    def fail():
        with written_whole(path) as aside:
            aside.write_text("half")
            raise OSError(errno.ENOSPC, "full", *([str(aside)] if names_aside else []))

    with pytest.raises(OSError, match="No space left") as caught:
        fail()
    assert caught.value.filename == str(path)
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_of_several_tables_the_one_that_failed_is_named(tmp_path, monkeypatch):
    def full(table, path, **_):
        if "b" in table:
            raise OSError(errno.ENOSPC, "full")

    monkeypatch.setattr(pd.DataFrame, "to_csv", full)
    tables = {f"{name}.tsv": pd.DataFrame({name: [1.0]}) for name in "abc"}
    with pytest.raises(OSError, match="No space left") as caught:
        write_tables(tables, tmp_path)
    assert caught.value.filename == str(tmp_path / "b.tsv")
    assert list(tmp_path.iterdir()) == []
