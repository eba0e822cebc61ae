"""The folder of a session, and names of files that come from a browser."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from skhoid.lab.workbench.session import (
    BrokenSession,
    SessionFolder,
    SessionInUse,
    safe_name,
)


@pytest.fixture
def folder(tmp_path):
    folder = SessionFolder(tmp_path / "session")
    folder.take()
    yield folder
    folder.give_back()


def test_it_keeps_what_it_is_given(folder):
    assert folder.load() is None
    content = {"files": [], "exploration": {"value": 0.1 + 0.2, "name": "µ \N{BLACK STAR}"}}
    folder.save(content)
    assert folder.load()["exploration"] == content["exploration"]
    assert sorted(os.listdir(folder.path)) == ["lock", "session.json"]


@pytest.mark.parametrize("content", [b"{", b"[]", b'{"version": 99}', b"\xff\xfe\x00"])
def test_a_broken_one_is_said_and_left_as_it_is(folder, content):
    path = folder.path / "session.json"
    path.write_bytes(content)
    with pytest.raises(BrokenSession, match=r"session\.json cannot be read: .*left as it is"):
        folder.load()
    assert path.read_bytes() == content


def test_two_servers_cannot_have_it(folder):
    other = SessionFolder(folder.path)
    with pytest.raises(SessionInUse, match=f"process {os.getpid()}.*--session"):
        other.take()
    folder.give_back()
    other.take()
    other.give_back()


def test_a_lock_whose_server_is_gone_is_taken_over(tmp_path):
    holds = f"import fcntl, os; f = open({str(tmp_path / 'lock')!r}, 'w'); "
    holds += "fcntl.flock(f, fcntl.LOCK_EX); os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", holds], check=False)
    folder = SessionFolder(tmp_path)
    folder.take()
    assert (tmp_path / "lock").read_text() == f"{os.getpid()}\n"
    folder.give_back()


def test_where_no_folder_can_be_is_said(tmp_path):
    (tmp_path / "session").write_text("")
    with pytest.raises(ValueError, match="is a file; name a folder by --session"):
        SessionFolder(tmp_path / "session").take()
    if Path("/proc").is_dir():  # which cannot be written into, even by root
        with pytest.raises(OSError, match="another folder by --session"):
            SessionFolder("/proc/skhoid").take()


def test_a_full_disk_leaves_the_old_one(folder, monkeypatch):
    folder.save({"step": 1})

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_text", full)
        with pytest.raises(OSError, match="No space left") as error:
            folder.save({"step": 2})
    assert error.value.filename == str(folder.path / "session.json")
    assert folder.load()["step"] == 1
    assert sorted(os.listdir(folder.path)) == ["lock", "session.json"]


def test_only_reports_of_the_session_are_given_out(folder, tmp_path):
    folder.save({})
    (folder.path / "report.html").write_text("page")
    (folder.path / "report-2.html").symlink_to(tmp_path / "secret")
    assert folder.report("report.html") == folder.path / "report.html"
    others = ["../session.json", "session.json", "lock", "..", "", "report", "report.html/"]
    assert [folder.report(name) for name in (*others, "report-2.html", "report-9.html")] == [
        None
    ] * 9


@pytest.mark.parametrize(
    ("name", "safe"),
    [
        ("run1.csv", "run1.csv"),
        ("My run (2).CSV", "My_run_2.csv"),
        ("../../etc/passwd.csv", "passwd.csv"),
        ("C:\\..\\data\\a.mat", "a.mat"),
        ("....csv", "file.csv"),
        ("a\x00b\n.csv", "a_b.csv"),
        ("données.csv", "données.csv"),
        ("a" * 1000 + ".csv", "a" * 80 + ".csv"),
    ],
)
def test_names_are_made_safe(name, safe):
    assert safe_name(name) == safe


@pytest.mark.parametrize("name", ["", "a", "a.exe", "a.csv/", "a.csv\x00.sh", "session.json", ".."])
def test_other_files_are_refused_with_what_can_be_read(name):
    with pytest.raises(ValueError, match=r"cannot be read: .*\.csv"):
        safe_name(name)
